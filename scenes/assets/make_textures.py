"""Makes wheel.png, sky.png, fan.png and studio.hdr, which mbinterval's own scenes use.

Run it in this folder: `python make_textures.py`. The files are committed, so nobody needs to.
"""

from pathlib import Path

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


def studio(width: int = 512) -> bytes:
    """All directions around a hall: a dark room, a bright floor's edge, three lamps and a window.

    A Radiance picture in RGBE, by longitude and latitude, without runs.
    """
    height = width // 2
    up = np.sin((0.5 - (np.arange(height) + 0.5) / height) * np.pi)[:, None]
    turn = (((np.arange(width) + 0.5) / width - 0.5) * 360.0)[None]
    light = np.where(up > 0, 0.10 + 0.25 * np.exp(-4.0 * np.abs(up)), 0.16 + 0.1 * up)
    light = light[..., None] * (0.75, 0.9, 1.25)
    light = np.broadcast_to(light, (height, width, 3)).copy()
    rise = np.degrees(np.arcsin(up))

    def lamp(at: float, wide: float, low: float, high: float, color: tuple) -> None:
        near = np.abs((turn - at + 180.0) % 360.0 - 180.0) < wide / 2
        light[near & (low < rise) & (rise < high)] = color

    lamp(-55.0, 40.0, 20.0, 50.0, (9.0, 8.0, 6.5))
    lamp(110.0, 24.0, 30.0, 65.0, (4.0, 5.5, 8.0))
    lamp(-160.0, 60.0, 15.0, 32.0, (5.0, 3.2, 1.6))
    for pane in range(4):
        lamp(20.0 + 13.0 * pane, 11.0, 4.0, 26.0, (1.6, 2.0, 2.6))
    largest = light.max(axis=2)
    fraction, exponent = np.frexp(largest)
    pixels = np.empty((height, width, 4), np.uint8)
    pixels[..., :3] = light * (fraction * 256.0 / largest)[..., None]
    pixels[..., 3] = exponent + 128
    rows = b"".join(b"\2\2" + width.to_bytes(2) + b"".join(map(runs, row.T)) for row in pixels)
    head = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n"
    return head.encode() + rows


def runs(channel: np.ndarray) -> bytes:
    """One channel of a row: runs of equal bytes, of two to 127, and single ones."""
    ends = np.append(np.flatnonzero(np.diff(channel)) + 1, len(channel))
    found, start = b"", 0
    for end in ends:
        for first in range(start, end, 127):
            count, value = min(end - first, 127), int(channel[first])
            found += bytes([128 + count, value] if count > 1 else [1, value])
        start = end
    return found


if __name__ == "__main__":
    wheel().quantize(16, dither=Image.Dither.NONE).save("wheel.png", optimize=True)
    sky().save("sky.png", optimize=True)
    fan().save("fan.png", optimize=True)
    Path("studio.hdr").write_bytes(studio())
