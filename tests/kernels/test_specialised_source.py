"""What a scene does not call for is not in its kernels: not a word of it in the compiled source."""

from __future__ import annotations

import io
import re
from functools import lru_cache

import numpy as np
import pcpp
import pytest
from support.all_effects import SIZE, everything
from support.closed_forms import UNIT_CAMERA
from support.kernels import ready_for

import mbinterval as mb
from mbinterval.device.sources import kernel_root
from mbinterval.scene.model import Mesh, Scene

KERNELS = {"analytic": "analytic/tile.cl", "stochastic": "stochastic/tile.cl"}
WORDS = {
    "lens": r"circle|blade",
    "shutter curve": r"ShutterKey\b.*\bkey",
    "transparency": r"translucent|blend_(stack|over|places)|passed_by",
    "alpha that varies": r"alpha_at|given_alpha|vertex_alpha",
    "reflected light": r"reflected|reflect_|flat_normal",
    "flat normals over time": r"\bbend\b",
    "metallic-roughness": r"gloss(?!y)|facets",
    "emission": r"emission",
    "point and spot lights": r"LIGHT_SPOT|cone",
    "shadows": r"shadow|caster|lit\[",
    "textures": r"texture_|texel_|bilinear",
    "mirrors": r"mirror|world",
    "glossy mirrors": r"shear|tilt",
    "environments": r"sky|cube|around|irradiance",
    "layers": r"sharp|event|record_",
}
"""Words, as regular expressions, that code of an effect is full of."""


@lru_cache
def compiled(file: str, options: tuple[str, ...]) -> str:
    """Functions of a kernel file as the compiler sees them: no comments, records or constants."""
    preprocessor = pcpp.Preprocessor()
    preprocessor.line_directive = None
    preprocessor.add_path(str(kernel_root()))
    for option in options:
        name, _, value = option.removeprefix("-D").partition("=")
        preprocessor.define(f"{name} {value or 1}")
    preprocessor.parse(
        (kernel_root() / file).read_text(encoding="utf-8"), str(kernel_root() / file)
    )
    text = io.StringIO()
    preprocessor.write(text)
    assert preprocessor.return_code == 0
    return re.sub(r"(typedef struct|enum) \{[^}]*\}[^;]*;", "", text.getvalue())


def source(scene: Scene, method: str) -> str:
    plan = ready_for(scene, mb.Settings(method=method), *SIZE).plan
    return compiled(KERNELS[method], plan.options)


@lru_cache
def plain() -> Scene:
    """Moving triangles of one colour each."""
    corners = np.array([[-0.5, -0.5, -2], [0.5, -0.5, -2], [0, 0.5, -2]])
    ends = np.stack([corners, corners + [0.3, 0, 0]])
    return Scene(meshes=[Mesh(positions=ends, faces=[[0, 1, 2]], shading="unlit")],
                 camera=UNIT_CAMERA)  # fmt: skip


@pytest.mark.parametrize("effect", WORDS)
@pytest.mark.parametrize("method", KERNELS)
def test_nothing_is_compiled_of_what_a_scene_does_not_call_for(method, effect):
    found = [line for line in source(plain(), method).splitlines()
             if re.search(WORDS[effect], line, re.IGNORECASE)]  # fmt: skip
    assert found == []


@pytest.mark.parametrize("effect", [e for e in WORDS if e not in ("layers", "shutter curve")])
def test_the_words_are_those_of_the_effects(effect):
    assert re.search(WORDS[effect], source(everything(), "analytic"), re.IGNORECASE)
