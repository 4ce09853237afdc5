"""The scene file as pydantic models: TOML, JSON and Python dicts share this one schema.

Imported only when a scene file is read. The models check types, ranges, names and whether files
exist; `conflicts` checks what involves several fields. Together they report every error at once.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, PlainValidator, ValidationInfo
from pydantic_core import PydanticCustomError

from mbinterval.errors import UsageError
from mbinterval.film.file_names import parse_outputs
from mbinterval.film.frame_ranges import parse_frames
from mbinterval.scene.field_values import LARGEST, UPTO

Vector3 = tuple[float, float, float]


def _numbers(*counts: int) -> Callable[[Any], tuple[float, ...]]:
    """Validate a list of as many finite numbers as one of ``counts`` says."""

    def check(value: Any) -> tuple[float, ...]:
        items = value.tolist() if isinstance(value, np.ndarray) else value
        if (
            not isinstance(items, list | tuple)
            or len(items) not in counts
            or not all(isinstance(item, int | float) for item in items)
            or any(isinstance(item, bool) for item in items)
            or not all(abs(item) < math.inf for item in items)
        ):
            wanted = " or ".join(map(str, counts))
            raise _problem(f"expected a list of {wanted} finite numbers, got {value!r:.80}")
        if any(abs(item) > LARGEST for item in items):
            raise _problem(f"expected numbers {UPTO}, got {value!r:.80}")
        return tuple(map(float, items))

    return check


def _scale(value: Any) -> tuple[float, ...]:
    if isinstance(value, int | float) and not isinstance(value, bool):
        value = [value] * 3
    return _numbers(3)(value)


def _rotation(value: Any) -> tuple[float, ...]:
    quaternion = _numbers(4)(value)
    if not any(quaternion):
        raise _problem("a quaternion [x, y, z, w] of length 0 is no rotation")
    return quaternion


def _up(value: Any) -> tuple[float, ...]:
    up = _numbers(3)(value)
    if not any(up):
        raise _problem("a vector of length 0 has no direction")
    return up


def _curve(value: Any) -> str | tuple[float, ...]:
    if value in ("box", "triangle", "trapezoid"):
        return str(value)
    if not isinstance(value, list | tuple) or len(value) < 2:
        raise _problem(
            f"expected 'box', 'triangle', 'trapezoid' or a list of numbers, got {value!r:.80}"
        )
    return _numbers(len(value))(value)


def _array(value: Any) -> np.ndarray[Any, Any]:
    try:
        array = np.asarray(value)
    except ValueError:
        array = np.empty(0, object)
    if array.dtype.kind not in "iuf":
        raise _problem("expected rows of numbers, each row as long as the others")
    return array


def _existing(value: Any, info: ValidationInfo) -> Path:
    """Validate the path of a file; it is relative to the folder in the context."""
    if not isinstance(value, str | Path) or not str(value):
        raise _problem(f"expected the path of a file, got {value!r:.80}")
    base: Path = (info.context or {}).get("base", Path())
    path = base / value
    if "\0" in str(value) or not path.is_file():
        raise _problem(
            f"file not found: tried {path}; a relative path is relative to the scene file"
        )
    return path


def _frames(value: Any) -> str:
    try:
        parse_frames(str(_text_or_count(value)))
    except UsageError as error:
        raise _problem(str(error)) from None
    return str(value)


def _output(value: Any) -> str:
    if not isinstance(value, str):
        raise _problem(f"expected a string in quotes, got {value!r:.80}")
    try:
        parse_outputs(value)
    except UsageError as error:
        raise _problem(str(error)) from None
    return value


def _text_or_count(value: Any) -> str | int:
    if isinstance(value, bool) or not isinstance(value, str | int):
        raise _problem(f"expected a string or a whole number, got {value!r:.80}")
    return value


def _background(value: Any, info: ValidationInfo) -> Path | tuple[float, ...]:
    return _existing(value, info) if isinstance(value, str | Path) else _numbers(3)(value)


def _problem(text: str) -> PydanticCustomError:
    return PydanticCustomError("mbinterval", "{text}", {"text": text})


Curve = Annotated[str | tuple[float, ...], PlainValidator(_curve)]
Vec3 = Annotated[Vector3, PlainValidator(_numbers(3))]
Pair = Annotated[tuple[float, float], PlainValidator(_numbers(2))]
Direction = Annotated[Vector3, PlainValidator(_up)]
Scale = Annotated[Vector3, PlainValidator(_scale)]
Rotation = Annotated[tuple[float, float, float, float], PlainValidator(_rotation)]
Size = Annotated[tuple[float, ...], PlainValidator(_numbers(2, 3))]
Array = Annotated[Any, PlainValidator(_array)]
TextOrCount = Annotated[str | int, PlainValidator(_text_or_count)]
File = Annotated[Path, PlainValidator(_existing)]
Positive = Annotated[float, Field(gt=0, le=LARGEST)]
NotNegative = Annotated[float, Field(ge=0, le=LARGEST)]
Angle = Annotated[float, Field(gt=0, lt=180)]
Count = Annotated[int, Field(ge=1)]
Pixels = Annotated[int, Field(ge=1, le=65536)]
Interpolation = Literal["linear", "step", "cubic"]


class Table(BaseModel):
    """A table of the scene file; unknown fields are errors."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


