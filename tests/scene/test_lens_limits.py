"""Where a lens's limits bend its blur meshes are cut and get motion segments, and stay as they are.

The blur of a point is what the kernels have, linear between the vertices of an exposure and between
its knots, against the circle of confusion at the point's own depth, written out again.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.nightly import nightly_but

from mbinterval.exposure import focus
from mbinterval.exposure.edge_errors import sags, swept
from mbinterval.exposure.exposure import Exposure, expose
from mbinterval.exposure.limits import bends_of
from mbinterval.exposure.mesh_exposure import MeshExposure
from mbinterval.exposure.poses import CameraPoses
from mbinterval.exposure.segments import View
from mbinterval.exposure.shutter_times import Window
from mbinterval.scene.model import Camera, Material, Mesh, Scene, Shutter
from mbinterval.scene.tracks import Track, Transform

SIZE = (96, 72)
ERROR = 0.1
UNLIT = Material(shading="unlit")
LIMITS = {
    "range": {"sharp_range": (4.0, 9.0)},
    "foreground": {"foreground_blur": 0.01},
    "both": {"sharp_range": (4.0, 9.0), "foreground_blur": 0.01},
    "none before": {"sharp_range": (3.0, 5.0), "foreground_blur": 0.0},
}


def keys(*values: object, **given: object) -> Track:
    return Track(np.linspace(-0.25, 0.25, len(values)), values, **given)


def turned(degrees: float) -> list[float]:
    half = np.radians(degrees) / 2
    return [0.0, float(np.sin(half)), 0.0, float(np.cos(half))]


LENS = {"fov": 50.0, "f_stop": 1.0, "focus_distance": 6.0, "meters_per_unit": 0.03}
STILL = Camera(**LENS)
PAN = Transform(rotation=keys(turned(-8), turned(8), quaternion=True))
CAMERAS = {
    "still": STILL,
    "push": replace(STILL, position=keys((0, 0, 0), (0.2, 0, -1.5))),
    "pan": Camera(transform=PAN, **LENS),
    "pull": replace(STILL, focus_distance=keys(4.0, 8.0)),
    "zoom": replace(STILL, fov=keys(40.0, 55.0)),
}


def ground(half: float = 30.0, near: float = 5.0, far: float = -40.0, **given: object) -> Mesh:
    """Two triangles below the eye, partly behind it."""
    corners = [[-half, -0.8, near], [half, -0.8, near], [half, -0.8, far], [-half, -0.8, far]]
    return Mesh(corners, [[0, 1, 2], [0, 2, 3]], **({"material": UNLIT} | given))


def triangles(seed: int, count: int = 12, **given: object) -> Mesh:
    """Triangles in view and beside it, each of which moves in its own way."""
    rng = np.random.default_rng(seed)
    middle = rng.uniform((-2, -1.5, -12), (2, 1.5, -2), (count, 3))
    start = middle[:, None] + rng.normal(0, (1.0, 1.0, 2.0), (count, 3, 3))
    end = start + rng.normal(0, 0.4, (count, 1, 3)) + rng.normal(0, 0.3, start.shape)
    faces = np.arange(3 * count).reshape(-1, 3)
    positions = np.stack([start, end]).reshape(2, -1, 3)
    return Mesh(positions, faces, **({"material": UNLIT} | given))


def exposed(*meshes: Mesh, camera: Camera, error: float = ERROR, **scene: object) -> Exposure:
    width, height = SIZE
    of = Scene(meshes, camera, **scene)
    return expose(of, 0.0, width / height, None, height, error, height)


def circle(camera: Camera, poses: CameraPoses, w: np.ndarray) -> np.ndarray:
    """Radius of blur times w in pixels, at depths ``(T, ...)``."""
    shape = (-1,) + (1,) * (w.ndim - 1)
    at = poses.focus.reshape(shape)
    slope = (poses.aperture * poses.focal).reshape(shape) * SIZE[1] / at
    near, far = camera.sharp_range or (at, at)
    found = slope * np.where(w > far, w - far, np.where(w < near, w - near, 0.0))
    if camera.foreground_blur is not None:
        found = np.maximum(found, -camera.foreground_blur * SIZE[1] * w)
    return found


def blur_errors(mesh: MeshExposure, camera: Camera) -> np.ndarray:
    """Errors of the radius in pixels ``(times, points)``, at points of all faces that are seen."""
    width, height = SIZE
    rng = np.random.default_rng(0)
    knots = np.arange(mesh.segments + 1)
    world = mesh.positions[np.minimum(knots, len(mesh.positions) - 1)]
    poses = mesh.poses.at(knots)
    seen = np.einsum("tij,tnj->tni", poses.rotation, world - poses.eye[:, None])
    seen[..., :2] *= (poses.focal * height)[:, None, None]
    seen[..., 2] *= -1.0
    values = np.concatenate([seen, circle(camera, poses, seen[..., 2])[..., None]], axis=2)
    share = rng.dirichlet(np.full(3, 0.4), (30 + 4000 // len(mesh.faces), len(mesh.faces)))
    points = np.einsum("pfc,tfck->tpfk", share, values[:, mesh.faces])
    times = (np.arange(200) + 0.5) / 200 if mesh.segments else np.zeros(1)
    knot = np.minimum((times * mesh.segments).astype(int), max(mesh.segments - 1, 0))
    part = (times * mesh.segments - knot)[:, None, None, None]
    after = np.minimum(knot + 1, mesh.segments)
    x, y, w, has = np.moveaxis((1.0 - part) * points[knot] + part * points[after], -1, 0)
    view = View(camera, Window(0.0, -0.25, 0.25), width / height, height)
    want = circle(camera, view.poses(times), w)
    in_view = (w > 0.3) & (np.abs(x) < 0.6 * width * w) & (np.abs(y) < 0.6 * height * w)
    away = np.where(in_view, np.abs(want - has) / np.maximum(w, 1e-9), 0.0)
    return away.reshape(len(times), -1)


SURFACES = {
    "ground": ground(),
    "huge": ground(200.0, 160.0, -600.0),
    "one triangle": Mesh([[-9, -1, 2], [9, -1, 2], [0, 0.5, -30]], [[0, 1, 2]], material=UNLIT),
    "triangles": triangles(1),
    "moves": ground(transform=Transform(translation=keys((0, 0, 0), (0.5, 0, 2.0)))),
}
MOVING = [(camera, surface) for camera in CAMERAS for surface in SURFACES]


@pytest.mark.parametrize("limit", nightly_but(LIMITS, "both"))
@pytest.mark.parametrize(("camera", "surface"), MOVING)
def test_blur_is_as_its_depth_has_it_at_every_point(camera, surface, limit):
    """Within `motion_error` on average over time, and ten times that at any moment."""
    seen = replace(CAMERAS[camera], **LIMITS[limit])
    (mesh,) = exposed(SURFACES[surface], camera=seen).meshes
    away = blur_errors(mesh, seen)
    assert away.mean(axis=0).max() < ERROR
    assert away.max() < 10 * ERROR
    (uncut,) = exposed(SURFACES[surface], camera=seen, error=np.inf).meshes
    assert uncut.cuts is None
    assert blur_errors(uncut, seen).mean(axis=0).max() > 2 * ERROR
    assert len(mesh.faces) < 2000
    assert mesh.segments <= 16


@pytest.mark.parametrize("curve", ["box", "triangle"])
def test_what_comes_in_a_shorter_time_counts_for_more(curve):
    """A vertex that passes a bend is wrong for one segment; of each line's time that is a part."""
    seen = replace(CAMERAS["push"], **LIMITS["both"])
    rolling = Shutter(
        -0.25, curve=curve, rolling="down", line_offset=0.4 / 24 / SIZE[1], line_exposure=0.1 / 24
    )
    for shutter, part in ((Shutter(curve=curve), 1.0), (rolling, 0.2)):
        (mesh,) = exposed(ground(), camera=seen, shutter=shutter).meshes
        away = blur_errors(mesh, seen)
        length = round(part * len(away))
        weight = np.ones(length) if curve == "box" else np.bartlett(length + 1)[:-1]
        windows = [away[at : at + length] for at in range(0, len(away) - length + 1, 10)]
        worst = max(np.average(window, axis=0, weights=weight).max() for window in windows)
        assert worst < ERROR


