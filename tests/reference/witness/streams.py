"""Streams of events against the witness: what they add up to, what they say at a moment, reports.

The README promises that events are what the film is the sum of, that an integral over a part of
the exposure is what a render of that exposure is, and that an event camera's reports tell each time
that the logarithm of a pixel's brightness has changed by a threshold since its last report.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from . import camera as cameras
from . import exposure
from . import film as films
from .cast import Triangles
from .film import Asked
from .judge import Verdict, judge
from .motion import freeze
from .shade import World

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Of linear Rec. 709."""
FLOOR = 1e-3
"""Added to luminance before its logarithm is taken."""
INSTANTS = 96
"""At which brightness is looked at; reports within one of these steps are at the same time."""
PATH_ERROR = 2e-3
MARGIN = 0.01
"""Parts of the exposure before and after an event's ends at which it is looked for."""
FAR_OFF = 5e-3
"""Of an event's depth at its ends, but for what path errors do to it."""
STATES = (0.131, 0.5, 0.83)
"""Moments at which events say what is seen."""


def added_up(events: Any) -> np.ndarray:
    """The film without background: the sum of weight times colour, ``(H, W, 4)``."""
    shape = events.shape[:2]
    sums = [np.bincount(events.pixel, events["weight"] * events[name], shape[0] * shape[1])
            for name in "rgba"]  # fmt: skip
    return np.stack(sums, axis=-1).reshape(*shape, 4)


def at_moment(events: Any, moment: float, meshes: int) -> np.ndarray:
    """Alpha that each mesh adds at a part of the exposure, ``(H, W, meshes)``."""
    shape = events.shape[:2]
    on = np.flatnonzero((events["t0"] <= moment) & (events["t1"] > moment))
    place = events.pixel[on] * meshes + events["object"][on] - 1
    alpha = events["share"][on] * events["a"][on]
    return np.bincount(place, alpha, shape[0] * shape[1] * meshes).reshape(*shape, meshes)


def re_exposed(
    scene: Any, frame: float, size: tuple[int, int], asked: Asked, events: list[Any], part: Any
) -> tuple[np.ndarray, np.ndarray]:
    """``(R, H, W, 4)`` of integrals over a part of the exposure, and of the witness's films."""
    seen = films.film(scene, frame, size, replace(asked, part=part, transparent=True))
    return np.stack([stream.integrate(*part) for stream in events]), seen.rgba


def judged(case: Any, size: tuple[int, int], given: list[Any], slack: Any) -> dict[str, Verdict]:
    """Verdicts of re-exposed shutters and of moments, of the films of a case."""
    streams = [film.events for film in given]
    rare = 2.0 / (case.asked.strata * case.asked.repeats)
    found = {}
    for part in case.parts:
        shown, seen = re_exposed(case.seen, case.frame, size, case.asked, streams, part)
        name = f"exposed from {part[0]:g} to {part[1]:g}"
        found[name] = judge(shown, seen, case.allowed + slack / (part[1] - part[0]), rare)
    for moment in STATES if case.effects.steady else ():
        shown = np.stack([at_moment(stream, moment, len(case.scene.meshes)) for stream in streams])
        found[f"seen at {moment:g}"] = _judged_moment(case, size, shown, moment)
    return found


def _judged_moment(case: Any, size: tuple[int, int], shown: np.ndarray, moment: float) -> Verdict:
    asked = replace(case.asked, moment=moment)
    if asked.centre:
        asked = replace(asked, strata=1, repeats=1)
    seen = films.film(case.seen, case.frame, size, asked).cover
    if not asked.centre:
        return judge(shown, seen, 2.0 * PATH_ERROR, 2.0 / (asked.strata * asked.repeats))
    slack = np.zeros(seen.shape[1:])
    for moved in _shifted(asked):
        other = films.film(case.seen, case.frame, size, moved).cover
        slack = np.maximum(slack, np.abs(other - seen)[0])
    # Two noiseless sides: the second of them twice, so that something is a variance.
    return judge(shown, np.repeat(seen, 2, axis=0), 1e-3 + slack)


def _shifted(asked: Asked) -> list[Asked]:
    """The same with all places moved by as much as paths may be off."""
    steps = ((1, 0), (-1, 0), (0, 1), (0, -1))
    return [replace(asked, shift=tuple(PATH_ERROR * part for part in step)) for step in steps]


