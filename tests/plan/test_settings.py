"""Settings: what passes, what is stored, and what is refused, alone and together."""

from __future__ import annotations

import inspect
import re
from dataclasses import fields

import numpy as np
import pytest

from mbinterval.errors import UsageError
from mbinterval.settings.rules import ANALYTIC, METHODS, OCCLUSIONS, SAMPLED
from mbinterval.settings.settings import RULES, SETTINGS, Settings, check_setting, conflicts

WRONG = {
    "method": ["exact", None, 1, ["analytic"]],
    "paths": ["wiggly", True, np.ones(2)],
    "pairing": ["", 0],
    "occlusion": [128.0, "128", True, 48, None, [128], np.float32(64)],
    "partial_bits": [1, 0, "yes", None, np.True_],
    "max_intervals": [0, 2.0, True, "90", 2**20 + 1],
    "samples": [0, 4097, 4.0, True, "4", None, np.float64(4)],
    "pattern": ["grid", 3],
    "filter": ["gauss", 2],
    "filter_radius": [0, -1, 8.1, True, "1", float("nan"), float("inf"), [1.0]],
    "texture_samples": [0, 1025, 1.5, False],
    "motion_segments": [0, 4097, 1.0, True],
    "anisotropy": [-1, 17, 2.0, True, None],
    "shading_error": [0, -0.1, True, "0.1", None, float("nan")],
    "motion_error": [0, -0.1, True, "0.1", None, float("nan")],
    "shadows": ["none", True, None],
    "shadow_map": [0, 8193, 2.0, True],
    "shadow_strata": [0, 65, 1.0, None],
    "shadow_bias": [-1, True, "1", None, float("nan")],
    "seed": [-1, 2**32, 0.0, None],
    "transparent": [1, "no", None],
    "tile_size": [4, 16.0, True, None, "16"],
    "cull": ["box", None, True],
    "cull_tile": [0, 17, 2.0, None],
    "test": ["guess", None],
    "shading_rate": ["line", 1],
    "hybrid": [1, "yes", None],
    "frameless": [0, 65, 4.0, True],
    "slices": [0, 4097, 8.0, None],
    "slice_times": ["now", None],
    "slice_lens": ["disc", None],
    "statistics": [1, "all", None],
    "aovs": ["depht", ["uv", 1], 3, "uv;depth", {"uv": 1}],
    "cryptomatte_levels": [0, 3, 22, 6.0, None, "6"],
    "deep_tolerance": [0, -0.1, 1.5, None, "0.1", float("nan")],
    "event_steps": [0, 4097, 16.0, None],
    "aov_time": [-0.1, 1.1, None, "0.5", True, float("nan")],
}


COUNTS = {
    **dict.fromkeys(
        ("method", "samples", "pattern", "filter", "filter_radius", "motion_segments",
         "motion_error", "shadows", "seed", "transparent"),
        (METHODS, False, ()),
    ),
    "statistics": (METHODS, True, ()),
    **dict.fromkeys(
        ("paths", "pairing", "occlusion", "partial_bits", "max_intervals", "texture_samples",
         "shading_error", "anisotropy", "aovs", "aov_time"),
        (ANALYTIC, False, ()),
    ),
    "tile_size": (ANALYTIC, True, ()),
    "cryptomatte_levels": (ANALYTIC, False, ("crypto_object", "crypto_material")),
    "deep_tolerance": (ANALYTIC, False, ("deep",)),
    "event_steps": (ANALYTIC, False, ("events",)),
    **dict.fromkeys(("cull", "cull_tile"), (SAMPLED, True, ())),
    **dict.fromkeys(
        ("test", "shading_rate", "hybrid", "shadow_map", "shadow_strata", "shadow_bias"),
        (SAMPLED, False, ()),
    ),
    "frameless": (("stochastic",), False, ()),
    **dict.fromkeys(("slices", "slice_times", "slice_lens"), (("accumulation",), False, ())),
}  # fmt: skip
"""Where each setting counts: methods, whether for speed alone, and layers."""