@pytest.mark.parametrize(("camera", "error"), [("push", 0.02), ("pan", 0.05)])
def test_a_smaller_error_is_kept_too(camera, error):
    seen = replace(CAMERAS[camera], **LIMITS["both"])
    (mesh,) = exposed(ground(), camera=seen, error=error).meshes
    assert blur_errors(mesh, seen).mean(axis=0).max() < error


def shares_of(mesh: MeshExposure) -> np.ndarray:
    """Shares ``(F, 3, 3)`` of the parent's corners, of each corner of each face."""
    old = mesh.positions[0][mesh.mesh.faces[mesh.parents]]
    new = mesh.positions[0][mesh.faces]
    edges = np.stack([old[:, 1] - old[:, 0], old[:, 2] - old[:, 0]], axis=2)
    found = np.linalg.pinv(edges) @ (new - old[:, :1]).swapaxes(1, 2)
    return np.concatenate([1.0 - found.sum(axis=1, keepdims=True), found], axis=1).swapaxes(1, 2)


@pytest.mark.parametrize("camera", ["push", "pan", "pull"])
def test_the_surface_and_all_that_vertices_have_stay(camera):
    rng = np.random.default_rng(4)
    plain = triangles(2)
    count = plain.positions.shape[1]
    given = {"normals": rng.normal(size=(2, count, 3)), "uv": rng.uniform(size=(count, 2)),
             "color": rng.uniform(size=(2, count, 4)), "color_domain": "vertex"}  # fmt: skip
    seen = replace(CAMERAS[camera], **LIMITS["both"])
    (mesh,) = exposed(replace(plain, **given), camera=seen).meshes
    (free,) = exposed(replace(plain, **given), camera=seen, error=np.inf).meshes
    assert len(mesh.faces) > len(free.faces) == len(free.parents) == 12
    assert np.all(np.diff(mesh.parents) >= 0)
    assert np.array_equal(np.unique(mesh.parents), np.arange(12))
    share = shares_of(mesh)
    assert share.min() > -1e-9
    for name in ("positions", "normals", "uv", "color"):
        values = getattr(mesh, name)
        known = values[:, : getattr(free, name).shape[1]]
        corners = known[:, mesh.mesh.faces[mesh.parents]]
        blended = np.einsum("fnc,tfck->tfnk", share, corners)
        assert np.allclose(values[:, mesh.faces], blended, rtol=0.0, atol=3e-7)
    # The parts fill each face once: they are turned as it is, and have its area together.
    area = np.linalg.det(share)
    assert area.min() > 0.0
    assert np.bincount(mesh.parents, area) == pytest.approx(1.0, abs=1e-9)


