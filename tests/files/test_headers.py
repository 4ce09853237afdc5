"""Headers that claim more than their file holds, or what does not fit together.

All files are read one after the other in a process of its own with little memory; each is refused
by the error of its reader, which names it, and none takes memory for what is not there.
"""

from __future__ import annotations

import base64
import copy
import io
import json
import os
import struct
import subprocess
import sys
import zipfile
import zlib
from pathlib import Path

import numpy as np
import OpenEXR
import pyarrow
import pyarrow.parquet
import pytest
from PIL import Image

import mbinterval as mb
from mbinterval.bench.cases import Case
from mbinterval.bench.report import read_result
from mbinterval.study import reference
from mbinterval.study.report import read_study

READ = """
import json, resource, sys, warnings
import OpenEXR, PIL.Image, pyarrow.parquet, trimesh
import mbinterval as mb
from mbinterval.bench.cases import make_case
from mbinterval.scene.formats.gltf import gltf
from mbinterval.scene.formats.meshes import mesh_files
from mbinterval.scene.formats.usd import usd
resource.setrlimit(resource.RLIMIT_AS, (3 << 30, 3 << 30))
warnings.simplefilter("error")
readers = {
    "events": mb.Events.read, "film": mb.Film.read, "deep": mb.DeepImage.read,
    "image": mb.read_image, "scene": mb.load,
    "reference": lambda path: make_case("fast_cubes:2", path, 16, 12),
}
def peak():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
for path in sys.stdin.read().split():
    before, kind = peak(), path.split("/")[-1].split("_")[0]
    try:
        readers[kind](path)
        said = "read"
    except BaseException as error:
        said = f"{type(error).__name__}: {error}"
    print(json.dumps([path, said, peak() - before]), file=sys.stderr)
"""
HUGE = 13000  # pixels along an edge, in what Pillow still takes for an image
GOOD = {"V0": np.eye(3), "V1": np.eye(3), "F": np.array([[0, 1, 2]]), "C": np.ones((1, 3)),
        "eye": np.array([0.0, 0, 4]), "fov": np.float64(40), "bg": np.float64(0),
        "W": np.int64(8), "H": np.int64(8)}  # fmt: skip


def npy(shape, kind="<f4", body=b""):
    """An array of any header."""
    head = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}"
    head += " " * (63 - (len(head) + 10) % 64) + "\n"
    return b"\x93NUMPY\1\0" + struct.pack("<H", len(head)) + head.encode() + body


def npz(arrays):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, value in arrays.items():
            if not isinstance(value, bytes):
                content = io.BytesIO()
                np.lib.format.write_array(content, np.asarray(value), allow_pickle=False)
                value = content.getvalue()
            archive.writestr(f"{name}.npy", value)
    return stream.getvalue()


def patched(data, place, new):
    return data[:place] + new + data[place + len(new) :]


def directory_lie(data, place):
    """An archive whose directory claims that an array has 4 GB, at ``place`` of its entry."""
    return patched(data, data.index(b"PK\1\2") + place, struct.pack("<I", 2**32 - 2))


def windowed(data, box, name=b"dataWindow"):
    head = name + b"\0box2i\0\x10\0\0\0"
    return patched(data, data.index(head) + len(head), struct.pack("<4i", *box))


def png(width, height, bits=8, kind=2):
    def chunk(name, data):
        return (
            struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        )

    head = struct.pack(">IIBBBBB", width, height, bits, kind, 0, 0, 0)
    parts = [(b"IHDR", head), (b"IDAT", zlib.compress(bytes(13))), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunk(*part) for part in parts)


def pillow(ending, mark, place, kind):
    """An image of 8 x 8 pixels whose header says `HUGE`, ``place`` bytes after ``mark``."""
    stream = io.BytesIO()
    Image.fromarray(np.arange(192, dtype=np.uint8).reshape(8, 8, 3)).save(stream, ending)
    data = stream.getvalue()
    return patched(data, data.index(mark) + place, struct.pack(kind, HUGE, HUGE))


def ply(vertices, faces, form, body):
    return (
        f"ply\nformat {form} 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\n"
        f"property float z\nelement face {faces}\nproperty list uchar int vertex_indices\n"
        "end_header\n"
    ).encode() + body


TEXT = b"0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
BINARY = struct.pack("<9fB3i", 0, 0, 0, 1, 0, 0, 0, 1, 0, 3, 0, 1, 2)
LITTLE = "binary_little_endian"
TRIANGLE = {
    "asset": {"version": "2.0"},
    "scenes": [{"nodes": [0]}],
    "nodes": [{"mesh": 0}],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
    "buffers": [{"byteLength": 36, "uri": "data:application/octet-stream;base64,"
                 + base64.b64encode(BINARY[:36]).decode()}],
    "bufferViews": [{"buffer": 0, "byteLength": 36}],
    "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
}  # fmt: skip


