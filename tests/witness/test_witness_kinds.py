"""One fixed scene of each kind agrees with the witness, which tells small errors of it.

Of all kinds a shutter a hundredth late and a film that is 1 % brighter are told from noise.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from reference.witness.compare import LEVEL, compare
from reference.witness.film import film
from reference.witness.judge import judge
from reference.witness.kinds import KINDS, kind_case
from reference.witness.product import colors, films
from reference.witness.scenes import SIZE, Case
from support.nightly import nightly_but

DAILY = ("textures", "shadows of a sun", "transparency", "glossy mirrors", "blades",
         "rolling left or right", "layers of a moment", "environment behind",
         "five-point rule")  # fmt: skip

TOLD = 1e-5
"""Probability below which a film with an error counts as told apart."""


def late(case: Case, part: float) -> Case:
    """With a shutter that is late by a part of its length."""
    shutter = case.scene.shutter
    length = shutter.close - shutter.open
    if shutter.rolling is not None:
        length = shutter.line_exposure * case.scene.fps
    moved = replace(shutter, open=shutter.open + part * length, close=shutter.close + part * length)
    return replace(case, scene=replace(case.scene, shutter=moved))


@pytest.mark.parametrize("name", nightly_but(KINDS, *DAILY))
def test_kind(name):
    case = kind_case(name, KINDS[name].seed, KINDS[name].strata)
    given = films(case.scene, case.frame, SIZE, case.repeats, **case.settings)
    result = compare(case, given=given)
    assert result.agrees, result
    shifted = late(case, 0.01)
    others = films(shifted.scene, case.frame, SIZE, case.repeats, **case.settings)
    seen = film(case.scene, case.frame, SIZE, case.asked).rgba
    # The same instants and places of a late shutter: what a late film would differ by.
    along = (film(shifted.scene, case.frame, SIZE, case.asked).rgba - seen).mean(axis=0)
    allowed, rare = case.allowed / 10.0, 2.0 / (case.asked.strata * case.asked.repeats)
    assert judge(colors(given), seen, case.allowed, rare, along).p > LEVEL
    assert judge(colors(others), seen, allowed, rare, along).p < TOLD
    brighter = colors(given) * np.float64(1.01)
    assert judge(brighter, seen, allowed, rare, seen.mean(axis=0)).p < TOLD
