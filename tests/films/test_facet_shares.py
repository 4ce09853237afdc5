"""The table of what facets reflect of light that is the same from everywhere, and its look-ups."""

from __future__ import annotations

import numpy as np
import pytest
from reference.facets import white_light
from support.environments import environment

import mbinterval as mb
from mbinterval.rendering import facet_shares

WITHIN = 4e-4
"""What the README says of the table's look-ups."""

ROUGHNESS = (0.03, 0.034, 0.045, 0.1, 0.3, 0.7, 1.0)
COSINES = (1e-4, 1e-3, 0.0038, 0.0317, 0.1, 0.45, 0.97)
SEEN = [(roughness, cosine) for roughness in ROUGHNESS for cosine in COSINES]
COLOR = np.array([1.0, 0.5, 0.0])
FAR = 1e6
"""So far away the eye sees all of a frame in one direction."""


def test_the_quadrature_agrees_with_one_over_visible_facets():
    found = [facet_shares.reflected(np.array([c]), r * r) for r, c in SEEN]
    expected = [white_light(c, r * r) for r, c in SEEN]
    assert np.abs(np.array(found)[..., 0] - expected).max() < 1e-4
    # Known from others: white metal of a case, by two quadratures.
    assert sum(white_light(0.0317, 0.09)) == pytest.approx(0.898, abs=5e-4)


def test_what_scattered_light_loses_is_the_mean_over_directions():
    rng = np.random.default_rng(4)
    up, turn = rng.uniform(size=(2, 1_000_000))
    for cosine in (0.0, 0.3, 1.0):
        along = np.sqrt((1 - cosine**2) * (1 - up)) * np.cos(2 * np.pi * turn)
        half = 0.5 * (1.0 + along + cosine * np.sqrt(up))
        mean = ((1.0 - np.sqrt(half)) ** 5).mean()
        assert facet_shares.lost_by_scattering(np.array([cosine])) == pytest.approx(mean, abs=2e-4)


def strip(row: int, roughness: float, metallic: float) -> mb.Mesh:
    """A row of squares, one in each pixel, whose normals have the cosines to the view."""
    left = np.arange(len(COSINES)) - len(COSINES) / 2
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    places = corners + np.stack([left, 0 * left + row, 0 * left], axis=-1)[:, None]
    normals = [[np.sqrt(1.0 - c * c), 0.0, c] for c in COSINES]
    faces = 4 * np.arange(len(COSINES))[:, None, None] + [[0, 1, 2], [0, 2, 3]]
    material = mb.Material(
        shading="metallic_roughness", metallic=metallic, roughness=roughness, base_color=COLOR
    )
    return mb.Mesh(
        places.reshape(-1, 3), faces.reshape(-1, 3), normals=np.repeat(normals, 4, axis=0),
        material=material,
    )  # fmt: skip


@pytest.mark.parametrize("method", ["analytic", "stochastic"])
def test_films_show_what_facets_reflect_at_every_slant(method):
    """Of light that is 1 everywhere, by metals and by what is none."""
    kinds = [(roughness, metallic) for metallic in (1.0, 0.0) for roughness in ROUGHNESS]
    high = len(kinds)
    camera = mb.Camera(
        position=(0, high / 2, FAR), look_at=(0, high / 2, 0), fov=np.degrees(high / FAR)
    )
    meshes = [strip(row, *kind) for row, kind in enumerate(kinds)]
    scene = mb.Scene(meshes, camera, environment=environment(lambda d: 0.0 * d + 1.0))
    settings = mb.Settings(method=method, samples=1)
    film = mb.render(scene, width=len(COSINES), height=high, settings=settings).rgba[::-1, :, :3]
    for row, (roughness, metallic) in enumerate(kinds):
        f0 = COLOR * metallic + 0.04 * (1.0 - metallic)
        lost = facet_shares.lost_by_scattering(np.array(COSINES))
        for column, cosine in enumerate(COSINES):
            factor, added = white_light(cosine, roughness**2, 200)
            scattered = COLOR * (1.0 - metallic) * (1.0 - f0) * (1.0 - lost[column])
            expected = f0 * factor + added + scattered
            found = film[row, column]
            assert found == pytest.approx(expected, abs=WITHIN), (roughness, metallic, cosine)
