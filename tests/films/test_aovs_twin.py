"""Layers of random scenes against the float64 twin, and the files that they are written to."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import lru_cache

import numpy as np
import OpenEXR
import pytest
from reference.moment import Moment, flow, moment
from support.busy_scenes import contents
from support.closed_forms import UNIT_CAMERA, world
from support.films import make_film
from support.nightly import nightly, nightly_but

import mbinterval as mb
from mbinterval.errors import UsageError
from mbinterval.exposure.asked import Asked
from mbinterval.exposure.exposure import Exposure, expose
from mbinterval.files.exr import ExrImage, write_exr
from mbinterval.film.aovs import AOVS, FLOWS, MOMENTARY
from mbinterval.film.film import Film
from mbinterval.rendering.shared_steps import Work
from mbinterval.scene.model import Camera, Light, Material, Mesh, Scene, Shutter, Texture
from mbinterval.scene.tracks import Track
from mbinterval.scene.transforms import Transform

SIZE = (48, 32)
SEGMENTS = 2
WALK = Track([-1, 3], [[0.0, 0, 0], [0.3, -0.2, 0.25]])
CAMERAS = {
    "still": UNIT_CAMERA,
    "moving": Camera(position=WALK, look_at=(0.1, 0, -3), focal_length=24.0),
}


def tumbling(rng: np.random.Generator, count: int, near: float, **fields: object) -> Mesh:
    """Triangles that fly and turn by keys, with normals and uv where ``fields`` have them."""
    middle = rng.uniform((-4, -4), (SIZE[0] + 4, SIZE[1] + 4), (count, 1, 2))
    corners = middle + rng.normal(0, 7, (count, 3, 2))
    turns = np.c_[rng.normal(0, 0.05, (3, 3)), np.ones(3)]
    way = rng.uniform(-0.5, 0.5, (3, 3))
    return Mesh(
        positions=world(corners, rng.uniform(near, 4.0, (count, 3)), SIZE).reshape(-1, 3),
        faces=np.arange(3 * count).reshape(-1, 3),
        transform=Transform(
            translation=Track([-1, 1, 3], way), rotation=Track([-1, 1, 3], turns, quaternion=True)
        ),
        **fields,
    )


def busy(seed: int, camera: str, near: float = 1.0) -> Scene:
    rng = np.random.default_rng(seed)
    one_sided = Material("one", double_sided=False)
    poster = Material("poster", texture=Texture(rng.uniform(0, 1, (8, 8, 3))), shading="unlit")
    still = tumbling(rng, 20, near)
    meshes = [
        tumbling(rng, 20, near, normals=rng.normal(size=(60, 3)), name="given"),
        tumbling(rng, 20, near, material=one_sided, name="one"),
        tumbling(rng, 20, near, uv=rng.uniform(-1, 2, (60, 2)), material=poster, name="poster"),
        Mesh(positions=still.positions, faces=still.faces, shading="unlit", name="still"),
    ]
    lights = [Light("ambient", intensity=0.2), Light("directional", direction=(0.4, -0.5, -1))]
    return Scene(meshes, CAMERAS[camera], lights, (0.1, 0.2, 0.3), Shutter(open=0.0, close=0.5))


def exposed(scene: Scene, frame: float) -> Exposure:
    return expose(scene, frame, SIZE[0] / SIZE[1], Asked(segments=SEGMENTS))


def settings(aovs: tuple[str, ...] = tuple(AOVS), **others: object) -> mb.Settings:
    values = {"samples": 1, "motion_segments": SEGMENTS, "texture_samples": 2} | others
    return mb.Settings(aovs=aovs, **values)


def rendered(scene: Scene, aovs: tuple[str, ...] = tuple(AOVS), **others: object) -> mb.Film:
    return mb.render(scene, width=SIZE[0], height=SIZE[1], settings=settings(aovs, **others))


@lru_cache
def film() -> mb.Film:
    return rendered(busy(1, "moving"))


def assert_agreement(layers: dict[str, np.ndarray], here: Exposure, want: Moment) -> None:
    ids = np.array([mesh.index + 1 for mesh in here.meshes])
    assert np.array_equal(layers["object"], np.where(want.mesh >= 0, ids[want.mesh], 0))
    assert len(np.unique(layers["object"])) > 2
    assert layers["depth"] == pytest.approx(want.depth, rel=1e-6)
    for name in set(MOMENTARY) - {"object", "material", "depth", *FLOWS}:
        assert layers[name] == pytest.approx(getattr(want, name), abs=2e-6)


@pytest.mark.parametrize(
    ("camera", "t"),
    [("moving", 0.7), nightly("still", 0.123), nightly("still", 0.7), nightly("moving", 0.123)],
)
@pytest.mark.parametrize("near", [1.0, -0.2])
def test_the_moment_agrees_with_the_twin(camera, near, t):
    for seed in (3, 4, 5):
        scene = busy(seed, camera, near)
        here, found = exposed(scene, 1.0), rendered(scene, aov_time=t).layers
        assert_agreement(found, here, moment(here, *SIZE, t))
        with pytest.raises(AssertionError):
            assert_agreement(found, here, moment(here, *SIZE, t + 0.01))


@pytest.mark.parametrize(
    ("camera", "key"),
    [("moving", 0), nightly("still", 1), nightly("still", 0), nightly("moving", 1)],
)
@pytest.mark.parametrize("near", [1.0, -0.2])
def test_optical_flow_agrees_with_the_twin(camera, key, near):
    """At the ends of motion segments, where the twin has the neighbours' vertices too."""
    for seed in (1, 2):
        scene = busy(seed, camera, near)
        t = key / SEGMENTS
        here, found = exposed(scene, 1.0), rendered(scene, aov_time=t).layers
        want = moment(here, *SIZE, t)
        assert_agreement(found, here, want)
        for name, step in FLOWS.items():
            there = flow(want, here, exposed(scene, 1.0 + step), key)
            assert np.isnan(found[name]).sum() == np.isnan(there).sum()
            assert found[name] == pytest.approx(there, rel=1e-6, abs=1e-6, nan_ok=True)
            late = flow(want, here, exposed(scene, 1.01 + step), key)
            assert np.nanmax(np.abs(found[name] - late)) > 1e-3


