"""A validated scene file becomes a `Scene`: tracks from keys, meshes from objects."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.errors import SceneError
from mbinterval.files.images import read_image, undecoded
from mbinterval.scene import generators
from mbinterval.scene.asset import GLTF_SUFFIXES, USD_SUFFIXES, Asset
from mbinterval.scene.formats.gltf.gltf import read_gltf
from mbinterval.scene.formats.meshes.mesh_files import read_mesh_file
from mbinterval.scene.formats.toml.schema import (
    CameraTable,
    EnvironmentTable,
    GeneratorTable,
    MaterialTable,
    ObjectTable,
    SceneTable,
    ShutterTable,
    Table,
    TransformTable,
)
from mbinterval.scene.formats.toml.validate import Problem, scene_error
from mbinterval.scene.formats.usd.usd import read_usd
from mbinterval.scene.model import (
    Camera,
    Environment,
    Light,
    Material,
    Mesh,
    Reflections,
    Scene,
    Shutter,
    Texture,
    Viewpoint,
)
from mbinterval.scene.primitives import PRIMITIVES
from mbinterval.scene.rotations import euler_quaternion
from mbinterval.scene.tracks import Track
from mbinterval.scene.transforms import Transform


def build_scene(table: SceneTable, file: str) -> Scene:
    """Read what the scene file names, and put the scene together.

    Raises ``SceneError`` with every object and image that can't be read.
    """
    problems: list[Problem] = []

    def attempt(path: str, make: Callable[[], Any]) -> Any:
        try:
            return make()
        except SceneError as error:
            problems.append(_located(path, str(error)))
        except MemoryError:
            problems.append((path, "does not fit into memory; ask for less of it"))
        return None

    scene = attempt("generator", lambda: _generated(table.generator)) or Scene(meshes=())
    fps = table.fps or scene.fps
    assets: list[Asset] = []
    for index, item in enumerate(table.objects):
        path = f"objects[{index}]"
        textures = {
            name: attempt(f"{path}.material.{name}", partial(_texture, item.material, name))
            for name in _TEXTURES
        }
        place = path if item.file is None else f"{path}.file"
        asset = attempt(place, partial(_object, item, fps, textures))
        assets += [asset] if asset is not None else []
    background = attempt("background", lambda: _background(table, scene))
    environment = attempt("environment", lambda: _environment(table.environment))
    own = [
        Viewpoint(camera)
        for path, item in _camera_tables(table)
        if (camera := attempt(path, partial(_camera, item))) is not None
    ]
    lights = [*scene.lights, *(light for asset in assets for light in asset.lights)]
    if table.lights is not None:
        lights = [
            attempt(f"lights[{index}]", partial(Light, **item.model_dump(exclude_none=True)))
            for index, item in enumerate(table.lights)
        ]
    shutter = next((asset.shutter for asset in assets if asset.shutter), scene.shutter)
    if table.shutter is not None:
        shutter = attempt("shutter", partial(_shutter, table.shutter))
    if problems:
        raise scene_error(file, problems)
    cameras, camera_notes = _cameras(own, scene, assets)
    if table.shutter is not None:
        cameras = [Viewpoint(view.camera) for view in cameras]
    return Scene(
        meshes=[*scene.meshes, *(mesh for asset in assets for mesh in asset.meshes)],
        camera=cameras[0].camera if cameras else None,
        lights=lights,
        background=background,
        shutter=shutter,
        fps=fps,
        name=table.name or Path(file).stem,
        notes=(*scene.notes, *(note for asset in assets for note in asset.notes), *camera_notes),
        animation=_animation(assets),
        cameras=cameras,
        environment=environment,
    )


_OBJECT = re.compile(r"(?:mesh|light|camera|shutter|environment)(?: '[^']*')?: ")
_FIELD = re.compile(r"(\w+)(?:=|: | (?=is |has |have |holds? ))")


def _located(path: str, text: str) -> Problem:
    """Path and text of what a record refused: its name for itself and the field are in the path."""
    label = _OBJECT.match(text)
    if label is None:
        return path, text
    rest = text[label.end() :]
    field = _FIELD.match(rest)
    return (path, rest) if field is None else (f"{path}.{field[1]}", rest[field.end() :])


def _animation(assets: Sequence[Asset]) -> tuple[float, float] | None:
    spans = [asset.animation for asset in assets if asset.animation is not None]
    return (min(span[0] for span in spans), max(span[1] for span in spans)) if spans else None


def _shutter(table: ShutterTable) -> Shutter:
    fields = table.model_dump(exclude_none=True)
    if "angle" in fields:
        return Shutter.from_angle(**fields)
    return Shutter(**fields)


def _background(table: SceneTable, scene: Scene) -> Any:
    if isinstance(table.background, Path):
        return read_image(table.background)[..., :3]
    return scene.background if table.background is None else table.background


def _environment(table: EnvironmentTable | None) -> Environment | None:
    if table is None:
        return None
    given = table.model_dump(exclude={"file"}, exclude_none=True)
    try:
        return Environment(read_image(table.file), **given)
    except SceneError as error:
        text = str(error).removeprefix("environment: ")
        named = text if str(table.file) in text else f"{table.file}: {text}"
        raise SceneError(f"environment: file: {named}") from None


def _generated(table: GeneratorTable | None) -> Scene:
    if table is None:
        return Scene(meshes=())
    make: Any = generators.GENERATORS[table.name]
    scene: Scene = make(**table.model_dump(exclude={"name"}, exclude_none=True))
    return scene


def _camera_tables(table: SceneTable) -> list[tuple[str, CameraTable]]:
    if table.camera is not None:
        return [("camera", table.camera)]
    return [(f"cameras[{index}]", item) for index, item in enumerate(table.cameras)]


def _cameras(
    own: list[Viewpoint], scene: Scene, assets: list[Asset]
) -> tuple[list[Viewpoint], list[str]]:
    """Cameras of the file, of the generator, and of the objects; notes on which is the first."""
    given = own if scene.camera is None else [*own, Viewpoint(scene.camera)]
    found = [view for asset in assets for view in asset.cameras]
    if given or not found:
        return [*given, *found], []
    return found, [f"no [camera]: camera {found[0].camera.name!r} of a model is used"]


Float64 = NDArray[np.float64]

_TEXTURES = ("texture", "metallic_roughness_texture", "emission_texture")
"""Fields of a material that are images."""

_Textures = Mapping[str, Texture | None]


def _texture(table: MaterialTable | None, name: str) -> Texture | None:
    file: Path | None = None if table is None else getattr(table, name)
    if file is None:
        return None
    image = read_image(file)
    if name == "metallic_roughness_texture" and file.suffix.lower() != ".exr":
        image = undecoded(image)
    return Texture(image, name=file.name)


def _object(item: ObjectTable, fps: float, textures: _Textures) -> Asset:
    root = None if item.transform is None else _transform(item.transform)
    if item.file is None:
        asset = Asset((_own_mesh(item, root),))
    elif item.file.suffix.lower() in GLTF_SUFFIXES:
        asset = read_gltf(item.file, item.fps or fps, item.clip, root)
    elif item.file.suffix.lower() in USD_SUFFIXES:
        asset = read_usd(item.file, item.fps or fps, root)
    else:
        asset = read_mesh_file(item.file, root)
    around = None if item.reflections is None else Reflections(**_given(item.reflections))
    return dataclasses.replace(
        asset,
        meshes=tuple(
            dataclasses.replace(_overridden(mesh, item, textures), reflections=around)
            for mesh in asset.meshes
        ),
    )


def _given(table: Table) -> dict[str, Any]:
    return table.model_dump(exclude_none=True)


def _own_mesh(item: ObjectTable, root: Transform | None) -> Mesh:
    """Mesh of arrays in the file, or of a simple shape."""
    if item.primitive is not None:
        sizes = item.primitive.model_dump(exclude={"kind"}, exclude_none=True)
        return dataclasses.replace(PRIMITIVES[item.primitive.kind](**sizes), transform=root)
    return Mesh(
        positions=np.asarray(item.positions),
        faces=np.asarray(item.faces),
        normals=item.normals,
        uv=item.uv,
        color=item.color,
        color_domain=item.color_domain,
        name=item.name,
        transform=root,
    )


def _overridden(mesh: Mesh, item: ObjectTable, textures: _Textures) -> Mesh:
    """``mesh`` with what the object's own fields say."""
    name = "/".join(part for part in (item.name, mesh.name) if part)
    return dataclasses.replace(
        mesh,
        name=mesh.name if mesh.name == item.name else name,
        material=_material(mesh.material or Material(item.name), item.material, textures),
        motion_segments=item.motion_segments or mesh.motion_segments,
        motion_blur=item.motion_blur and mesh.motion_blur,
        shutter_scale=mesh.shutter_scale if item.shutter_scale is None else item.shutter_scale,
        visible=_visible(mesh, item),
    )


