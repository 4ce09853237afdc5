"""The result of a render: pixels, per-pixel measures, timings, and how they are written."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.errors import OutputError, UsageError
from mbinterval.files.exr import PIXEL_DIGEST, AttributeValue, ExrImage, read_exr
from mbinterval.film.aovs import AOVS, channels_of, layers_of
from mbinterval.film.formats import format_of
from mbinterval.values import nearest

if TYPE_CHECKING:
    from mbinterval.film.deep import DeepImage
    from mbinterval.film.events import Events

_COLOUR = ("R", "G", "B", "A")


@dataclass(frozen=True, eq=False)
class Film:
    """A rendered frame, or a crop of one.

    Attributes
    ----------
    rgba
        ``(H, W, 4)`` float32, scene-linear, premultiplied; alpha is coverage over pixel and
        shutter. Colour lies over the background unless it was rendered ``transparent``.
    depth
        ``(H, W)`` float32: mean distance along the view axis of what is visible, weighted by
        coverage; infinity where nothing is.
    intervals
        ``(H, W)`` uint32: time intervals met in the pixel, summed over its samples; of point
        samples the number of those that see something.
    layers
        What else was asked for, by name: see `mbinterval.film.aovs.AOVS`.
    deep, events
        Where they were asked for, the `DeepImage` and the `Events` of the film.
    timings
        Seconds by stage, in the order in which the stages run. Not written to files.
    resolution
        Width and height of the whole frame in pixels.
    origin
        Column and row of the film's first pixel in the whole frame.
    metadata
        What is written into files: frame, shutter, camera, settings, version.
    stats
        Counts of the render. Analytic: ``tests``, pairs of a motion path and a sample that were
        solved, and ``hits``, those of them that gave an interval (exact paths). Point samples,
        where ``Settings.statistics`` asks for it: ``bounded``, pixels for which the bounds of a
        path were found (those of tiles of ``cull_tile`` pixels each, and not by ``cull="best"``);
        ``visited``, samples in pixels that a path may touch, and those left after the lens's part
        of the culling (``stage1``); ``tests`` and ``hits``; ``depth_tests``, hits whose depth was
        compared; ``texels`` that were looked up, and ``texel_lines``, 64 bytes each, that a cache
        of 6 kB would have fetched for them. Not written to files.
    transparent
        The background was left out of the colour, so that a PNG gets an alpha channel.
    notes
        What had to be assumed about the scene, for people. Not written to files.
    device
        Name of the device that rendered it. Not written to files.
    """

    rgba: NDArray[np.float32]
    depth: NDArray[np.float32]
    intervals: NDArray[np.uint32]
    timings: Mapping[str, float]
    resolution: tuple[int, int]
    origin: tuple[int, int] = (0, 0)
    metadata: Mapping[str, AttributeValue] = field(default_factory=dict)
    stats: Mapping[str, int] = field(default_factory=dict)
    transparent: bool = False
    layers: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    deep: DeepImage | None = None
    events: Events | None = None
    notes: tuple[str, ...] = ()
    device: str = ""

    def __post_init__(self) -> None:
        shape = np.shape(self.rgba)[:2]
        _set_array(self, "rgba", np.float32, (*shape, 4))
        _set_array(self, "depth", np.float32, shape)
        _set_array(self, "intervals", np.uint32, shape)
        layers = {name: _layer(name, self.layers[name], shape) for name in self.layers}
        object.__setattr__(self, "layers", layers)
        if len(shape) != 2 or 0 in shape:
            raise UsageError(f"film: {shape} pixels; expected at least one row and one column")

    def write(self, path: str | Path) -> Path:
        """Write a file, by the ending of ``path``; all of it or nothing.

        An EXR has the channels R, G, B, A and Z in 32-bit float and ``intervals`` in 32-bit
        integers, and those of ``layers``, compressed without loss, the film as data window and the
        whole frame as display window, and the metadata and a digest of the pixels as attributes. A
        PNG has the colour alone, in 8 bits with the sRGB curve, and alpha, straight, where the film
        is transparent; metadata and digest are text chunks. A file that ends in .deep.exr gets the
        deep image, one in .npz or .parquet the events. Equal films give equal bytes. Missing
        folders are made. What is there is replaced, whoever made it: a link stays and the file that
        it leads to is replaced; a pipe or a device gets the bytes.

        Raises
        ------
        UsageError
            For another ending, and where the film was rendered without what is to be written.
        OutputError
            Where the file can't be written; nothing is left then, and an older file stays.
        """
        kind, path = format_of(path), Path(path)
        if not kind.part:
            kind.write(path, self._image())
            return path
        found: DeepImage | Events | None = getattr(self, kind.part)
        if found is None:
            raise UsageError(
                f"{path}: the film has no {kind.part}; render it with aovs={kind.part!r}"
            )
        of_film = replace(
            found, resolution=self.resolution, origin=self.origin, metadata=self.metadata
        )
        kind.write(path, of_film)
        return path

    def _image(self) -> ExrImage:
        channels: dict[str, NDArray[Any]] = {
            name: self.rgba[..., index] for index, name in enumerate(_COLOUR)
        }
        channels |= {"Z": self.depth, "intervals": self.intervals, **channels_of(self.layers)}
        attributes = {**self.metadata, "transparent": int(self.transparent)}
        return ExrImage(channels, self.resolution, self.origin, attributes)

    @classmethod
    def read(cls, path: str | Path) -> Film:
        """Read an EXR that this or another program wrote.

        Without A alpha is 1, without Z depth is infinite, and without whole ``intervals`` they
        are 0. Of ``layers`` those are read whose channels are all there.

        Raises
        ------
        OutputError
            Where the file is missing, broken, cut off, or has no colour.
        """
        image = read_exr(path)
        if not set(_COLOUR[:3]) <= image.channels.keys():
            found = ", ".join(sorted(image.channels))
            raise OutputError(f"{path}: a film needs channels R, G and B; the file has {found}")
        shape = image.channels["R"].shape
        defaults = {"A": np.ones(shape), "Z": np.full(shape, np.inf), "intervals": np.zeros(shape)}
        channels = {**defaults, **image.channels}
        if channels["intervals"].dtype.kind != "u":  # another program's, and no count
            channels["intervals"] = defaults["intervals"]
        attributes = dict(image.attributes)
        transparent = attributes.pop("transparent", 0) == 1
        attributes.pop(PIXEL_DIGEST, None)
        return cls(
            rgba=np.stack([channels[name] for name in _COLOUR], axis=2),
            depth=channels["Z"],
            intervals=channels["intervals"],
            timings={},
            resolution=image.resolution,
            origin=image.origin,
            metadata=attributes,
            layers=layers_of(image.channels),
            transparent=transparent,
        )


def _set_array(film: Film, name: str, dtype: type, shape: tuple[int, ...]) -> None:
    object.__setattr__(film, name, _array(name, getattr(film, name), dtype, shape))


def _layer(name: str, pixels: Any, shape: tuple[int, ...]) -> NDArray[Any]:
    if name not in AOVS:
        raise UsageError(f"film: unknown layer {name!r}, {nearest(name, AOVS)}")
    aov = AOVS[name]
    count = len(aov.channels)
    if aov.ranked and np.ndim(pixels) == 3:
        count *= max(np.shape(pixels)[2] // count, 1)
    return _array(name, pixels, aov.dtype, shape if count == 1 else (*shape, count))


def _array(name: str, value: Any, dtype: type | str, shape: tuple[int, ...]) -> NDArray[Any]:
    try:
        array: NDArray[Any] = np.ascontiguousarray(value, dtype=dtype)
    except (TypeError, ValueError):
        raise UsageError(f"film: {name} is no array of numbers") from None
    if array.shape != shape:
        raise UsageError(f"film: {name} has shape {array.shape}, expected {shape}")
    return array
