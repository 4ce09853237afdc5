"""On the same samples every culling method gives the film of `bbox`, bit for bit.

To build a kernel takes a second or two, and a film a few milliseconds: so many scenes, nearly all
with the same effects, are shown to each method.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest
from support.culling_scenes import EXACT, random_scene, same
from support.hard_cases import CASES, SIZE, mesh, scene
from support.lens_scenes import with_lens
from support.nightly import nightly, nightly_but

import mbinterval as mb
from mbinterval.scene.formats.load import load_file
from mbinterval.scene.model import Light, Material, Mesh, Scene

SCENES = Path(__file__).resolve().parents[2] / "scenes"


def film(of: Scene, cull: str, size: tuple[int, int] = SIZE, **values: object) -> mb.Film:
    frame = values.pop("frame", 1.0)
    settings = mb.Settings(method="stochastic", cull=cull, **({"samples": 16} | values))
    return mb.render(of, frame=frame, width=size[0], height=size[1], settings=settings)


def with_hidden(of: Scene) -> Scene:
    """And a triangle behind the eye that moves and has one side, so that effects are the same."""
    hidden = mesh(np.zeros((2, 1, 3, 2)), -np.array([1.0, 2.0])[:, None, None] * np.ones(3))
    one_sided = replace(hidden, material=Material(shading="unlit", double_sided=False))
    return replace(of, meshes=[*of.meshes, one_sided])


def hard_case(name: str, lens: bool) -> Scene:
    of = with_hidden(CASES[name].make())
    return with_lens(of) if lens else of


def at_rest(of: Scene) -> Scene:
    return with_hidden(replace(of, meshes=[replace(m, motion_blur=False) for m in of.meshes]))


def plain(of: Mesh) -> Mesh:
    """Its faces in colours of their own, unlit."""
    colors = np.random.default_rng(len(of.faces)).uniform(0.1, 1.0, (len(of.faces), 3))
    one_sided = of.material is not None and not of.material.double_sided
    material = Material(shading="unlit", double_sided=not one_sided)
    look = {"color": colors, "color_domain": "face", "uv": None, "normals": None}
    return replace(of, material=material, **look)


def shipped(path: Path, lens: bool) -> Scene:
    of = load_file(path).scene
    of = replace(of, meshes=[*map(plain, of.meshes)], background=(0.1, 0.1, 0.1))
    if lens:
        of = replace(of, camera=replace(of.camera, f_stop=1.0, focus_distance=6.0))
    return with_hidden(of)


SHOWN: dict[str, tuple[Callable[[], Scene], dict[str, object]]] = {
    **{f"{name}, lens {lens}": (partial(hard_case, name, lens), {})
       for name in CASES for lens in (False, True)},
    **{f"random {seed}": (partial(random_scene, seed), {"seed": seed}) for seed in range(30)},
    **{f"random {seed} at rest": (lambda seed=seed: at_rest(random_scene(seed)), {})
       for seed in range(6)},
    **{f"{path.stem}, lens {lens}": (partial(shipped, path, lens),
                                     {"size": (96, 72), "frame": 1.0})
       for path in sorted(SCENES.glob("*.toml")) for lens in (False, True)},
}  # fmt: skip
"""Hard cases, random scenes and those that are shipped: how to make them, and how to show them."""

UNUSUAL = tuple(name for name in SHOWN if name.startswith(("chrome", "lanterns", "propeller")))
"""With effects that others don't have: a sky, a lens with blades, a rolling shutter."""
USUAL = tuple(name for name in SHOWN if name not in UNUSUAL)
THROUGH_LENS = [f"random {seed}" for seed in range(30) if seed // 3 % 2]


@cache
def shown(name: str) -> Scene:
    return SHOWN[name][0]()


@cache
def boxed(name: str, pattern: str) -> mb.Film:
    return film(shown(name), "bbox", pattern=pattern, **SHOWN[name][1])


def differing(
    cull: str, pattern: str, names: Iterable[str] = USUAL, **values: object
) -> Iterator[str]:
    for name in names:
        found = film(shown(name), cull, pattern=pattern, **SHOWN[name][1], **values)
        if not same(found, boxed(name, pattern)):
            yield name


@pytest.mark.parametrize("names", [USUAL, nightly(tuple(SHOWN))], ids=["usual", "all"])
def test_what_is_shown_is_seen_and_blurred(names):
    alpha = {name: boxed(name, "sobol").rgba[..., 3] for name in names}
    assert sum(a.any() for a in alpha.values()) > 0.95 * len(alpha)
    blurred = [name for name, a in alpha.items() if ((a > 0.1) & (a < 0.9)).mean() > 0.02]
    assert len(blurred) > 0.7 * len(alpha)


ELSEWHERE = ("zmin", "zmax", "zmax_strata", "clip_space", "hull")


@pytest.mark.parametrize("cull", [nightly(cull) if cull in ELSEWHERE else cull for cull in EXACT])
def test_hard_cases_random_scenes_and_those_that_are_shipped(cull):
    assert list(differing(cull, "sobol", statistics=True)) == []


@pytest.mark.parametrize(
    ("cull", "pattern", "names"),
    [("best", "sobol", UNUSUAL[::2]),
     *(nightly(cull, "sobol", UNUSUAL) for cull in EXACT),
     *(nightly(cull, "interleave_uvt", UNUSUAL) for cull in ("interleave_uvt", "best"))],
)  # fmt: skip
def test_effects_that_few_of_the_scenes_have(cull, pattern, names):
    assert list(differing(cull, pattern, names)) == []


@pytest.mark.parametrize("cull", ["interleave_uvt", "best"])
def test_interleaved_samples(cull):
    assert list(differing(cull, "interleave_uvt")) == []


@pytest.mark.parametrize(
    "cull", nightly_but([cull for cull in EXACT if cull != "best"], "dual_space")
)
def test_interleaved_samples_through_a_lens(cull):
    assert list(differing(cull, "interleave_uvt", THROUGH_LENS)) == []


def test_bounds_that_lose_hits_are_found_out():
    assert len(list(differing("clip_space_printed", "sobol"))) > 10


@pytest.mark.parametrize(
    ("pattern", "samples", "seeds"),
    [("jittered", 5, (1, 2)), nightly("random", 100, (3, 4))],
)
def test_the_method_of_the_product_with_any_pattern_and_count(pattern, samples, seeds):
    for seed in seeds:
        of = random_scene(seed)
        given = {"pattern": pattern, "samples": samples}
        assert same(film(of, "best", **given), film(of, "bbox", **given))


@pytest.mark.parametrize("cull", ["best", nightly("dual_space"), nightly("clip_space")])
def test_wide_filters_motion_segments_rolling_lines_and_frameless_rendering(cull):
    curved = hard_case("a way that leaves the hull of its ends", True)
    rolling = mb.Shutter(rolling="down", line_offset=0.0004, line_exposure=0.01)
    values = {"filter": "mitchell", "filter_radius": 3.0, "frameless": 7}
    for of in (curved, random_scene(3), random_scene(4), random_scene(5)):
        rolled = replace(of, shutter=rolling)
        want = film(rolled, "bbox", **values)
        assert same(film(rolled, cull, **values), want)


@pytest.mark.parametrize(
    ("cull", "edge"),
    [("dual_space", 5), ("clip_space", 2), nightly("hull", 16),
     nightly("dual_space", 2), nightly("clip_space", 4), nightly("pixar", 4)],
)  # fmt: skip
def test_bounds_of_tiles_of_pixels(cull, edge):
    names = [f"random {seed}" for seed in range(30)]
    assert list(differing(cull, "sobol", names, cull_tile=edge)) == []


@pytest.mark.parametrize("cull", ["best", nightly("hull")])
def test_edge_functions_over_time(cull):
    for seed in (0, 1, 2, 6, 7, 8):
        want, found = (film(random_scene(seed), name, test="edges") for name in ("bbox", cull))
        assert same(found, want)


@pytest.mark.parametrize("name", ["running_fox", nightly("milk_truck")])
def test_shipped_scenes_with_their_light_and_textures(name):
    of = load_file(SCENES / f"{name}.toml").scene
    best, box = (film(of, cull, (96, 72), hybrid=True) for cull in ("best", "bbox"))
    assert same(best, box)


@pytest.mark.parametrize(
    "values", [{}, nightly({"shading_rate": "pixel"}), nightly({"hybrid": True})]
)
def test_a_lamp_at_the_eye_and_triangles_around_it(values):
    clay = Material("clay", specular=(0.3, 0.3, 0.3), shininess=12.0)
    for seed in (0, 1, 2):
        dark = random_scene(seed)
        lit = [replace(m, material=clay, shading=None) for m in dark.meshes]
        of = replace(dark, meshes=lit, lights=[Light("point", intensity=2.0)])
        box = film(of, "bbox", **values)
        assert same(film(of, "best", **values), box)
        assert np.isfinite(box.rgba).all()
        assert box.rgba[..., :3].std() > 0.01


def growing() -> Scene:
    """A triangle that grows about the middle: it covers pixels at no corner's own time."""
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [0.0, 1.2]])
    ends = np.stack([24 + 2 * corners, 24 + 12 * corners])[:, None] - [0, 8]
    return with_hidden(scene(mesh(ends)))