def test_the_sharp_frame_is_a_film_whose_shutter_is_open_for_an_instant():
    scene = busy(1, "still")
    found = rendered(scene, ("sharp",), samples=4, aov_time=0.5).layers["sharp"]

    def closed(at: float) -> np.ndarray:
        shutter = Shutter(open=at, close=at + 1e-7)
        return rendered(replace(scene, shutter=shutter), (), samples=4, motion_segments=1).rgba

    assert np.sqrt(np.mean((found - closed(0.25)) ** 2)) < 1e-4
    assert np.sqrt(np.mean((found - closed(0.26)) ** 2)) > 1e-2


def test_two_runs_crops_and_tiles_give_the_same_bytes():
    again = rendered(busy(1, "moving"))
    scene = busy(1, "moving")
    crop = (17, 5, 20, 19)
    part = mb.render(scene, width=48, height=32, crop=crop, settings=settings())
    tiled = rendered(scene, tile_size=8)
    assert contents(again) == contents(film()) == contents(tiled)
    for name in AOVS:
        pixels = film().layers[name]
        assert again.layers[name].tobytes() == pixels.tobytes()
        if name != "operations":  # a measure of work
            assert part.layers[name].tobytes() == pixels[5:24, 17:37].tobytes()
            assert tiled.layers[name].tobytes() == pixels.tobytes()


@pytest.mark.parametrize("name", nightly_but(AOVS, "normal", "object"))
def test_a_layer_alone_is_the_one_among_all_whatever_was_in_memory(name, monkeypatch):
    want, allocate = film().layers[name], Work.allocate

    def fill(work: Work, kind: str, array: str, *others: object) -> None:
        allocate(work, kind, array, *others)
        if array in ("planes", "sharp"):
            work.runtime.fill(work.arrays[array], 0x3F123456)

    monkeypatch.setattr(Work, "allocate", fill)
    alone = rendered(busy(1, "moving"), (name,)).layers
    assert list(alone) == [name]
    assert alone[name].tobytes() == want.tobytes()


def test_tiles_done_in_pieces_and_again_count_operations_once():
    from support.kernels import render_with

    scene = busy(1, "moving")
    chosen = settings(("sharp", "operations"), samples=3, texture_samples=16)
    whole = render_with(scene, chosen, *SIZE).layers
    pieces = render_with(scene, chosen, *SIZE, capacity=24).layers
    for name in chosen.aovs:
        assert np.array_equal(whole[name], pieces[name])


def test_a_file_reads_back_equal_with_layers_and_names(tmp_path):
    path = film().write(tmp_path / "a.exr")
    back = Film.read(path)
    assert list(back.layers) == list(AOVS)
    for name in AOVS:
        assert back.layers[name].dtype == film().layers[name].dtype
        assert np.array_equal(back.layers[name], film().layers[name], equal_nan=True)
    assert json.loads(back.metadata["objects"]) == ["given", "one", "poster", "still"]
    assert back.metadata["settings.aovs"] == ",".join(AOVS)
    assert film().write(tmp_path / "b.exr").read_bytes() == path.read_bytes()


def test_its_channels_are_where_other_programs_look(tmp_path):
    path = film().write(tmp_path / "a.exr")
    channels = OpenEXR.File(str(path), separate_channels=True).channels()
    moments = [aov for name, aov in AOVS.items() if not name.startswith("crypto_")]
    names = {channel for aov in moments for channel in aov.channels}
    names |= {
        f"crypto_{kind}{place}.{channel}"
        for kind in ("object", "material") for place in ("00", "01", "02") for channel in "RGBA"
    }  # fmt: skip
    assert set(channels) == {*"RGBAZ", "intervals", *names}
    flow_y = channels["forward.v"].pixels
    assert flow_y.dtype == np.float32
    assert np.array_equal(flow_y, film().layers["forward"][..., 1], equal_nan=True)
    assert channels["object.id"].pixels.dtype == np.uint32
    assert "depth.Z" not in channels  # compositing programs take it for Z


def test_without_layers_a_file_says_nothing_of_them(tmp_path):
    plain = rendered(busy(1, "moving"), (), aov_time=0.7)
    back = Film.read(plain.write(tmp_path / "a.exr"))
    assert back.layers == {}
    assert not [name for name in back.metadata if "aov" in name or name in ("objects", "materials")]


def test_layers_that_are_incomplete_or_of_another_kind_are_not_ours(tmp_path):
    image = make_film(2, 3).write(tmp_path / "a.exr")
    channels = {
        name: channel.pixels
        for name, channel in OpenEXR.File(str(image), separate_channels=True).channels().items()
    }
    ours = np.zeros((2, 3), np.float32)
    channels |= {"normal.X": ours, "object.id": ours, "uv.u": ours, "uv.v": ours}
    write_exr(image, ExrImage(channels, (3, 2), (0, 0), {}))
    assert list(Film.read(image).layers) == ["uv"]


def test_layers_of_a_film_must_have_its_size():
    with pytest.raises(UsageError, match=r"normal has shape \(21, 34\), expected \(21, 34, 3\)"):
        make_film(layers={"normal": np.zeros((21, 34))})
    with pytest.raises(UsageError, match=r"unknown layer 'normals', did you mean normal\?"):
        make_film(layers={"normals": np.zeros((21, 34, 3))})
