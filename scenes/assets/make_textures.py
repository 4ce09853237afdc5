"""Makes wheel.png, sky.png and fan.png, the textures that mbinterval's own scenes use.

Run it in this folder: `python make_textures.py`. The files are committed, so nobody needs to.
"""

import numpy as np
from PIL import Image


def wheel(size: int = 256) -> Image.Image:
    """A tyre, a rim, and twelve spokes, one of them red so that turns can be counted."""
    y, x = np.mgrid[:size, :size]
    x, y = (2 * x + 1) / size - 1, 1 - (2 * y + 1) / size
    radius, angle = np.hypot(x, y), np.degrees(np.arctan2(y, x)) % 360
    spoke = (angle + 15) % 30 > 15
    pixels = np.full((size, size, 3), (38, 38, 42), np.uint8)
    pixels[radius < 0.78] = (196, 160, 96)
    pixels[(radius < 0.70) & spoke] = (92, 60, 34)
    pixels[(radius < 0.70) & spoke & (angle < 15)] = (190, 30, 24)
    pixels[radius < 0.16] = (210, 210, 214)
    return Image.fromarray(pixels)


def sky(width: int = 320, height: int = 240) -> Image.Image:
    """A gradient from blue to a bright horizon, and ground below."""
    y = (np.arange(height) + 0.5) / height
    above = np.clip(y / 0.6, 0, 1)[:, None]
    rows = (1 - above) * (64, 110, 190) + above * (226, 232, 236)
    rows[y > 0.6] = (120, 112, 92)
    return Image.fromarray(np.broadcast_to(rows[:, None], (height, width, 3)).round().astype("u1"))


def fan(size: int = 256) -> Image.Image:
    """Three blades with red tips about a hub; the rest is not there."""
    y, x = np.mgrid[:size, :size]
    x, y = (2 * x + 1) / size - 1, 1 - (2 * y + 1) / size
    radius, angle = np.hypot(x, y), np.degrees(np.arctan2(y, x)) % 120
    blade = (radius < 0.95) & (angle < 38)
    pixels = np.zeros((size, size, 4), np.uint8)
    pixels[..., :3] = (70, 74, 82)
    pixels[radius > 0.75, :3] = (180, 40, 30)
    pixels[radius < 0.16, :3] = (30, 30, 34)
    pixels[blade | (radius < 0.16), 3] = 255
    return Image.fromarray(pixels)


if __name__ == "__main__":
    wheel().quantize(16, dither=Image.Dither.NONE).save("wheel.png", optimize=True)
    sky().save("sky.png", optimize=True)
    fan().save("fan.png", optimize=True)