def gltf(kind, **fields):
    tree = copy.deepcopy(TRIANGLE)
    tree[kind][0] = {name: value for name, value in (tree[kind][0] | fields).items() if value != {}}
    return json.dumps(tree).encode()


def sparse(count, offset=0):
    indices = {"bufferView": 0, "componentType": 5125, "byteOffset": offset}
    return {"count": count, "indices": indices, "values": {"bufferView": 0}}


def scenes():
    """Files that are read as scenes, by name."""
    good = npz(GOOD)
    yield "array.npz", npz(GOOD | {"V0": npy((10**11, 3), "<f8", bytes(72))})
    yield "product.npz", npz(GOOD | {"V0": npy((10**9,) * 3, "<f8")})
    yield "text.npz", npz(GOOD | {"V0": npy((), "<U400000000", bytes(72))})
    yield "object.npz", npz(GOOD | {"V0": npy((3, 3), "|O", bytes(72))})
    yield "negative.npz", npz(GOOD | {"V0": npy((-3, -3), "<f8", bytes(72))})
    yield "size.npz", directory_lie(good, 24)
    yield "packed.npz", directory_lie(good, 20)
    for form, body in (("ascii", TEXT), (LITTLE, BINARY)):
        yield f"vertices-{form}.ply", ply(10**9, 1, form, body)
        yield f"faces-{form}.ply", ply(3, 10**9, form, body)
    yield "cut.ply", ply(3, 2, "ascii", TEXT)
    yield "vertices.off", b"OFF\n1000000000 1 0\n" + TEXT
    yield "faces.off", b"OFF 3 1000000000 0\n# a word\n" + TEXT
    yield "triangles.stl", bytes(80) + struct.pack("<I", 10**9) + bytes(50)
    yield "count.gltf", gltf("accessors", count=10**9)
    yield "zeros.gltf", gltf("accessors", count=6 * 10**7, bufferView={})
    yield "sparse.gltf", gltf("accessors", sparse=sparse(10**9))
    yield "place.gltf", gltf("accessors", sparse=sparse(1, 12))
    yield "view.gltf", gltf("bufferViews", byteLength=10**9)
    yield "stride.gltf", gltf("bufferViews", byteStride=2**31)


def images():
    yield "pixels.png", png(HUGE, HUGE)
    yield "deep.png", png(10000, 10000, 16, 6)
    yield "endless.png", png(2**31 - 1, 2**31 - 1)
    yield "pixels.jpg", pillow("JPEG", b"\xff\xc0", 5, ">HH")
    yield "screen.gif", pillow("GIF", b"GIF8", 6, "<HH")
    yield "frame.gif", pillow("GIF", b"\x2c\0\0\0\0", 5, "<HH")
    yield "pixels.bmp", pillow("BMP", b"BM", 18, "<ii")
    yield "pixels.ppm", b"P6\n13000 13000\n255\n" + bytes(100)
    head = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n"
    yield "runs.hdr", head + b"-Y 99999 +X 32767\n\2\2\x7f\xff" + bytes(400_000)
    yield "flat.hdr", head + b"-Y 999999 +X 999999\n" + bytes(400_000)


WINDOWS = {
    "square": (0, 0, 99999, 99999),
    "wide": (0, 0, 2**25, 11),
    "wider": (0, 0, 2**27, 11),
    "high": (0, 0, 15, 2**25),
    "endless": (-(2**31), 0, 2**31 - 1, 11),
}
COMPRESSIONS = ("NO", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "DWAA", "DWAB")


def exr(compression):
    channels = {name: np.random.default_rng(1).random((12, 16)).astype("f4") for name in "RGBA"}
    kind = getattr(OpenEXR, f"{compression}_COMPRESSION")
    return channels, {"compression": kind, "type": OpenEXR.scanlineimage}


