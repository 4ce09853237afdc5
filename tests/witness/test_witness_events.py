"""Events against the witness: what is seen when, exposures made of them, and an event camera's.

Random scenes of unlit surfaces, sampled at pixels' centres, so that brightness changes where
visibility does: every event is looked for where it begins and ends, parts of the exposure are what
the witness exposes for so long, and reports keep their definition (``streams.py`` says how). Events
of everything else are among the scenes of ``test_witness.py``.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from reference.witness import streams
from reference.witness.compare import compare
from reference.witness.judge import judge
from reference.witness.product import (
    Camera,
    Film,
    Material,
    Mesh,
    Scene,
    Settings,
    Shutter,
    Texture,
    Track,
    Transform,
    films,
    render,
)
from reference.witness.scenes import SIZE, Case, Effects, Recipe, build
from support.nightly import nightly

EFFECTS = (
    Effects(layers="events", sampling="centre", color="face"),
    Effects(layers="events", sampling="centre", rolling="rows", camera="moving"),
    Effects(layers="events", sampling="centre", alpha="blend", curve="curve"),
    Effects(layers="events", sampling="centre", mirror="flat", sides="single"),
)
FACES = [[0, 1, 2], [0, 2, 3]]
THRESHOLDS = (0.2, 0.07)


def rendered(effects: Effects, seed: int) -> tuple[Case, Film]:
    case = build(Recipe(effects, seed))
    return case, films(case.scene, case.frame, SIZE, 1, **case.settings)[0]


def wrong(case: Case, events: Any) -> list[str]:
    """What is wrong with the events of a film of pixels' centres."""
    found = streams.wrong_events(case.scene, case.frame, SIZE, events)
    for threshold in THRESHOLDS:
        found += streams.wrong_reports(case.scene, case.frame, SIZE, events, threshold)
    return found


@pytest.mark.parametrize("count", [6, nightly(100)])
@pytest.mark.parametrize("effects", EFFECTS, ids=str)
def test_events_are_what_the_witness_sees(effects, count):
    for seed in range(count):
        case, film = rendered(effects, seed)
        assert not (found := wrong(case, film.events)), (seed, found)
        result = compare(case, given=[film])
        assert result.agrees, (seed, result)


def changed(events: Any, **columns: np.ndarray) -> Any:
    return replace(events, columns=dict(events.columns) | columns)


def test_events_that_are_late_elsewhere_or_of_another_face_are_told():
    case, film = rendered(EFFECTS[0], 5)
    events = film.events
    t0, t1 = (np.clip(events[name] + np.float32(0.02), 0.0, 1.0) for name in ("t0", "t1"))
    assert streams.wrong_events(case.scene, case.frame, SIZE, changed(events, t0=t0, t1=t1))
    deeper = changed(events, z0=events["z0"] * np.float32(1.01))
    assert streams.wrong_events(case.scene, case.frame, SIZE, deeper)
    counts = np.array([len(mesh.faces) for mesh in case.scene.meshes])
    other = changed(events, face=(events["face"] + 1) % counts[events["object"] - 1])
    assert streams.wrong_events(case.scene, case.frame, SIZE, other)


def test_reports_of_light_that_is_late_or_weaker_are_told():
    case, film = rendered(EFFECTS[0], 5)
    for changes in (
        {name: np.clip(film.events[name] - np.float32(0.05), 0.0, 1.0) for name in ("t0", "t1")},
        {name: film.events[name] * np.float32(0.8) for name in "rgb"},
    ):
        events = changed(film.events, **changes)
        assert streams.wrong_reports(case.scene, case.frame, SIZE, events)


def test_a_part_of_the_exposure_that_is_late_by_a_hundredth_is_told():
    case, film = rendered(EFFECTS[0], 8)
    asked = replace(case.asked, strata=64)

    def exposed(part: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
        return streams.re_exposed(case.scene, case.frame, SIZE, asked, [film.events], part)

    shown, seen = exposed((0.25, 0.5))
    assert judge(shown, seen, 1e-3, 2e-3).p > 1e-7
    assert judge(exposed((0.26, 0.51))[0], seen, 1e-3, 2e-3).p < 1e-7


def test_seven_exposures_of_one_render_are_those_of_shutters_that_follow_each_other():
    """The README's example, at parts where no colour changes but is told so often."""
    for seed in (4, 5):
        case, film = rendered(EFFECTS[0], seed)
        parts = tuple((k / 7, (k + 1) / 7) for k in range(7))
        result = compare(replace(case, parts=parts), given=[film])
        assert len(result.verdicts) > 9
        assert result.agrees, result


# Where the product and the definition are known to differ.


def known(reason: str) -> Any:
    return pytest.mark.xfail(strict=True, raises=AssertionError, reason=reason)


def crossing(material: Material, keys: Track, half: float = 0.5, **given: Any) -> Scene:
    corners = [[-half, -0.5, 0], [half, -0.5, 0], [half, 0.5, 0], [-half, 0.5, 0]]
    mesh = Mesh(corners, FACES, material=material, transform=Transform(translation=keys), **given)
    camera = Camera(position=(0, 0, 5), fov=33.4)
    return Scene([mesh], camera, background=(0.1, 0.1, 0.1), shutter=Shutter(0.0, 1.0))


@known("issue 23: a step of many thresholds is cut by rounding, and one report is lost")
def test_what_ends_as_bright_as_it_began_has_reported_as_many_rises_as_falls():
    plate = crossing(Material(shading="unlit"), Track([0.0, 1.0], [[-1.5, 0, 0], [1.5, 0, 0]]))
    settings = Settings(samples=4, aovs=("events",))
    events = render(plate, frame=0.0, width=40, height=30, settings=settings).events
    found = events.brightness_changes(0.2, background=plate.background)
    net = np.zeros((30, 40), int)
    np.add.at(net, (found["y"], found["x"]), found["polarity"])
    ends = [events.integrate(*part)[..., 3] for part in ((0.0, 1e-6), (1.0 - 1e-6, 1.0))]
    same = (ends[0] < 1e-3) & (ends[1] < 1e-3)
    assert not net[same].any()


@pytest.mark.parametrize("steps", [1, 4])
@known("issue 23: brightness that changes gradually is told in steps of the exposure's parts")
def test_brightness_that_changes_gradually_is_reported_when_it_has_changed(steps):
    u = np.arange(256) / 256
    stripes = np.tile((0.5 + 0.45 * np.sin(2.0 * np.pi * u))[None, :, None], (4, 1, 3))
    scene = crossing(
        Material(shading="unlit", texture=Texture(stripes.astype(np.float32))),
        Track([0.0, 1.0], [[0, 0, 0], [0.5, 0, 0]]), half=4.0,
        uv=np.array([[0, 0], [16, 0], [16, 1], [0, 1.0]]),
    )  # fmt: skip
    settings = Settings(samples=1, aovs=("events",), event_steps=steps)
    events = render(scene, frame=0.0, width=8, height=6, settings=settings).events
    assert not streams.wrong_reports(scene, 0.0, (8, 6), events, gradual=True)