def wrong_sums(case: Any, given: list[Any]) -> list[str]:
    """Whether events add up to their film, in words."""
    if case.scene.environment is not None or np.ndim(case.scene.background) == 3:
        return []
    away = 0.0
    for film in given:
        own = film.rgba.astype(np.float64)
        own[..., :3] -= (1.0 - own[..., 3:]) * np.asarray(case.scene.background)
        away = max(away, float(np.abs(added_up(film.events) - own).max()))
    return [f"events: their sum is off by {away:.1e}"] if away > case.allowed else []


def levels(scene: Any, frame: float, size: tuple[int, int], asked: Asked) -> np.ndarray:
    """Logarithms ``(T, H, W)`` of brightness at the moments that are asked for."""
    return np.log(films.film(scene, frame, size, asked).rgba[..., :3] @ LUMINANCE + FLOOR)


def wrong_reports(
    scene: Any,
    frame: float,
    size: tuple[int, int],
    events: Any,
    threshold: float = 0.2,
    gradual: bool = False,
) -> list[str]:
    """What reports of `brightness_changes` do not keep of their definition, in words.

    At every moment the reports so far tell the logarithm of brightness to less than a threshold,
    and each was due: brightness had changed by all that is reported at its time. Where brightness
    changes at once, moments count that are no nearer to that than `INSTANTS` tells, and path errors
    leave; where it is ``gradual`` all do, to what it changes by from one of them to the next.
    """
    times = np.append(1e-6, (np.arange(INSTANTS) + 0.5) / INSTANTS)
    asked = Asked(1, len(times), centre=True, moment=tuple(times))
    level = levels(scene, frame, size, asked)
    steps = np.abs(np.diff(level, axis=0, prepend=level[:1], append=level[-1:]))
    slack = np.maximum(steps[:-1], steps[1:])
    sure = np.ones_like(level, bool)
    if not gradual:
        for moved in _shifted(asked):
            sure &= np.abs(levels(scene, frame, size, moved) - level) < 1e-6
        sure &= slack < 1e-6
    found = events.brightness_changes(threshold, background=scene.background, floor=FLOOR)
    place, wrong = found["y"] * size[0] + found["x"], []
    for pixel in np.flatnonzero(sure[0].ravel()):
        y, x = divmod(int(pixel), size[0])
        mine = place == pixel
        here = events.pixel == pixel
        ends = np.unique([events["t0"][here], events["t1"][here]])
        looked = _Looked(times, level[:, y, x], sure[:, y, x], slack[:, y, x], ends)
        text = looked.wrong(found["t"][mine], found["polarity"][mine], threshold)
        wrong += [f"events: pixel ({x}, {y}): {text}"] if text else []
    return wrong[:1] + ([f"and {len(wrong) - 1} more pixels"] if len(wrong) > 1 else [])


@dataclass(frozen=True, eq=False)
class _Looked:
    """A pixel at ``times`` ``(T,)``: its brightness' logarithm, if that is sure, and how much.

    ``ends`` are where its events begin and end.
    """

    times: np.ndarray
    level: np.ndarray
    sure: np.ndarray
    slack: np.ndarray
    ends: np.ndarray

    def wrong(self, when: np.ndarray, signs: np.ndarray, threshold: float) -> str:
        """What is wrong with reports ``when`` and in which direction, in words."""
        margin = threshold * (1.0 + 1e-3) + self.slack
        told = self.level[0] + threshold * np.array([signs[when <= t].sum() for t in self.times])
        away = np.where(self.sure, np.abs(self.level - told) - margin, -1.0)
        if away.max() > 0.0:
            worst = away.argmax()
            return (
                f"at {self.times[worst]:.3f} reports are {self.level[worst] - told[worst]:+.3f} off"
            )
        before = self.level[0]
        for t in np.unique(when):
            many = int(signs[when == t].sum())
            after = int(np.searchsorted(self.times, t, side="right"))
            alone = after < len(self.times) and self.sure[after]
            if alone and not np.any((self.ends > t + 1e-7) & (self.ends < self.times[after])):
                changed = (self.level[after] - before) * np.sign(many) + self.slack[after]
                if changed < abs(many) * threshold - 1e-3:
                    return f"{many} reports at {t:.4f} of {changed:.3f}"
            before += many * threshold
        return ""


