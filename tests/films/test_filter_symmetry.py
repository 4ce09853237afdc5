"""Filters are symmetric: what they make of an edge lies where the edge is, whatever the pattern."""

from __future__ import annotations

import numpy as np
import pytest
from reference.witness.filters import RADII, weight
from support.closed_forms import FACES, UNIT_CAMERA, world

import mbinterval as mb
from mbinterval.scene.model import Mesh, Scene

SIZE = 20


def half_plane(angle: float) -> Scene:
    """What lies on one side of a line through the frame's middle; 0: the right half."""
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    corners = np.array([[0, 90], [90, 90], [90, -90], [0, -90.0]]) @ turn + SIZE / 2
    mesh = Mesh(positions=world(corners, 2.0, (SIZE, SIZE)), faces=FACES, shading="unlit")
    return Scene(meshes=[mesh], camera=UNIT_CAMERA)


def alpha(angle: float, **given: object) -> np.ndarray:
    settings = mb.Settings(pattern="fixed", **given)
    return mb.render(half_plane(angle), width=SIZE, height=SIZE, settings=settings).rgba[..., 3]


def step(name: str, angle: float, at: np.ndarray) -> np.ndarray:
    """What the filter makes of a half-plane that begins ``at`` pixels after the pixel's centre."""
    line = (np.arange(1000) + 0.5) / 500 - 1
    line *= RADII[name]
    size = weight(name, RADII[name], line)
    along = np.cos(angle) * line[:, None] + np.sin(angle) * line[None]
    order = np.argsort(along, axis=None)
    passed = np.cumsum(np.outer(size, size).ravel()[order])
    return 1.0 - np.interp(at, along.ravel()[order], passed / passed[-1])


METHODS = {
    "analytic": {},
    "stochastic": {"method": "stochastic"},
    "accumulation": {"method": "accumulation", "slices": 1},
}


@pytest.mark.parametrize("method", METHODS)
def test_opposite_pixels_share_an_edge_through_a_filter_with_lobes(method):
    """Of any direction; lattices without opposites shifted it by up to an eighth of a pixel."""
    for samples in (32, 37, 64, 256):
        for angle in (0.0, 0.5 * np.pi, 0.3, -1.1):
            found = alpha(angle, filter="mitchell", samples=samples, **METHODS[method])
            assert found + found[::-1, ::-1] == pytest.approx(np.ones_like(found), abs=2e-5)


@pytest.mark.parametrize("name", ["triangle", "gaussian", "blackman_harris"])
def test_filters_without_lobes_shift_no_edge(name):
    for samples in (16, 37):
        for angle in (0.0, 0.5 * np.pi):
            found = alpha(angle, filter=name, samples=samples)
            assert found + found[::-1, ::-1] == pytest.approx(np.ones_like(found), abs=2e-5)


@pytest.mark.parametrize("name", ["gaussian", "mitchell"])
def test_an_edge_looks_as_the_filter_has_it(name):
    rows, columns = np.indices((SIZE, SIZE)) + 0.5 - SIZE / 2
    for angle in (0.0, 0.3, -1.1):
        want = step(name, angle, -(np.cos(angle) * columns + np.sin(angle) * rows))
        for samples, within in ((64, 0.015), (256, 0.006)):
            found = alpha(angle, filter=name, samples=samples)
            assert np.sqrt(np.mean((found - want) ** 2)) < within, (angle, samples)
