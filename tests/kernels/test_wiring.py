"""What kernels take and what the host gives them: names and kinds, in all combinations of effects.

A kernel's own signature is the declaration. The host reads it from the built kernel and binds by
name, so that the order of arguments means nothing; here signatures are read from the source, for
more combinations than could be built.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from support.closed_forms import UNIT_CAMERA
from support.kernels import ready_for

import mbinterval as mb
from mbinterval.device import records
from mbinterval.device.runtime import runtime
from mbinterval.device.sources import kernel_root
from mbinterval.plan.buffers import pools, scratch
from mbinterval.scene.model import Scene

SIGNATURE = re.compile(r"^kernel void (\w+)\((.*?)\)\n\{", re.M | re.S)
PARAMETER = re.compile(r"(?:global )?(?:const )?(\w+) (\*?)(\w+)")


def signatures() -> Iterator[tuple[str, str, str]]:
    """File, name and text of the parameters of every kernel."""
    for path in sorted(kernel_root().rglob("*.cl")):
        for name, text in SIGNATURE.findall(path.read_text(encoding="utf-8")):
            yield path.relative_to(kernel_root()).as_posix(), name, text


def parameters(text: str, active: frozenset[str] | None = None) -> dict[str, str]:
    """Kinds by name, of what is there with the macros that are ``active``; None is all of them."""
    there, depth = [True], []
    for line in text.splitlines():
        if line.startswith("#if"):
            condition = re.sub(r"(\w+)\(\)", r"('\1' in active)", line.removeprefix("#if "))
            condition = condition.replace("||", " or ").replace("&&", " and ")
            holds = active is None or eval(condition, {"active": active})
            there.append(there[-1] and holds)
        elif line.startswith("#else"):
            there[-1] = there[-2] and (active is None or not there[-1])
        elif line.startswith("#endif"):
            there.pop()
        elif there[-1]:
            depth.append(line)
    found = [PARAMETER.fullmatch(part.strip()) for part in "".join(depth).split(",")]
    assert all(found), text
    return {match[3]: match[1] + match[2] for match in found}


def text_of(file: str) -> str:
    (text,) = (text for found, name, text in signatures() if (found, name) == (file, "tile"))
    return text


def test_a_name_is_of_one_kind_in_all_kernels():
    """But for those that stand for something else in each kernel."""
    own = {"given", "depths", "grid"}
    kinds: dict[str, set[str]] = {}
    for _, _, text in signatures():
        for name, kind in parameters(text).items():
            kinds.setdefault(name, set()).add(kind)
    assert len(kinds) > 80
    several = {name for name, found in kinds.items() if len(found) > 1}
    assert several == own


def test_every_kind_is_one_that_the_host_knows():
    for file, name, text in signatures():
        for kind in parameters(text).values():
            assert records.element(kind.removesuffix("*")).itemsize, (file, name, kind)


SWITCHES = {
    "analytic": (
        *("EXACT", "PLACED", "WEIGHTED", "AOV_SHARP", "AOV_OPERATIONS", "MOMENTARY"),
        *("AOV_FORWARD", "AOV_BACKWARD", "SHADOWS", "LIGHT_AROUND", "PANORAMA", "SKY", "RECORDED"),
    ),
    "stochastic": (
        *("GLOSSY", "MIRRORS", "WEIGHTED", "PATTERN_RGSS"),
        *("SHADOWS", "LIGHT_AROUND", "PANORAMA", "SKY"),
    ),
}


@pytest.mark.parametrize("method", SWITCHES)
def test_scratch_and_pools_are_those_that_the_kernel_takes_with_any_effects(method):
    scene = Scene([], camera=UNIT_CAMERA)
    plan = ready_for(scene, mb.Settings(method=method, samples=4), 32, 16).plan
    text = text_of(f"{method}/tile.cl")
    known = {name for line in text.splitlines() for name in re.findall(r"\b[A-Z][A-Z_]+\b", line)}
    assert known - {"SHADOW_MAP"} == set(SWITCHES[method])
    all_scratch = {name for name in parameters(text) if name.startswith(("sample_", "pixel_"))}
    for chosen in product([False, True], repeat=len(SWITCHES[method])):
        names = zip(SWITCHES[method], chosen, strict=True)
        active = frozenset(name for name, on in names if on)
        stages = (*plan.stages, *(("shadow",) if "SHADOWS" in active else ()))
        asked = replace(plan, active=active, stages=stages)
        taken = parameters(text, active)
        given = {name: kind for name, (kind, _) in scratch(asked).items()} | pools(asked)
        assert {name: f"{kind}*" for name, kind in given.items()}.items() <= taken.items()
        assert taken.keys() & all_scratch <= given.keys()


def test_what_is_missing_or_of_another_kind_is_refused_by_name(tmp_path):
    file = tmp_path / "takes.cl"
    file.write_text(
        '#include "shared/records.h"\n'
        "kernel void takes(global const Vertex *vertices, uint count, Frame frame,\n"
        "                  float share) {}\n"
    )
    device = runtime()
    kernel = device.kernel(str(file), "takes")
    kinds = {"vertices": "Vertex*", "count": "uint", "frame": "Frame", "share": "float"}
    assert dict(kernel.parameters) == kinds
    right = {
        "vertices": device.allocate("Vertex", 2),
        "count": 3,
        "share": 1,
        "frame": records.pack("Frame", x=0, y=0, width=1, height=1, background=0.0),
        "more": device.allocate("uint", 1),
    }
    device.run(kernel, 1, right).wait()
    wrong = {
        "vertices": device.allocate("Path", 2),
        "frame": np.zeros(1, records.TILE_GRID),
    }
    numbers = {
        "vertices": (3, 3.0, None, np.zeros(2, records.VERTEX)),
        "count": (3.7, 3.0, -1, 1 << 32, "3", None, np.zeros(2, np.uint32)),
        "frame": (3, None, np.zeros(1, np.float32)),
        "share": ("half", None, np.zeros(2, np.float32), right["frame"]),
    }
    for name, given in (*wrong.items(), *((n, v) for n, each in numbers.items() for v in each)):
        with pytest.raises(TypeError, match=f"kernel takes takes .*{name}, not"):
            device.run(kernel, 1, {**right, name: given})
    for name in ("vertices", "count", "frame"):
        less = {other: given for other, given in right.items() if other != name}
        with pytest.raises(TypeError, match=f"{name}, which is not given"):
            device.run(kernel, 1, less)
    with pytest.raises(TypeError, match="is to be read as Vertex"):
        device.upload("Vertex", np.zeros(2, records.PATH), "vertices")
    with pytest.raises(TypeError, match=r"left out: \['hight', 'height'\]|\['height', 'hight'\]"):
        records.pack("Frame", x=0, y=0, width=1, hight=1, background=0.0)