def _visible(mesh: Mesh, item: ObjectTable) -> bool | Track:
    if not item.visible or not item.visibility:
        return mesh.visible if item.visible else False
    frames, values = zip(*((key.frame, key.visible) for key in item.visibility), strict=True)
    return Track(np.array(frames), np.array(values, float), "step")


def _material(own: Material, table: MaterialTable | None, textures: _Textures) -> Material:
    if table is None:
        return own
    given = table.model_dump(exclude={*_TEXTURES, "wrap"}, exclude_none=True)
    for name in _TEXTURES:
        texture = textures[name] or getattr(own, name)
        if texture is not None and table.wrap is not None:
            texture = dataclasses.replace(texture, wrap=table.wrap)
        given[name] = texture
    return dataclasses.replace(own, **given)


_CAMERA_TRACKS = (
    *("position", "look_at", "up", "fov", "focal_length"),
    *("f_stop", "focus_distance"),
)
"""Fields of the camera that may be keyed."""


def _camera(table: CameraTable) -> Camera:
    fields = table.model_dump(exclude={"keys", "interpolation", "transform"}, exclude_none=True)
    for name in _CAMERA_TRACKS:
        track = _keyed(table.keys, name, table.interpolation)
        if track is not None:
            fields[name] = track
    transform = None if table.transform is None else _transform(table.transform)
    return Camera(**fields, transform=transform)


