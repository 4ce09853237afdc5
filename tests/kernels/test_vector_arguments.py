"""Vectors pass between functions in no way that depends on how wide the CPU's registers are.

Only what is inlined takes or returns them; and compilers for CPUs with narrow registers, which most
laptops have, say nothing of them.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

import pytest
from support import oclgrind_scenes
from support.nightly import nightly
from support.processes import python

from mbinterval.device.choose import choose_device
from mbinterval.device.sources import kernel_root

BUILT_IN = r"(?:u?int|float)(?:8|16)|(?:u?long|double)(?:3|4|8|16)|u?short16"
"""OpenCL's types that are wider than four floats, as the narrowest registers of x86 are."""
FUNCTION = re.compile(r"^(?!kernel |#)([A-Za-z][\w *]*?)\b(\w+)\(([^;{}()]*)\)\s*\{", re.M)


def texts() -> list[str]:
    """All kernel files, without comments."""
    files = [path for path in kernel_root().rglob("*") if path.suffix in (".h", ".cl")]
    return [re.sub(r"//.*|\\\n", "", path.read_text(encoding="utf-8")) for path in files]


def vectors(sources: Iterable[str]) -> re.Pattern[str]:
    """What finds a type that is a wide vector."""
    pattern = re.compile(rf"typedef (?:{BUILT_IN}) (\w+);")
    names = {name for source in sources for name in pattern.findall(source)}
    return re.compile(rf"\b(?:{'|'.join([BUILT_IN, *sorted(names)])})\b")


def passed_by_value(sources: Iterable[str], wide: re.Pattern[str]) -> list[tuple[str, bool]]:
    """Functions that take or return wide vectors, and whether they are inlined."""
    found = []
    for source in sources:
        for head, name, parameters in FUNCTION.findall(source):
            passed = [head, *parameters.split(",")]
            if any(wide.search(part) and not re.search(r"[*\[]", part) for part in passed):
                found.append((name, "INLINED" in head.split()))
    return found


def test_what_takes_or_returns_a_wide_vector_is_inlined():
    sources = texts()
    wide = vectors(sources)
    assert {"Lanes", "LaneMask", "LaneDoubles", "Doubles"} <= set(wide.pattern[5:-3].split("|"))
    functions = passed_by_value(sources, wide)
    assert len(functions) > 140
    assert [name for name, inlined in functions if not inlined] == []


OF_A_WIDTH = re.compile(
    r"\b(?:(?:u?(?:char|short|int|long)|float|double)(?:8|16)|v(?:load|store)(?:8|16)"
    r"|(?:convert|as)_\w*?(?:8|16)(?:_\w+)?)\b|\.(?:s(?!eed\b)[0-9a-fA-F]+|lo|hi|even|odd)\b"
)
"""What says how many lanes a vector has: types, loads and stores, conversions, single lanes."""


def test_only_one_header_knows_how_wide_vectors_are():
    root = kernel_root()
    found = [
        f"{path.relative_to(root)}: {line.strip()}"
        for path in sorted([*root.rglob("*.h"), *root.rglob("*.cl")])
        for line in re.sub(r"//.*", "", path.read_text(encoding="utf-8")).splitlines()
        if OF_A_WIDTH.search(line)
    ]
    assert [line for line in found if not line.startswith("shared/lanes.h: ")] == []
    assert len(found) > 20


@pytest.mark.parametrize("line", [
    "float16 a;", "vload8(0, p)", "vstore16(a, 0, p)", "convert_int8_sat(a)", "as_uint16(a)",
    "b.s0", "b->x.sf + 1", "b.s0123", "a.lo",
])  # fmt: skip
def test_a_vector_of_a_width_is_found(line):
    assert OF_A_WIDTH.search(line)
    assert not OF_A_WIDTH.search("float4 a = vload4(0, p); b.seed + c.slack + d.x")


def test_a_function_that_is_not_inlined_is_found():
    wide = vectors(["typedef float16 Lanes;"])
    wrong = """
static inline Lanes first(int a) { return a; }
static float second(const float *b,
                    Lanes a)
{
}
NOT_INLINED static void third(double3 a) { }
"""
    right = """
static INLINED Lanes first(Lanes a) { return a; }
static void second(const Lanes *a, Lanes many[2], float4 narrow) { }
kernel void third(global Lanes *a) { }
"""
    assert passed_by_value([wrong], wide) == [("first", False), ("second", False), ("third", False)]
    assert passed_by_value([right], wide) == [("first", True)]


SCENES = {
    "analytic/tile.cl": ("environment", "shadows, layers", "triangulated"),
    "stochastic/tile.cl": ("stochastic, glossy mirrors", "stochastic, shadow map"),
    "stochastic/shadow_map.cl": ("stochastic, shadow map",),
    "stochastic/rgss.cl": ("stochastic, rotated grid",),
}
"""Scenes whose plans have the options of these files; the others have enough without."""

COMPILE = """
import sys
import pyopencl as cl
from mbinterval.device.choose import choose_device
from mbinterval.device.pocl_cpu import _write
from mbinterval.device.sources import kernel_root
device = choose_device()
cpu, *files = sys.argv[1:]
if cpu:
    assert _write(device.int_ptr, cpu)
for given in files:
    file, *options = given.split(" ")
    program = cl.Program(cl.Context([device]), f'#include "{file}"')
    program.compile(["-cl-std=CL1.2", "-I", str(kernel_root()), *options])
    print(program.get_build_info(device, cl.program_build_info.LOG), flush=True)
"""


def programs() -> list[str]:
    """All kernel files with options, some more than once."""
    root = kernel_root()
    files = [p for p in root.rglob("*.cl") if re.search("^kernel void", p.read_text(), re.M)]
    return [
        " ".join([file, *options])
        for file in sorted(path.relative_to(root).as_posix() for path in files)
        for options in map(options_of, SCENES.get(file, [""]))
    ]


def options_of(scene: str) -> tuple[str, ...]:
    return oclgrind_scenes.ready_for(oclgrind_scenes.SCENES[scene]).plan.options if scene else ()


@pytest.mark.parametrize("cpu", ["penryn", nightly("haswell")])
def test_compiling_for_narrower_registers_says_nothing(cpu):
    """Of PoCL 3.0, which can be told of another CPU; other devices compile for their own."""
    if "PoCL 3.0" not in choose_device().platform.version:
        cpu = ""
    run = python("-W", "ignore", "-c", COMPILE, cpu, *programs())
    assert (run.returncode, run.stderr) == (0, "")
    assert "warning" not in run.stdout.lower()  # some compilers tell of what went well