def test_every_setting_is_here_and_explained():
    assert set(WRONG) == set(SETTINGS) == {field.name for field in fields(Settings)}
    lines = re.findall(r"^\w+(?:, \w+)*$", inspect.getdoc(Settings), re.M)
    assert {name for line in lines for name in line.split(", ")} - {"Attributes"} == set(SETTINGS)


def test_every_setting_counts_where_it_should():
    rules = {name: (rule.methods, rule.speed_only, rule.of_aovs) for name, rule in RULES.items()}
    assert rules == COUNTS


@pytest.mark.parametrize(("name", "value"), [(n, v) for n, vs in WRONG.items() for v in vs])
def test_a_wrong_value_names_the_setting_and_what_is_expected(name, value):
    with pytest.raises(UsageError, match=rf"^{name}=.*: expected ") as caught:
        Settings(**{name: value})
    assert "\n" not in str(caught.value)
    with pytest.raises(UsageError):
        check_setting(name, value)


def test_numpys_numbers_are_stored_as_pythons():
    given = Settings(
        occlusion=np.int64(128), samples=np.uint8(9), seed=np.int32(3), tile_size=np.int16(8),
        filter=np.str_("gaussian"), filter_radius=np.float32(1.5), motion_segments=np.array(2),
    )  # fmt: skip
    plain = Settings(
        occlusion=128, samples=9, seed=3, tile_size=8,
        filter="gaussian", filter_radius=1.5, motion_segments=2,
    )  # fmt: skip
    assert given == plain
    assert hash(given) == hash(plain)
    assert repr(given) == repr(plain)
    assert type(Settings(filter_radius=2).filter_radius) is float


@pytest.mark.parametrize("value", OCCLUSIONS)
def test_every_occlusion_is_taken(value):
    assert Settings(occlusion=value).occlusion == value


@pytest.mark.parametrize(
    ("values", "names", "remedy"),
    [
        ({"paths": "triangulated", "pattern": "sobol"}, ("pattern", "paths"), "pattern='fixed'"),
        ({"max_intervals": 90}, ("max_intervals", "paths"), "paths='triangulated'"),
        ({"partial_bits": True}, ("partial_bits", "occlusion"), "32 to 1024"),
        ({"filter": "five_point"}, ("filter", "samples"), "use filter='box'"),
        (
            {"filter": "five_point", "samples": 1, "pattern": "sobol"},
            ("filter", "pattern"),
            "use filter='box'",
        ),
        (
            {"filter": "five_point", "samples": 1, "filter_radius": 1.0},
            ("filter_radius", "filter"),
            "has none",
        ),
        ({"aovs": "sharp", "occlusion": 64}, ("aovs", "occlusion"), "a mask does not tell"),
        ({"aovs": "events", "occlusion": 64}, ("aovs", "occlusion"), "does not tell when"),
        ({"aovs": "events", "paths": "triangulated"}, ("aovs", "paths"), "exact in time"),
        ({"aovs": "deep", "filter": "five_point", "samples": 1}, ("aovs", "filter"), "shared"),
        ({"aovs": "crypto_object", "filter": "mitchell"}, ("aovs", "filter"), "below 0"),
        ({"aovs": "operations", "paths": "triangulated"}, ("aovs", "paths"), "paths='exact'"),
    ],
)
def test_settings_that_do_not_go_together_name_both_and_the_remedy(values, names, remedy):
    (found,) = conflicts(values)
    assert found.names == names
    with pytest.raises(UsageError, match=rf"^{names[0]}=.* with {names[1]}=.*: .*{remedy}"):
        Settings(**values)
    assert not conflicts({})


def test_an_unknown_name_is_told_the_nearest():
    with pytest.raises(UsageError, match=r"unknown name 'oclusion', did you mean occlusion\?"):
        Settings.from_mapping({"oclusion": 64})
    with pytest.raises(UsageError, match=r"unknown name 'x', known here: method, paths, "):
        Settings.from_mapping({"x": 64})