def test_the_printed_bounds_lose_hits_that_the_corrected_ones_keep():
    want = film(growing(), "bbox").rgba
    printed = film(growing(), "clip_space_printed").rgba
    assert np.array_equal(film(growing(), "clip_space", statistics=True).rgba, want)
    assert printed[..., 3].sum() < 0.9 * want[..., 3].sum()


@pytest.mark.parametrize(
    "culls",
    [tuple(cull for cull in EXACT if cull not in ("zmin", "zmax")), nightly(EXACT)],
    ids=["daily", "all"],
)
def test_statistics_tell_the_methods_apart(culls):
    of, lens = random_scene(2), random_scene(3)
    for each in (of, lens):
        counts = {cull: film(each, cull, statistics=True).stats for cull in ("bbox", *culls)}
        hits = {k: c["hits"] for k, c in counts.items() if not k.startswith(("best", "zmax"))}
        assert set(hits.values()) == {counts["bbox"]["hits"]}
        tests = {cull: c["tests"] for cull, c in counts.items()}
        for cull in ("hull", "dual_space", "clip_space"):
            assert tests[cull] < tests["bbox"]
        assert all(c["tests"] >= c["hits"] > 0 for c in counts.values())
        assert all(c["visited"] <= 16 * c["bounded"] for c in counts.values())
    assert film(of, "bbox").stats == {}


