"""Renders that are counted and timed, and words for what they show."""

from __future__ import annotations

import dataclasses
import re
import time
from collections.abc import Iterator, Sequence
from functools import cache

import numpy as np
from culling_scenes import SCENES, variant

import mbinterval as mb
from mbinterval.device.sources import kernel_root

SIZE = [960, 540]
ROUNDS = 3
TIMED = ("bbox", "dual_space", "clip_space", "best")


@dataclasses.dataclass(frozen=True)
class Measured:
    """Counts of a render, and its number of triangles."""

    stats: dict[str, int]
    triangles: int

    @property
    def ste(self) -> float:
        return 100.0 * self.stats["hits"] / max(self.stats["tests"], 1)


def render(of: mb.Scene, part: int = 1, **values: object) -> mb.Film:
    """Render by point samples, or as given; at a ``part`` of the width and height."""
    settings = mb.Settings(**({"method": "stochastic"} | values))  # type: ignore[arg-type]
    return mb.render(of, width=SIZE[0] // part, height=SIZE[1] // part, settings=settings)


def how(cull: str) -> dict[str, object]:
    return {"cull": cull, "pattern": "interleave_uvt" if cull == "interleave_uvt" else "sobol"}


@cache
def measured(name: str, row: str, cull: str, samples: int = 16, tile: int = 1) -> Measured:
    of = variant(name, row)
    film = render(of, samples=samples, cull_tile=tile, statistics=True, **how(cull))
    return Measured(dict(film.stats), sum(len(mesh.faces) for mesh in of.meshes))


@cache
def seconds_of(name: str, row: str) -> dict[str, float]:
    """Medians by method of ``TIMED``; every round renders each once, kernels built before."""
    of = variant(name, row)
    took: dict[str, list[float]] = {cull: [] for cull in TIMED}
    for _ in range(1 + ROUNDS):
        for cull in TIMED:
            started = time.perf_counter()
            render(of, samples=16, **how(cull))
            took[cull].append(time.perf_counter() - started)
    return {cull: float(np.median(seconds[1:])) for cull, seconds in took.items()}


def operations_of(file: str) -> dict[str, tuple[int, int]]:
    """What a culling file states: operations without a lens and with one, by what takes them."""
    text = (kernel_root() / "stochastic" / "cull" / f"{file}.h").read_text()
    line = re.search(r"// Operations: (.*)\.", text)
    assert line is not None, file
    parts = re.findall(r"(\w+) (\d+)(?: \((\d+)\))?", line[1])
    return {what: (int(a), int(b or a)) for what, a, b in parts}


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterator[str]:
    yield f"| {' | '.join(head)} |"
    yield f"|{'---|' * len(head)}"
    yield from (f"| {' | '.join(row)} |" for row in rows)
    yield ""


def verdict(holds: bool) -> str:
    return "Confirmed" if holds else "Refuted"


def span(values: Sequence[float], form: str = ".2f") -> str:
    return f"{min(values):{form}} to {max(values):{form}}"


def changes(cull: str, effect: str) -> list[float]:
    """How STE changes when an effect is doubled: percent, of each scene."""
    return [
        100.0 * (measured(n, f"{effect} x2", cull).ste / measured(n, effect, cull).ste - 1.0)
        for n in SCENES
    ]


def said(values: Sequence[float], unit: str = " %") -> str:
    names = [f"{value:+.1f}{unit} ({name})" for name, value in zip(SCENES, values, strict=True)]
    return " and ".join(names)
