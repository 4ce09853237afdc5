"""The animated scene as frozen records, validated when they are made.

World space is right-handed; the camera looks down its own -Z with +Y up. Colour is scene-linear
Rec. 709. Keys are in frames. Arrays are copied to contiguous float64 (geometry) or float32
(colour) and made read-only, so that a scene never changes under a render.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import InitVar, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mbinterval.errors import SceneError
from mbinterval.scene.tracks import Track, Transform

Float64 = NDArray[np.float64]
Float32 = NDArray[np.float32]
Vector = tuple[float, float, float]

SHADINGS = ("unlit", "phong")
LIGHT_KINDS = ("ambient", "directional", "point")
WRAPS = ("repeat", "clamp", "mirror")


@dataclass(frozen=True, eq=False)
class Texture:
    """An image looked up by uv; v points up, as in OpenGL: (0, 0) is the lower left corner.

    Attributes
    ----------
    image
        ``(h, w, 3)`` or ``(h, w, 4)``, scene-linear, first row on top. Stored as float32
        ``(h, w, 4)`` with straight alpha.
    wrap
        ``"repeat"``, ``"clamp"`` or ``"mirror"``, for u and v.
    """

    image: Float32
    name: str = ""
    wrap: str = "repeat"

    def __post_init__(self) -> None:
        image = np.asarray(self.image, dtype=np.float32)
        if image.ndim != 3 or image.shape[2] not in (3, 4) or 0 in image.shape:
            raise SceneError(
                f"texture {self.name!r}: image has shape {image.shape}, expected (h, w, 3 or 4)"
            )
        if image.shape[2] == 3:
            image = np.concatenate([image, np.ones_like(image[..., :1])], axis=2)
        _check_finite(image, f"texture {self.name!r}: image", "pixel")
        _check_choice(self.wrap, WRAPS, f"texture {self.name!r}: wrap")
        _freeze(self, image=image)


@dataclass(frozen=True)
class Material:
    """How a surface answers light.

    ``"unlit"`` shows ``base_color`` times texture times vertex or face colour. ``"phong"`` is
    Phong's model: that colour times (ambient + sum of light * max(0, n.l)), plus
    ``specular`` * light * max(0, r.v) ** ``shininess``; no factor of pi anywhere.
    A two-sided surface turns its normal to the viewer; of a single-sided one only the side whose
    vertices run counter-clockwise is seen, at every moment of the shutter.
    """

    name: str = ""
    base_color: Vector = (1.0, 1.0, 1.0)
    texture: Texture | None = None
    shading: str = "phong"
    specular: Vector = (0.04, 0.04, 0.04)
    shininess: float = 32.0
    double_sided: bool = True

    def __post_init__(self) -> None:
        where = f"material {self.name!r}"
        _check_choice(self.shading, SHADINGS, f"{where}: shading")
        _freeze(
            self,
            base_color=_vector(self.base_color, f"{where}: base_color"),
            specular=_vector(self.specular, f"{where}: specular"),
        )
        if not (np.isfinite(self.shininess) and self.shininess > 0):
            raise SceneError(f"{where}: shininess={self.shininess!r}, expected a number above 0")


@dataclass(frozen=True)
class Light:
    """A light without extent: ``"ambient"``, ``"directional"`` or ``"point"``.

    ``direction`` is the way that light travels. A point light falls off with the square of the
    distance: ``color * intensity / distance**2``.
    """

    kind: str
    color: Vector = (1.0, 1.0, 1.0)
    intensity: float = 1.0
    direction: Vector = (0.0, 0.0, -1.0)
    position: Vector = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        _check_choice(self.kind, LIGHT_KINDS, "light: kind")
        direction = _vector(self.direction, "light: direction")
        if self.kind == "directional" and not any(direction):
            raise SceneError("light: direction is zero; give the way that light travels")
        if not (np.isfinite(self.intensity) and self.intensity >= 0):
            raise SceneError(f"light: intensity={self.intensity!r}, expected a number from 0 up")
        _freeze(
            self,
            color=_vector(self.color, "light: color"),
            direction=direction,
            position=_vector(self.position, "light: position"),
        )


@dataclass(frozen=True)
class Shutter:
    """When the shutter opens and closes, in frames relative to the frame.

    The default, -0.25 to 0.25, is a 180 degree shutter centred on the frame.
    """

    open: float = -0.25
    close: float = 0.25

    def __post_init__(self) -> None:
        if not (np.isfinite(self.open) and np.isfinite(self.close) and self.open < self.close):
            raise SceneError(
                f"shutter: open={self.open!r}, close={self.close!r}; expected open < close, "
                "in frames relative to the frame"
            )

    def at(self, frame: float, t: float) -> float:
        """Time in frames at ``t`` in [0, 1] of the exposure of ``frame``."""
        return frame + self.open + t * (self.close - self.open)


@dataclass(frozen=True)
class Camera:
    """A pinhole camera. ``position``, ``look_at``, ``up`` and the lens fields may be keyed.

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
    """

    position: Vector | Track = (0.0, 0.0, 0.0)
    look_at: Vector | Track | None = None
    up: Vector | Track = (0.0, 1.0, 0.0)
    transform: Transform | None = None
    fov: float | Track | None = None
    focal_length: float | Track | None = None
    vertical_aperture: float | None = None
    horizontal_aperture: float | None = None
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
                _freeze(self, **{name: _vector(value, f"{where}: {name}")})
        for name, low, high in (
            ("fov", 0.0, 180.0),
            ("focal_length", 0.0, np.inf),
            ("vertical_aperture", 0.0, np.inf),
            ("horizontal_aperture", 0.0, np.inf),
        ):
            value = getattr(self, name)
            values = value.values if isinstance(value, Track) else value
            if value is not None and not np.all((np.asarray(values) > low) & (values < high)):
                raise SceneError(
                    f"{where}: {name}={value!r}, expected a value between {low} and {high}"
                )


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles that may move.

    Attributes
    ----------
    positions
        ``(N, 3)`` static, or ``(K+1, N, 3)`` at K+1 equally spaced times over the shutter, the
        same for every frame. In the space that ``transform`` maps to the world.
    faces
        ``(F, 3)`` integers, counter-clockwise seen from the front.
    normals, uv
        Per vertex, ``(N, 3)`` and ``(N, 2)``, or per time, ``(K+1, N, ...)``. Without normals a
        Phong surface is faceted.
    color
        ``(3,)`` for all, ``(F, 3)`` per face, ``(N, 3)`` or ``(K+1, N, 3)`` per vertex;
        multiplies the material's. Where N equals F, ``color_domain`` must say which is meant.
    shading
        Shorthand for ``material=Material(shading=...)``.
    motion_segments
        Linear motion segments over the shutter; a multiple of K for positions per time.
    visible
        False leaves the mesh out.
    """

    positions: Float64
    faces: NDArray[np.int32]
    normals: Float64 | None = None
    uv: Float64 | None = None
    color: Float32 | None = None
    material: Material | None = None
    motion_segments: int | None = None
    visible: bool = True
    name: str = ""
    transform: Transform | None = None
    color_domain: str = "auto"
    shading: InitVar[str | None] = None

    def __post_init__(self, shading: str | None) -> None:
        where = f"mesh {self.name!r}"
        positions = _array(self.positions, np.float64, f"{where}: positions")
        if positions.ndim not in (2, 3) or positions.shape[-1] != 3 or positions.shape[0] == 0:
            raise SceneError(
                f"{where}: positions have shape {positions.shape}, expected (N, 3) for a static "
                "mesh or (K+1, N, 3) for K motion segments"
            )
        if positions.ndim == 3 and positions.shape[0] == 1:
            positions = positions[0]
        _check_finite(positions, f"{where}: positions", "vertex")
        count, times = positions.shape[-2], positions.shape[0] if positions.ndim == 3 else 1
        faces = _faces(self.faces, count, where)
        normals = _attribute(self.normals, 3, count, times, f"{where}: normals")
        uv = _attribute(self.uv, 2, count, times, f"{where}: uv")
        color, domain = _color(self.color, self.color_domain, count, len(faces), times, where)
        if shading is not None:
            if self.material is not None:
                raise SceneError(f"{where}: material and shading both given; give one")
            _freeze(self, material=Material(shading=shading))
        segments = self.motion_segments
        if segments is not None and (
            isinstance(segments, bool) or not isinstance(segments, int) or segments < 1
        ):
            raise SceneError(f"{where}: motion_segments={segments!r}, expected a whole number >= 1")
        if segments is not None and times > 1 and segments % (times - 1):
            raise SceneError(
                f"{where}: motion_segments={segments}, but positions are given for {times - 1} "
                "segments; expected a multiple of that"
            )
        _freeze(
            self,
            positions=positions,
            faces=faces,
            normals=normals,
            uv=uv,
            color=color,
            color_domain=domain,
        )

    @property
    def times(self) -> int:
        """Number of times over the shutter at which positions are given: K+1, or 1."""
        return self.positions.shape[0] if self.positions.ndim == 3 else 1


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything that is rendered; it can be evaluated at any frame.

    ``background`` is a colour, or an image ``(h, w, 3)``, scene-linear, that fills the frame.
    ``notes`` are what a reader had to assume; ``mbinterval info`` prints them.
    """

    meshes: Sequence[Mesh]
    camera: Camera | None = None
    lights: Sequence[Light] = ()
    background: Vector | Float32 = (0.0, 0.0, 0.0)
    shutter: Shutter = field(default_factory=Shutter)
    fps: float = 24.0
    name: str = ""
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name, kind in (("meshes", Mesh), ("lights", Light)):
            items = tuple(getattr(self, name))
            for index, item in enumerate(items):
                if not isinstance(item, kind):
                    raise SceneError(
                        f"scene: {name}[{index}] is {type(item).__name__}, expected {kind.__name__}"
                    )
            _freeze(self, **{name: items})
        if not (np.isfinite(self.fps) and self.fps > 0):
            raise SceneError(f"scene: fps={self.fps!r}, expected a number above 0")
        if np.ndim(self.background) == 1:
            _freeze(self, background=_vector(self.background, "scene: background"))
        else:
            image = _array(self.background, np.float32, "scene: background")
            if image.ndim != 3 or image.shape[2] != 3 or 0 in image.shape:
                raise SceneError(
                    f"scene: background has shape {image.shape}, expected (3,) or (h, w, 3)"
                )
            _check_finite(image, "scene: background", "pixel")
            _freeze(self, background=image)


def _freeze(record: object, **values: Any) -> None:
    """Set fields of a frozen record; arrays become contiguous and read-only."""
    for name, value in values.items():
        if isinstance(value, np.ndarray):
            value = np.ascontiguousarray(value)
            if value.base is not None or value.flags.writeable:
                value = value.copy()
            value.flags.writeable = False
        object.__setattr__(record, name, value)


def _array(value: ArrayLike, dtype: Any, what: str) -> NDArray[Any]:
    try:
        return np.asarray(value, dtype=dtype)
    except (TypeError, ValueError) as error:
        raise SceneError(f"{what}: not an array of numbers ({error})") from None


def _vector(value: Any, what: str) -> Vector:
    array = _array(value, np.float64, what)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise SceneError(f"{what}={value!r}, expected three finite numbers")
    return (float(array[0]), float(array[1]), float(array[2]))


def _check_choice(value: str, choices: tuple[str, ...], what: str) -> None:
    if value not in choices:
        raise SceneError(f"{what}={value!r}, expected one of {', '.join(map(repr, choices))}")


def _check_finite(array: NDArray[Any], what: str, unit: str) -> None:
    if np.isfinite(array).all():
        return
    place = np.argwhere(~np.isfinite(array))[0]
    value = array[tuple(place)]
    if unit == "pixel":
        at = f"pixel (row {place[0]}, column {place[1]})"
    else:
        at = f"{unit} {place[-2]}" + (f" at time {place[0]}" if array.ndim == 3 else "")
    raise SceneError(f"{what}: {value} at {at}; every value must be finite")


def _faces(value: ArrayLike, count: int, where: str) -> NDArray[np.int32]:
    faces = np.asarray(value)
    if faces.ndim != 2 or faces.shape[1] != 3 or faces.dtype.kind not in "iu":
        raise SceneError(
            f"{where}: faces have shape {faces.shape} and type {faces.dtype}, expected (F, 3) "
            "integers; triangulate polygons first"
        )
    if faces.size and (faces.min() < 0 or faces.max() >= count):
        face = int(np.argwhere((faces < 0) | (faces >= count))[0][0])
        raise SceneError(
            f"{where}: face {face} is {faces[face].tolist()}, "
            f"but vertices run from 0 to {count - 1}"
        )
    return faces.astype(np.int32)


def _attribute(
    value: ArrayLike | None, width: int, count: int, times: int, what: str
) -> Float64 | None:
    if value is None:
        return None
    array = _array(value, np.float64, what)
    shapes = [(count, width)] + ([(times, count, width)] if times > 1 else [])
    if array.shape not in shapes:
        expected = " or ".join(map(str, shapes))
        raise SceneError(f"{what} have shape {array.shape}, expected {expected}")
    _check_finite(array, what, "vertex")
    return array


def _color(
    value: ArrayLike | None, domain: str, count: int, faces: int, times: int, where: str
) -> tuple[Float32 | None, str]:
    """Colour with its domain made explicit: ``"face"`` (F, 3) or ``"vertex"`` (..., N, 3)."""
    what = f"{where}: color"
    _check_choice(domain, ("auto", "face", "vertex"), f"{where}: color_domain")
    if value is None:
        return None, domain
    array = _array(value, np.float32, what)
    if array.shape == (3,):
        array, domain = np.broadcast_to(array, (faces, 3)), "face"
    shapes: dict[str, list[tuple[int, ...]]]
    shapes = {"face": [(faces, 3)], "vertex": [(count, 3)] + [(times, count, 3)] * (times > 1)}
    fitting = [key for key in shapes if domain in ("auto", key) and array.shape in shapes[key]]
    if not fitting:
        raise SceneError(
            f"{what} has shape {array.shape}, expected (3,), {(faces, 3)} per face or "
            f"{(count, 3)} per vertex"
        )
    if len(fitting) == 2:
        raise SceneError(
            f"{what} of shape {array.shape} fits both faces and vertices; "
            'give color_domain="face" or "vertex"'
        )
    _check_finite(array[..., :], what, "vertex" if fitting[0] == "vertex" else "face")
    return array, fitting[0]