def _transform(table: TransformTable) -> Transform:
    fields: dict[str, Any] = table.model_dump(include={"translation", "scale", "rotation"})
    for name in ("translation", "scale", "rotation"):
        track = _keyed(table.keys, name, table.interpolation, quaternion=name == "rotation")
        fields[name] = fields[name] if track is None else track
    if table.euler is not None:
        fields["rotation"] = tuple(euler_quaternion(table.euler, table.euler_order))
    angles = _keyed(table.keys, "euler", table.interpolation)
    if angles is not None:
        fields["rotation"] = dataclasses.replace(angles, euler=table.euler_order)
    return Transform(**{name: value for name, value in fields.items() if value is not None})


def _keyed(
    keys: Sequence[Any], name: str, interpolation: str, quaternion: bool = False
) -> Track | None:
    """Track of one field through those keys that give it; None if none does."""
    pairs = [(key.frame, getattr(key, name)) for key in keys]
    given = [(frame, value) for frame, value in pairs if value is not None]
    if not given:
        return None
    frames, values = map(np.array, zip(*given, strict=True))
    if interpolation == "cubic":
        handles = [
            [getattr(side, name) if side is not None else None for side in (key.before, key.after)]
            for key in keys
            if getattr(key, name) is not None
        ]
        values = cubic_values(frames, values.astype(np.float64), handles, quaternion)
    return Track(frames, values, interpolation, quaternion)


def cubic_values(
    frames: Float64,
    values: Float64,
    handles: Sequence[Sequence[Any]],
    quaternion: bool = False,
) -> Float64:
    """Keys ``(n, 3, ...)`` with tangents, as `Track` has them, from values ``(n, ...)``.

    ``handles`` of each key are the values of its Bezier handles before and after it, a third of the
    way in time to the next key, or None. Without, the curve goes through the key as the line
    between its neighbours does (Catmull & Rom 1974).
    """
    if quaternion:  # the shorter way
        turned = np.cumprod(np.append(1.0, np.sign(np.sum(values[1:] * values[:-1], axis=1))))
        values = values * np.where(turned == 0.0, 1.0, turned)[:, None]
    last = len(values) - 1
    tangents = np.zeros((2, *values.shape))
    for key in range(len(values)):
        low, high = max(key - 1, 0), min(key + 1, last)
        if high > low:
            tangents[:, key] = (values[high] - values[low]) / (frames[high] - frames[low])
        before, after = handles[key]
        if before is not None and key > 0:
            tangents[0, key] = 3.0 * (values[key] - before) / (frames[key] - frames[key - 1])
        if after is not None and key < last:
            tangents[1, key] = 3.0 * (after - values[key]) / (frames[key + 1] - frames[key])
    return np.stack([tangents[0], values, tangents[1]], axis=1)