class TransformHandle(Table):
    """Values of Bezier handles of keys, a third of the way in time to the next key."""

    translation: Vec3 | None = None
    rotation: Rotation | None = None
    euler: Vec3 | None = None
    scale: Scale | None = None


class TransformKey(TransformHandle):
    """Any of translation, rotation (or euler) and scale at a frame; handles on both sides of it."""

    frame: float
    before: TransformHandle | None = None
    after: TransformHandle | None = None


class TransformTable(Table):
    """Constant or keyed. Euler angles are degrees about the fixed axes, in ``euler_order``."""

    translation: Vec3 | None = None
    rotation: Rotation | None = None
    euler: Vec3 | None = None
    euler_order: Literal["xyz", "xzy", "yxz", "yzx", "zxy", "zyx"] = "xyz"
    scale: Scale | None = None
    interpolation: Interpolation = "linear"
    keys: list[TransformKey] = Field(default_factory=list)


class CameraHandle(Table):
    """Values of Bezier handles of keys, a third of the way in time to the next key."""

    position: Vec3 | None = None
    look_at: Vec3 | None = None
    up: Direction | None = None
    fov: Angle | None = None
    focal_length: Positive | None = None
    f_stop: Positive | None = None
    focus_distance: Positive | None = None


class CameraKey(CameraHandle):
    """Any of the camera's fields that can be keyed, at a frame; handles on both sides of it."""

    frame: float
    before: CameraHandle | None = None
    after: CameraHandle | None = None


class CameraTable(Table):
    """See `mbinterval.Camera`; apertures and focal length in millimetres."""

    name: str = ""
    position: Vec3 | None = None
    look_at: Vec3 | None = None
    up: Direction | None = None
    transform: TransformTable | None = None
    fov: Angle | None = None
    focal_length: Positive | None = None
    vertical_aperture: Positive | None = None
    horizontal_aperture: Positive | None = None
    f_stop: Positive | None = None
    focus_distance: Positive | None = None
    blades: int | None = None
    blade_rotation: float | None = None
    sharp_range: Pair | None = None
    foreground_blur: NotNegative | None = None
    meters_per_unit: Positive | None = None
    interpolation: Interpolation = "linear"
    keys: list[CameraKey] = Field(default_factory=list)


class ShutterTable(Table):
    """See `mbinterval.Shutter`; open and close in frames relative to the frame.

    Instead of these: an angle in degrees, and what of the shutter is on the frame.
    """

    open: float | None = None
    close: float | None = None
    angle: NotNegative | None = None
    place: Literal["centre", "start", "end"] | None = None
    curve: Curve | None = None
    opening: NotNegative | None = None
    closing: NotNegative | None = None
    rolling: Literal["down", "up", "right", "left"] | None = None
    line_offset: NotNegative | None = None
    line_exposure: Positive | None = None


