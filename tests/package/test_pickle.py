"""What goes to another process comes out as it went in, and renders the same bytes."""

from __future__ import annotations

import copy
import dataclasses
import hashlib
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from support.nightly import nightly

import mbinterval as mb
from mbinterval.scene.deform import Morph, MorphedSkin
from mbinterval.scene.formats.load import load_file

SCENES = Path(__file__).parents[2] / "scenes"
SIZE = {"width": 32, "height": 24}
SETTINGS = mb.Settings(samples=1, aovs="object,events,deep,crypto_material")
TRIANGLE = {"positions": np.eye(3), "faces": [[0, 1, 2]], "name": "a"}

ELSEWHERE = """
import hashlib, pickle, sys
import mbinterval as mb
for scene, frame, settings in pickle.load(sys.stdin.buffer):
    film = mb.render(scene, frame=frame, width=32, height=24, settings=settings)
    print(hashlib.sha256(film.rgba.tobytes() + film.events.digest().encode()).hexdigest())
"""


def digest(film):
    return hashlib.sha256(film.rgba.tobytes() + film.events.digest().encode()).hexdigest()


@pytest.mark.parametrize(
    "names", [("running_fox", "chrome"), nightly(("milk_truck", "mirror", "glass", "fast_cubes"))]
)
def test_scenes_render_the_same_bytes_in_another_process(names):
    """Skins, textures, an environment and what mirrors it; animated nodes, mirrors, glass."""
    jobs = [(mb.load(SCENES / f"{name}.toml"), 5.0, SETTINGS) for name in names]
    run = subprocess.run(
        [sys.executable, "-c", ELSEWHERE], input=pickle.dumps(jobs), capture_output=True, check=True
    )
    here = [
        digest(mb.render(scene, frame=frame, settings=settings, **SIZE))
        for scene, frame, settings in jobs
    ]
    assert run.stdout.decode().split() == here
    assert len(set(here)) == len(here)


def arrays(value, seen=None):
    """All arrays that a record holds, in records below it too."""
    if isinstance(value, np.ndarray):
        yield value
    elif isinstance(value, tuple | list):
        for item in value:
            yield from arrays(item)
    elif dataclasses.is_dataclass(value):
        for field in dataclasses.fields(value):
            yield from arrays(getattr(value, field.name))


@pytest.mark.parametrize("protocol", range(2, pickle.HIGHEST_PROTOCOL + 1))
def test_a_scene_is_read_only_as_ever(protocol):
    scene = mb.load(SCENES / "running_fox.toml")
    found = pickle.loads(pickle.dumps(scene, protocol))
    there, here = list(arrays(found)), list(arrays(scene))
    assert len(there) == len(here) > 20
    for one, other in zip(there, here, strict=True):
        assert np.array_equal(one, other)
        assert not one.flags.writeable


def test_copies_of_what_never_changes_are_itself():
    scene = mb.load(SCENES / "running_fox.toml")
    for value in (scene, scene.meshes[0], scene.camera, scene.shutter, mb.Light("point")):
        assert copy.copy(value) is copy.deepcopy(value) is value


def test_nodes_nest_deeper_than_the_stack():
    """And what they share is shared still."""
    node = None
    for step in range(3000):
        node = mb.Transform(translation=(1.0, 0.0, step % 3), parent=node)
    one = mb.Mesh(**TRIANGLE, transform=node)
    other = mb.Mesh(**TRIANGLE, transform=mb.Transform(parent=node.parent))
    found = pickle.loads(pickle.dumps(mb.Scene([one, other])))
    assert np.array_equal(found.meshes[0].transform.at(0), node.at(0))
    assert found.meshes[0].transform.parent is found.meshes[1].transform.parent
    assert len(found.meshes[0].transform._chain()) == 3000


class Swell:
    """A deformer of the caller's own."""

    jumps = ()

    def __init__(self, size):
        self.size = size

    def positions(self, frame, which=slice(None), base=None):
        return self.size * (1.0 + 0.1 * frame) * np.eye(3)[which]

    def normals(self, frame):
        return None

    def mirrors(self, frame):
        return False