def test_colours_of_faces_stay_with_their_parts():
    color = np.random.default_rng(0).uniform(size=(12, 3))
    mesh = triangles(2, color=color, color_domain="face")
    (cut,) = exposed(mesh, camera=replace(STILL, **LIMITS["both"])).meshes
    assert len(cut.faces) > 12
    assert np.array_equal(cut.face_color, mesh.color[cut.parents])


def sheet(shared: bool, seed: int = 5) -> Mesh:
    """A bent sheet whose neighbours share vertices, or places alone, in another order."""
    rng = np.random.default_rng(seed)
    x, z = np.meshgrid(np.linspace(-3, 3, 5), np.linspace(-1, -14, 5), indexing="ij")
    points = np.stack([x, -0.8 + 0.1 * rng.normal(size=x.shape), z], axis=-1).reshape(-1, 3)
    i = np.arange(25).reshape(5, 5)
    a, b, c, d = (p.ravel() for p in (i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    both = np.stack([points, points + rng.normal(0, 0.15, points.shape)])
    if shared:
        return Mesh(both, faces, material=UNLIT)
    faces = np.array([np.roll(face, rng.integers(3)) for face in faces])
    return Mesh(both[:, faces.ravel()], np.arange(faces.size).reshape(-1, 3), material=UNLIT)


@pytest.mark.parametrize("shared", [True, False], ids=["shared", "unshared"])
@pytest.mark.parametrize("camera", CAMERAS)
def test_neighbours_cut_the_edge_that_they_share_alike(camera, shared):
    """To the last bit: each edge of a part is one of another's, or on the border of the sheet."""
    (mesh,) = exposed(sheet(shared), camera=replace(CAMERAS[camera], **LIMITS["both"])).meshes
    assert len(mesh.faces) > 40
    places = mesh.positions.transpose(1, 0, 2).reshape(mesh.positions.shape[1], -1)
    _, first, same = np.unique(places, axis=0, return_index=True, return_inverse=True)
    faces = same.reshape(-1)[mesh.faces]
    ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    edges, uses = np.unique(ends, axis=0, return_counts=True)
    assert uses.max() == 2
    x, _, z = mesh.positions[0][first[edges[uses == 1]]].transpose(2, 0, 1)
    sides = (np.abs(x) > 3 - 1e-9, z > -1 - 1e-9, z < -14 + 1e-9)
    assert np.any([side.all(axis=1) for side in sides], axis=0).all()


def test_nothing_is_cut_or_added_where_nothing_bends():
    thin = replace(STILL, f_stop=1e4, **LIMITS["range"])
    for camera in (STILL, replace(STILL, sharp_range=(3.0, 3.0)), thin):
        for mesh in exposed(ground(), triangles(3), camera=camera).meshes:
            assert mesh.cuts is None
            assert mesh.faces is mesh.mesh.faces
            assert mesh.segments <= 1
    beyond = replace(STILL, sharp_range=(2.0, 100.0), foreground_blur=0.5)
    (mesh,) = exposed(ground(near=-2.5, far=-90.0), camera=beyond).meshes
    assert mesh.cuts is None


def test_one_cut_is_enough_for_what_rests():
    """Along each bend a triangle falls into parts that are straight each."""
    road = Mesh([[-1, -1, -1], [1, -1, -1], [0, -1, -20]], [[0, 1, 2]], material=UNLIT)
    camera = replace(STILL, **LIMITS["both"])
    (mesh,) = exposed(road, camera=camera).meshes
    assert len(mesh.faces) == 7  # three strips and the tip
    assert blur_errors(mesh, camera).max() < 1e-9


def test_numbers_that_are_asked_for_win():
    camera = replace(CAMERAS["push"], **LIMITS["both"])
    (chosen,) = exposed(ground(), camera=camera).meshes
    assert chosen.segments > 1
    assert "blur within" in chosen.reason
    (asked,) = exposed(ground(motion_segments=1), camera=camera).meshes
    assert asked.segments == 1
    assert len(asked.faces) > 2
    times = replace(triangles(3), positions=triangles(3).positions[[0, 1, 0, 1]])
    (mesh,) = exposed(times, camera=camera).meshes
    assert mesh.segments % 3 == 0


def test_what_is_too_much_is_left_and_said(monkeypatch):
    camera = replace(CAMERAS["pan"], **LIMITS["both"])
    assert exposed(ground(name="road"), camera=camera).notes == ()
    monkeypatch.setattr(focus, "_MOST_FACES", 400)
    exposure = exposed(ground(name="road"), camera=camera)
    (note,) = exposure.notes
    assert note.startswith("lens: where its limits begin, blur is up to ")
    assert "'road'; motion_error=0.1 asks for more" in note
    left = float(note.split("up to ")[1].split()[0])
    assert blur_errors(exposure.meshes[0], camera).mean(axis=0).max() < max(left, ERROR)


# The parts


def test_bends_add_up_to_the_circle():
    w = np.linspace(-3.0, 30.0, 2001)
    for camera in CAMERAS.values():
        for limit in LIMITS.values():
            seen = replace(camera, **limit)
            poses = View(seen, Window(0.0, -0.25, 0.25), 4 / 3, SIZE[1]).poses(np.linspace(0, 1, 3))
            bends = bends_of(seen, poses, SIZE[1])
            depths = np.broadcast_to(w, (3, len(w)))
            value = circle(seen, poses, depths)
            assert np.allclose(bends.circle(depths), value, atol=1e-12)
            for time in range(3):
                ramps = [
                    change[time] * np.maximum(w - place[time], 0.0)
                    for place, change in zip(bends.places, bends.changes, strict=True)
                ]
                basis = np.stack([np.ones_like(w), w, *ramps], axis=1)
                fit, *_ = np.linalg.lstsq(basis, value[time], rcond=None)
                assert np.abs(basis @ fit - value[time]).max() < 1e-8
                assert np.abs(fit[2:]) == pytest.approx(1.0, abs=1e-8)


def test_sags_and_where_a_bend_is_against_brute_force():
    rng = np.random.default_rng(7)
    a, b = rng.normal(size=(2, 4, 300))
    b[:, :60] = a[:, :60] + 2.0  # a bend that goes along
    a[:, 60:90], b[:, 60:90] = -1.0, 0.5  # one that rests
    b[:, 90:100] = a[:, 90:100]
    t = np.linspace(0.0, 1.0, 2001)[:, None, None]
    p, q = ((1 - t) * end[:-1] + t * end[1:] for end in (a, b))
    across = p * q < 0.0
    sag = np.where(across, np.abs(p * q) / np.where(across, np.abs(p) + np.abs(q), 1.0), 0.0)
    most, mean = sags(a, b)
    assert np.allclose(most, sag.max(axis=0), atol=2e-3)
    assert np.all(most >= sag.max(axis=0) - 1e-12)
    assert np.all(mean >= sag.mean(axis=0) - 1e-3)
    assert np.all(mean <= 1.6 * sag.mean(axis=0) + 2e-3)
    place = np.abs(p) / np.where(across, np.abs(p) + np.abs(q), 1.0)
    low, high = swept(a, b)
    ever = across.any(axis=(0, 1))
    assert np.all((low <= high)[ever])
    assert np.all((low > high)[~ever])
    first = np.where(across, place, 1.0).min(axis=(0, 1))[ever]
    last = np.where(across, place, 0.0).max(axis=(0, 1))[ever]
    assert np.all(low[ever] <= first + 1e-12)
    assert np.all(high[ever] >= last - 1e-12)
    assert low[ever] == pytest.approx(first, abs=0.02)
    assert high[ever] == pytest.approx(last, abs=0.02)