def visible(
    scene: Any,
    frame: float,
    size: tuple[int, int],
    pixels: np.ndarray,
    parts: np.ndarray,
    shift: tuple[float, float] = (0.0, 0.0),
) -> tuple[np.ndarray, np.ndarray]:
    """What centres of ``pixels`` ``(n, 2)``, x and y, see at ``parts`` of the exposure ``(n,)``.

    Which of all faces, ``(n, F)``, none of them behind an opaque one; and depths of planes.
    """  # fmt: skip
    starts = exposure.line_starts(scene, size)
    line = pixels[:, 0 if scene.shutter.rolling in ("left", "right") else 1]
    opens = np.full(len(pixels), scene.shutter.open) if starts is None else starts[line]
    instants = opens + parts * exposure.length(scene)
    poses = cameras.poses_at(scene.camera, frame + instants, size[0] / size[1])
    world = World(scene, Triangles(freeze(scene, frame, instants, exposure.window(scene, size))))
    places = pixels[:, None] + 0.5 + np.array(shift)
    rays, hits = films.primary(world, scene.camera, poses, places, None, size)
    depth = np.where(hits.front | world.double, hits.distance, np.inf)
    first = np.where(world.kind == "opaque", depth, np.inf).min(axis=1, initial=np.inf)
    faces = world.triangles
    above, along = (np.einsum("nfi,ni->nf", faces.normals, way) for way in (rays.start, rays.way))
    return np.isfinite(depth) & (depth <= first[:, None]), (faces.offsets - above) / along


def wrong_events(scene: Any, frame: float, size: tuple[int, int], events: Any) -> list[str]:
    """Which events of a film of pixels' centres are not seen, or not just then, or not there.

    A little after an event begins and before it ends its face must be seen, and its plane must be
    where the event says at its end; where no other event of the face goes on with it, something
    else must be seen beyond, if it is no mirror. Places count that do not depend on path errors.
    """
    y, x = np.divmod(events.pixel, size[0])
    pixels, row = np.stack([x, y], axis=1), np.arange(len(events))
    offsets = np.cumsum([0, *(len(mesh.faces) for mesh in scene.meshes)])
    face = offsets[events["object"].astype(int) - 1] + events["face"].astype(int)
    plain = np.array([mesh.material.reflectivity == 0.0 for mesh in scene.meshes])
    plain = plain[events["object"].astype(int) - 1]

    def seen(parts: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """What is seen, where planes are, and for both what path errors do to them."""
        here = [visible(scene, frame, size, pixels, parts, asked.shift)
                for asked in (Asked(), *_shifted(Asked()))]  # fmt: skip
        sure = np.all([np.all(one[0] == here[0][0], axis=1) for one in here], axis=0)
        spread = np.max([np.abs(one[1] - here[0][1])[row, face] for one in here], axis=0)
        return here[0][0], here[0][1][row, face], sure, spread

    wrong = []
    for end, other, z in (("t0", "t1", "z0"), ("t1", "t0", "z1")):
        at, inwards = events[end].astype(float), np.sign(events[other] - events[end]) * MARGIN
        (within, _, sure, _), (beyond, _, also, _) = seen(at + inwards), seen(at - inwards)
        sure &= np.abs(events[other] - events[end]) > 2.0 * MARGIN
        bad = sure & ~within[row, face]
        wrong += [f"events: {bad.sum()} are not seen at {end}"] if bad.any() else []
        _, depth, _, spread = seen(at)
        away = np.abs(depth - events[z]) - 2.0 * spread
        if np.any(away > FAR_OFF):
            wrong.append(f"events: {z} is off by {away.max():.4f}")
        inner = plain & (at > 1.5 * MARGIN) & (at < 1.0 - 1.5 * MARGIN)
        inner &= ~_goes_on(events, face, end, other)
        bad = sure & also & inner & np.all(within == beyond, axis=1)
        wrong += [f"events: nothing changes at {end} of {bad.sum()}"] if bad.any() else []
    return wrong


def _goes_on(events: Any, face: np.ndarray, end: str, other: str) -> np.ndarray:
    """Whether another event of the face in the sample begins where one ends, or a little later."""
    same = (events.sample[:, None] == events.sample) & (face[:, None] == face)
    np.fill_diagonal(same, False)
    near = np.abs(events[end][:, None] - events[other]) < 2.0 * MARGIN
    return (same & near).any(axis=1)
