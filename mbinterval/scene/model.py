"""The animated scene as frozen records, validated when they are made.

World space is right-handed; the camera looks down its own -Z with +Y up. Colour is scene-linear
Rec. 709. Keys are in frames. Arrays are copied to contiguous float64 (geometry) or float32
(colour) and made read-only, so that a scene never changes under a render.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import InitVar, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.errors import SceneError, UsageError
from mbinterval.scene import field_values
from mbinterval.scene.camera import Camera, Shutter, Viewpoint
from mbinterval.scene.deform import Deformer
from mbinterval.scene.environment import Environment, Reflections
from mbinterval.scene.field_values import Vector, freeze
from mbinterval.scene.frozen import Frozen, check_portable
from mbinterval.scene.mesh_arrays import check_attribute, check_color, check_faces, check_positions
from mbinterval.scene.tracks import Track
from mbinterval.scene.transforms import Placement, check_place

__all__ = [
    "Camera",
    "Environment",
    "Light",
    "Material",
    "Mesh",
    "Reflections",
    "Scene",
    "Shutter",
    "Texture",
    "Vector",
    "Viewpoint",
]

Float64 = NDArray[np.float64]
Float32 = NDArray[np.float32]

SHADINGS = ("unlit", "phong", "metallic_roughness")
ALPHA_MODES = ("auto", "opaque", "mask", "blend")
LIGHT_KINDS = ("ambient", "directional", "point", "spot")
MOST_SEGMENTS = 4096
WRAPS = ("repeat", "clamp", "mirror")


@dataclass(frozen=True, eq=False)
class Texture(Frozen):
    """An image looked up by uv; v points up, as in OpenGL: (0, 0) is the lower left corner.

    Attributes
    ----------
    image
        ``(h, w, 3)`` or ``(h, w, 4)``, scene-linear, first row on top. Stored as float32
        ``(h, w, 4)`` with straight alpha. `read_image` reads a file.
    wrap
        ``"repeat"``, ``"clamp"`` or ``"mirror"``, for u and v.
    """

    image: Float32
    name: str = ""
    wrap: str = "repeat"

    def __post_init__(self) -> None:
        where = field_values.named("texture", self.name)
        image = field_values.image(self.image, f"{where}: image")
        if image.shape[2] == 3:
            image = np.concatenate([image, np.ones_like(image[..., :1])], axis=2)
        freeze(self, image=image, wrap=field_values.choice(self.wrap, WRAPS, f"{where}: wrap"))

    @cached_property
    def alpha_range(self) -> tuple[float, float]:
        """Least and greatest alpha of any texel."""
        alpha = self.image[..., 3]
        return float(alpha.min()), float(alpha.max())


@dataclass(frozen=True)
class Material(Frozen):
    """How a surface answers light.

    ``"unlit"`` shows ``base_color`` times texture times vertex or face colour. ``"phong"`` is
    Phong's model: that colour times (ambient + sum of light * max(0, n.l)), plus
    ``specular`` * light * max(0, r.v) ** ``shininess``; no factor of pi anywhere.
    ``"metallic_roughness"`` is glTF's model (2.0, appendix B): that colour is scattered by what is
    not metal and mirrored by what is, over microfacets of Trowbridge & Reitz's distribution (GGX);
    light has the same scale. ``metallic_roughness_texture``, looked up by the same uv, multiplies
    ``roughness`` by its green and ``metallic`` by its blue. ``emission`` times its texture is what
    surfaces that reflect light add to it.
    Phong's model has highlights of a size and colour of one's choice and is cheap; that of glTF is
    for materials that are made elsewhere, and for metals.
    A two-sided surface turns its normal to the viewer; of a single-sided one only the side whose
    vertices run counter-clockwise is seen, at every moment of the shutter.

    With ``reflectivity``, from 0 to 1, a flat mesh is a mirror: it shows that share of the light
    that comes from where it mirrors the eye's view to, and the rest of its own colour. What is seen
    in a mirror is reflected once: other mirrors have there their own colour alone. With
    ``reflection_shear`` the mirror is glossy (Akenine-Möller et al. 2007, 4.3): what is at a
    distance from it is sheared along it, evenly in all directions, and so spread over a disc whose
    radius is ``reflection_shear`` times that distance.

    Alpha, as in glTF, is ``opacity`` times the texture's and the mesh colour's. ``alpha_mode``
    says what follows: ``"opaque"`` ignores it, ``"mask"`` shows the surface, opaque, where it is
    not below ``alpha_cutoff``, ``"blend"`` lays the surface's colour, highlights too, over what is
    behind. ``"auto"`` is ``"blend"`` where ``opacity`` is below 1, and else ``"opaque"``.
    """

    name: str = ""
    base_color: Vector = (1.0, 1.0, 1.0)
    texture: Texture | None = None
    shading: str = "phong"
    specular: Vector = (0.04, 0.04, 0.04)
    shininess: float = 32.0
    metallic: float = 0.0
    roughness: float = 0.5
    metallic_roughness_texture: Texture | None = None
    emission: Vector = (0.0, 0.0, 0.0)
    emission_texture: Texture | None = None
    double_sided: bool = True
    reflectivity: float = 0.0
    reflection_shear: float = 0.0
    opacity: float = 1.0
    alpha_mode: str = "auto"
    alpha_cutoff: float = 0.5

    def __post_init__(self) -> None:
        where = field_values.named("material", self.name)
        for field_name in ("texture", "metallic_roughness_texture", "emission_texture"):
            if getattr(self, field_name) is not None:
                remedy = ", made of pixels that mbinterval.read_image reads"
                field_values.check_kind(
                    getattr(self, field_name), Texture, f"{where}: {field_name}", remedy
                )
        freeze(
            self,
            base_color=field_values.vector(self.base_color, f"{where}: base_color"),
            shading=field_values.choice(self.shading, SHADINGS, f"{where}: shading"),
            specular=field_values.vector(self.specular, f"{where}: specular"),
            shininess=field_values.number(self.shininess, f"{where}: shininess", above=0.0),
            metallic=field_values.number(self.metallic, f"{where}: metallic", 0.0, 1.0),
            roughness=field_values.number(self.roughness, f"{where}: roughness", 0.0, 1.0),
            emission=field_values.vector(self.emission, f"{where}: emission"),
            double_sided=field_values.flag(self.double_sided, f"{where}: double_sided"),
            reflectivity=field_values.number(self.reflectivity, f"{where}: reflectivity", 0.0, 1.0),
            reflection_shear=field_values.number(
                self.reflection_shear, f"{where}: reflection_shear", 0.0
            ),
            opacity=field_values.number(self.opacity, f"{where}: opacity", 0.0, 1.0),
            alpha_mode=field_values.choice(self.alpha_mode, ALPHA_MODES, f"{where}: alpha_mode"),
            alpha_cutoff=field_values.number(self.alpha_cutoff, f"{where}: alpha_cutoff", 0.0),
        )

    @property
    def textures(self) -> list[Texture]:
        """Textures that it has."""
        all_of_them = (self.texture, self.metallic_roughness_texture, self.emission_texture)
        return [texture for texture in all_of_them if texture is not None]

    @property
    def alpha(self) -> str:
        """What alpha means: ``"opaque"``, ``"mask"`` or ``"blend"``."""
        if self.alpha_mode != "auto":
            return self.alpha_mode
        return "blend" if self.opacity < 1.0 else "opaque"


@dataclass(frozen=True)
class Light(Frozen):
    """A light without extent: ``"ambient"``, ``"directional"``, ``"point"`` or ``"spot"``.

    ``direction`` is the way that light travels. A point light falls off with the square of the
    distance: ``color * intensity / distance**2``. Both are in the space that ``transform`` maps to
    the world; a light that moves stands for a whole exposure where it is at the frame.

    A spot light is a point light in a cone about ``direction``: full within ``inner_angle`` of it,
    none beyond ``outer_angle``, both in degrees, ``0 <= inner_angle < outer_angle <= 90``. Between
    them it fades with the square of (cos(angle) - cos(outer)) / (cos(inner) - cos(outer)), as
    glTF's KHR_lights_punctual proposes.

    With ``shadows`` surfaces hide it from each other; `Settings.shadows` can decide for all lights.
    Ambient light has no shadows.
    """

    kind: str
    color: Vector = (1.0, 1.0, 1.0)
    intensity: float = 1.0
    direction: Vector = (0.0, 0.0, -1.0)
    position: Vector = (0.0, 0.0, 0.0)
    transform: Placement | None = None
    inner_angle: float = 0.0
    outer_angle: float = 45.0
    shadows: bool = False

    def __post_init__(self) -> None:
        kind = field_values.choice(self.kind, LIGHT_KINDS, "light: kind")
        direction = field_values.vector(self.direction, "light: direction")
        if kind in ("directional", "spot") and not any(direction):
            raise SceneError("light: direction is zero; give the way that light travels")
        inner = field_values.number(self.inner_angle, "light: inner_angle", 0.0)
        outer = field_values.number(self.outer_angle, "light: outer_angle", 0.0, 90.0)
        if inner >= outer:
            raise SceneError(
                f"light: inner_angle={inner:g}, outer_angle={outer:g}; expected inner_angle < "
                "outer_angle, in degrees from the middle of the cone"
            )
        color = field_values.vector(self.color, "light: color")
        intensity = field_values.number(self.intensity, "light: intensity", 0.0)
        field_values.product({"color": color, "intensity": intensity}, "light")
        freeze(
            self,
            kind=kind,
            color=color,
            intensity=intensity,
            direction=direction,
            position=field_values.vector(self.position, "light: position"),
            inner_angle=inner,
            outer_angle=outer,
            shadows=field_values.flag(self.shadows, "light: shadows"),
        )
        if self.transform is not None:
            check_place(self.transform, "light: transform")

    def __getstate__(self) -> dict[str, Any]:
        check_portable(self.transform, "light: transform")
        return dict(vars(self))

    def at(self, frame: float) -> Light:
        """Return the light in the world at ``frame``."""
        if self.transform is None:
            return self
        matrix = self.transform.at(frame)
        direction = tuple(matrix[:3, :3] @ self.direction)
        position = tuple(matrix[:3, :3] @ self.position + matrix[:3, 3])
        return replace(self, direction=direction, position=position, transform=None)


@dataclass(frozen=True, eq=False)
class Mesh(Frozen):
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
        With four columns the last is alpha, from 0 to 1, which counts if the material says so.
    shading
        Shorthand for ``material=Material(shading=...)``.
    motion_segments
        Linear motion segments over the shutter; a multiple of K for positions per time. None lets
        `Settings` decide.
    motion_blur
        False shows the mesh throughout the exposure as it is at the frame.
    shutter_scale
        Its own shutter is so many times as long, around the frame; 0 is ``motion_blur=False``.
        Positions per time hold their first and last values beyond the scene's shutter.
    visible
        False leaves the mesh out; a stepped track of 0 and 1 lets it appear and vanish, at any
        time of the shutter.
    deformer
        Moves the vertices at any frame, as joints and morph targets do; ``positions`` and
        ``normals`` are then those at rest.
    reflections
        Lets it mirror what is around it (`Reflections`); None mirrors the environment alone.
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
    reflections: Reflections | None = None
    shading: InitVar[str | None] = None

    def __post_init__(self, shading: str | None) -> None:
        where = field_values.named("mesh", self.name)
        positions = check_positions(self.positions, where)
        count, times = positions.shape[-2], positions.shape[0] if positions.ndim == 3 else 1
        faces = check_faces(self.faces, count, where)
        normals = check_attribute(self.normals, 3, count, times, f"{where}: normals")
        uv = check_attribute(self.uv, 2, count, times, f"{where}: uv")
        color, domain = check_color(self.color, self.color_domain, count, len(faces), times, where)
        freeze(
            self,
            positions=positions,
            faces=faces,
            normals=normals,
            uv=uv,
            color=color,
            color_domain=domain,
            visible=_visibility(self.visible, f"{where}: visible"),
            motion_blur=field_values.flag(self.motion_blur, f"{where}: motion_blur"),
            shutter_scale=field_values.number(self.shutter_scale, f"{where}: shutter_scale", 0.0),
        )
        self._check_material(shading, where)
        self._check_segments(where)
        if self.transform is not None:
            check_place(self.transform, f"{where}: transform")
        if self.reflections is not None:
            field_values.check_kind(self.reflections, Reflections, f"{where}: reflections")
        if self.deformer is not None and self.times > 1:
            raise SceneError(f"{where}: a deformer and positions per time; give one")

    def __getstate__(self) -> dict[str, Any]:
        for name in ("transform", "deformer"):
            check_portable(getattr(self, name), f"{field_values.named('mesh', self.name)}: {name}")
        return dict(vars(self))

    def _check_material(self, shading: str | None, where: str) -> None:
        if self.material is not None:
            field_values.check_kind(self.material, Material, f"{where}: material")
            base = self.material.base_color
            if self.color is not None and max(map(abs, base)) > 1.0:
                field_values.product({"color": self.color, "base_color": base}, where)
        if shading is None:
            return
        if self.material is not None:
            raise SceneError(f"{where}: material and shading both given; give one")
        freeze(
            self,
            material=Material(shading=field_values.choice(shading, SHADINGS, f"{where}: shading")),
        )

    def _check_segments(self, where: str) -> None:
        if self.motion_segments is None:
            return
        most = max(MOST_SEGMENTS, self.times - 1)
        segments = field_values.whole_number(
            self.motion_segments, f"{where}: motion_segments", 1, most
        )
        if self.times > 1 and segments % (self.times - 1):
            raise SceneError(
                f"{where}: motion_segments={segments}, but positions are given for "
                f"{self.times - 1} segments; expected a multiple of that"
            )
        freeze(self, motion_segments=segments)

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
class Scene(Frozen):
    """Everything that is rendered; it can be evaluated at any frame.

    ``background`` is a colour, or an image ``(h, w, 3)``, scene-linear, that fills the frame; alpha
    that `read_image` brings is left out. Where an ``environment`` is seen, it is not.
    ``notes`` are what a reader had to assume; ``mbinterval info`` prints them. ``cameras`` are all
    that a file has, for `through`; ``camera`` is the one in use.
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
    cameras: Sequence[Viewpoint] = ()
    environment: Environment | None = None

    def __post_init__(self) -> None:
        if self.camera is not None:
            field_values.check_kind(self.camera, Camera, "scene: camera")
        if self.environment is not None:
            remedy = ", made of pixels that mbinterval.read_image reads"
            field_values.check_kind(self.environment, Environment, "scene: environment", remedy)
        field_values.check_kind(self.shutter, Shutter, "scene: shutter")
        freeze(
            self,
            meshes=field_values.items(self.meshes, Mesh, "scene: meshes"),
            lights=field_values.items(self.lights, Light, "scene: lights"),
            background=_background(self.background),
            fps=field_values.number(self.fps, "scene: fps", above=0.0),
            name=field_values.text(self.name, "scene: name"),
            notes=field_values.items(self.notes, str, "scene: notes"),
            cameras=field_values.items(self.cameras, Viewpoint, "scene: cameras"),
        )

    def through(self, camera: str | int) -> Scene:
        """Return the scene as one of its cameras sees it, with the shutter of that camera.

        ``camera`` is a name, or a place in ``cameras``; see `camera_index`.
        """
        index = self.camera_index(camera) if isinstance(camera, str) else camera
        view = self.cameras[index]
        return replace(self, camera=view.camera, shutter=view.shutter or self.shutter)

    def camera_index(self, name: str) -> int:
        """Place in ``cameras`` of the first that is called ``name``.

        Where none is, a number is the place itself. Raises `UsageError` where there is no such
        camera.
        """
        names = [view.camera.name for view in self.cameras]
        if name in names:
            return names.index(name)
        if name.isdecimal() and int(name) < len(names):
            return int(name)
        known = ", ".join(known or str(index) for index, known in enumerate(names))
        raise UsageError(
            f"no camera {name!r}; the scene has {known or 'none: one that frames it is made'}"
        )


def _visibility(value: Any, what: str) -> bool | Track:
    if not isinstance(value, Track):
        return field_values.flag(value, what)
    if value.interpolation != "step" or value.shape != ():
        raise SceneError(f"{what} is keyed, but not by a stepped track of single numbers")
    return value


def _background(value: Any) -> Vector | Float32:
    what = "scene: background"
    if isinstance(value, str | Path) or np.ndim(value) == 3:
        pixels: Float32 = field_values.image(value, what)[..., :3]
        return pixels
    red, green, blue = field_values.row(
        value, 3, what, "three finite numbers, or an image (h, w, 3)"
    )
    return red, green, blue
