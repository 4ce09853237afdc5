"""What ``mbinterval info`` says is what a render does."""

from __future__ import annotations

import dataclasses
import re
from itertools import product

import numpy as np
import pytest
from support.closed_forms import UNIT_CAMERA, rectangle, world
from support.effect_scenes import SIZE, UV, WAYS, mesh
from support.kernels import ready_for
from support.nightly import nightly

import mbinterval as mb
from mbinterval.device import choose
from mbinterval.device.runtime import Runtime, runtime
from mbinterval.errors import DeviceError
from mbinterval.layout.appearance import mip_chain
from mbinterval.plan.memory import buffer_bytes, texel_count
from mbinterval.rendering.describe import describe
from mbinterval.scene.model import Light, Material, Scene, Shutter, Texture

PICTURE = Texture(np.random.default_rng(0).uniform(0, 1, (5, 12, 3)), name="poster.png")
PHONG = Material("poster", texture=PICTURE)


def described(*meshes, settings=None, crop=None, **fields):
    scene = Scene(**({"meshes": meshes, "camera": UNIT_CAMERA} | fields))
    return describe(scene, 1.0, *SIZE, settings or mb.Settings(), crop)


def test_effects_have_reasons_and_stages_their_order():
    meshes = [mesh(name="slab"), mesh(False, name="wall")]
    text = described(*meshes, settings=mb.Settings(samples=2, **WAYS["triangulated"]))
    for part in (
        "frame 1, 32 x 16 pixels, 2 samples per pixel",
        "on  motion: 2 motion paths",
        "off texture: no material calls for it",
        "slab: 2 faces, 1 motion segment",
        "wall: 2 faces, static",
        "stages: paths bin nearest rasterize intervals sort occlude shade resolve",
    ):
        assert part in text


def line(text, start):
    (found,) = [line for line in text.splitlines() if line.startswith(start)]
    return found.removeprefix(start)


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ({}, "open from -0.25 to 0.25 frames, 0.02083 s; box curve"),
        ({"open": 0, "close": 1, "curve": "triangle"}, "open from 0 to 1 frames, 0.04167 s; tri"),
        ({"curve": [1, 2, 0]}, "open from -0.25 to 0.25 frames, 0.02083 s; a curve of 3 values"),
        (
            {"rolling": "left", "line_offset": 1e-4, "line_exposure": 0.01},
            "rolls left, from -0.25 frames on, 0.0001 s from column to column, each open for 0.0",
        ),
    ],
)
def test_the_shutter_is_told_in_frames_and_seconds(fields, expected):
    text = described(mesh(), shutter=Shutter(**fields))
    assert line(text, "shutter: ").startswith(expected)


def test_lens_occlusion_lights_and_textures():
    plain = described(mesh())
    assert line(plain, "lens: ") == "a pinhole"
    assert line(plain, "occlusion: ") == "exact in time"
    assert line(plain, "lights: ") == line(plain, "textures: ") == "none"
    lens = dataclasses.replace(
        UNIT_CAMERA, fov=None, focal_length=50, f_stop=mb.Track([0, 2], [2, 2]), focus_distance=3,
        blades=6, sharp_range=(2, 4),
    )  # fmt: skip
    text = described(
        mesh(material=PHONG, uv=UV), mesh(False, material=PHONG, uv=UV),
        camera=lens, lights=[Light("ambient"), Light("point"), Light("point")],
        settings=mb.Settings(occlusion=64, partial_bits=True),
    )  # fmt: skip
    assert line(text, "lens: ") == (
        "0.025 wide, in focus at 3, sharp from 2 to 4 (scene units), 6 blades"
    )
    assert "on  lens: the camera has an f_stop" in text
    assert line(text, "occlusion: ").startswith("a mask of 64 bits over the shutter, that begin")
    assert line(text, "lights: ") == "1 ambient, 2 point"
    assert line(text, "textures: ") == "12 x 5 poster.png"
    unlit = described(mesh(), lights=[Light("ambient")])
    assert line(unlit, "lights: ") == "1 ambient; no surface reflects them"


def test_reasons_hold_where_nothing_moves():
    text = described(
        mesh(False), shutter=Shutter(curve="triangle"),
        settings=mb.Settings(paths="triangulated", pairing="depth"),
    )  # fmt: skip
    for name in ("shutter curve", "pairing by depth", "rolling shutter", "partial bits"):
        assert f"off {name}: nothing moves" in text
    assert line(text, "occlusion: ") == "by depth alone, since nothing moves"
    assert "off pairing by depth: exact paths have no" in described(
        mesh(), settings=mb.Settings(pairing="depth")
    )


