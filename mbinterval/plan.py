"""What a scene calls for: its effects with their reasons, and from them stages, options and sizes.

An effect that is not called for leaves no code in the kernels (each is a macro), no buffer and
no stage.
"""

from __future__ import annotations

import operator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.device import records
from mbinterval.errors import UsageError
from mbinterval.sampling import RADII, PixelFilter, pixel_filter, sample_slots
from mbinterval.settings import Settings

if TYPE_CHECKING:
    from mbinterval.motion import Motion
    from mbinterval.scene.camera import Shutter
    from mbinterval.scene.exposure import Exposure
    from mbinterval.scene.model import Scene

_SAMPLES_AT_A_TIME = 1024
_POOL_RECORDS = 65536

Crop = tuple[int, int, int, int]


@dataclass(frozen=True)
class Effect:
    """Something that a scene may call for, and why it does or does not."""

    name: str
    active: bool
    reason: str
    macro: str = ""


@dataclass(frozen=True)
class Plan:
    """How one exposure is rendered. Frozen and hashable; equal plans run the same kernels.

    Attributes
    ----------
    stages
        Names of the stages that run, in order; each is a file in ``cl/analytic``.
    options
        Compiler options of the kernels: one ``-D`` for each active effect and each size.
    crop
        Column, row, width and height of the film in the frame.
    tile, layers
        Edge of a tile in pixels; samples per pixel that a tile works on at a time.
    capacity
        Records in each of a work-item's pools at first; a pool that runs full is not an error.
    """

    width: int
    height: int
    crop: Crop
    effects: tuple[Effect, ...]
    stages: tuple[str, ...]
    options: tuple[str, ...]
    settings: Settings
    tile: int
    layers: int
    capacity: int

    @property
    def exact(self) -> bool:
        """Whether depth and attributes are exact functions of time."""
        return "-DEXACT" in self.options


