"""Shipped scenes render to the films that are kept; `reports/first_light.py` does all of them."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "reports"))

import first_light

from mbinterval.device.choose import choose_device


@pytest.fixture(scope="module")
def device():
    return first_light.FirstRuntime(choose_device())


def test_a_film_of_every_row_is_kept():
    kept = first_light.kept_films()
    assert kept.keys() == {row.name for row in first_light.ROWS}
    shipped = {path.stem for path in first_light.SCENES.glob("*.toml")}
    assert {row.scene for row in first_light.ROWS} == shipped
    colours = [film[..., :4] for film in kept.values()]
    assert all(np.isfinite(rgba).all() and rgba[..., 3].max() > 0 for rgba in colours)


@pytest.mark.parametrize("row", first_light.ROWS[2::6], ids=lambda row: row.name)
def test_films_are_those_that_are_kept(device, row):
    (difference,) = first_light.compare(device, first_light.kept_films(), [row])
    assert difference.held, (difference.rmse, difference.largest)


def test_a_film_that_is_half_a_percent_off_does_not_hold(device):
    row = first_light.ROWS[2]
    off = {row.name: first_light.kept_films()[row.name] * np.float32(1.005)}
    (difference,) = first_light.compare(device, off, [row])
    assert not difference.held
