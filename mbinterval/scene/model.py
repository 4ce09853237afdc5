"""The animated scene as frozen records, validated when they are made.

World space is right-handed; the camera looks down its own -Z with +Y up. Colour is scene-linear
Rec. 709. Keys are in frames. Arrays are copied to contiguous float64 (geometry) or float32
(colour) and made read-only, so that a scene never changes under a render.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import InitVar, dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mbinterval.checks import number
from mbinterval.errors import SceneError
from mbinterval.scene.camera import Camera, Shutter
from mbinterval.scene.checks import Vector, check_choice, check_finite, freeze, numbers, vector
from mbinterval.scene.deform import Deformer
from mbinterval.scene.tracks import Placement, Track

__all__ = ["Camera", "Light", "Material", "Mesh", "Scene", "Shutter", "Texture", "Vector"]

Float64 = NDArray[np.float64]
Float32 = NDArray[np.float32]

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
        check_finite(image, f"texture {self.name!r}: image", "pixel")
        check_choice(self.wrap, WRAPS, f"texture {self.name!r}: wrap")
        freeze(self, image=image)


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
        check_choice(self.shading, SHADINGS, f"{where}: shading")
        freeze(
            self,
            base_color=vector(self.base_color, f"{where}: base_color"),
            specular=vector(self.specular, f"{where}: specular"),
        )
        if not (np.isfinite(self.shininess) and self.shininess > 0):
            raise SceneError(f"{where}: shininess={self.shininess!r}, expected a number above 0")


@dataclass(frozen=True)
class Light:
    """A light without extent: ``"ambient"``, ``"directional"`` or ``"point"``.

    ``direction`` is the way that light travels. A point light falls off with the square of the
    distance: ``color * intensity / distance**2``. Both are in the space that ``transform`` maps to
    the world; a light that moves stands for a whole exposure where it is at the frame.
    """

    kind: str
    color: Vector = (1.0, 1.0, 1.0)
    intensity: float = 1.0
    direction: Vector = (0.0, 0.0, -1.0)
    position: Vector = (0.0, 0.0, 0.0)
    transform: Placement | None = None

    def __post_init__(self) -> None:
        check_choice(self.kind, LIGHT_KINDS, "light: kind")
        direction = vector(self.direction, "light: direction")
        if self.kind == "directional" and not any(direction):
            raise SceneError("light: direction is zero; give the way that light travels")
        if not (np.isfinite(self.intensity) and self.intensity >= 0):
            raise SceneError(f"light: intensity={self.intensity!r}, expected a number from 0 up")
        freeze(
            self,
            color=vector(self.color, "light: color"),
            direction=direction,
            position=vector(self.position, "light: position"),
        )

    def at(self, frame: float) -> Light:
        """Return the light in the world at ``frame``."""
        if self.transform is None:
            return self
        matrix = self.transform.at(frame)
        direction = tuple(matrix[:3, :3] @ self.direction)
        position = tuple(matrix[:3, :3] @ self.position + matrix[:3, 3])
        return replace(self, direction=direction, position=position, transform=None)


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
        Linear motion segments over the shutter; a multiple of K for positions per time. None lets
        `Settings` decide.
    motion_blur
        False shows the mesh throughout the exposure as it is at the frame.
    shutter_scale
        Its own shutter is so many times as long, around the frame; 0 is ``motion_blur=False``.
    visible
        False leaves the mesh out; a stepped track of 0 and 1 lets it appear and vanish, at any
        time of the shutter.
    deformer
        Moves the vertices at any frame, as joints and morph targets do; ``positions`` and
        ``normals`` are then those at rest.
    """

    positions: Float64
    faces: NDArray[np.int32]
    normals: Float64 | None = None
    uv: Float64 | None = None
    color: Float32 | None = None
    material: Material | None = None
    motion_segments: int | None = None
    motion_blur: bool = True
    shutter_scale: float = 1.0
    visible: bool | Track = True
    name: str = ""
    transform: Placement | None = None
    color_domain: str = "auto"
    deformer: Deformer | None = None
    shading: InitVar[str | None] = None

    def __post_init__(self, shading: str | None) -> None:
        where = f"mesh {self.name!r}"
        positions = numbers(self.positions, np.float64, f"{where}: positions")
        if positions.ndim not in (2, 3) or positions.shape[-1] != 3 or positions.shape[0] == 0:
            raise SceneError(
                f"{where}: positions have shape {positions.shape}, expected (N, 3) for a static "
                "mesh or (K+1, N, 3) for K motion segments"
            )
        if positions.ndim == 3 and positions.shape[0] == 1:
            positions = positions[0]
        check_finite(positions, f"{where}: positions", "vertex")
        count, times = positions.shape[-2], positions.shape[0] if positions.ndim == 3 else 1
        faces = _faces(self.faces, count, where)
        normals = _attribute(self.normals, 3, count, times, f"{where}: normals")
        uv = _attribute(self.uv, 2, count, times, f"{where}: uv")
        color, domain = _color(self.color, self.color_domain, count, len(faces), times, where)
        if shading is not None:
            if self.material is not None:
                raise SceneError(f"{where}: material and shading both given; give one")
            freeze(self, material=Material(shading=shading))
        segments = self.motion_segments
        if segments is not None and (
            isinstance(segments, bool) or not isinstance(segments, int) or segments < 1
        ):
            raise SceneError(f"{where}: motion_segments={segments!r}, expected a whole number >= 1")
        if self.deformer is not None and times > 1:
            raise SceneError(f"{where}: a deformer and positions per time; give one")
        if segments is not None and times > 1 and segments % (times - 1):
            raise SceneError(
                f"{where}: motion_segments={segments}, but positions are given for {times - 1} "
                "segments; expected a multiple of that"
            )
        if isinstance(self.visible, Track) and (
            self.visible.interpolation != "step" or self.visible.values.ndim != 1
        ):
            raise SceneError(f"{where}: visible must be true, false or a stepped track of numbers")
        number(self.shutter_scale, f"{where}: shutter_scale", 0.0, error=SceneError)
        freeze(
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

    @property
    def own_shutter(self) -> float:
        """Length of its own shutter as a part of the scene's: 0 without motion blur."""
        return self.shutter_scale if self.motion_blur else 0.0

    @property
    def animated(self) -> bool:
        """Whether a transform or a deformer may move it."""
        moved = self.transform is not None and self.transform.animated
        return moved or self.deformer is not None

    @property
    def jumps(self) -> list[float]:
        """Frames at which it may jump."""
        parts = (self.transform, self.deformer)
        return [frame for part in parts if part is not None for frame in part.jumps]


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything that is rendered; it can be evaluated at any frame.

    ``background`` is a colour, or an image ``(h, w, 3)``, scene-linear, that fills the frame.
    ``animation`` is the first and the last frame of the animation that was read, if any; ``notes``
    are what a reader had to assume; ``mbinterval info`` prints them.
    """

    meshes: Sequence[Mesh]
    camera: Camera | None = None
    lights: Sequence[Light] = ()
    background: Vector | Float32 = (0.0, 0.0, 0.0)
    shutter: Shutter = field(default_factory=Shutter)
    fps: float = 24.0
    name: str = ""
    notes: tuple[str, ...] = ()
    animation: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        for name, kind in (("meshes", Mesh), ("lights", Light)):
            items = tuple(getattr(self, name))
            for index, item in enumerate(items):
                if not isinstance(item, kind):
                    raise SceneError(
                        f"scene: {name}[{index}] is {type(item).__name__}, expected {kind.__name__}"
                    )
            freeze(self, **{name: items})
        if not (np.isfinite(self.fps) and self.fps > 0):
            raise SceneError(f"scene: fps={self.fps!r}, expected a number above 0")
        if np.ndim(self.background) == 1:
            freeze(self, background=vector(self.background, "scene: background"))
        else:
            image = numbers(self.background, np.float32, "scene: background")
            if image.ndim != 3 or image.shape[2] != 3 or 0 in image.shape:
                raise SceneError(
                    f"scene: background has shape {image.shape}, expected (3,) or (h, w, 3)"
                )
            check_finite(image, "scene: background", "pixel")
            freeze(self, background=image)


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
    array = numbers(value, np.float64, what)
    shapes = [(count, width)] + ([(times, count, width)] if times > 1 else [])
    if array.shape not in shapes:
        expected = " or ".join(map(str, shapes))
        raise SceneError(f"{what} have shape {array.shape}, expected {expected}")
    check_finite(array, what, "vertex")
    return array


def _color(
    value: ArrayLike | None, domain: str, count: int, faces: int, times: int, where: str
) -> tuple[Float32 | None, str]:
    """Colour with its domain made explicit: ``"face"`` (F, 3) or ``"vertex"`` (..., N, 3)."""
    what = f"{where}: color"
    check_choice(domain, ("auto", "face", "vertex"), f"{where}: color_domain")
    if value is None:
        return None, domain
    array = numbers(value, np.float32, what)
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
    check_finite(array[..., :], what, "vertex" if fitting[0] == "vertex" else "face")
    return array, fitting[0]