class LightTable(Table):
    """See `mbinterval.Light`."""

    kind: Literal["ambient", "directional", "point", "spot"]
    color: Vec3 | None = None
    intensity: NotNegative | None = None
    direction: Direction | None = None
    position: Vec3 | None = None
    inner_angle: NotNegative | None = None
    outer_angle: Annotated[float, Field(gt=0, le=90)] | None = None
    shadows: bool | None = None


class MaterialTable(Table):
    """Given fields replace those of the object's own materials."""

    base_color: Vec3 | None = None
    texture: File | None = None
    wrap: Literal["repeat", "clamp", "mirror"] | None = None
    shading: Literal["unlit", "phong", "metallic_roughness"] | None = None
    specular: Vec3 | None = None
    shininess: Positive | None = None
    metallic: Annotated[float, Field(ge=0, le=1)] | None = None
    roughness: Annotated[float, Field(ge=0, le=1)] | None = None
    metallic_roughness_texture: File | None = None
    emission: Vec3 | None = None
    emission_texture: File | None = None
    double_sided: bool | None = None
    reflectivity: Annotated[float, Field(ge=0, le=1)] | None = None
    reflection_shear: NotNegative | None = None
    opacity: Annotated[float, Field(ge=0, le=1)] | None = None
    alpha_mode: Literal["auto", "opaque", "mask", "blend"] | None = None
    alpha_cutoff: NotNegative | None = None


class EnvironmentTable(Table):
    """See `mbinterval.Environment`; a picture of all directions by longitude and latitude."""

    file: File
    intensity: NotNegative | None = None
    rotation: float | None = None
    background: bool | None = None


class ReflectionsTable(Table):
    """See `mbinterval.Reflections`."""

    size: Annotated[int, Field(ge=16, le=1024)] | None = None
    times: Annotated[int, Field(ge=1, le=64)] | None = None


class PrimitiveTable(Table):
    """A simple shape centred on the origin; see `mbinterval.scene.primitives`."""

    kind: Literal["plane", "box", "sphere", "cylinder"]
    size: Size | None = None
    radius: Positive | None = None
    height: Positive | None = None
    segments: Annotated[int, Field(ge=3, le=4096)] | None = None


class VisibilityKey(Table):
    """From this frame on, up to the next key, the object is there or not."""

    frame: float
    visible: bool


class ObjectTable(Table):
    """A mesh from a file, from arrays in the file, or a simple shape."""

    name: str = ""
    file: File | None = None
    clip: TextOrCount | None = None
    fps: Positive | None = None
    positions: Array | None = None
    faces: Array | None = None
    normals: Array | None = None
    uv: Array | None = None
    color: Array | None = None
    color_domain: Literal["auto", "face", "vertex"] = "auto"
    primitive: PrimitiveTable | None = None
    transform: TransformTable | None = None
    material: MaterialTable | None = None
    motion_segments: Count | None = None
    motion_blur: bool = True
    shutter_scale: NotNegative | None = None
    visible: bool = True
    visibility: list[VisibilityKey] = Field(default_factory=list)
    reflections: ReflectionsTable | None = None


class GeneratorTable(Table):
    """A generated scene; see `mbinterval.scene.generators`."""

    name: Literal["ho17_cubes", "fast_cubes", "blades", "dense_sphere"]
    count: Count | None = None
    seed: Annotated[int, Field(ge=0, le=2**32 - 1)] | None = None


class RenderTable(Table):
    """Defaults of the command line."""

    width: Pixels | None = None
    height: Pixels | None = None
    frames: Annotated[str | None, PlainValidator(_frames)] = None
    output: Annotated[str | None, PlainValidator(_output)] = None


class SceneTable(Table):
    """The whole scene file."""

    name: str = ""
    fps: Positive | None = None
    background: Annotated[Any, PlainValidator(_background)] = None
    camera: CameraTable | None = None
    cameras: list[CameraTable] = Field(default_factory=list)
    shutter: ShutterTable | None = None
    lights: list[LightTable] | None = None
    environment: EnvironmentTable | None = None
    objects: list[ObjectTable] = Field(default_factory=list)
    generator: GeneratorTable | None = None
    settings: dict[str, Any] = Field(default_factory=dict)
    render: RenderTable = Field(default_factory=RenderTable)