class Place:
    """A placement, and weights, of the caller's own."""

    animated, jumps = False, ()

    def at(self, frame, base=None):
        return np.eye(4) if base is None else np.zeros(1)


class Weights(Place):
    def at(self, frame):
        return np.zeros(1)


def test_a_deformer_of_ones_own_goes_along():
    scene = mb.Scene([mb.Mesh(**TRIANGLE, deformer=Swell(2.0), shading="unlit")])
    found = pickle.loads(pickle.dumps(scene))
    films = [mb.render(each, settings=SETTINGS, **SIZE) for each in (scene, found)]
    assert digest(films[0]) == digest(films[1])


def local(kind):
    class Local(kind):
        pass

    return Local


def on_the_spot(kind, *given):
    made = kind(*given)
    made.function = lambda frame: frame
    return made


def usd(folder):
    (folder / "m.usda").write_text(
        '#usda 1.0\ndef Mesh "a" {\n point3f[] points = [(0,0,0), (1,0,0), (0,1,0)]\n'
        " int[] faceVertexCounts = [3]\n int[] faceVertexIndices = [0,1,2]\n}\n"
    )
    return mb.load(folder / "m.usda")


LOOSE = {
    "lambda": lambda _: mb.Mesh(**TRIANGLE, deformer=on_the_spot(Swell, 1.0)),
    "local": lambda _: mb.Mesh(**TRIANGLE, deformer=local(Swell)(1.0)),
    "weights": lambda _: mb.Mesh(
        **TRIANGLE,
        deformer=MorphedSkin(np.eye(3), morph=Morph(np.zeros((1, 3, 3)), None, local(Weights)())),
    ),
    "transform": lambda _: mb.Mesh(**TRIANGLE, transform=on_the_spot(Place)),
    "camera": lambda _: mb.Camera(transform=on_the_spot(Place), name="c"),
    "light": lambda _: mb.Light("point", transform=on_the_spot(Place)),
    "usd": usd,
}
SAID = {
    "lambda": "mesh 'a': deformer=<",
    "local": "mesh 'a': deformer=<",
    "weights": "mesh 'a': deformer.morph.weights=<",
    "transform": "mesh 'a': transform=<",
    "camera": "camera 'c': transform=<",
    "light": "light: transform=<",
    "usd": "mesh 'a': transform reads a USD stage of this process",
}


@pytest.mark.parametrize("kind", LOOSE)
def test_what_cannot_go_along_is_named(tmp_path, kind):
    made = LOOSE[kind](tmp_path)
    with pytest.raises(mb.SceneError) as caught:
        pickle.dumps([made])
    assert str(caught.value).startswith(SAID[kind])
    assert "cannot be pickled" in str(caught.value)
    assert copy.deepcopy(made) is made


def test_results_and_settings_go_along(tmp_path):
    loaded = load_file(SCENES / "running_fox.toml")
    film = mb.render(loaded.scene, settings=SETTINGS, **SIZE)
    found = pickle.loads(pickle.dumps(film))
    film.write(tmp_path / "a.exr")
    found.write(tmp_path / "b.exr")
    assert (tmp_path / "a.exr").read_bytes() == (tmp_path / "b.exr").read_bytes()
    for name in ("a.npz", "a.deep.exr"):
        film.write(tmp_path / name)
        found.write(tmp_path / f"b{name[1:]}")
        assert (tmp_path / name).read_bytes() == (tmp_path / f"b{name[1:]}").read_bytes()
    assert pickle.loads(pickle.dumps(SETTINGS)) == SETTINGS
    assert pickle.loads(pickle.dumps(loaded)).files == loaded.files
    assert pickle.loads(pickle.dumps(mb.devices())) == mb.devices()
    compared = mb.compare(film, film)
    assert pickle.loads(pickle.dumps(compared)).metrics == compared.metrics
