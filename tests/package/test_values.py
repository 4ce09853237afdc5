"""Checks of single values: what passes, what is stored, and what the message says."""

from __future__ import annotations

import numpy as np
import pytest

from mbinterval.errors import SceneError, UsageError
from mbinterval.values import choice, instance, number, shown, whole_number


@pytest.mark.parametrize("value", [16, np.int64(16), np.uint8(16), np.array(16)])
def test_whole_numbers_of_every_kind_are_stored_as_int(value):
    assert type(whole_number(value, "tile", 1, 32)) is int
    assert whole_number(value, "tile", 16, 16) == 16


@pytest.mark.parametrize("value", [16.0, np.float32(16), True, np.True_, "16", None, 0, 33, [16]])
def test_what_is_no_whole_number_in_range_is_refused(value):
    with pytest.raises(UsageError, match=r"^tile=.*: expected a whole number from 1 to 32$"):
        whole_number(value, "tile", 1, 32)
    with pytest.raises(SceneError, match="from 1 up"):
        whole_number(0, "tile", 1, error=SceneError)


@pytest.mark.parametrize("value", [2, 2.0, np.float32(2), np.int8(2), np.array(2.0)])
def test_numbers_of_every_kind_are_stored_as_float(value):
    assert type(number(value, "fps")) is float
    assert number(value, "fps", 2, 2) == 2


@pytest.mark.parametrize(
    "value", [0, 8.5, "a", None, True, np.True_, 1j, np.nan, np.inf, [1.0], np.ones(1), 10**400]
)
def test_what_is_no_number_in_range_is_refused(value):
    with pytest.raises(UsageError, match=r"^size=.*: expected a number above 0 and up to 8$"):
        number(value, "size", above=0, high=8)
    for unbound in ("a", np.nan, -np.inf, 10**400):
        with pytest.raises(UsageError, match=r"expected a finite number$"):
            number(unbound, "size")


def test_choices_and_instances():
    assert choice("box", ("box", "plane"), "kind") == "box"
    for value in ("cube", 3, None, np.ones(2), ["box"]):
        with pytest.raises(UsageError, match=r"^kind=.*: expected one of 'box', 'plane'$"):
            choice(value, ("box", "plane"), "kind")
    assert instance(True, bool, "flag") is True
    for value in (1, np.True_, None):
        with pytest.raises(UsageError, match=r"^flag=.*: expected True or False$"):
            instance(value, bool, "flag")


def test_long_values_are_shown_in_one_short_line():
    text = shown(np.arange(10000).reshape(100, 100))
    assert len(text) == 60
    assert "\n" not in text
    assert text.endswith("...")
