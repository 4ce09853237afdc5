"""Scenes that combine effects at random, against the witness (``tests/reference/witness``).

``MB_WITNESS=10000`` tries so many, of 400 sets of effects; 300 of 10 sets are tried each time. A
scene is a `Recipe`, effects and a seed, which a failure prints: what was found is kept in ``KEPT``.
"""

from __future__ import annotations

import os

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, seed, settings
from reference.witness import camera, exposure, filters
from reference.witness.around import WIDE, mirrored, mirrored_by_draws, shares
from reference.witness.compare import Result, compare
from reference.witness.film import Asked, film
from reference.witness.judge import judge
from reference.witness.product import (
    PATH_ERROR,
    Camera,
    Environment,
    Mesh,
    Scene,
    Settings,
    Shutter,
    films,
    render,
)
from reference.witness.scenes import AXES, SIZE, Effects, Recipe, build, effect_sets, recipes
from support.nightly import nightly

DAILY, DAILY_SETS = 300, 10
NIGHTLY, NIGHTLY_SETS = int(os.environ.get("MB_WITNESS", "10000")), 400


def found(recipe: Recipe) -> Result:
    result = compare(build(recipe))
    assert result.agrees, f"{recipe}\n{result}"
    return result


def check(count: int, sets: int) -> None:
    @seed(18)
    @settings(
        max_examples=count, deadline=None, database=None, phases=(Phase.generate,),
        suppress_health_check=list(HealthCheck),
    )  # fmt: skip
    @given(recipes(sets))
    def every(recipe: Recipe) -> None:
        found(recipe)

    every()


def test_random_scenes_are_what_the_witness_sees():
    check(DAILY, DAILY_SETS)


@pytest.mark.parametrize("count", [nightly(NIGHTLY)])
def test_many_random_scenes_are_what_the_witness_sees(count):
    check(count, NIGHTLY_SETS)


def test_sets_of_effects_have_every_value_by_day_and_every_pair_at_night():
    """But for the five-point rule, which is daily as a kind."""
    daily = {pair for effects in effect_sets(DAILY_SETS) for pair in vars(effects).items()}
    every = {(axis, value) for axis, values in AXES.items() for value in values}
    assert every - daily <= {("sampling", "five_point")}
    rng = np.random.default_rng(0)
    drawn = [{axis: str(rng.choice(values)) for axis, values in AXES.items()} for _ in range(300)]
    pairs = set().union(*(Effects(**values).consistent().pairs for values in drawn))
    assert pairs <= set().union(*(effects.pairs for effects in effect_sets(NIGHTLY_SETS)))


KEPT = [
    Recipe(Effects(lens="blades", rolling="rows", shading="phong", lights="lamps",
                   shadows="shadows", alpha="mask", sides="single", mirror="glossy",
                   sampling="triangle", layers="moment"), 0, 3),
]  # fmt: skip
"""Scenes that told of something: normals of what deforms, once."""


@pytest.mark.parametrize("recipe", KEPT, ids=str)
def test_scenes_that_once_differed_agree(recipe):
    found(recipe)


def test_films_of_scenes_that_are_exposed_once_are_those_of_renders_alone():
    case = build(KEPT[0])
    given = films(case.scene, case.frame, SIZE, 2, **case.settings)
    alone = {"motion_error": PATH_ERROR} | case.settings
    for number, shown in enumerate(given):
        own = render(case.scene, frame=case.frame, width=SIZE[0], height=SIZE[1],
                     settings=Settings(**alone, seed=number))  # fmt: skip
        assert own.rgba.tobytes() == shown.rgba.tobytes()
        assert all(
            own.layers[name].tobytes() == shown.layers[name].tobytes() for name in own.layers
        )


# The witness itself, against closed forms.


def square(left: float, right: float, depth: float = 0.0, **given: object) -> Mesh:
    corners = [[left, -9, depth], [right, -9, depth], [right, 9, depth], [left, 9, depth]]
    return Mesh(corners, [[0, 1, 2], [0, 2, 3]], shading="unlit", **given)