def test_meshes_without_a_name_are_named_by_their_place_in_the_scene_and_a_crowd_is_cut():
    text = described(mesh(), mesh(visible=False), mesh(False), mesh(name="slab"))
    assert "3 meshes, 1 more without faces or not visible" in text
    assert "  mesh 0: 2 faces, 1 motion segment: its positions" in text
    assert "  mesh 2: 2 faces, static\n  slab: 2" in text
    crowd = described(*[mesh() for _ in range(30)])
    assert "30 meshes" in crowd
    assert "  and 22 more" in crowd
    assert len(crowd.splitlines()) < 70
    assert "note: no visible mesh: only the background is seen" in described()


def test_notes_are_those_of_the_film():
    settings = mb.Settings(aovs=("forward", "crypto_object"), samples=1)
    scene = Scene([mesh(name="flag"), mesh(False, name="flag")], camera=UNIT_CAMERA)
    film = mb.render(scene, frame=1, width=SIZE[0], height=SIZE[1], settings=settings)
    assert "optical flow: mesh 'flag'" in " ".join(film.notes)
    lines = describe(scene, 1.0, *SIZE, settings).splitlines()
    assert [text[6:] for text in lines if text.startswith("note: ")] == list(film.notes)


def test_device_and_crop_are_those_of_the_render(monkeypatch):
    text = described(mesh(), crop=(8, 4, 16, 8))
    assert "frame 1, 32 x 16 pixels, of which 8,4,16,8 is rendered, 4 samples per pixel" in text
    assert line(text, "device: ") == runtime().device.name.strip()
    scene = Scene(meshes=[mesh()], camera=UNIT_CAMERA)
    with pytest.raises(DeviceError, match="no device is called 'nonesuch'"):
        describe(scene, 1.0, *SIZE, mb.Settings(), device="nonesuch")
    monkeypatch.delenv("MBINTERVAL_DEVICE", raising=False)
    monkeypatch.delenv("PYOPENCL_CTX", raising=False)
    monkeypatch.setattr(choose, "_all_devices", lambda: [])
    said = line(described(mesh()), "device: ")
    assert re.match(r"none \((PoCL offers no device|no OpenCL device was found)", said)


GROUPS = {
    "geometry": (
        *("positions", "jobs", "cameras", "paths", "meshes"),
        *("vertex_colors", "uvs", "normals"),
        *("vertices", "shapes", "depths", "order"),
    ),
    "textures": ("texels",),
    "film": ("rgba", "depth", "met", "background"),
}


FIVE_POINT = {"filter": "five_point", "samples": 1}


@pytest.mark.parametrize(
    ("tall", "way"),
    [
        nightly(*case) if number % 4 else case
        for number, case in enumerate(product([False, True], [*WAYS.values(), FIVE_POINT]))
    ],
)
def test_the_memory_that_is_told_is_the_memory_that_is_taken(way, tall, monkeypatch):
    """Buffers are counted as the render asks the device for them, by their names."""
    taken: dict[str, int] = {}
    upload, allocate = Runtime.upload, Runtime.allocate

    def counting_upload(self, kind, array, what=""):
        taken[what] = taken.get(what, 0) + array.nbytes
        return upload(self, kind, array, what)

    def counting_allocate(self, *given):
        made = allocate(self, *given)
        taken[given[2]] = taken.get(given[2], 0) + made.nbytes
        return made

    ends = world(np.stack([rectangle(3, 9, -1, 17)] * 2), 2.0, SIZE)
    more = mb.Mesh(ends[0], [[0, 1, 2]], color=np.eye(4, 3), color_domain="vertex", material=PHONG)
    scene = Scene(
        meshes=[mesh(material=PHONG, uv=UV), mesh(False), more],
        camera=UNIT_CAMERA,
        background=np.zeros((2, 2, 3)) if tall else (0, 0, 0),
    )
    settings = mb.Settings(**{"samples": 2, **way})
    size = (16, 40) if tall else SIZE
    ready = ready_for(scene, settings, *size)
    monkeypatch.setattr(Runtime, "upload", counting_upload)
    monkeypatch.setattr(Runtime, "allocate", counting_allocate)
    mb.render(scene, frame=1, width=size[0], height=size[1], settings=settings)
    told = buffer_bytes(ready.motion, ready.plan, runtime().workers)
    for group, names in GROUPS.items():
        assert told[group] == sum(taken.get(name, 0) for name in names), group
    assert told["pools"] == sum(n for name, n in taken.items() if name.startswith("pool of "))
    assert f"(geometry {told['geometry'] / 2**20:.1f}, " in describe(scene, 1.0, *size, settings)
    rest = sum(taken.values()) - sum(told.values())
    assert rest < 2**18  # small tables, scratch, and the lists of paths by tile


def test_texels_are_those_of_all_mip_levels():
    for shape in ((1, 1), (5, 12), (64, 64), (7, 1)):
        texture = Texture(np.zeros((*shape, 3)))
        assert texel_count(texture) == sum(level[..., 0].size for level in mip_chain(texture.image))
