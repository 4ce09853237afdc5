"""The five-point rule: a pixel's average from the values at its centre and beside it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.busy_scenes import busy_scene
from support.closed_forms import rectangle, scene, slab
from support.nightly import nightly

import mbinterval as mb
from mbinterval.errors import UsageError

SIZE = (40, 30)


def film(of: mb.Scene, crop: tuple[int, int, int, int] | None = None, **values: object) -> mb.Film:
    settings = mb.Settings(**{"samples": 1, "filter": "five_point"} | values)
    return mb.render(of, width=SIZE[0], height=SIZE[1], settings=settings, crop=crop)


@pytest.mark.parametrize("paths", ["exact", nightly("triangulated")])
def test_it_is_the_rule_applied_to_the_centres(paths):
    centre = film(busy_scene(), filter="box", transparent=True, paths=paths)
    c = np.pad(centre.rgba.astype(np.float64), ((1, 1), (1, 1), (0, 0)), mode="edge")
    around = c[:-2, 1:-1] + c[2:, 1:-1] + c[1:-1, :-2] + c[1:-1, 2:]
    want = (20 * c[1:-1, 1:-1] + around) / 24
    shared = film(busy_scene(), transparent=True, paths=paths)
    assert shared.rgba == pytest.approx(want, abs=1e-6)
    assert np.abs(shared.rgba - centre.rgba).max() > 0.01
    assert np.array_equal(shared.depth, centre.depth)
    assert np.array_equal(shared.intervals, centre.intervals)


def test_the_background_is_not_shared():
    image = np.random.default_rng(3).uniform(0, 1, (SIZE[1], SIZE[0], 3)).astype(np.float32)
    of = replace(busy_scene(), background=image)
    over, alone = film(of), film(of, transparent=True)
    want = alone.rgba[..., :3] + (1 - alone.rgba[..., 3:]) * image
    assert over.rgba[..., :3] == pytest.approx(want, abs=1e-6)


@pytest.mark.parametrize("crop", [(0, 0, 7, 5), (11, 9, 13, 8), (39, 29, 1, 1), (16, 0, 16, 30)])
def test_a_crop_is_a_part_of_the_frame_to_the_bit(crop):
    whole, part = film(busy_scene()), film(busy_scene(), crop)
    x, y, width, height = crop
    for name in ("rgba", "depth", "intervals"):
        want = getattr(whole, name)[y : y + height, x : x + width]
        assert np.array_equal(getattr(part, name), want), name


def test_on_a_ramp_it_is_the_pixels_average():
    first = slab(rectangle(-200, 2, -50, 80), (40, 0), 2.0, SIZE)
    across = film(scene([first]), transparent=True).rgba[15, 4:36, 3]
    edge = 2 + 40 * np.linspace(0, 1, 200001)[:, None]
    x = np.arange(4, 36)
    want = np.clip(edge - x, 0, 1).mean(axis=0)  # the pixel's part left of the edge, over time
    assert across == pytest.approx(want, abs=1e-5)


def test_it_is_nearer_to_the_truth_than_the_centre_alone():
    truth = film(busy_scene(), filter="box", samples=256).rgba

    def error(name: str) -> float:
        return float(np.sqrt(np.mean((film(busy_scene(), filter=name).rgba - truth) ** 2)))

    assert error("five_point") < 0.8 * error("box")


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"samples": 4}, "samples=1"),
        ({"pattern": "sobol"}, "pattern='fixed'"),
        ({"filter_radius": 1.0}, "has none"),
    ],
)
def test_other_samples_are_refused(values, words):
    with pytest.raises(UsageError, match=words):
        mb.Settings(**{"samples": 1, "filter": "five_point"} | values)