def event_lies(film, folder):
    """Files of events, by name."""
    with zipfile.ZipFile(film.write(folder / "ev.npz")) as archive:
        whole = {name[:-4]: archive.read(name) for name in archive.namelist()}
    offsets, count = film.events.offsets, len(film.events)

    def text(value):
        return np.array(value if isinstance(value, str) else json.dumps(value))

    changes = {
        "t0": {"t0": npy((10**11,))},
        "two": {"t0": npy((10**9, 10**9))},
        "flat": {"t0": film.events["t0"][:, None]},
        "kind": {"t0": film.events["t0"].astype("f8")},
        "words": {"t0": film.events["t0"].astype("U9")},
        "objects": {"t0": npy((count,), "|O", bytes(8 * count))},
        "huge": {"shape": text([65536, 65536, 256])},
        "negative": {"shape": text([-12, -16, 2])},
        "turned": {"shape": text([16, 12, 2])},
        "float": {"shape": text([12.0, 16, 2])},
        "nested": {"shape": text("[" * 100_000)},
        "digits": {"shape": text("9" * 5000)},
        "metadata": {"metadata": text([1, 2])},
        "origin": {"origin": text([1, 2, 3])},
        "outside": {"origin": text([9, 9])},
        "over": {"offsets": np.where(np.arange(len(offsets)) == 5, 10**15, offsets)},
        "under": {"offsets": np.where(np.arange(len(offsets)) == 5, -7, offsets)},
        "reals": {"offsets": offsets.astype("f8")},
    }
    for name, change in changes.items():
        yield f"{name}.npz", npz(whole | change)
    yield "size.npz", directory_lie(npz(whole), 24)
    yield "missing.npz", npz({name: data for name, data in whole.items() if name != "t1"})
    table = pyarrow.parquet.read_table(film.write(folder / "ev.parquet"))
    yield from ((f"{name}.parquet", data) for name, data in parquet_lies(table))


def parquet_lies(table):
    texts = dict(table.schema.metadata)
    count = len(table)

    def written(changed=table, **new):
        stream = io.BytesIO()
        metadata = texts | {name.encode(): value for name, value in new.items()}
        pyarrow.parquet.write_table(changed.replace_schema_metadata(metadata), stream)
        return stream.getvalue()

    def column(name, values):
        return table.set_column(table.schema.get_field_index(name), name, values)

    yield "huge", written(shape=b"[65536, 65536, 65536]")
    yield "large", written(shape=b"[60000, 60000, 16]")
    yield "small", written(shape=b"[2, 2, 2]")
    yield "nested", written(shape=b"[" * 100_000)
    yield "bytes", written(metadata=b"\xff\xfe")
    yield "list", written(metadata=b"[1]")
    yield "mixed", written(table.take(np.arange(count)[::-1]))
    yield "beyond", written(column("x", pyarrow.array(np.full(count, 2**32 - 1, "u4"))))
    yield "real", written(column("x", pyarrow.array(np.full(count, np.nan, "f4"))))
    yield "null", written(column("t0", pyarrow.array([None] * count, pyarrow.float32())))
    yield "word", written(column("t0", pyarrow.array(["a"] * count)))
    yield "missing", written(table.drop_columns(["t1"]))
    yield "twice", written(table.append_column("t0", table["t0"]))


def first_chunk(data):
    """Where an EXR file's first chunk is: after the header comes a table of all."""
    place = 8
    while data[place]:
        name = data.index(b"\0", place)
        kind = data.index(b"\0", name + 1)
        place = kind + 5 + struct.unpack_from("<i", data, kind + 1)[0]
    return struct.unpack_from("<Q", data, place + 1)[0]


def deep_lies(data):
    """Of windows, and of a line's sizes: of its counts, of its samples packed and unpacked."""
    for name, box in WINDOWS.items():
        yield f"{name}.deep.exr", windowed(data, box)
    for field, place in (("counts", 4), ("packed", 12), ("unpacked", 20)):
        for size in (10**8, 2**40, 2**62):
            lie = patched(data, first_chunk(data) + place, struct.pack("<Q", size))
            yield f"{field}-{size}.deep.exr", lie


def film_lies(folder):
    for compression in COMPRESSIONS:
        channels, header = exr(compression)
        OpenEXR.File(header, channels).write(str(folder / "good.exr"))
        data = (folder / "good.exr").read_bytes()
        for name, box in WINDOWS.items():
            yield f"{compression}-{name}.exr", windowed(data, box)


