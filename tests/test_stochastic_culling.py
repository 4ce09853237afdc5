"""On the same samples every culling method gives the film of `bbox`, bit for bit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from test_hard_cases import CASES, SIZE, mesh, scene
from test_stochastic_twin import with_lens

import mbinterval as mb
from mbinterval.scene.load import load_file
from mbinterval.scene.model import Light, Material, Scene
from mbinterval.settings import CULLS

SCENES = Path(__file__).resolve().parents[1] / "scenes"
EXACT = tuple(
    cull for cull in CULLS if cull not in ("bbox", "interleave_uvt", "clip_space_printed")
)
"""Methods that must lose nothing, whatever the pattern."""


def film(of: Scene, cull: str, size: tuple[int, int] = SIZE, **values: object) -> mb.Film:
    settings = mb.Settings(method="stochastic", cull=cull, **({"samples": 16} | values))
    return mb.render(of, width=size[0], height=size[1], settings=settings)


def same(a: mb.Film, b: mb.Film) -> bool:
    arrays = ("rgba", "depth", "intervals")
    return all(getattr(a, name).tobytes() == getattr(b, name).tobytes() for name in arrays)


@pytest.mark.parametrize("cull", EXACT)
def test_hard_cases(cull):
    for name, case in CASES.items():
        for of in (case.make(), with_lens(case.make())):
            assert same(film(of, cull), film(of, "bbox")), name


def random_scene(seed: int) -> Scene:
    """Big and small triangles, near the eye and behind it, one-sided or not, moving or not."""
    rng = np.random.default_rng(seed)
    count = 24
    spread = 10 ** rng.uniform(-0.5, 1.5, (1, count, 1, 1))
    points = rng.uniform((-20, -20), (68, 52), (2, count, 1, 2))
    points[1, : count // 4] = points[0, : count // 4]
    points = points + rng.normal(0, 1, (2, count, 3, 2)) * spread
    low = (0.5, 0.02, -1.0)[seed % 3]
    w = rng.uniform(low, 3.0, (2, count, 3))
    still = mesh(points[:1, :6], w[:1, :6], shift=40)
    one_sided = Material(shading="unlit", double_sided=False)
    back = replace(mesh(points[:, 6:12], w[:, 6:12], shift=60), material=one_sided)
    of = scene(mesh(points[:, 12:], w[:, 12:]), still, back)
    if seed // 3 % 2:
        camera = replace(of.camera, fov=None, focal_length=24.0, f_stop=0.02, focus_distance=1.2)
        of = replace(of, camera=camera)
    return of


@pytest.mark.parametrize("cull", EXACT)
def test_random_scenes_with_motion_defocus_and_both(cull):
    seen = 0.0
    for seed in range(30):
        of = random_scene(seed)
        want = film(of, "bbox", seed=seed)
        assert same(film(of, cull, seed=seed), want), seed
        seen += want.rgba[..., 3].mean()
    assert seen > 3.0


@pytest.mark.parametrize("cull", [*EXACT, "interleave_uvt"])
def test_interleaved_samples(cull):
    for seed in (0, 1, 2, 3, 4, 5):
        of = random_scene(seed)
        want = film(of, "bbox", pattern="interleave_uvt")
        assert same(film(of, cull, pattern="interleave_uvt"), want), seed


@pytest.mark.parametrize("pattern", ["jittered", "random", "fixed"])
@pytest.mark.parametrize("samples", [5, 64, 100])
def test_the_method_of_the_product_with_any_pattern_and_count(pattern, samples):
    for seed in (1, 2, 3, 4):
        of = random_scene(seed)
        given = {"pattern": pattern, "samples": samples}
        assert same(film(of, "best", **given), film(of, "bbox", **given))


@pytest.mark.parametrize("cull", ["best", "dual_space", "clip_space", "pixar"])
def test_wide_filters_motion_segments_rolling_lines_and_frameless_rendering(cull):
    curved = CASES["a way that leaves the hull of its ends"].make()
    rolling = mb.Shutter(rolling="down", line_offset=0.0004, line_exposure=0.01)
    for of, values in (
        (random_scene(1), {"filter": "mitchell"}),
        (random_scene(4), {"filter": "gaussian", "filter_radius": 3.0}),
        (curved, {}),
        (replace(curved, shutter=rolling), {}),
        (random_scene(2), {"frameless": 7}),
    ):
        assert same(film(of, cull, **values), film(of, "bbox", **values))


@pytest.mark.parametrize("cull", ["dual_space", "clip_space", "pixar", "hull"])
@pytest.mark.parametrize("edge", [2, 4])
def test_bounds_of_tiles_of_pixels(cull, edge):
    for seed in range(6):
        of = random_scene(seed)
        assert same(film(of, cull, cull_tile=edge), film(of, "bbox"))


@pytest.mark.parametrize("cull", ["best", "hull", "obb", "dual_space"])
def test_edge_functions_over_time(cull):
    for seed in (0, 1, 2):
        of = random_scene(seed)
        assert same(film(of, cull, test="edges"), film(of, "bbox", test="edges"))


@pytest.mark.parametrize("path", sorted(SCENES.glob("*.toml")), ids=lambda path: path.stem)
def test_shipped_scenes(path):
    of = load_file(path).scene
    frame = 12.0
    want = mb.render(of, frame=frame, width=160, height=120,
                     settings=mb.Settings(method="stochastic", samples=8, cull="bbox"))  # fmt: skip
    for cull in EXACT:
        settings = mb.Settings(method="stochastic", samples=8, cull=cull)
        found = mb.render(of, frame=frame, width=160, height=120, settings=settings)
        assert same(found, want), cull


def growing() -> Scene:
    """A triangle that grows about the middle: it covers pixels at no corner's own time."""
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [0.0, 1.2]])
    ends = np.stack([24 + 2 * corners, 24 + 12 * corners])[:, None] - [0, 8]
    return scene(mesh(ends))


def test_the_printed_bounds_lose_hits_that_the_corrected_ones_keep():
    want = film(growing(), "bbox").rgba
    printed = film(growing(), "clip_space_printed").rgba
    assert np.array_equal(film(growing(), "clip_space").rgba, want)
    assert printed[..., 3].sum() < 0.9 * want[..., 3].sum()


def test_statistics_tell_the_methods_apart():
    of = random_scene(3)
    counts = {cull: film(of, cull, statistics=True).stats for cull in ("bbox", *EXACT)}
    assert {c["hits"] for k, c in counts.items() if not k.startswith(("best", "zmax"))} == {
        counts["bbox"]["hits"]
    }
    tests = {cull: c["tests"] for cull, c in counts.items()}
    for cull in ("hull", "dual_space", "clip_space"):
        assert tests[cull] < tests["bbox"]
    assert all(c["tests"] >= c["hits"] > 0 for c in counts.values())
    assert film(of, "bbox").stats == {}


def test_lit_scenes_under_every_method_of_shading():
    lamp = Light("point", position=(0.0, 0.0, 0.0), intensity=2.0)
    base = random_scene(0)
    clay = Material("clay", specular=(0.3, 0.3, 0.3), shininess=12.0)
    lit = [replace(m, material=clay, shading=None) for m in base.meshes]
    of = replace(base, meshes=lit, lights=[lamp])
    for values in ({}, {"shading_rate": "pixel"}, {"hybrid": True}):
        assert same(film(of, "best", **values), film(of, "bbox", **values))