def make_plan(
    exposure: Exposure,
    motion: Motion,
    settings: Settings,
    width: int,
    height: int,
    crop: Crop,
    capacity: int = _POOL_RECORDS,
) -> Plan:
    """Plan the render of ``exposure``, laid out as ``motion``."""
    effects = _effects(exposure, motion, settings)
    active = {effect.macro for effect in effects if effect.active}
    if "LENS" in active and settings.paths == "triangulated":
        raise UsageError("paths='triangulated' has no lens; use paths='exact', or leave f_stop out")
    tile = settings.tile_size
    layers = max(1, min(settings.samples, _SAMPLES_AT_A_TIME // tile**2))
    sizes: dict[str, int | str] = {
        "TILE": tile,
        "SAMPLES": settings.samples,
        "LAYERS": layers,
    }
    if "MOVING" in active:
        if settings.occlusion != "exact":
            sizes["MASK_BITS"] = settings.occlusion
        if settings.max_intervals is not None:
            sizes["MAX_INTERVALS"] = settings.max_intervals
    if active & {"PHONG", "TEXTURED", "VERTEX_COLOR"}:
        sizes["TEXTURE_SAMPLES"] = settings.texture_samples
    sizes |= _sampling_sizes(exposure, settings, active)
    timed = _time_stages(settings) if "MOVING" in active else ()
    return Plan(
        width=width,
        height=height,
        crop=crop,
        effects=effects,
        stages=(
            "paths",
            "bin",
            *(("place",) if "PLACED" in active else ()),
            *(("nearest",) if "STATIC" in active else ()),
            *timed,
            "shade",
            "resolve",
        ),
        options=tuple(f"-D{name}" for name in sorted(active - {""}))
        + tuple(f"-D{name}={value}" for name, value in sizes.items()),
        settings=settings,
        tile=tile,
        layers=layers,
        capacity=capacity if timed else 1,
    )


def filter_of(settings: Settings) -> PixelFilter | None:
    """Return the pixel filter that samples are drawn from; None for a box of one pixel."""
    radius = RADII[settings.filter] if settings.filter_radius is None else settings.filter_radius
    if (settings.filter, radius) == ("box", 0.5):
        return None
    return pixel_filter(settings.filter, radius)


def slots_of(settings: Settings) -> NDArray[np.void]:
    """Return where each of a pixel's samples may lie, as ``Slot`` records."""
    return sample_slots(settings.pattern, settings.samples, filter_of(settings))


def _sampling_sizes(
    exposure: Exposure, settings: Settings, active: set[str]
) -> dict[str, int | str]:
    """Macros with a value that the effects of sampling, lens and shutter ask for."""
    sizes: dict[str, int | str] = {}
    shape, camera = filter_of(settings), exposure.camera
    if "SCATTERED" in active and shape is not None:
        sizes["FILTER_TABLE"] = len(shape.table) - 1
    if "WEIGHTED" in active and shape is not None:
        sizes["FILTER_ZERO"], sizes["FILTER_MASS"] = _float(shape.zero), _float(shape.mass**2)
    if "LENS" in active and camera.blades:
        sizes["BLADES"] = camera.blades
        sizes["BLADE_ROTATION"] = _float(float(np.radians(camera.blade_rotation)))
    if exposure.shutter.curve != "box" and "MOVING" in active:
        sizes["SHUTTER_CURVE"] = len(shutter_keys(exposure.shutter))
    return sizes


def _float(value: float) -> str:
    return f"{value:.9e}f"


def shutter_keys(shutter: Shutter) -> NDArray[np.void]:
    """Return the shutter's curve as ``ShutterKey`` records, times strictly ascending."""
    corners = shutter.keys()
    corners = corners[np.append(True, np.diff(corners[:, 0]) > 0.0)]
    t, opening = corners.T
    passed = np.append(0.0, np.cumsum(0.5 * (opening[1:] + opening[:-1]) * np.diff(t)))
    keys = np.zeros(len(t), records.SHUTTER_KEY)
    keys["t"], keys["open"], keys["passed"] = t, opening, passed / passed[-1]
    return keys


def _time_stages(settings: Settings) -> tuple[str, ...]:
    if settings.paths == "triangulated":
        return ("rasterize", "intervals", "sort", "occlude")
    return ("solve", "envelope" if settings.occlusion == "exact" else "mask")


def _effects(exposure: Exposure, motion: Motion, settings: Settings) -> tuple[Effect, ...]:
    paths, static = len(motion.paths), motion.static_paths
    materials = motion.materials
    phong = [m.name for m in materials if m.shading == "phong"]
    textured = [m.name for m in materials if m.texture is not None]
    single = [m.name for m in materials if not m.double_sided]
    colored = [m.mesh.name for m in exposure.meshes if m.color is not None]
    painted = [m.mesh.name for m in exposure.meshes if m.face_color is not None]
    segments = sorted({mesh.segments for mesh in exposure.meshes if mesh.segments})
    plural = "" if segments == [1] else "s"
    many = f", {' and '.join(map(str, segments))} motion segment{plural}" if segments else ""
    image = not isinstance(exposure.background, tuple)
    lens = any(np.any(poses.aperture > 0.0) for poses in exposure.cameras.values())
    scattered = settings.pattern == "sobol"
    shape = filter_of(settings)
    weighted = shape is not None and shape.mass != 1.0
    return (
        Effect("motion", paths > static, f"{paths - static} motion paths{many}", "MOVING"),
        Effect(
            "exact in time",
            settings.paths == "exact" or paths == static,
            f"paths={settings.paths!r}" if paths > static else "nothing moves",
            "EXACT",
        ),
        Effect(
            "camera motion",
            exposure.camera_moves,
            "the camera moves: every mesh has motion paths"
            if exposure.camera_moves
            else "the camera stays",
        ),
        Effect(
            "lens",
            lens,
            f"f/{exposure.camera.f_stop}" if lens else "the camera is a pinhole",
            "LENS",
        ),
        Effect("scattered samples", scattered, f"pattern={settings.pattern!r}", "SCATTERED"),
        Effect(
            "weighted samples",
            weighted,
            f"the {settings.filter} filter has {'' if weighted else 'no '}negative lobes",
            "WEIGHTED",
        ),
        Effect(
            "samples placed by pixel",
            lens or scattered or weighted,
            "each pixel has its own"
            if lens or scattered or weighted
            else "all pixels have the same",
            "PLACED",
        ),
        Effect(
            "shutter curve",
            exposure.shutter.curve != "box" and paths > static,
            str(exposure.shutter.curve)[:40],
        ),
        Effect(
            "rolling shutter",
            exposure.roll is not None and paths > static,
            f"rolling={exposure.shutter.rolling!r}",
            "ROLLING",
        ),
        Effect(
            "rolling columns",
            exposure.roll is not None and exposure.roll.columns and paths > static,
            f"rolling={exposure.shutter.rolling!r}",
            "ROLLING_COLUMNS",
        ),
        Effect("static geometry", static > 0, f"{static} triangles do not move", "STATIC"),
        Effect("single-sided", bool(single), _named("material", single), "SINGLE_SIDED"),
        Effect("phong shading", bool(phong), _named("material", phong), "PHONG"),
        Effect(
            "point lights",
            bool(phong) and any(light.kind == "point" for light in exposure.lights),
            f"{sum(light.kind == 'point' for light in exposure.lights)} point lights",
            "POINT_LIGHTS",
        ),
        Effect("texture", bool(textured), _named("material", textured), "TEXTURED"),
        Effect("vertex colour", bool(colored), _named("mesh", colored), "VERTEX_COLOR"),
        Effect("face colour", bool(painted), _named("mesh", painted), "FACE_COLOR"),
        Effect(
            "background image",
            image and not settings.transparent,
            "the scene has one" if image else "a constant colour",
            "BACKGROUND_IMAGE",
        ),
        Effect(
            "transparent film",
            settings.transparent,
            "asked for" if settings.transparent else "not asked for",
            "TRANSPARENT",
        ),
        Effect(
            "pairing by depth",
            settings.pairing == "depth" and paths > static,
            f"pairing={settings.pairing!r}",
            "PAIR_BY_DEPTH",
        ),
        Effect(
            "partial bits",
            settings.partial_bits and settings.occlusion != "exact" and paths > static,
            f"partial_bits={settings.partial_bits}",
            "PARTIAL_BITS",
        ),
    )


def _named(kind: str, names: list[str]) -> str:
    """Say which items call for an effect: 'material 'tyre' and 2 more', or 'no material'."""
    if not names:
        return f"no {kind} calls for it"
    more = f" and {len(names) - 1} more" if len(names) > 1 else ""
    first = next((repr(name) for name in names if name), "without a name")
    return f"{kind} {first}{more}"


def roll_lines(scene: Scene, width: int, height: int) -> int:
    """Return the number of lines of the scene's shutter, rows or columns, if it rolls."""
    return width if scene.shutter.rolling in ("left", "right") else height


def check_crop(crop: Any, width: int, height: int) -> Crop:
    """Return ``crop`` as four whole numbers inside the frame, or the whole frame for None."""
    if crop is None:
        return (0, 0, width, height)
    try:
        x, y, columns, rows = (operator.index(value) for value in crop)
    except (TypeError, ValueError):
        raise UsageError(
            f"crop={crop!r}: expected four whole numbers: column, row, width and height"
        ) from None
    if min(x, y) < 0 or min(columns, rows) < 1 or x + columns > width or y + rows > height:
        raise UsageError(
            f"crop {x},{y},{columns},{rows} does not lie in the frame of {width} x {height} pixels"
        )
    return (x, y, columns, rows)