@pytest.fixture(scope="module")
def refused(tmp_path_factory):
    """What came of each file, by name: what was said, and the memory that it took in MiB."""
    folder = tmp_path_factory.mktemp("lies")
    triangle = np.array([[[-1.0, -1, 0], [1, -1, 0], [0, 1, 0]]]) + [[[0, 0, 0]], [[0.5, 0, 0]]]
    scene = mb.Scene([mb.Mesh(triangle, [[0, 1, 2]], shading="unlit")], mb.Camera((0, 0, 4)))
    film = mb.render(
        scene, width=16, height=12, settings=mb.Settings(samples=2, aovs="events,deep")
    )
    lies = {
        "scene": dict(scenes()),
        "image": dict(images()),
        "events": dict(event_lies(film, folder)),
        "film": dict(film_lies(folder)),
        "deep": dict(deep_lies(film.write(folder / "a.deep.exr").read_bytes())),
    }
    rgb = npy((10**6, 10**6, 3))
    lies["reference"] = {"array.npz": npz({"rgb": rgb}), "size.npz": directory_lie(
        npz({"rgb": np.zeros((12, 16, 3), "f4")}), 24)}  # fmt: skip
    lies["image"] |= {
        f"{name}.exr": data for name, data in lies["film"].items() if name.startswith("ZIP-")
    }
    paths = []
    for kind, files in lies.items():
        for name, data in files.items():
            paths.append(folder / f"{kind}_{name}")
            paths[-1].write_bytes(data)
    run = subprocess.run(
        [sys.executable, "-c", READ], input="\n".join(map(str, paths)), text=True,
        capture_output=True, check=False, timeout=300,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr[-2000:]
    found = [json.loads(line) for line in run.stderr.splitlines() if line.startswith("[")]
    assert len(found) == len(paths)
    return {Path(path).name: (said, memory) for path, said, memory in found}


@pytest.mark.parametrize(
    ("kind", "error"),
    [
        ("scene", "SceneError"),
        ("image", "SceneError"),
        ("reference", "SceneError"),
        ("events", "OutputError"),
        ("film", "OutputError"),
        ("deep", "OutputError"),
    ],
)
def test_headers_that_lie_are_refused_by_the_reader(refused, kind, error):
    """Each names its file, and takes no memory for what the file does not hold."""
    found = {name: said for name, said in refused.items() if name.startswith(f"{kind}_")}
    assert len(found) >= 2
    for name, (said, memory) in found.items():
        assert said.startswith(f"{error}: "), (name, said)
        assert name in said, (name, said)
        assert memory < 150, (name, memory)


def test_what_the_files_are_made_of_is_read(tmp_path):
    """The lies are what is refused, and nothing else about them."""
    (tmp_path / "a.npz").write_bytes(npz(GOOD))
    assert mb.load(tmp_path / "a.npz").meshes[0].positions.shape == (2, 3, 3)
    for form, body in (("ascii", TEXT), (LITTLE, BINARY)):
        (tmp_path / "a.ply").write_bytes(ply(3, 1, form, body))
        assert len(mb.load(tmp_path / "a.ply").meshes[0].faces) == 1
    for head in (b"OFF\n3 1 0\n", b"OFF 3 1 0\n# a word\n", b"# a word\nOFF\n3 1 0\n\n"):
        (tmp_path / "a.off").write_bytes(head + TEXT)
        assert len(mb.load(tmp_path / "a.off").meshes[0].faces) == 1, head
    (tmp_path / "a.gltf").write_bytes(gltf("accessors", count=3))
    assert len(mb.load(tmp_path / "a.gltf").meshes[0].faces) == 1
    (tmp_path / "a.png").write_bytes(png(2, 1))
    assert mb.read_image(tmp_path / "a.png").shape == (1, 2, 3)


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_an_exr_of_one_colour_which_holds_the_most_in_a_byte_is_read(tmp_path, compression):
    _, header = exr(compression)
    pixels = {name: np.zeros((2048, 4096), "f4") for name in "RGB"}
    OpenEXR.File(header, pixels).write(str(tmp_path / "a.exr"))
    assert mb.Film.read(tmp_path / "a.exr").rgba.shape == (2048, 4096, 4)


@pytest.mark.parametrize("ending", ["png", "gif", "jpg"])
def test_an_image_of_one_colour_which_holds_the_most_in_a_byte_is_read(tmp_path, ending):
    Image.new("1", (3000, 3000)).save(tmp_path / f"a.{ending}", optimize=True)
    assert mb.read_image(tmp_path / f"a.{ending}").shape == (3000, 3000, 3)


FACTS = np.array('{"renders": 4, "seconds": 1}')


@pytest.mark.parametrize(
    "arrays",
    [
        {"halves": npy((2, 10**6, 10**6, 3)), "facts": FACTS},
        {"halves": np.zeros((2, 4, 4, 3), "f4"), "facts": FACTS},
        {"halves": np.zeros((2, 12, 16, 3), "f4"), "facts": np.array("[" * 100_000)},
        {"halves": np.zeros((2, 12, 16, 3), "f4"), "facts": np.array("[]")},
        {"halves": np.zeros((2, 12, 16, 3), "f4")},
    ],
)
def test_a_reference_that_lies_is_made_again(tmp_path, arrays, caplog):
    """Of another size, too: it is found by the name that all it depends on gives it."""
    case = Case("a", mb.Scene([]), 1.0, 16, 12)
    (tmp_path / "a.npz").write_bytes(npz(arrays))
    assert reference._read(tmp_path / "a.npz", mb.Settings(), case) is None
    assert "it is made again" in caplog.text
    good = {
        "halves": np.ones((2, 12, 16, 3), "f4"),
        "facts": FACTS,
    }
    (tmp_path / "a.npz").write_bytes(npz(good))
    assert reference._read(tmp_path / "a.npz", mb.Settings(), case).renders == 4


@pytest.mark.parametrize("text", ["[" * 100_000, "9" * 5000, "[]", '{"format": "x"}', "\xff"])
def test_results_that_are_none_are_told_of(tmp_path, text):
    for name, read in (("study.json", read_study), ("a.json", read_result)):
        (tmp_path / name).write_text(text, encoding="latin-1")
        with pytest.raises(mb.UsageError, match=name):
            read(tmp_path if read is read_study else tmp_path / name)


@pytest.mark.parametrize("kind", ["npz", "parquet", "exr", "deep.exr"])
def test_no_seeded_change_of_an_output_gives_another_error(tmp_path, kind):
    """Bits, words and whole parts of it; what is read of a changed file is a film all the same."""
    triangle = mb.Mesh(np.eye(3), [[0, 1, 2]], shading="unlit")
    film = mb.render(
        mb.Scene([triangle]), width=8, height=6,
        settings=mb.Settings(samples=1, aovs="events,deep,object"),
    )  # fmt: skip
    data = film.write(tmp_path / f"a.{kind}").read_bytes()
    run = subprocess.run(
        [sys.executable, "-c", CHANGE, str(tmp_path / f"a.{kind}")],
        text=True, capture_output=True, check=False, timeout=300,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr[-2000:]
    assert int(run.stdout.split()[-1]) > 100, run.stdout[-1000:]
    assert data


CHANGE = """
import random, resource, struct, sys
import OpenEXR, pyarrow.parquet
import mbinterval as mb
resource.setrlimit(resource.RLIMIT_AS, (3 << 30, 3 << 30))
resource.setrlimit(resource.RLIMIT_CPU, (120, 120))
path, chance, refused = sys.argv[1], random.Random(7), 0
read = mb.DeepImage.read if path.endswith("deep.exr") else mb.Events.read
read = mb.Film.read if path.endswith("a.exr") else read
data = open(path, "rb").read()
words = ["ffffff7f", "ff" * 8, "ff" * 7 + "7f", "00" * 4, "00000010"]
for _ in range(300):
    found = bytearray(data)
    for _ in range(chance.choice((1, 1, 2, 8))):
        end = chance.choice((len(found), min(len(found), 600)))
        place = chance.randrange(end)
        if chance.random() < 0.5:
            place = len(found) - end + place
        how = chance.randrange(4)
        if how == 0:
            found[place] ^= 1 << chance.randrange(8)
        elif how == 1:
            word = bytes.fromhex(chance.choice(words))
            found[place : place + len(word)] = word
        elif how == 2:
            del found[place : place + chance.randrange(16)]
        elif chance.random() < 0.3:
            del found[place:]
        found = found or bytearray(b"x")
    with open(path, "wb") as file:
        file.write(found)
    try:
        read(path)
    except mb.OutputError:
        refused += 1
print(refused)
"""


def test_films_are_read_from_folders_of_any_name(tmp_path):
    """OpenEXR takes names in UTF-8 alone."""
    triangle = mb.Mesh(np.eye(3), [[0, 1, 2]], shading="unlit")
    film = mb.render(
        mb.Scene([triangle]), width=8, height=6, settings=mb.Settings(samples=1, aovs="deep")
    )
    film.write(tmp_path / "a.exr")
    film.write(tmp_path / "a.deep.exr")
    folder = tmp_path / os.fsdecode(b"bytes \xff\xfe")
    folder.mkdir()
    for name, read in (("a.exr", mb.Film.read), ("a.deep.exr", mb.DeepImage.read)):
        (folder / name).write_bytes((tmp_path / name).read_bytes())
        assert np.array_equal(read(folder / name).rgba, read(tmp_path / name).rgba)
    assert mb.read_image(folder / "a.exr").shape == (6, 8, 4)
