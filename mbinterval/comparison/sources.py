"""What ``mbinterval compare`` compares: renders and files with their names, and the table."""

from __future__ import annotations

import argparse
import glob
import logging
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from mbinterval.comparison.comparison import METRICS, Comparison
from mbinterval.errors import UsageError
from mbinterval.files.ownership import check_replaceable
from mbinterval.files.results import aligned
from mbinterval.film.film import Film
from mbinterval.rendering.renderer import render

_log = logging.getLogger(__name__)

_TITLES = {"rmse": "RMSE", "relative_mse": "relative MSE", "mae": "MAE", "psnr": "PSNR dB"}
_TITLES |= {"ssim": "SSIM", "flip": "HDR-FLIP"}


@dataclass(frozen=True, eq=False)
class Source:
    """One image of a comparison by name, with its independent repeats."""

    name: str
    films: Sequence[Film]


def read_sources(pattern: str) -> Source:
    """Read an EXR file, or the repeats that a pattern such as ``'seed*.exr'`` matches."""
    paths = [pattern]
    if not Path(pattern).is_file() and glob.has_magic(pattern):
        paths = sorted(glob.glob(pattern))
        if not paths:
            raise UsageError(f"{pattern}: matches no file")
    return Source(Path(pattern).stem, [Film.read(path) for path in paths])


def render_sources(
    arguments: argparse.Namespace, make_job: Callable[[argparse.Namespace], Any]
) -> list[Source]:
    """Render ``arguments.scene`` with each of ``arguments.variants``, ``arguments.repeats`` times.

    Repeats differ in their seed only: the setting's value and those that follow.
    """
    stem = Path(arguments.scene).stem
    sources = []
    for text, values in arguments.variants or [("", {})]:
        job = make_job(argparse.Namespace(**{**vars(arguments), **values}))
        width, height = job.resolution
        films = []
        for index in range(arguments.repeats):
            settings = replace(job.settings, seed=(job.settings.seed + index) % 2**32)
            film = render(
                job.scene,
                frame=job.frames[0],
                width=width,
                height=height,
                settings=settings,
                device=job.device,
                crop=job.crop,
            )
            _log.info("%s %s: %d of %d", stem, text, index + 1, arguments.repeats)
            films.append(film)
        sources.append(Source(f"{stem} {text}".strip(), films))
    return sources


def table(reference: Source, results: Mapping[str, Comparison]) -> str:
    """Lines of text: a row of metrics for each image, then what is to be said of it."""
    names = [name for name in METRICS if any(name in r.metrics for r in results.values())]
    rows = [("image", *(_TITLES[name] for name in names))]
    for name, result in results.items():
        rows.append((name, *(_shown(metric, result.metrics.get(metric)) for metric in names)))
    lines = [f"reference: {reference.name}", "", *aligned(rows), ""]
    for name, result in results.items():
        if result.verdict is not None:
            lines.append(f"{name}: {result.verdict}")
        lines += [f"{name}: note: {note}" for note in result.notes]
    return "\n".join(lines)


def _shown(metric: str, value: float | None) -> str:
    if value is None:
        return ""
    if metric == "psnr":
        return f"{value:.2f}"
    return f"{value:.5f}" if metric in ("ssim", "flip") else f"{value:.3e}"


def write_maps(folder: Path, results: Mapping[str, Comparison]) -> None:
    """Write error maps into a folder for each image, or none where a file is in the way."""
    folders: dict[str, Path] = {}
    for name in results:
        place = folder / re.sub(r"[^\w.=,-]+", "_", name)
        while place in folders.values():
            place = place.with_name(f"{place.name}_")
        folders[name] = place
    for name, result in results.items():
        for path in result.map_paths(folders[name]):
            check_replaceable(path, ".png", "give another folder")
    for name, result in results.items():
        result.write_maps(folders[name])