def test_a_slab_covers_its_share_of_the_time_by_the_shutters_curve():
    slab = np.array([[-20, -9, 0.0], [0, -9, 0], [0, 9, 0], [-20, 9, 0]])
    moving = np.stack([slab, slab + [4.0, 0, 0]])
    mesh = Mesh(moving, [[0, 1, 2], [0, 2, 3]], shading="unlit")
    # The edge passes the middle of column 8 of 14, of 6 rows, after this part of the time.
    part = (8.5 - 7.0) / 3.0 * np.tan(np.radians(20.0)) * 4.0 / 4.0
    for curve, left in (((1.0, 1.0), 1.0 - part), ((0.0, 1.0), 1.0 - part**2)):
        scene = Scene([mesh], Camera(position=(0, 0, 4), fov=40.0), shutter=Shutter(curve=curve))
        seen = film(scene, 0.0, (14, 6), Asked(strata=256, repeats=4, centre=True))
        assert seen.rgba[:, 3, 8, 3].mean() == pytest.approx(left, abs=2e-3)


def test_light_through_the_lens_is_spread_over_the_circle_of_confusion():
    """A half-plane out of focus: alpha beside its edge is a segment's share of a disc."""
    lens = {"f_stop": 1.0, "focus_distance": 4.0, "fov": 40.0, "meters_per_unit": 0.02}
    scene = Scene([square(0.0, 99.0, -4.0)], Camera(**lens, position=(0, 0, 4)))
    seen = film(scene, 0.0, (40, 30), Asked(strata=256, repeats=8, centre=True))
    focal = 0.5 / np.tan(np.radians(20.0))
    radius = focal * 24e-3 / 0.02 / 2.0 * focal * 30 * (1 / 4 - 1 / 8)
    for column in (14, 17, 20, 23):
        s = np.clip((column + 0.5 - 20.0) / radius, -1.0, 1.0)
        share = 1.0 - (np.arccos(s) - s * np.sqrt(1.0 - s * s)) / np.pi
        assert seen.rgba[:, :, column, 3].mean() == pytest.approx(share, abs=3e-3)


def test_drawn_times_and_filters_have_their_weights():
    share = (np.arange(4000) + 0.5) / 4000
    for curve, mean in (("box", 0.5), ("triangle", 0.5), ((0.0, 1.0), 2 / 3), ((1.0, 0.0), 1 / 3)):
        times = exposure.drawn_times(Shutter(curve=curve), share)
        assert times.mean() == pytest.approx(mean, abs=1e-4)
    for name in filters.RADII:
        at, weight = filters.draw(name, None, share)
        assert weight.mean() == pytest.approx(1.0, abs=1e-3)
        x = np.linspace(-2.0, 2.0, 40001)
        value = filters.weight(name, filters.RADII[name], x)
        second = (value * x * x).sum() / value.sum()
        assert (weight * at * at).mean() == pytest.approx(second, abs=2e-3)


def test_white_facets_reflect_what_two_other_quadratures_say():
    """Of `shared/cases/truth/grazing_metal.py`: .8754 at cosine .1, .898 at .0317, roughness .3."""
    cosine, factor, added, _ = shares(0.3)
    whole = np.interp([0.1, 0.0317], cosine, factor + added)
    assert whole == pytest.approx([0.8754, 0.898], abs=4e-3)


def test_a_table_of_what_facets_mirror_is_what_draws_of_them_say():
    rng = np.random.default_rng(3)
    turn = np.linspace(0.0, 2.0 * np.pi, 64, endpoint=False)
    flat = np.cos(np.linspace(-0.5, 0.5, 32) * np.pi)[:, None]
    image = 0.5 + 0.3 * (flat * np.cos(turn))[..., None] * [1.0, 0.5, -1.0]
    around, ways = Environment(image.astype(np.float32)), rng.normal(size=(500, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    for alpha in (WIDE, 0.3, 0.9):
        away = mirrored(around, ways, alpha) - mirrored_by_draws(around, ways, alpha, 2000)
        assert np.abs(away).max() < 2e-3


def test_lens_points_fill_a_polygon_whose_first_corner_the_rotation_tells():
    square_points = np.random.default_rng(0).uniform(size=(20000, 2))
    five = Camera(f_stop=1.0, focus_distance=1.0, blades=5, blade_rotation=30.0)
    points = camera.lens_points(five, square_points)
    farthest = points[np.argmax(np.hypot(*points.T))]
    turn = np.degrees(np.arctan2(farthest[1], farthest[0])) % 72.0
    assert turn == pytest.approx(30.0, abs=2.0)


def test_the_judge_tells_a_small_shift_and_accepts_another_seed():
    rng = np.random.default_rng(5)
    truth = rng.uniform(size=(12, 16, 3))
    noise = [truth + 0.01 * rng.normal(size=(24, *truth.shape)) for _ in range(2)]
    assert judge(noise[0], noise[1]).p > 1e-3
    assert judge(noise[0] + 0.004, noise[1]).p < 1e-9
    assert judge(noise[0], noise[1] * 1.01).p < 1e-9
