"""Time-dependent shadow maps (Akenine-Möller et al. 2007, 3.5), against exact shadows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.kernels import ready_for
from support.nightly import nightly
from support.shadow_scenes import AMBIENT, CASES, LAMP, SUN, plate, scene

import mbinterval as mb
from mbinterval.scene.model import Scene

SIZE = (32, 24)
POINTS = {"method": "stochastic", "samples": 64}


def film(of: Scene, **values: object) -> np.ndarray:
    settings = mb.Settings(**{"motion_segments": 1, **values})
    rgba = mb.render(of, width=SIZE[0], height=SIZE[1], settings=settings).rgba
    return np.asarray(rgba[..., :3], np.float64)


def error(of: Scene, truth: np.ndarray, size: int, strata: int, **values: object) -> float:
    found = film(of, **POINTS, shadow_map=size, shadow_strata=strata, **values)
    return float(np.sqrt(np.mean((found - truth) ** 2)))


@pytest.mark.parametrize("light", [SUN, nightly(LAMP)], ids=["directional", "point"])
def test_finer_maps_with_more_times_come_to_the_exact_shadow(light):
    of = replace(CASES["moving caster on static receiver"](), lights=[AMBIENT, light])
    truth = film(of, samples=64, pattern="sobol")
    coarse, fine = error(of, truth, 24, 4), error(of, truth, 384, 16)
    noise = float(np.sqrt(np.mean((film(of, **POINTS) - truth) ** 2)))
    assert coarse > 2.0 * fine
    assert fine < 2.0 * noise
    assert np.sqrt(np.mean((film(of, **POINTS, shadows="off") - truth) ** 2)) > 10.0 * fine


def test_the_bias_keeps_a_floor_from_shading_itself():
    floor = scene(plate((0, 0, 0), 4.0), lights=(AMBIENT, SUN, LAMP))
    free = film(floor, **POINTS, shadows="off")
    assert np.abs(film(floor, **POINTS, shadow_map=64) - free).max() < 1e-6
    assert np.abs(film(floor, **POINTS, shadow_map=64, shadow_bias=0.0) - free).max() > 0.2


def test_several_times_keep_a_moving_floor_from_shading_itself():
    """What they are for: the map's time is at most 1 / n of the shutter from the sample's."""
    of = scene(plate((0, 0, 0), 4.0, (0.0, 0.8, 0.0)), lights=(AMBIENT, SUN))
    free = film(of, **POINTS, shadows="off")
    lost = [
        float((free - film(of, **POINTS, shadow_map=64, shadow_strata=strata)).mean())
        for strata in (1, 4, 64)
    ]
    assert lost[0] > 0.05
    assert lost[0] > 1.5 * lost[1] > 0.0
    assert lost[2] < 0.1 * lost[0]
    assert np.abs(free - film(of, **POINTS)).max() < 1e-6  # rays need neither


def test_maps_are_the_same_again_and_differ_by_seed():
    of = CASES["both"]()
    first, again = (film(of, **POINTS, shadow_map=32) for _ in range(2))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, film(of, **POINTS, shadow_map=32, seed=1))


def test_the_plan_has_a_stage_for_maps_where_they_are_asked_for():
    of = CASES["both"]()
    mapped = mb.Settings(**POINTS, shadow_map=32)
    plan = ready_for(of, mapped, *SIZE).plan
    assert "shadow_map" in plan.stages
    assert "-DMB_SHADOW_MAP" in plan.options
    assert dict(plan.numbers)["shadow_size"] == 32
    assert "shadow_map" in mb.render(of, width=8, height=8, settings=mapped).timings
    for other in (mb.Settings(**POINTS), replace(mapped, shadows="off")):
        plan = ready_for(of, other, *SIZE).plan
        assert "shadow_map" not in plan.stages
        assert not [option for option in plan.options if "SHADOW_MAP" in option]
    with pytest.raises(mb.UsageError, match=r"shadow_map=32 with method='analytic'"):
        mb.Settings(shadow_map=32)
