"""Effects have one list, which kernels and host agree on, and a name that is not in it is an error.

A plain ``#if TYPO`` is silently 0 in C, and so is ``#ifdef TYPO``; ``#if TYPO()`` does not compile.
"""

from __future__ import annotations

import dataclasses
import re
import warnings
from collections.abc import Iterator

import pytest
from support.all_effects import everything
from support.closed_forms import UNIT_CAMERA
from support.kernels import ready_for
from support.oclgrind_scenes import SCENES, prepared

import mbinterval as mb
from mbinterval.device.kernel_effects import KERNEL_EFFECTS, effect_options
from mbinterval.device.opencl import opencl
from mbinterval.device.sources import kernel_root
from mbinterval.scene.model import Scene

HEADER = kernel_root() / "shared" / "effects.h"
LISTED = re.compile(r"^#define (\w+)\(\) GIVEN\(MB_(\w+)\)(?: //.*)?$", re.M)
FOLLOWS = re.compile(r"^#define (\w+)\(\) (?!GIVEN)", re.M)
CONDITION = re.compile(r"^[ \t]*#[ \t]*(?:el)?if(n?def)?\b(.*)", re.M)
GUARD = re.compile(r"\A(?:[ \t]*//.*\n|\n)*#ifndef (MB_\w+_H)\n#define \1\n")
OTHERS = {
    "shared/inlining.h": [" INLINED", " __has_warning", ' __has_warning("-Wpsabi")'],
    "stochastic/tile_of_slabs.h": [" MOST_SLABS"],
}
"""Conditions that ask of no effect: what a test may replace, and what compilers know."""

ASK = """
#include "shared/effects.h"
kernel void ask(global int *out)
{
#if %s
    out[0] = 1;
#else
    out[0] = 0;
#endif
}
"""


def devices() -> list[object]:
    """The first device of each platform that is here."""
    return [platform.get_devices()[0] for platform in opencl().get_platforms()]


def compiles(device: object, condition: str) -> bool:
    cl = opencl()
    program = cl.Program(cl.Context([device]), ASK % condition)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # some devices tell of each step
            program.build(["-cl-std=CL1.2", "-I", str(kernel_root()), "-DMB_LENS"])
    except cl.RuntimeError:
        return False
    return True


@pytest.mark.parametrize("device", devices(), ids=lambda device: device.platform.name)
def test_an_effect_that_is_misspelt_or_unknown_does_not_compile(device):
    assert compiles(device, "LENS()")
    assert compiles(device, "GLOSSY() && !SHADOWS()")
    for wrong in ("LNES()", "!LNES()", "UNHEARD_OF()"):
        assert not compiles(device, wrong)
    assert compiles(device, "LNES")  # which is why conditions have brackets


def test_kernels_and_host_have_the_same_effects():
    listed = LISTED.findall(HEADER.read_text(encoding="utf-8"))
    assert [name for name, option in listed if name != option] == []
    assert len(listed) == len(dict(listed))
    assert dict(listed).keys() == KERNEL_EFFECTS


def conditions() -> Iterator[tuple[str, str, str]]:
    """File, kind (``"def"``, ``"ndef"`` or nothing) and text of every condition but guards."""
    for path in sorted([*kernel_root().rglob("*.h"), *kernel_root().rglob("*.cl")]):
        text = GUARD.sub("", path.read_text(encoding="utf-8"))
        for kind, condition in CONDITION.findall(text):
            yield path.relative_to(kernel_root()).as_posix(), kind, condition.split(" //")[0]


def asks_of_effects(kind: str, condition: str) -> bool:
    rest = re.sub(r"\b[A-Z][A-Z_]+\(\)", "1", condition)
    return not kind and re.fullmatch(r"[1!&|() ]*", rest) is not None


def test_conditions_ask_of_effects_by_macros_with_brackets():
    asked = list(conditions())
    others = [(file, text) for file, kind, text in asked if not asks_of_effects(kind, text)]
    assert others == [(file, text) for file, texts in OTHERS.items() for text in texts]
    assert len(asked) > 500


@pytest.mark.parametrize(
    ("kind", "text"), [("def", " LENS"), ("", " LENS"), ("", " defined(LENS)"), ("", " TILE > 8")]
)
def test_a_condition_that_a_misspelling_would_turn_off_is_found(kind, text):
    assert not asks_of_effects(kind, text)
    assert asks_of_effects("", " LENS() && !(GLOSSY() || SKY())")


def test_every_effect_is_asked_of_somewhere():
    text = HEADER.read_text(encoding="utf-8")
    follow = {name: line for line in text.splitlines() for name in FOLLOWS.findall(line)}
    asked = {name for _, _, each in conditions() for name in re.findall(r"(\w+)\(\)", each)}
    told = {name for line in follow.values() for name in re.findall(r"(\w+)\(\)", line)[1:]}
    assert KERNEL_EFFECTS | follow.keys() == asked | told


def test_every_effect_is_called_for_by_some_scene():
    plans = [prepared(small).plan for small in SCENES.values()]
    plans.append(ready_for(everything(), mb.Settings(), 32, 16).plan)  # colours as often as needed
    called_for = set().union(*(plan.active for plan in plans))
    assert called_for == KERNEL_EFFECTS - {"CLANG_BUILTINS"}  # which depends on the device


def test_an_effect_that_the_kernels_lack_has_no_option():
    plan = ready_for(Scene([], camera=UNIT_CAMERA), mb.Settings(), 32, 16).plan
    assert set(effect_options(plan.active)) < set(plan.options)
    wrong = dataclasses.replace(plan, active=plan.active | {"UNHEARD_OF"})
    with pytest.raises(LookupError, match="no effect of the kernels: UNHEARD_OF"):
        assert wrong.options


def test_no_two_headers_have_one_name():
    names = [path.name for path in kernel_root().rglob("*.h")]
    assert len(names) > 40
    assert sorted(set(names)) == sorted(names)
