"""The camera and its shutter."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.errors import SceneError
from mbinterval.scene import field_values
from mbinterval.scene.field_values import Vector, freeze
from mbinterval.scene.frozen import Frozen, check_portable
from mbinterval.scene.tracks import Track, keyed
from mbinterval.scene.transforms import Placement, check_place

Float64 = NDArray[np.float64]

CURVES = ("box", "triangle", "trapezoid")
ROLLINGS = ("down", "up", "right", "left")
PLACES = ("centre", "start", "end")


@dataclass(frozen=True)
class Shutter(Frozen):
    """When the shutter is open, and how far. The default is a 180 degree shutter.

    Attributes
    ----------
    open, close
        In frames relative to the frame; where they are equal, all is seen at that instant.
    curve
        How far it is open over that time: ``"box"`` throughout; ``"triangle"``; ``"trapezoid"``,
        which takes the fraction ``opening`` of the time to open and ``closing`` to close; or a
        sequence of at least two values from 0 up at equally spaced times, linear in between. Only
        its shape counts: light is normalized.
    rolling
        Direction in which the lines of a rolling shutter follow each other, ``"down"``, ``"up"``,
        ``"right"`` or ``"left"``; None exposes all lines together.
    line_offset, line_exposure
        Of a rolling shutter, in seconds: from one line's opening to the next one's, and how long
        each is open. The first line opens at ``open``; ``close`` is not used.
    """

    open: float = -0.25
    close: float = 0.25
    curve: str | tuple[float, ...] = "box"
    opening: float = 0.25
    closing: float = 0.25
    rolling: str | None = None
    line_offset: float | None = None
    line_exposure: float | None = None

    @classmethod
    def from_angle(cls, angle: float, place: str = "centre", **fields: Any) -> Shutter:
        """Return a shutter that is open for ``angle`` / 360 frames.

        Its ``"centre"``, ``"start"`` or ``"end"`` is on the frame. ``fields`` are the other ones.
        """
        field_values.choice(place, PLACES, "shutter: place")
        length = field_values.number(angle, "shutter: angle", 0.0) / 360.0
        start = {"centre": -0.5 * length, "start": 0.0, "end": -length}[place]
        return cls(open=start, close=start + length, **fields)

    def __post_init__(self) -> None:
        opens = field_values.number(self.open, "shutter: open")
        closes = field_values.number(self.close, "shutter: close")
        if opens > closes:
            raise SceneError(
                f"shutter: open={opens:g}, close={closes:g}; expected open <= close, "
                "in frames relative to the frame"
            )
        freeze(
            self,
            open=opens,
            close=closes,
            curve=_curve(self.curve),
            opening=field_values.number(self.opening, "shutter: opening", 0.0, 1.0),
            closing=field_values.number(self.closing, "shutter: closing", 0.0, 1.0),
        )
        if self.curve == "trapezoid" and self.opening + self.closing > 1.0:
            raise SceneError("shutter: opening and closing take longer than the shutter is open")
        self._check_rolling()

    def _check_rolling(self) -> None:
        if self.rolling is None:
            for name in ("line_offset", "line_exposure"):
                if getattr(self, name) is not None:
                    raise SceneError(f"shutter: {name} without rolling; give its direction")
            return
        rolling = field_values.choice(self.rolling, ROLLINGS, "shutter: rolling")
        for name in ("line_offset", "line_exposure"):
            if getattr(self, name) is None:
                raise SceneError(f"shutter: rolling without {name}; give it in seconds")
        freeze(
            self,
            rolling=rolling,
            line_offset=field_values.number(self.line_offset, "shutter: line_offset", 0.0),
            line_exposure=field_values.number(
                self.line_exposure, "shutter: line_exposure", above=0.0
            ),
        )

    def keys(self) -> Float64:
        """``(n, 2)`` times and openings, both in [0, 1], between which the curve is linear.

        Its ends are at 0 and 1. A trapezoid that opens or closes at once has one corner there.
        """
        if not isinstance(self.curve, str):
            times = np.linspace(0.0, 1.0, len(self.curve))
            return np.stack([times, np.array(self.curve)], axis=1)
        if self.curve == "box":
            values = [(0.0, 1.0), (1.0, 1.0)]
        elif self.curve == "triangle":
            values = [(0.0, 0.0), (0.5, 1.0), (1.0, 0.0)]
        else:
            values = [(self.opening, 1.0), (1.0 - self.closing, 1.0)]
            if self.opening > 0.0:
                values.insert(0, (0.0, 0.0))
            if self.closing > 0.0:
                values.append((1.0, 0.0))
        return np.array(values)

    def window(self, fps: float, lines: int) -> tuple[float, float]:
        """Open and close of the exposure of ``lines`` lines, in frames relative to the frame."""
        if self.rolling is None or self.line_offset is None or self.line_exposure is None:
            return self.open, self.close
        seconds = (lines - 1) * self.line_offset + self.line_exposure
        return self.open, self.open + seconds * fps


@dataclass(frozen=True)
class Camera(Frozen):
    """A camera. ``position``, ``look_at``, ``up`` and the lens fields may be keyed.

    The view is given either by ``position``, ``look_at`` and ``up``, or by a ``transform`` that
    maps camera space (looking down -Z, +Y up) to world space.

    Attributes
    ----------
    fov
        Vertical field of view in degrees, between 0 and 180. Default 45 when no
        ``focal_length`` is given.
    focal_length, vertical_aperture, horizontal_aperture
        Instead of ``fov``, in millimetres. The vertical aperture decides where both are given,
        since pixels are square; with neither it is 24 mm.
    f_stop, focus_distance
        A thin lens, focal length over f-stop wide, in focus at that distance along the view, in
        world units. Without ``f_stop`` the camera is a pinhole. A camera given by ``fov`` has the
        focal length that a sensor 24 mm high asks for.
    blades, blade_rotation
        Number of blades of the diaphragm, from 3; 0 is a round one. Rotation in degrees.
    sharp_range
        Nearest and farthest distance of an extended range in focus; blur begins beyond it (Wu et
        al. 2015, 3.4).
    foreground_blur
        Greatest radius of blur before the focus, as a fraction of the image's height.
    meters_per_unit
        Size of a world unit, for the lens.
    """

    position: Vector | Track = (0.0, 0.0, 0.0)
    look_at: Vector | Track | None = None
    up: Vector | Track = (0.0, 1.0, 0.0)
    transform: Placement | None = None
    fov: float | Track | None = None
    focal_length: float | Track | None = None
    vertical_aperture: float | None = None
    horizontal_aperture: float | None = None
    f_stop: float | Track | None = None
    focus_distance: float | Track | None = None
    blades: int = 0
    blade_rotation: float = 0.0
    sharp_range: tuple[float, float] | None = None
    foreground_blur: float | None = None
    meters_per_unit: float = 1.0
    name: str = ""

    def __post_init__(self) -> None:
        where = field_values.named("camera", self.name)
        self._check_view(where)
        if self.fov is not None and self.focal_length is not None:
            raise SceneError(f"{where}: fov and focal_length both given; give one")
        for name in ("vertical_aperture", "horizontal_aperture"):
            if self.focal_length is None and getattr(self, name) is not None:
                raise SceneError(f"{where}: {name} without focal_length; give focal_length or fov")
        for name, end in _KEYED_NUMBERS.items():
            value = getattr(self, name)
            if value is not None and keyed(value, (), f"{where}: {name}") is None:
                value = field_values.number(value, f"{where}: {name}", above=0.0, below=end)
                freeze(self, **{name: value})
            elif value is not None and not (0.0 < value.range[0] <= value.range[1] < end):
                below = f" and below {end:g}" if end < np.inf else ""
                raise SceneError(
                    f"{where}: {name} has keys, or handles of them, that are not above 0{below}"
                )
        self._check_lens(where)

    def __getstate__(self) -> dict[str, Any]:
        check_portable(self.transform, f"{field_values.named('camera', self.name)}: transform")
        return dict(vars(self))

    @property
    def tracks(self) -> list[Track]:
        """Its keyed fields."""
        values = (getattr(self, item.name) for item in fields(self))
        return [value for value in values if isinstance(value, Track)]

    @property
    def animated(self) -> bool:
        """Whether it may differ between frames."""
        return bool(self.tracks) or (self.transform is not None and self.transform.animated)

    @property
    def jumps(self) -> list[float]:
        """Frames at which it may jump: cuts."""
        found = [frame for track in self.tracks for frame in track.jumps]
        return found if self.transform is None else found + self.transform.jumps

    def _check_view(self, where: str) -> None:
        for name in ("position", "look_at", "up"):
            value = getattr(self, name)
            what = f"{where}: {name}"
            if keyed(value, (3,), what) is None and not (name == "look_at" and value is None):
                freeze(self, **{name: field_values.vector(value, what)})
        if self.transform is None:
            return
        check_place(self.transform, f"{where}: transform")
        for name in ("position", "look_at", "up"):
            if getattr(self, name) != getattr(Camera, name):
                raise SceneError(f"{where}: transform and {name} both given; give one")

    def _check_lens(self, where: str) -> None:
        for name in ("vertical_aperture", "horizontal_aperture", "meters_per_unit"):
            value = getattr(self, name)
            if value is not None or name == "meters_per_unit":
                freeze(self, **{name: field_values.number(value, f"{where}: {name}", above=0.0)})
        blades = field_values.whole_number(self.blades, f"{where}: blades", 0, 64)
        if blades in (1, 2):
            raise SceneError(f"{where}: blades={blades}: expected 0, a round lens, or 3 to 64")
        turn = field_values.number(self.blade_rotation, f"{where}: blade_rotation")
        freeze(self, blades=blades, blade_rotation=turn)
        if self.foreground_blur is not None:
            blur = field_values.number(self.foreground_blur, f"{where}: foreground_blur", 0.0)
            freeze(self, foreground_blur=blur)
        if self.sharp_range is not None:
            what, expected = f"{where}: sharp_range", "nearest and farthest distance, above 0"
            near, far = field_values.row(self.sharp_range, 2, what, expected)
            if not 0.0 < near <= far:
                raise field_values.refuse(self.sharp_range, what, expected)
            freeze(self, sharp_range=(near, far))
        given = ("focus_distance", "sharp_range", "foreground_blur")
        for name in given if self.f_stop is None else ():
            if getattr(self, name) is not None:
                raise SceneError(f"{where}: {name} without f_stop; a pinhole has no focus")
        if self.f_stop is not None and self.focus_distance is None:
            raise SceneError(f"{where}: f_stop without focus_distance; give the distance in focus")


@dataclass(frozen=True)
class Viewpoint(Frozen):
    """A camera that may be chosen by its name, and the shutter that its file gives it, if any."""

    camera: Camera
    shutter: Shutter | None = None


_KEYED_NUMBERS = {"fov": 180.0, "focal_length": np.inf, "f_stop": np.inf, "focus_distance": np.inf}
"""Numbers that may be keyed, above 0, and what they stay below."""


def _curve(value: Any) -> str | tuple[float, ...]:
    if isinstance(value, str):
        return field_values.choice(value, CURVES, "shutter: curve")
    curve = field_values.numbers(value, np.float64, "shutter: curve")
    if curve.ndim != 1 or not 2 <= len(curve) <= 1024:
        expected = f"{', '.join(map(repr, CURVES))}, or 2 to 1024 values"
        raise field_values.refuse(value, "shutter: curve", expected)
    if not (np.isfinite(curve).all() and (curve >= 0.0).all() and curve.any()):
        raise SceneError("shutter: curve values must be finite, from 0 up, and not all 0")
    field_values.row(curve, len(curve), "shutter: curve", "finite numbers")
    return tuple(curve.tolist())
