"""Images in and out: sRGB and linear pixels, reading of textures, writing of PNG.

Everything inside mbinterval is scene-linear float32. Integer files (PNG, JPEG) hold the sRGB curve
of IEC 61966-2-1 and straight alpha; EXR files hold linear, premultiplied colour.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.errors import OutputError, SceneError
from mbinterval.files.atomic import write_file
from mbinterval.files.contents import read_file
from mbinterval.files.exr import PIXEL_DIGEST, pixel_digest, read_exr
from mbinterval.files.radiance import decode_radiance
from mbinterval.values import shown

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


def undecoded(image: Float32) -> Float32:
    """Return the values that a file of integers has, of an image that was decoded from sRGB."""
    return np.concatenate([linear_to_srgb(image[..., :3]), image[..., 3:]], axis=-1).astype("f4")


def read_image(path: str | Path) -> Float32:
    """Read a texture, a background or an environment from a PNG, JPEG, EXR, HDR or other file.

    Returns
    -------
    ``(h, w, 3)`` or ``(h, w, 4)`` float32, scene-linear, first row on top, straight alpha.

    Raises
    ------
    SceneError
        Naming the file, where it is missing, broken or of an unknown kind.
    """
    if not isinstance(path, str | Path):
        raise SceneError(f"image {shown(path)}: expected the path of a file")
    path = Path(path)
    if not path.is_file():
        raise SceneError(f"image {path}: no such file")
    try:
        return _decoded(path, read_file(path))
    except OSError as error:
        raise SceneError(f"image {path}: {error.strerror or error}") from error
    except MemoryError:
        raise SceneError(f"image {path}: does not fit into memory; make it smaller") from None


def _decoded(path: Path, data: bytes) -> Float32:
    if path.suffix.lower() == ".exr":
        return _read_exr_image(path, data)
    if data.startswith(b"#?"):
        return decode_radiance(data, str(path))
    return decode_image(data, str(path))


def decode_image(data: bytes, what: str) -> Float32:
    """Decode the bytes of an integer image file, as glTF embeds them; see `read_image`.

    ``what`` names the image in errors.
    """
    from PIL import Image, UnidentifiedImageError

    try:
        # Pillow warns of what it does without, such as a tag that says nothing of the pixels.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(io.BytesIO(data)) as image:
                _check_size(image, len(data))
                image.load()
                return linear_pixels(image)
    except UnidentifiedImageError as error:  # its text has an address and no more
        raise SceneError(
            f"image {what}: not a kind of image that is known, or broken; save it as PNG or EXR"
        ) from error
    except MemoryError:
        raise SceneError(f"image {what}: does not fit into memory; make it smaller") from None
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise SceneError(f"image {what}: cannot be read ({error}); save it again") from error


_MOST_PIXELS = {"PNG": 8 * 1032, "GIF": 8 * 1032, "JPEG": 8 * 1032, "PPM": 8}
"""Pixels of a byte, by the kind of file: of those that pack bits by deflate, LZW or less."""


def _check_size(image: Image.Image, size: int) -> None:
    """Refuse a header that claims more pixels than the ``size`` bytes of the file can hold."""
    width, height = image.size
    if width * height > _MOST_PIXELS.get(str(image.format), width * height) * size:
        raise ValueError(f"its header claims {width} x {height} pixels, more than the file holds")


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


def _read_exr_image(path: Path, data: bytes) -> Float32:
    try:
        channels = read_exr(path, data).channels
    except OutputError as error:
        raise SceneError(f"image {error}") from error
    names = "RGB" if {"R", "G", "B"} <= set(channels) else "YYY"
    if names[0] not in channels:
        raise SceneError(
            f"image {path}: no R, G, B or Y channel among {', '.join(sorted(channels))}"
        )
    pixels = np.stack([channels[name] for name in names], axis=2).astype(np.float32)
    if "A" in channels:
        alpha = channels["A"].astype(np.float32)[..., None]
        with np.errstate(over="ignore", invalid="ignore"):
            pixels = np.concatenate([unpremultiplied(pixels, alpha), alpha], axis=2)
    if not np.isfinite(pixels).all():
        row, column, channel = np.argwhere(~np.isfinite(pixels))[0]
        raise SceneError(
            f"image {path}: {'RGBA'[channel]} is {pixels[row, column, channel]} in row {row}, "
            f"column {column}; every value must be finite: mend it where it was made"
        )
    return pixels


def unpremultiplied(colour: Float32, alpha: Float32) -> Float32:
    """Colour ``(h, w, 3)`` divided by alpha ``(h, w, 1)``; black where alpha is 0."""
    return np.divide(colour, alpha, out=np.zeros_like(colour), where=alpha > 0)


def write_png(
    path: str | Path, rgba: Float32, transparent: bool, text: Mapping[str, object]
) -> None:
    """Write an 8-bit sRGB PNG, all of it or nothing; equal pixels and text give equal bytes.

    Parameters
    ----------
    path
        Where to; missing folders are made.
    rgba
        ``(h, w, 4)`` scene-linear, premultiplied.
    transparent
        Write straight alpha; otherwise the alpha is left out.
    text
        Written as text chunks, in this order, and the digest of the pixels after them.

    Raises
    ------
    OutputError
        Where the file can't be written; nothing is left then.
    """
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    colour, alpha = rgba[..., :3], rgba[..., 3:]
    if transparent:
        encoded = np.concatenate([linear_to_srgb(unpremultiplied(colour, alpha)), alpha], axis=2)
    else:
        encoded = linear_to_srgb(colour)
    pixels = np.rint(np.clip(np.nan_to_num(encoded), 0.0, 1.0) * 255.0).astype(np.uint8)
    info = PngInfo()
    info.add(b"sRGB", b"\0")
    for name, value in text.items():
        info.add_itxt(name[:79], str(value))
    info.add_itxt(PIXEL_DIGEST, pixel_digest({"": pixels}))
    written = io.BytesIO()
    Image.fromarray(pixels).save(written, format="PNG", pnginfo=info)
    write_file(path, written.getvalue())


_PNG_END = b"\0\0\0\0IEND\xaeB`\x82"
"""The last chunk: its length, its name, and its checksum."""


def read_png(path: Path) -> tuple[NDArray[np.uint8], dict[str, str]]:
    """Read the pixels of a PNG as they are stored, and its text chunks, checking all of it.

    Raises
    ------
    OutputError
        Where the file is missing, no PNG, cut off, or a checksum is wrong.
    """
    from PIL.PngImagePlugin import PngImageFile

    try:
        data = path.read_bytes()
        with PngImageFile(io.BytesIO(data)) as image:
            _check_size(image, len(data))
            image.verify()  # the checksums of all chunks but the last
        if not data.endswith(_PNG_END):
            raise ValueError("cut off, or more than a PNG")
        with PngImageFile(io.BytesIO(data)) as image:
            image.load()
            text = {str(key): str(value) for key, value in image.info.items()}
            return np.asarray(image), text
    except MemoryError:
        raise OutputError(f"{path}: does not fit into memory") from None
    except (OSError, ValueError, SyntaxError, Warning) as error:
        raise OutputError(f"{path}: not a whole PNG ({error})") from error
