"""Images in: sRGB and linear pixels, and reading of textures and backgrounds.

Everything inside mbinterval is scene-linear float32. Integer files (PNG, JPEG) hold the sRGB curve
of IEC 61966-2-1 and straight alpha; EXR files hold linear, premultiplied colour.
"""

from __future__ import annotations

import io
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.errors import SceneError

if TYPE_CHECKING:
    from PIL import Image

Float32 = NDArray[np.float32]


def srgb_to_linear(values: NDArray[Any]) -> Float32:
    """Decode sRGB values in [0, 1], any shape, to linear float32."""
    encoded = np.asarray(values, dtype=np.float64)
    low, high = encoded / 12.92, ((np.maximum(encoded, 0.0) + 0.055) / 1.055) ** 2.4
    return np.where(encoded <= 0.04045, low, high).astype(np.float32)


def linear_to_srgb(values: NDArray[Any]) -> NDArray[np.float64]:
    """Encode linear values, any shape, with the sRGB curve; clipped to [0, 1], NaN becomes 0."""
    linear = np.clip(np.nan_to_num(np.asarray(values, dtype=np.float64), nan=0.0), 0.0, 1.0)
    return np.where(linear <= 0.0031308, linear * 12.92, 1.055 * linear ** (1 / 2.4) - 0.055)


def read_image(path: str | Path) -> Float32:
    """Read a texture or a background from a PNG, JPEG, EXR or other image file.

    Returns
    -------
    ``(h, w, 3)`` or ``(h, w, 4)`` float32, scene-linear, first row on top, straight alpha.

    Raises
    ------
    SceneError
        Naming the file, where it is missing, broken or of an unknown kind.
    """
    path = Path(path)
    if not path.is_file():
        raise SceneError(f"image {path}: no such file")
    if path.suffix.lower() == ".exr":
        return _read_exr_image(path)
    try:
        data = path.read_bytes()
    except OSError as error:
        raise SceneError(f"image {path}: {error.strerror or error}") from error
    return decode_image(data, str(path))


def decode_image(data: bytes, what: str) -> Float32:
    """Decode the bytes of an integer image file, as glTF embeds them; see `read_image`.

    ``what`` names the image in errors.
    """
    from PIL import Image

    try:
        with Image.open(io.BytesIO(data)) as image:
            image.load()
            return linear_pixels(image)
    except (OSError, ValueError, SyntaxError, Warning, Image.DecompressionBombError) as error:
        raise SceneError(f"image {what}: cannot be read ({error})") from error


def linear_pixels(image: Image.Image) -> Float32:
    """Scene-linear pixels of a Pillow image that holds sRGB, of any mode; see `read_image`."""
    if image.mode.startswith("I"):
        grey = srgb_to_linear(np.asarray(image, dtype=np.float64) / 65535.0)
        return np.repeat(grey[..., None], 3, axis=2)
    pixels = np.asarray(image.convert("RGBA" if image.has_transparency_data else "RGB"))
    linear: Float32 = srgb_to_linear(np.arange(256) / 255.0)[pixels]
    if pixels.shape[2] == 4:
        linear[..., 3] = pixels[..., 3] / np.float32(255.0)
    return linear


def _read_exr_image(path: Path) -> Float32:
    channels = read_exr_channels(path)
    try:
        colour = [channels[name] for name in ("R", "G", "B")]
    except KeyError:
        if "Y" not in channels:
            raise SceneError(
                f"image {path}: no R, G, B or Y channel among {', '.join(sorted(channels))}"
            ) from None
        colour = [channels["Y"]] * 3
    pixels = np.stack(colour, axis=2).astype(np.float32)
    if not np.isfinite(pixels).all():
        raise SceneError(f"image {path}: has pixels that are not finite")
    if "A" not in channels:
        return pixels
    alpha = channels["A"].astype(np.float32)[..., None]
    straight = np.divide(pixels, alpha, out=np.zeros_like(pixels), where=alpha > 0)
    return np.concatenate([straight, alpha], axis=2)


def read_exr_channels(path: Path) -> dict[str, NDArray[Any]]:
    """Channels ``(h, w)`` of the first part of an EXR, by name; SceneError where it is broken."""
    import OpenEXR

    try:
        parts = OpenEXR.File(os.fspath(path), separate_channels=True).parts
    except (RuntimeError, ValueError, OSError) as error:
        raise SceneError(f"image {path}: cannot be read as EXR ({error})") from error
    if not parts or not parts[0].channels:
        raise SceneError(f"image {path}: the file is cut off or broken")
    return {name: channel.pixels for name, channel in parts[0].channels.items()}
