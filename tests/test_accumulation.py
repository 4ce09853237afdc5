"""Accumulated slices: static pictures at their times, and stochastic passes for curved motion."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from reference.accumulation import render as twin
from test_hard_cases import CASES, SIZE

import mbinterval as mb
from mbinterval.scene.exposure import expose
from mbinterval.scene.model import Scene


def film(of: Scene, **values: object) -> np.ndarray:
    settings = mb.Settings(**{"method": "accumulation", "samples": 1} | values)
    return mb.render(of, width=SIZE[0], height=SIZE[1], settings=settings).rgba


def test_slices_are_the_twins():
    for name in ("shared edges", "pivoting edges", "through the camera plane"):
        of = CASES[name].make()
        want = twin(expose(of, 1.0, 1.5), *SIZE, slices=8).rgba
        found = film(of, slices=8, motion_segments=1)
        assert (np.abs(found - want).max(axis=-1) > 1e-5).mean() < 2e-3, name
        other = film(of, slices=7, motion_segments=1)
        assert (np.abs(other - want).max(axis=-1) > 1e-5).mean() > 0.05


def test_one_slice_is_the_middle_of_the_shutter_at_rest():
    of = CASES["interpenetrating meshes"].make()
    still = [replace(m, positions=m.positions.mean(axis=0)) for m in of.meshes]
    want = mb.render(replace(of, meshes=still), width=SIZE[0], height=SIZE[1],
                     settings=mb.Settings(samples=9)).rgba  # fmt: skip
    found = film(of, slices=1, samples=9)
    assert (np.abs(found - want).max(axis=-1) > 1e-5).mean() < 2e-3


def test_more_slices_come_closer():
    of = CASES["interpenetrating meshes"].make()
    truth = mb.render(of, width=SIZE[0], height=SIZE[1], settings=mb.Settings(samples=4)).rgba
    errors = [
        np.sqrt(np.mean((film(of, slices=n, samples=4) - truth) ** 2)) for n in (4, 16, 64, 256)
    ]
    assert all(b < 0.5 * a for a, b in pairwise(errors))
    jittered = film(of, slices=64, samples=4, slice_times="jittered")
    assert np.sqrt(np.mean((jittered - truth) ** 2)) < 3 * errors[2]
    assert not np.array_equal(jittered, film(of, slices=64, samples=4))


def test_stochastic_passes_follow_a_curve():
    of = CASES["a way that leaves the hull of its ends"].make()
    truth = mb.render(of, width=SIZE[0], height=SIZE[1], settings=mb.Settings(samples=16)).rgba
    passes = film(of, slices=8, samples=16, slice_times="stochastic")
    assert np.sqrt(np.mean((passes - truth) ** 2)) < 0.02
    same = mb.render(of, width=SIZE[0], height=SIZE[1],
                     settings=mb.Settings(method="stochastic", samples=128)).rgba  # fmt: skip
    assert np.array_equal(passes, same)
    ends = replace(of, meshes=[replace(of.meshes[0], positions=of.meshes[0].positions[::8])])
    straight = film(ends, slices=8, samples=16, slice_times="stochastic")
    assert np.sqrt(np.mean((straight - truth) ** 2)) > 0.03