def test_a_path_before_all_others_needs_no_comparison_and_one_behind_no_test():
    """Three screens that fill the frame, one behind the other, from near to far or not."""
    corners = np.array([[-50, -50], [150, -50], [-50, 150.0]])
    screens = np.stack([corners] * 3)[None]
    depths = np.ones((2, 3, 3)) * [[1.0], [2.0], [4.0]]
    of = with_hidden(scene(mesh(np.repeat(screens, 2, 0), depths)))
    count = 16 * SIZE[0] * SIZE[1]
    stats = {cull: film(of, cull, statistics=True).stats
             for cull in ("bbox", "zmax", "zmax_strata", "zmin", "zmin_strata")}  # fmt: skip
    assert stats["bbox"]["hits"] == stats["bbox"]["depth_tests"] == 3 * count
    assert stats["zmax"]["hits"] == stats["zmax_strata"]["hits"] == count
    assert stats["zmin"]["depth_tests"] == stats["zmin_strata"]["depth_tests"] == 2 * count
    crossing = np.array([[1.0, 2.0, 4.0], [4.0, 2.0, 1.0]])[..., None] * np.ones(3)
    of = with_hidden(scene(mesh(np.repeat(screens, 2, 0), crossing)))
    saved = {cull: film(of, cull, statistics=True).stats for cull in stats}
    for name, what in (("zmax", "tests"), ("zmin", "depth_tests")):
        assert saved[name][what] > saved[f"{name}_strata"][what]
        assert saved[f"{name}_strata"][what] < saved["bbox"][what]
