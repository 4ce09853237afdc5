"""``compare``: how far an image is from a reference, where, and whether noise explains it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.comparison import metrics
from mbinterval.comparison.verdict import LEVEL, TOLERANCE, Repeats, Verdict, judge
from mbinterval.errors import UsageError
from mbinterval.files.images import srgb_to_linear, write_png
from mbinterval.files.ownership import SOFTWARE
from mbinterval.film.film import Film
from mbinterval.values import nearest, number, shown, whole_number

METRICS = ("rmse", "relative_mse", "mae", "psnr", "ssim", "flip")
"""Names of all metrics, in the order of a table; each is a function of `metrics`."""

MAP_RANGE = (1e-4, 1.0)
"""Errors at the dark and the bright end of the colours of a map, which are logarithmic."""

_COLOURS = (0x000004, 0x1B0C41, 0x4A0C6B, 0x781C6D, 0xA52C60, 0xCF4446, 0xED6925, 0xFB9B06)
_HEAT = np.array([*_COLOURS, 0xF7D13D, 0xFCFFA4])  # of matplotlib's "inferno", sRGB
_SHARED_TIMES = ("interleave_uvt",)


@dataclass(frozen=True, eq=False)
class Comparison:
    """What `compare` found.

    Attributes
    ----------
    metrics
        Figures by name, those of ``METRICS`` that were asked for, of the first repeat of the image
        against the mean of the reference's. All are 0 for equal images but ``ssim``, which is 1,
        and ``psnr``, in dB, which is infinite.
    difference
        ``(H, W, 3)`` float32: image minus reference, of which the metrics are.
    maps
        ``(H, W)`` float32, 0 where the images are equal: ``rms`` over the channels, and ``flip``
        where it was asked for.
    verdict
        Whether sampling noise explains the difference; None without independent repeats.
    notes
        What the figures do not say, for people.
    """

    metrics: Mapping[str, float]
    difference: NDArray[np.float32]
    maps: Mapping[str, NDArray[np.float32]]
    verdict: Verdict | None
    notes: tuple[str, ...] = field(default=())

    def as_dict(self) -> dict[str, Any]:
        """Metrics, verdict and notes as JSON has them; what is not finite is None."""
        verdict = None
        if self.verdict is not None:
            rows, columns = np.nonzero(self.verdict.pixels)
            verdict = {
                "explained": self.verdict.explained,
                "level": self.verdict.level,
                "p_value": self.verdict.p_value,
                "degrees": self.verdict.degrees,
                "detectable": {str(n): value for n, value in self.verdict.detectable.items()},
                "pixels": np.stack([columns, rows], axis=1).tolist(),
                "regions": [vars(region) for region in self.verdict.regions],
            }
        figures = {n: value if math.isfinite(value) else None for n, value in self.metrics.items()}
        return {"metrics": figures, "verdict": verdict, "notes": list(self.notes)}

    def write_maps(self, folder: str | Path) -> list[Path]:
        """Write each map as a PNG in false colours, see `false_colour`, and return the paths.

        With a verdict there is ``verdict.png`` too: the picture of ``rms`` where pixels, or tiles
        they are in, say no, and black elsewhere. Raises ``OutputError``.
        """
        pictures = dict(self.maps)
        if self.verdict is not None:
            pictures["verdict"] = np.where(self.disputed(), self.maps["rms"], np.float32(0.0))
        paths = self.map_paths(folder)
        for path, (name, values) in zip(paths, pictures.items(), strict=True):
            alpha = np.ones((*values.shape, 1), np.float32)
            rgba = np.concatenate([false_colour(values), alpha], axis=2)
            low, high = MAP_RANGE
            facts = {"software": SOFTWARE, "map": name, "range": f"{low:g} to {high:g}, log"}
            write_png(path, rgba, False, facts)
        return paths

    def map_paths(self, folder: str | Path) -> list[Path]:
        """Files that `write_maps` writes into ``folder``."""
        names = [*self.maps, *(("verdict",) if self.verdict is not None else ())]
        return [Path(folder) / f"{name}.png" for name in names]

    def disputed(self) -> NDArray[np.bool_]:
        """``(H, W)``: pixels that say no, and those of the tiles that do."""
        if self.verdict is None:
            return np.zeros(self.difference.shape[:2], bool)
        mask = self.verdict.pixels.copy()
        for region in self.verdict.regions:
            rows = slice(region.row, region.row + region.size)
            mask[rows, region.column : region.column + region.size] = True
        return mask


Image = Film | NDArray[Any] | str | Path
"""An image: a film, an array ``(H, W, 3)`` or ``(H, W, 4)``, or the path of an EXR file."""


def compare(
    image: Image | Sequence[Image],
    reference: Image | Sequence[Image],
    *,
    which: Iterable[str] | None = None,
    samples: int | None = None,
    level: float = LEVEL,
    tolerance: float = TOLERANCE,
) -> Comparison:
    """Compare an image with a reference, in scene-linear colour; alpha and depth are left out.

    Parameters
    ----------
    image, reference
        A film, an array ``(H, W, 3)`` or ``(H, W, 4)``, or an EXR file; or a list of these, or an
        array ``(n, H, W, 3)``: independent repeats, that is renders that differ in their ``seed``.
        With repeats on either side there is a verdict, see `verdict`. A single image
        counts as free of noise there, so give repeats of whatever is random.
    which
        Names of ``METRICS``; None is all of them, but for ``flip`` where its package is missing.
    samples
        Samples per pixel of one repeat, where it doesn't say itself, as films and their files do.
        None is 1: then the verdict will be slow to say no to single pixels.
    level
        Probability with which the verdict says no to images of equal expectation, above 0, below 1.
    tolerance
        Difference of colour up to which the verdict takes it for rounding, from 0.

    Raises
    ------
    UsageError
        For images of different sizes or crops, or that are not finite.
    OutputError
        For a file that cannot be read.
    """
    level = number(level, "level", above=0.0, below=1.0)
    tolerance = number(tolerance, "tolerance", low=0.0)
    if samples is not None:
        samples = whole_number(samples, "samples", 1)
    names = _names(which)
    sides = [_side(image, "image", samples), _side(reference, "reference", samples)]
    first, second = sides
    if (first.shape, first.origin) != (second.shape, second.origin):
        raise UsageError(f"image is {first.extent}, reference is {second.extent}: not the same")
    pixels = first.repeats.images[0]
    truth = _mean(second.repeats.images)
    figures = {name: getattr(metrics, name) for name in names if name != "flip"}
    found = {name: figure(pixels, truth) for name, figure in figures.items()}
    maps = {"rms": metrics.rms_map(pixels, truth)}
    if "flip" in names:
        maps["flip"] = metrics.flip_map(pixels, truth)
        found["flip"] = float(np.mean(maps["flip"], dtype=np.float64))
    verdict = judge(first.repeats, second.repeats, level, tolerance)
    return Comparison(
        metrics=found,
        difference=np.asarray(pixels - truth, np.float32),
        maps=maps,
        verdict=verdict,
        notes=tuple(_notes(sides, verdict, which)),
    )


def false_colour(values: NDArray[Any]) -> NDArray[np.float32]:
    """Colours ``(H, W, 3)``, scene-linear, for errors ``(H, W)``: black, purple, orange, yellow.

    Logarithmic over `MAP_RANGE`, whatever the image, so that maps can be compared: each of the
    four decades takes a quarter of the colours.
    """
    low, high = MAP_RANGE
    clipped = np.clip(np.asarray(values, np.float64), low, high)
    place = np.log(clipped / low) / math.log(high / low) * (len(_HEAT) - 1)
    steps = np.arange(len(_HEAT))
    channels = [np.interp(place, steps, (_HEAT >> shift) & 255) / 255.0 for shift in (16, 8, 0)]
    return srgb_to_linear(np.stack(channels, axis=2))


@dataclass(frozen=True, eq=False)
class _Side:
    """One side of a comparison, checked: all repeats have one shape and one place."""

    repeats: Repeats
    shape: tuple[int, int]
    origin: tuple[int, int]
    told: bool

    @property
    def extent(self) -> str:
        where = f" from ({self.origin[0]}, {self.origin[1]})" if self.origin != (0, 0) else ""
        return f"{self.shape[1]} x {self.shape[0]} pixels{where}"


def _side(source: Any, what: str, samples: int | None) -> _Side:
    several = isinstance(source, list | tuple) or np.ndim(_array(source)) == 4
    sources = list(source) if several else [source]
    if not sources:
        raise UsageError(f"{what}: an empty list; give at least one image")
    labels = [f"{what}[{i}]" for i in range(len(sources))] if several else [what]
    films = [Film.read(item) if isinstance(item, str | Path) else item for item in sources]
    images = [_pixels(film, label) for film, label in zip(films, labels, strict=True)]
    places = [film.origin if isinstance(film, Film) else (0, 0) for film in films]
    for pixels, place, label in zip(images, places, labels, strict=True):
        if pixels.shape != images[0].shape or place != places[0]:
            raise UsageError(f"{label}: its size or its place differs from {labels[0]}'s")
    said = _samples_of(films[0])
    count, shared = said or (samples or 1, False)
    repeats = Repeats(images, count, shared)
    return _Side(repeats, images[0].shape[:2], places[0], told=bool(said or samples))


def _array(source: Any) -> Any:
    return source if isinstance(source, np.ndarray) else None


def _pixels(image: Any, what: str) -> NDArray[np.float32]:
    """Colour of one image, ``(H, W, 3)``."""
    try:
        values = np.asarray(image.rgba if isinstance(image, Film) else image, np.float32)
    except (TypeError, ValueError):
        values = np.empty(0, np.float32)
    if values.ndim != 3 or values.shape[2] not in (3, 4) or 0 in values.shape:
        raise UsageError(
            f"{what}={shown(image)}: expected a film, an array (height, width, 3 or 4), or the "
            "path of an EXR file"
        )
    values = values[..., :3]
    if not np.isfinite(values).all():
        row, column, _channel = np.argwhere(~np.isfinite(values))[0]
        raise UsageError(f"{what}: the pixel in column {column}, row {row} is not finite")
    return values


def _samples_of(film: Any) -> tuple[int, bool] | None:
    """Samples per pixel by a film's metadata, and whether pixels share their times."""
    stored = film.metadata if isinstance(film, Film) else {}
    count = stored.get("settings.samples")
    if not isinstance(count, int):
        return None
    accumulated = stored.get("settings.method") == "accumulation"
    slices = stored.get("settings.slices", 1) if accumulated else 1
    shared = accumulated or stored.get("settings.pattern") in _SHARED_TIMES
    return count * (slices if isinstance(slices, int) else 1), shared


def _mean(images: Sequence[NDArray[np.float32]]) -> NDArray[np.float64]:
    total = np.zeros(images[0].shape)
    for image in images:
        total += image
    return total / len(images)


def _names(which: Iterable[str] | None) -> tuple[str, ...]:
    if which is None:
        return tuple(name for name in METRICS if name != "flip" or metrics.has_flip())
    names = tuple(which)
    for name in names:
        if name not in METRICS:
            raise UsageError(f"metric {name!r}: unknown, {nearest(str(name), METRICS)}")
    return names


def _notes(sides: Sequence[_Side], verdict: Verdict | None, which: Any) -> Iterable[str]:
    if which is None and not metrics.has_flip():
        yield "FLIP is left out: its package is missing; pip install 'mbinterval[study]'"
    for side, what in zip(sides, ("image", "reference"), strict=True):
        if len(side.repeats.images) > 1 and not side.repeats.noisy:
            yield f"the repeats of the {what} are all equal: it counts as free of noise"
        elif len(side.repeats.images) > 1 and not side.told:
            yield f"the {what} does not tell its samples per pixel: 1 is taken for the verdict"
    if verdict is None:
        yield "no verdict: neither side has independent repeats"
