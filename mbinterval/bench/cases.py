"""What a benchmark renders: scenes from files or generators, and what they should look like."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.errors import SceneError, UsageError
from mbinterval.files.arrays import read_arrays
from mbinterval.film.film import Film
from mbinterval.film.frame_ranges import parse_frames, resolution
from mbinterval.scene.formats.load import load_file
from mbinterval.scene.generators import GENERATORS
from mbinterval.scene.model import Material, Mesh, Scene
from mbinterval.values import nearest


@dataclass(frozen=True, eq=False)
class Case:
    """What is measured: a scene at a size, and what it should look like where that is known.

    ``reference`` is ``(H, W, 3)`` scene-linear; ``settings`` those of the scene's file.
    """

    name: str
    scene: Scene
    frame: float
    width: int
    height: int
    settings: Mapping[str, Any] = field(default_factory=dict)
    reference: NDArray[np.float32] | None = None


def make_case(
    source: str,
    reference: str | None = None,
    width: int | None = None,
    height: int | None = None,
    single_sided: bool = False,
    at_rest: bool = False,
) -> Case:
    """Read a scene file or make a generated scene, such as ``fast_cubes`` or ``fast_cubes:2000``.

    Width and height default to the file's, else to 1024 and 768; one of them keeps the shape. With
    ``single_sided`` back faces of closed meshes are culled; with ``at_rest`` everything is
    throughout the exposure where it is at the frame.

    Raises
    ------
    UsageError, SceneError
        For a scene that is neither, for a reference that is not one of it, and for a camera that
        moves and should be at rest.
    """
    name, _, count = source.partition(":")
    if name in GENERATORS:
        if not (count or "1").isdecimal():
            raise UsageError(f"scene {source!r}: {count!r} is no count, as in {name}:100")
        make: Any = GENERATORS[name]
        scene = make(int(count)) if count else make()
        case = Case(source, scene, 1.0, *resolution(width, height, None, None))
    elif Path(source).suffix:
        loaded = load_file(source)
        stored = loaded.render
        first = parse_frames(stored.frames or "1")[0]
        size = resolution(width, height, stored.width, stored.height)
        case = Case(Path(source).stem, loaded.scene, first, *size, loaded.settings)
    else:
        known = nearest(name, GENERATORS)
        raise UsageError(f"scene {source!r}: neither a file nor a generated scene, {known}")
    if single_sided:
        case = dataclasses.replace(case, scene=_single_sided(case.scene))
    if at_rest:
        case = dataclasses.replace(case, scene=_at_rest(case))
    if reference is not None:
        case = dataclasses.replace(case, reference=_reference(Path(reference), case))
    return case


def _reference(path: Path, case: Case) -> NDArray[np.float32]:
    if path.suffix.lower() != ".npz":
        rgb = Film.read(path).rgba[..., :3]
    else:
        try:
            rgb = np.asarray(read_arrays(path, ["rgb"])["rgb"], np.float32)
        except (OSError, ValueError, KeyError) as error:
            raise SceneError(
                f"reference {path}: cannot be read ({error}); expected an EXR, or an npz with an "
                "array rgb (height, width, 3)"
            ) from None
    if rgb.shape != (case.height, case.width, 3):
        shape = " x ".join(map(str, rgb.shape[1::-1]))
        raise UsageError(
            f"reference {path}: {shape} pixels, but {case.name} is {case.width} x {case.height}"
        )
    return rgb


def _single_sided(scene: Scene) -> Scene:
    """Cull the back faces of closed meshes, which no eye outside of them sees."""
    meshes = [
        dataclasses.replace(
            mesh,
            material=dataclasses.replace(mesh.material or Material(), double_sided=False),
        )
        if is_closed(mesh)
        else mesh
        for mesh in scene.meshes
    ]
    return dataclasses.replace(scene, meshes=meshes)


def _at_rest(case: Case) -> Scene:
    """Show every mesh throughout the exposure as it is at the frame."""
    camera = case.scene.camera
    if camera is not None and camera.animated:
        raise UsageError(f"scene {case.name}: its camera moves; at_rest is for one that stands")
    meshes = [dataclasses.replace(mesh, motion_blur=False) for mesh in case.scene.meshes]
    return dataclasses.replace(case.scene, meshes=meshes)


def is_closed(mesh: Mesh) -> bool:
    """Whether each edge has one face on either side, and faces look outwards.

    Vertices that always lie at the same place are one.
    """
    positions = np.atleast_3d(mesh.positions.T).T  # (K+1, N, 3)
    points = positions.transpose(1, 0, 2).reshape(positions.shape[1], -1)
    welded = np.unique(points, axis=0, return_inverse=True)[1].reshape(-1)[mesh.faces]
    edges = welded[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2).astype(np.int64)
    size = int(edges.max(initial=0)) + 1
    there, back = np.sort(edges @ [size, 1]), np.sort(edges @ [1, size])
    corners = positions[0][mesh.faces] - positions[0].mean(axis=0)
    outwards = bool(np.linalg.det(corners).sum() > 0)
    return outwards and bool((np.diff(there) > 0).all()) and np.array_equal(there, back)
