"""A small study for the tests of reports."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mbinterval as mb
from mbinterval.bench.cases import make_case
from mbinterval.study.judge import Truth
from mbinterval.study.reference import Reference
from mbinterval.study.run import study
from mbinterval.study.sweeps import SWEEPS as ALL
from mbinterval.study.sweeps import Sweep

SWEEPS = ("samples", "five-point", "samples-published", "occlusion", "stochastic-sobol", "slices")


def with_rows(sweep: Sweep, step: int) -> Sweep:
    """The sweep with one of ``step`` of its rows, from the first: most are a kernel to build."""
    return replace(sweep, rows=dict(list(sweep.rows.items())[::step]))


def small_study(folder: Path, **options):
    """48 x 36 pixels of 60 cubes; references are made of other seeds, and good enough."""
    case = make_case("fast_cubes:60", width=48, height=36)

    def halves(**values):
        films = [
            mb.render(case.scene, width=48, height=36, settings=mb.Settings(seed=seed, **values))
            for seed in (1, 2)
        ]
        return np.stack([film.rgba[..., :3] for film in films])

    points = halves(method="stochastic", samples=1024)
    exact = halves(samples=16, pattern="sobol")
    centres = halves(method="accumulation", samples=1, slices=512, slice_times="jittered")
    truth = Truth(
        pixels=[
            Reference(points, "samples=1024", "stochastic", 2, 1.0),
            Reference(exact, "samples=16", "analytic", 2, 1.0),
        ],
        centres=[Reference(centres, "slices=512", "accumulation", 2, 1.0)],
    )
    with pytest.MonkeyPatch.context() as patch:
        for name in SWEEPS:
            patch.setitem(ALL, name, with_rows(ALL[name], 3))
        return study(case, truth, folder=folder, **{"sweeps": SWEEPS, "rounds": 1, **options})
