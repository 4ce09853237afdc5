"""What time depends on beside settings: cubes, speed, triangles, and the effects of a scene.

One setting of each method is measured on changed scenes. No errors are looked at.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from mbinterval.bench.bench import Brevity, measure
from mbinterval.bench.cases import Case
from mbinterval.bench.meter import MeteredRuntime
from mbinterval.film.film import Film
from mbinterval.plan.effects import Effect
from mbinterval.plan.prepare import prepare
from mbinterval.scene.generators import ho17_cubes
from mbinterval.scene.model import Mesh, Scene
from mbinterval.settings.settings import Settings
from mbinterval.study.sweeps import ACCUMULATION, EXACT, PUBLISHED, STOCHASTIC
from mbinterval.study.switches import SWITCHES, at_middle

METHODS: dict[str, dict[str, Any]] = {
    "exact, 1 sample": {**EXACT, "samples": 1},
    "published, 1 sample": {**PUBLISHED, "samples": 1},
    "stochastic, 64 samples": {**STOCHASTIC, "samples": 64},
    "accumulation, 64 slices": {**ACCUMULATION, "samples": 1, "slices": 64},
}
"""Settings of each method by name."""

_BREVITY = Brevity(1.5)
_CUBES = (250, 500, 1000, 2000, 4000)
_SPEEDS = (0.25, 0.5, 1.0, 2.0, 4.0)
_MOST_TRIANGLES = 200_000


def curve(name: str, case: Case, rounds: int, meter: MeteredRuntime) -> dict[str, Any]:
    """Measure ``METHODS`` along a curve of `CURVES`.

    Returns
    -------
    ``title``, ``axis``, and ``points`` with their ``x`` and a row for each method (see
    `mbinterval.bench.bench.measure`).
    """
    title, axis, cases_of = CURVES[name]
    cases = dict(cases_of(case))
    found = measure(list(cases.values()), METHODS, rounds, meter, brevity=_BREVITY)
    points = [
        {"x": x, "triangles": scene["triangles"], "rows": scene["rows"]}
        for x, scene in zip(cases, found["scenes"], strict=True)
    ]
    return {"title": title, "axis": axis, "points": points}


def _cubes(case: Case) -> Iterable[tuple[float, Case]]:
    for count in _CUBES:
        yield count, replace(case, scene=ho17_cubes(count), frame=1.0, settings={})


def _speeds(case: Case) -> Iterable[tuple[float, Case]]:
    for speed in _SPEEDS:
        yield speed, replace(case, scene=at_speed(case.scene, speed))


def _triangles(case: Case) -> Iterable[tuple[float, Case]]:
    scene = case.scene
    while True:
        count = sum(len(mesh.faces) for mesh in scene.meshes)
        yield count, replace(case, scene=scene)
        finer = split_in_four(scene)
        more = sum(len(mesh.faces) for mesh in finer.meshes)
        if more == count or more > _MOST_TRIANGLES:
            return
        scene = finer


CURVES: dict[str, tuple[str, str, Callable[[Case], Iterable[tuple[float, Case]]]]] = {
    "cubes": ("time against the number of cubes, as in Hong & Oh's figure 15", "cubes", _cubes),
    "speed": ("time against the speed of motion", "times the scene's speed", _speeds),
    "triangles": ("time against triangles, the same surfaces split", "triangles", _triangles),
}
"""Title, axis, and the changed scenes of each curve, by its name."""


def at_speed(scene: Scene, speed: float) -> Scene:
    """Let everything move ``speed`` times as far while the shutter is open.

    The shutter is open for as many times as long, around the same moment; positions that are given
    over the shutter are drawn away from its middle.
    """
    shutter = scene.shutter
    middle, half = (shutter.open + shutter.close) / 2.0, (shutter.close - shutter.open) / 2.0
    changed: dict[str, Any] = {"open": middle - speed * half, "close": middle + speed * half}
    if shutter.line_exposure is not None:
        changed["line_exposure"] = speed * shutter.line_exposure
    meshes = []
    for mesh in scene.meshes:
        if mesh.times > 1:
            still = at_middle(mesh.positions)
            mesh = replace(mesh, positions=still + speed * (mesh.positions - still))
        meshes.append(mesh)
    return replace(scene, meshes=meshes, shutter=replace(shutter, **changed))


def split_in_four(scene: Scene) -> Scene:
    """Split each triangle at the middles of its edges: the same picture of more triangles.

    Meshes that a deformer moves stay as they are.
    """
    return replace(scene, meshes=[m if m.deformer else _split(m) for m in scene.meshes])


def _split(mesh: Mesh) -> Mesh:
    faces, count = mesh.faces, mesh.positions.shape[-2]
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    unique, inverse = np.unique(edges, axis=0, return_inverse=True)
    (a, b, c), (ab, bc, ca) = faces.T, inverse.reshape(-1, 3).T + count
    parts = np.stack([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]])
    changed: dict[str, Any] = {"faces": parts.transpose(2, 0, 1).reshape(-1, 3).astype(np.int32)}

    def with_middles(values: Any) -> Any:
        middles = 0.5 * (values[..., unique[:, 0], :] + values[..., unique[:, 1], :])
        return np.concatenate([values, middles], axis=-2)

    for name in ("positions", "normals", "uv"):
        values = getattr(mesh, name)
        if values is not None:
            changed[name] = with_middles(values)
    if mesh.color is not None and mesh.color_domain == "face":
        changed["color"] = np.repeat(mesh.color, 4, axis=0)
    elif mesh.color is not None and mesh.color_domain == "vertex":
        changed["color"] = with_middles(mesh.color)
    return replace(mesh, **changed)


def effects(
    case: Case,
    rounds: int,
    meter: MeteredRuntime,
    keep: Callable[[str, Film], str] | None = None,
) -> list[dict[str, Any]]:
    """Measure the scene as it is, and with each of its effects switched off in turn.

    ``keep`` stores a film of exact time, by the effect that is off ("" for none), and tells where.

    Returns
    -------
    For each, the scene as it is first: ``effect``, why the scene calls for it (``reason``), what
    was done to switch it off (``off``), a row for each of `METHODS`, and its ``film`` if it was
    kept.
    """
    found = [_effect(case, ("", "", "the scene as it is"), rounds, meter, keep)]
    for effect in active_effects(case):
        if effect.name not in SWITCHES:
            continue
        off, switch = SWITCHES[effect.name]
        without = replace(case, scene=switch(case.scene, case.frame))
        found.append(_effect(without, (effect.name, effect.reason, off), rounds, meter, keep))
    return found


def _effect(
    case: Case,
    told: tuple[str, str, str],
    rounds: int,
    meter: MeteredRuntime,
    keep: Callable[[str, Film], str] | None,
) -> dict[str, Any]:
    films: list[Film] = []  # of the rows, in their order

    def figures(_row: str, film: Film) -> dict[str, Any]:
        films.append(film)
        return {}

    measured = measure([case], METHODS, rounds, meter, figures, _BREVITY)["scenes"][0]
    entry = dict(zip(("effect", "reason", "off"), told, strict=True), rows=measured["rows"])
    if keep is not None and films and "median" in measured["rows"][0]:
        entry["film"] = keep(told[0], films[0])
    return entry


def active_effects(case: Case) -> list[Effect]:
    """Effects that exact time has in the scene, in the order of the pipeline."""
    settings = Settings.from_mapping(METHODS["exact, 1 sample"])
    ready = prepare(case.scene, case.frame, case.width, case.height, settings)
    return [effect for effect in ready.plan.effects if effect.active]
