"""What is written can be read by a program that is not ours: OpenImageIO finds every layer."""

import json

import numpy as np
import OpenImageIO as oiio
from support.closed_forms import UNIT_CAMERA, rectangle, slab

import mbinterval as mb
from mbinterval.film.aovs import AOVS, channels_of
from mbinterval.scene.model import Scene


def test_openimageio_reads_every_layer_and_the_names_of_objects(tmp_path):
    mesh = slab(rectangle(4, 19, -5, 30), (6, 0), 2.0, (32, 16))
    settings = mb.Settings(samples=2, aovs=tuple(AOVS))
    scene = Scene(meshes=[mesh], camera=UNIT_CAMERA, background=(0.1, 0.2, 0.3))
    film = mb.render(scene, width=32, height=16, settings=settings)
    file = oiio.ImageInput.open(str(film.write(tmp_path / "a.exr")))
    spec = file.spec()
    read = {
        name: file.read_image(0, 0, index, index + 1, oiio.TypeFloat)[..., 0]
        for index, name in enumerate(spec.channelnames)
    }
    kinds = dict(zip(spec.channelnames, map(str, spec.channelformats), strict=True))
    file.close()
    expected = channels_of(film.layers) | {"R": film.rgba[..., 0], "Z": film.depth}
    for name, pixels in expected.items():
        assert kinds[name] == ("uint" if pixels.dtype.kind == "u" else "float"), name
        # OpenImageIO scales whole numbers to [0, 1] where floats are asked for.
        scale = 2.0**32 - 1 if pixels.dtype.kind == "u" else 1.0
        assert np.array_equal(np.float32(read[name] * scale), np.float32(pixels)), name
    assert spec.channelnames[:4] == ("R", "G", "B", "A")
    assert json.loads(spec.getattribute("objects")) == [""]
