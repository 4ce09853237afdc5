"""Scenes that hypothesis makes: nothing crashes, no NaN is in a film, coverage stays in [0, 1].

Kernels are compiled for the effects of a scene, so scenes vary freely within a dozen sets of
effects. ``MB_EXAMPLES=1000`` tries so many scenes of each.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support.nightly import nightly

import mbinterval as mb
from mbinterval.errors import SceneError, UsageError
from mbinterval.scene.model import Camera, Light, Material, Mesh, Scene, Shutter, Texture

EXAMPLES = int(os.environ.get("MB_EXAMPLES", "25"))
SIZE = (9, 7)
LENS = {"f_stop": 1.0, "focal_length": 50.0}
ROLL = {"line_offset": 0.004, "line_exposure": 0.01}


@dataclass(frozen=True)
class Kind:
    """What a set of scenes has in common."""

    settings: dict[str, object] = field(default_factory=dict)
    material: Material = field(default_factory=lambda: Material(shading="unlit"))
    camera: dict[str, object] = field(default_factory=dict)
    shutter: dict[str, object] = field(default_factory=dict)
    resting: bool = False


PICTURE = Texture(np.random.default_rng(0).uniform(0, 1, (4, 4, 3)))
POSTER = Material("poster", texture=PICTURE, double_sided=False)
GLASS = Material("glass", shading="unlit", opacity=0.5)
SEE_THROUGH = Texture(np.random.default_rng(1).uniform(0, 1, (4, 4, 4)))
LEAF = Material("leaf", texture=SEE_THROUGH, alpha_mode="blend")
METAL = Material("metal", shading="metallic_roughness", metallic=1.0, roughness=0.0)
TRIANGULATED = {"paths": "triangulated", "samples": 2}
KINDS = {
    "exact": Kind({"samples": 2}),
    "with something at rest": Kind({"samples": 1}, resting=True),
    "textured and lit": Kind({"samples": 2, "texture_samples": 3}, POSTER, resting=True),
    "textured over footprints": Kind(
        {"samples": 1, "anisotropy": 3, "shading_error": 0.05}, POSTER, resting=True
    ),
    "metal": Kind(
        {"samples": 1, "shading_error": 0.05},
        METAL,
        resting=True,
    ),
    "glass": Kind({"samples": 2}, GLASS, resting=True),
    "alpha of a texture": Kind({"samples": 1, "texture_samples": 3}, LEAF, camera=LENS),
    "masked": Kind({"occlusion": 32, "partial_bits": True, "samples": 1}),
    "scattered, Gaussian": Kind({"pattern": "sobol", "filter": "gaussian", "samples": 3}),
    "scattered, Mitchell": Kind({"pattern": "sobol", "filter": "mitchell", "samples": 4}),
    "lens": Kind({"samples": 4}, camera=LENS),
    "lens, lit": Kind(
        {"samples": 2, "pattern": "sobol", "filter": "blackman_harris"}, POSTER,
        camera=LENS | {"blades": 6, "foreground_blur": 0.1}, resting=True,
    ),
    "rolling": Kind({"samples": 2}, shutter=ROLL | {"rolling": "up"}, resting=True),
    "rolling columns, curve": Kind(
        {"occlusion": 64}, shutter=ROLL | {"rolling": "right", "curve": "triangle"}
    ),
    "curve": Kind({"samples": 1}, POSTER, shutter={"curve": (0.0, 2.0, 1.0, 0.5)}),
    "triangulated": Kind(TRIANGULATED | {"occlusion": 32}, resting=True),
    "triangulated, by depth": Kind(TRIANGULATED | {"occlusion": "exact", "pairing": "depth"}),
}  # fmt: skip

ORDINARY = st.floats(-4.0, 4.0, allow_subnormal=False).map(lambda x: round(x, 4))
SPECIAL = st.sampled_from([0.0, -0.0, 1.0, -1.0, 1e-300, -1e-18, 1e-7, 1e4, -1e9, 1e18, 5e-324])
NUMBER = st.one_of(ORDINARY, ORDINARY, ORDINARY, ORDINARY, SPECIAL)
AHEAD = st.tuples(ORDINARY, ORDINARY, st.floats(-4.0, -0.5))
POINT = st.one_of(AHEAD, AHEAD, AHEAD, st.tuples(NUMBER, NUMBER, NUMBER))


@st.composite
def moving_points(draw: st.DrawFn) -> np.ndarray:
    """Positions ``(K + 1, 3 n, 3)``: some vertices, or all, rest or are the same."""
    count, times = draw(st.integers(1, 5)), draw(st.sampled_from([2, 2, 3]))
    pool = draw(st.lists(POINT, min_size=5, max_size=12, unique=True))
    choice = st.integers(0, len(pool) - 1)
    first = draw(st.lists(choice, min_size=3 * count, max_size=3 * count))
    ends = [first]
    for _ in range(1, times):
        moves = draw(st.lists(st.one_of(st.none(), choice), min_size=3 * count,
                              max_size=3 * count))  # fmt: skip
        ends.append([f if m is None else m for f, m in zip(first, moves, strict=True)])
    points = np.array(pool)[np.array(ends)]
    if np.all(points == points[:1]):  # what rests altogether is another kind
        points[-1, 0] += [0.25, 0.0, 0.0]
    return points


@st.composite
def scenes(draw: st.DrawFn, kind: Kind) -> Scene:
    points = draw(moving_points())
    faces = np.arange(points.shape[1]).reshape(-1, 3)
    uv = None if kind.material.texture is None else points[0, :, :2]
    meshes = [Mesh(positions=points, faces=faces, material=kind.material, uv=uv)]
    if kind.resting:
        still = np.array(draw(st.lists(POINT, min_size=6, max_size=6)))
        uv = None if uv is None else still[:, :2]
        faces = [[0, 1, 2], [3, 4, 5]]
        meshes.append(Mesh(positions=still, faces=faces, material=kind.material, uv=uv))
    place = draw(st.sampled_from([(0.0, 0.0, 0.0), tuple(points[0, 0])]))
    optics = {"fov": draw(st.sampled_from([100.0, 45.0, 1.0]))}
    if kind.camera:
        focus = draw(st.sampled_from([1e-3, 1.0, 2.5, 1e6]))
        optics = kind.camera | {"focus_distance": focus}
    lights = (Light("ambient"), Light("point", position=tuple(points[0, 1])))
    return Scene(
        meshes=meshes, camera=Camera(position=place, **optics), lights=lights,
        shutter=Shutter(**kind.shutter), background=(0.25, 0.5, 0.75),
    )  # fmt: skip


AT_NIGHT = ("textured and lit", "scattered, Gaussian", "lens", "rolling", "curve", "triangulated")
"""Of what another kind has as well."""


@pytest.mark.parametrize("name", [nightly(name) if name in AT_NIGHT else name for name in KINDS])
def test_no_scene_crashes_and_films_are_finite_and_covered_from_0_to_1(name):
    kind = KINDS[name]
    rendered, refused = [], []

    @settings(
        max_examples=EXAMPLES, derandomize=True, deadline=None, database=None,
        suppress_health_check=list(HealthCheck),
    )  # fmt: skip
    @given(scenes(kind))
    def check(scene: Scene) -> None:
        try:
            film = mb.render(
                scene, width=SIZE[0], height=SIZE[1], settings=mb.Settings(**kind.settings)
            )
        except (SceneError, UsageError) as error:
            refused.append(str(error))
            return
        alpha = film.rgba[..., 3]
        rendered.append(alpha.max() > 0)
        assert np.isfinite(film.rgba).all()
        assert not np.isnan(film.depth).any()
        low, high = (-1.0, 2.0) if kind.settings.get("filter") == "mitchell" else (0.0, 1.0)
        assert alpha.min() >= low
        assert alpha.max() <= high
        if (low, high) == (0.0, 1.0):
            assert np.all(film.depth[alpha > 0] >= 0)
            assert np.array_equal(np.isinf(film.depth), alpha == 0)

    check()
    assert all(len(message) > 20 for message in refused)
    assert len(rendered) > 0.8 * EXAMPLES
    assert np.mean(rendered) > 0.2


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("field", ["positions", "normals", "uv", "color"])
def test_numbers_that_are_not_finite_are_refused_by_the_name_of_mesh_and_vertex(field, value):
    arrays = {
        "positions": np.zeros((2, 5, 3)),
        "normals": np.ones((2, 5, 3)),
        "uv": np.zeros((5, 2)),
        "color": np.ones((5, 3)),
    }
    arrays[field] = arrays[field].copy()
    arrays[field][..., 3, 1] = value
    with pytest.raises(SceneError) as caught:
        Mesh(faces=[[0, 1, 2]], name="sail", color_domain="vertex", **arrays)
    assert "'sail'" in str(caught.value)
    assert "vertex 3" in str(caught.value)
