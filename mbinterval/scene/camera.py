"""The camera and its shutter."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.errors import SceneError
from mbinterval.scene.checks import Vector, check_choice, freeze, numbers, vector
from mbinterval.scene.tracks import Placement, Track

Float64 = NDArray[np.float64]

CURVES = ("box", "triangle", "trapezoid")
ROLLINGS = ("down", "up", "right", "left")
PLACES = ("centre", "start", "end")


@dataclass(frozen=True)
class Shutter:
    """When the shutter is open, and how far. The default is a 180 degree shutter.

    Attributes
    ----------
    open, close
        In frames relative to the frame.
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
        check_choice(place, PLACES, "shutter: place")
        if not 0.0 < angle < np.inf:
            raise SceneError(f"shutter: angle={angle!r}, expected degrees, above 0")
        length = angle / 360.0
        start = {"centre": -0.5 * length, "start": 0.0, "end": -length}[place]
        return cls(open=start, close=start + length, **fields)

    def __post_init__(self) -> None:
        if not (np.isfinite(self.open) and np.isfinite(self.close) and self.open < self.close):
            raise SceneError(
                f"shutter: open={self.open!r}, close={self.close!r}; expected open < close, "
                "in frames relative to the frame"
            )
        if isinstance(self.curve, str):
            check_choice(self.curve, CURVES, "shutter: curve")
        else:
            freeze(self, curve=_curve(self.curve))
        for name in ("opening", "closing"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise SceneError(f"shutter: {name}={getattr(self, name)!r}, expected 0 to 1")
        if self.curve == "trapezoid" and self.opening + self.closing > 1.0:
            raise SceneError("shutter: opening and closing take longer than the shutter is open")
        self._check_rolling()

    def _check_rolling(self) -> None:
        if self.rolling is None:
            for name in ("line_offset", "line_exposure"):
                if getattr(self, name) is not None:
                    raise SceneError(f"shutter: {name} without rolling; give its direction")
            return
        check_choice(self.rolling, ROLLINGS, "shutter: rolling")
        offset, exposure = self.line_offset, self.line_exposure
        if offset is None or not 0.0 <= offset < np.inf:
            raise SceneError(f"shutter: line_offset={offset!r}, expected seconds, 0 or more")
        if exposure is None or not 0.0 < exposure < np.inf:
            raise SceneError(f"shutter: line_exposure={exposure!r}, expected seconds, above 0")

    def keys(self) -> Float64:
        """``(n, 2)`` times and openings, both in [0, 1], between which the curve is linear."""
        if not isinstance(self.curve, str):
            times = np.linspace(0.0, 1.0, len(self.curve))
            return np.stack([times, np.array(self.curve)], axis=1)
        if self.curve == "box":
            values = [(0.0, 1.0), (1.0, 1.0)]
        elif self.curve == "triangle":
            values = [(0.0, 0.0), (0.5, 1.0), (1.0, 0.0)]
        else:
            values = [(0.0, 0.0), (self.opening, 1.0), (1.0 - self.closing, 1.0), (1.0, 0.0)]
        return np.array(values)

    def window(self, fps: float, lines: int) -> tuple[float, float]:
        """Open and close of the exposure of ``lines`` lines, in frames relative to the frame."""
        if self.rolling is None or self.line_offset is None or self.line_exposure is None:
            return self.open, self.close
        seconds = (lines - 1) * self.line_offset + self.line_exposure
        return self.open, self.open + seconds * fps


@dataclass(frozen=True)
class Camera:
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
        where = f"camera {self.name!r}" if self.name else "camera"
        if self.fov is not None and self.focal_length is not None:
            raise SceneError(f"{where}: fov and focal_length both given; give one")
        if self.focal_length is None and (self.vertical_aperture or self.horizontal_aperture):
            raise SceneError(f"{where}: an aperture without focal_length; give focal_length or fov")
        if self.transform is not None and self.look_at is not None:
            raise SceneError(f"{where}: transform and look_at both given; give one")
        for name in ("position", "look_at", "up"):
            value = getattr(self, name)
            if value is not None and not isinstance(value, Track):
                freeze(self, **{name: vector(value, f"{where}: {name}")})
        for name, low, high in (
            ("fov", 0.0, 180.0),
            ("focal_length", 0.0, np.inf),
            ("vertical_aperture", 0.0, np.inf),
            ("horizontal_aperture", 0.0, np.inf),
            ("f_stop", 0.0, np.inf),
            ("focus_distance", 0.0, np.inf),
            ("meters_per_unit", 0.0, np.inf),
        ):
            value = getattr(self, name)
            values = value.values if isinstance(value, Track) else value
            if value is not None and not np.all((np.asarray(values) > low) & (values < high)):
                raise SceneError(
                    f"{where}: {name}={value!r}, expected a value between {low} and {high}"
                )
        self._check_lens(where)

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

    def _check_lens(self, where: str) -> None:
        if self.f_stop is None:
            given = ("focus_distance", "sharp_range", "foreground_blur")
            for name in (name for name in given if getattr(self, name) is not None):
                raise SceneError(f"{where}: {name} without f_stop; a pinhole has no focus")
            return
        if self.focus_distance is None:
            raise SceneError(f"{where}: f_stop without focus_distance; give the distance in focus")
        if self.blades != 0 and not 3 <= self.blades <= 64:
            raise SceneError(f"{where}: blades={self.blades!r}, expected 0 or 3 to 64")
        if self.foreground_blur is not None and not self.foreground_blur >= 0.0:
            raise SceneError(f"{where}: foreground_blur={self.foreground_blur!r}, expected >= 0")
        if self.sharp_range is not None:
            near, far = self.sharp_range
            if not 0.0 < near <= far:
                raise SceneError(
                    f"{where}: sharp_range={self.sharp_range!r}, expected nearest <= farthest, > 0"
                )


def _curve(values: Any) -> tuple[float, ...]:
    curve = numbers(values, np.float64, "shutter: curve")
    if curve.ndim != 1 or len(curve) < 2 or len(curve) > 1024:
        raise SceneError(f"shutter: curve has shape {curve.shape}, expected 2 to 1024 values")
    if not (np.isfinite(curve).all() and (curve >= 0.0).all() and curve.any()):
        raise SceneError("shutter: curve values must be finite, from 0 up, and not all 0")
    return tuple(curve.tolist())
