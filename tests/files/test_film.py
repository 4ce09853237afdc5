"""Films are written whole, exactly, and the same bytes every time; images are read as linear."""

import os
import resource
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from PIL import Image
from support.films import METADATA, make_film

from mbinterval.errors import OutputError, SceneError, UsageError
from mbinterval.files.atomic import replacing
from mbinterval.files.exr import PIXEL_DIGEST, ExrImage, read_exr, write_exr
from mbinterval.files.images import linear_pixels, linear_to_srgb, read_image, srgb_to_linear
from mbinterval.film.film import Film


def assert_same_pixels(film, other):
    assert np.array_equal(film.rgba, other.rgba)
    assert np.array_equal(film.depth, other.depth)
    assert np.array_equal(film.intervals, other.intervals)


@pytest.mark.parametrize("ending", ["exr", "png"])
def test_equal_films_give_equal_bytes_and_others_do_not(tmp_path, ending):
    first = make_film(timings={"paths": 1.0}).write(tmp_path / f"a.{ending}").read_bytes()
    again = make_film(timings={"paths": 2.0}).write(tmp_path / f"b.{ending}").read_bytes()
    other = make_film(seed=1).write(tmp_path / f"c.{ending}").read_bytes()
    assert first == again
    assert first != other


def test_an_exr_reads_back_equal(tmp_path):
    film = make_film(transparent=True)
    back = Film.read(film.write(tmp_path / "a.exr"))
    assert_same_pixels(film, back)
    assert back.transparent
    assert back.resolution == film.resolution
    assert back.origin == (0, 0)
    expected = dict(METADATA) | {"settings.seed": str(2**32 - 1)}
    assert back.metadata == expected


def test_a_path_that_ends_like_a_folders_is_the_files(tmp_path):
    film = make_film()
    path = film.write(f"{tmp_path}/a.EXR/")
    assert path.is_file()
    assert_same_pixels(film, Film.read(path))


def test_a_crop_keeps_its_place_in_the_frame(tmp_path):
    film = make_film(resolution=(1024, 768), origin=(100, 200))
    back = Film.read(film.write(tmp_path / "a.exr"))
    assert (back.resolution, back.origin) == ((1024, 768), (100, 200))
    assert_same_pixels(film, back)
    header = OpenEXR.File(str(tmp_path / "a.exr")).header()
    assert np.array_equal(header["dataWindow"], [(100, 200), (133, 220)])
    assert np.array_equal(header["displayWindow"], [(0, 0), (1023, 767)])


@pytest.mark.parametrize(
    "view",
    [
        lambda a: np.asfortranarray(a),
        lambda a: np.repeat(a, 2, axis=1)[:, ::2],
        lambda a: a[::-1].copy()[::-1],
        lambda a: a.astype(a.dtype.newbyteorder(">")),
    ],
    ids=["fortran order", "strided", "reversed", "big-endian"],
)
def test_the_layout_of_arrays_does_not_change_the_file(tmp_path, view):
    film = make_film()
    plain = film.write(tmp_path / "a.exr").read_bytes()
    viewed = make_film(rgba=view(film.rgba), depth=view(film.depth), intervals=view(film.intervals))
    assert viewed.write(tmp_path / "b.exr").read_bytes() == plain


def test_writing_changes_neither_the_metadata_nor_other_given_mappings(tmp_path):
    attributes, channels = {"frame": 1.0}, {"Z": np.zeros((2, 3), np.float32)}
    write_exr(tmp_path / "a.exr", ExrImage(channels, (3, 2), (0, 0), attributes))
    assert attributes == {"frame": 1.0}
    assert list(channels) == ["Z"]
    assert type(channels["Z"]) is np.ndarray


def test_arrays_that_do_not_fit_together_are_refused():
    with pytest.raises(UsageError, match=r"depth has shape \(3, 3\), expected \(21, 34\)"):
        make_film(depth=np.zeros((3, 3)))
    with pytest.raises(UsageError, match="rgba has shape"):
        make_film(rgba=np.zeros((21, 34, 3)))
    with pytest.raises(UsageError, match="at least one row"):
        make_film(rgba=np.zeros((0, 3, 4)), depth=np.zeros((0, 3)), intervals=np.zeros((0, 3)))


def test_an_exr_of_another_program_needs_only_colour(tmp_path):
    colour = {name: np.full((2, 3), 0.25, np.float16) for name in "RGB"}
    write_exr(tmp_path / "a.exr", ExrImage(colour, (3, 2), (0, 0), {}))
    film = Film.read(tmp_path / "a.exr")
    assert film.rgba.dtype == np.float32
    assert np.array_equal(film.rgba[1, 2], [0.25, 0.25, 0.25, 1.0])
    assert np.isinf(film.depth).all()
    assert not film.intervals.any()
    write_exr(tmp_path / "z.exr", ExrImage({"Z": colour["R"]}, (3, 2), (0, 0), {}))
    with pytest.raises(
        OutputError, match=r"z\.exr: a film needs channels R, G and B; the file has Z"
    ):
        Film.read(tmp_path / "z.exr")


def test_what_another_program_calls_intervals_or_transparent_is_not_ours(tmp_path):
    pixels = {name: np.full((2, 3), 0.25, np.float32) for name in "RGB"}
    pixels["intervals"] = np.full((2, 3), np.nan, np.float32)
    write_exr(tmp_path / "a.exr", ExrImage(pixels, (3, 2), (0, 0), {"transparent": "no"}))
    film = Film.read(tmp_path / "a.exr")
    assert not film.intervals.any()
    assert not film.transparent


@pytest.mark.parametrize("name", ["a.png", "folder", "missing.exr"])
def test_what_is_no_exr_is_an_error_that_says_so(tmp_path, name):
    make_film().write(tmp_path / "a.png")
    (tmp_path / "folder").mkdir()
    reason = {"a.png": "not an EXR file", "folder": "is a folder", "missing.exr": "no such file"}
    with pytest.raises(OutputError, match=rf"{name}: {reason[name]}"):
        Film.read(tmp_path / name)
    with pytest.raises(OutputError, match="None: expected the path of a file"):
        Film.read(None)


@pytest.mark.parametrize("part", [0.0, 0.01, 0.3, 0.7, 0.99])
def test_a_truncated_exr_is_an_error(tmp_path, part):
    path = make_film().write(tmp_path / "a.exr")
    data = path.read_bytes()
    path.write_bytes(data[: int(part * len(data))])
    with pytest.raises(OutputError, match=r"a\.exr"):
        Film.read(path)


def test_an_exr_without_its_last_byte_is_an_error(tmp_path):
    path = make_film().write(tmp_path / "a.exr")
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(OutputError, match="cut off or broken"):
        Film.read(path)


def test_a_png_has_the_srgb_curve_and_no_alpha(tmp_path):
    rgba = np.zeros((1, 4, 4), np.float32)
    rgba[0, :, :3] = np.array([0.0, 0.5, 1.0, 7.0])[:, None]
    film = make_film(1, 4, rgba=rgba)
    with Image.open(film.write(tmp_path / "a.png")) as image:
        assert image.mode == "RGB"
        assert np.asarray(image)[0, :, 1].tolist() == [0, 188, 255, 255]
        assert image.text["settings.paths"] == "triangulated"


def test_a_transparent_png_has_straight_alpha(tmp_path):
    rgba = np.array([[[0.25, 0.0, 0.1, 0.5], [0.0, 0.0, 0.0, 0.0]]], np.float32)
    film = make_film(1, 2, rgba=rgba, transparent=True)
    with Image.open(film.write(tmp_path / "a.png")) as image:
        assert image.mode == "RGBA"
        assert np.asarray(image)[0].tolist() == [[188, 0, 124, 128], [0, 0, 0, 0]]


@pytest.mark.parametrize("ending", ["exr", "png"])
def test_pixels_that_are_not_finite_are_written_too(tmp_path, ending):
    film = make_film(1, 3, rgba=np.array([[[np.nan] * 4, [np.inf] * 4, [-1.0] * 4]], np.float32))
    path = film.write(tmp_path / f"a.{ending}")
    if ending == "exr":
        assert np.array_equal(Film.read(path).rgba, film.rgba, equal_nan=True)


def test_an_unknown_ending_is_a_usage_error(tmp_path):
    for name in ("a.tif", "a", "exr"):
        with pytest.raises(UsageError, match=r"expected \.exr, \.png, \.npz or \.parquet"):
            make_film().write(tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_missing_folders_are_made_and_the_file_is_as_others_are(tmp_path):
    path = make_film().write(tmp_path / "a" / "b" / "c.EXR")
    assert path.is_file()
    (tmp_path / "other").touch()
    assert path.stat().st_mode == (tmp_path / "other").stat().st_mode


def test_what_cannot_be_written_is_an_output_error(tmp_path):
    (tmp_path / "file").touch()
    (tmp_path / "folder.exr").mkdir()
    for path, reason in (
        (tmp_path / "file" / "a.exr", "exists"),
        (tmp_path / "folder.exr", "is a folder"),
        (tmp_path / f"{'n' * 300}.exr", "cannot be written"),
    ):
        with pytest.raises(OutputError, match=reason) as caught:
            make_film().write(path)
        assert str(caught.value).startswith(f"{path}: ")
        assert ".part" not in str(caught.value)


@pytest.mark.parametrize("error", [KeyboardInterrupt, MemoryError, OSError(28, "disk full")])
def test_an_interrupted_write_leaves_the_older_file_and_nothing_else(tmp_path, error):
    path = tmp_path / "a.exr"
    path.write_bytes(b"older")

    def interrupted():
        with replacing(path) as temporary:
            temporary.write_bytes(b"half")
            raise error

    with pytest.raises((KeyboardInterrupt, MemoryError, OutputError)):
        interrupted()
    assert [p.name for p in tmp_path.iterdir()] == ["a.exr"]
    assert path.read_bytes() == b"older"


@pytest.mark.parametrize("ending", ["exr", "png"])
def test_a_full_disk_is_an_output_error_and_leaves_nothing(tmp_path, ending):
    film = make_film(200, 300)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (5000, limits[1]))
    try:
        with pytest.raises(OutputError, match="File too large"):
            film.write(tmp_path / f"a.{ending}")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert not list(tmp_path.iterdir())


def test_two_processes_that_write_one_file_do_not_mix(tmp_path):
    code = (
        "import sys; sys.path.insert(0, sys.argv[1]); from support.films import make_film\n"
        "film = make_film(300, 400)\n"
        "for _ in range(10): film.write(sys.argv[2])"
    )
    tests = str(Path(__file__).parents[1])
    arguments = [sys.executable, "-c", code, tests, str(tmp_path / "a.exr")]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    writers = [subprocess.Popen(arguments, env=environment) for _ in range(2)]
    assert [writer.wait(120) for writer in writers] == [0, 0]
    assert [p.name for p in tmp_path.iterdir()] == ["a.exr"]
    assert_same_pixels(Film.read(tmp_path / "a.exr"), make_film(300, 400))


def test_the_srgb_curve_is_exact_on_all_codes():
    codes = np.arange(256)
    back = linear_to_srgb(srgb_to_linear(codes / 255.0)) * 255.0
    assert np.abs(back - codes).max() < 1e-4
    assert srgb_to_linear(np.array(0.5)) == pytest.approx(0.21404114, rel=1e-6)
    assert linear_to_srgb(np.array([np.nan, -1.0, np.inf])) == pytest.approx([0, 0, 1])


@pytest.mark.parametrize("mode", ["1", "L", "LA", "P", "RGB", "RGBA", "CMYK"])
def test_every_mode_of_integer_image_is_read(mode):
    pixels = linear_pixels(Image.new("RGBA", (5, 4), (255, 255, 255, 51)).convert(mode))
    assert pixels.shape == (4, 5, 4 if mode in ("LA", "P", "RGBA") else 3)
    assert pixels.dtype == np.float32
    assert pixels[0, 0, :3] == pytest.approx(1.0, abs=1e-6)
    assert pixels.shape[2] == 3 or pixels[0, 0, 3] == pytest.approx(0.2)


def test_sixteen_bit_grey_keeps_its_precision(tmp_path):
    Image.fromarray(np.array([[32768]], np.uint16)).save(tmp_path / "a.png")
    assert read_image(tmp_path / "a.png")[0, 0] == pytest.approx(
        [float(srgb_to_linear(np.array(32768 / 65535)))] * 3, rel=1e-6
    )


def test_an_exr_texture_is_read_as_linear_with_straight_alpha(tmp_path):
    rgba = np.array([[[0.5, 0.25, 0.0, 0.5], [0.0, 0.0, 0.0, 0.0]]], np.float32)
    make_film(1, 2, rgba=rgba).write(tmp_path / "a.exr")
    expected = [[[1.0, 0.5, 0.0, 0.5], [0.0, 0.0, 0.0, 0.0]]]
    assert np.array_equal(read_image(tmp_path / "a.exr"), expected)
    grey = ExrImage({"Y": np.full((1, 1), 0.5, np.float32)}, (1, 1), (0, 0), {})
    write_exr(tmp_path / "y.exr", grey)
    assert np.array_equal(read_image(tmp_path / "y.exr"), [[[0.5, 0.5, 0.5]]])


def test_an_image_that_cannot_be_read_is_a_scene_error_that_names_it(tmp_path):
    for name, data in (("a.png", b"no"), ("a.exr", b"no"), ("b.jpg", b"")):
        (tmp_path / name).write_bytes(data)
        with pytest.raises(SceneError, match=name):
            read_image(tmp_path / name)
    with pytest.raises(SceneError, match=r"missing\.png: no such file"):
        read_image(tmp_path / "missing.png")
    whole = tmp_path / "whole.png"
    Image.new("RGB", (64, 64)).save(whole)
    whole.write_bytes(whole.read_bytes()[:-30])
    with pytest.raises(SceneError, match=r"whole\.png"):
        read_image(whole)


def test_read_exr_keeps_foreign_attributes(tmp_path):
    channels = {"Z": np.zeros((1, 1), np.float32)}
    write_exr(tmp_path / "a.exr", ExrImage(channels, (1, 1), (0, 0), {"owner": "né", "n": (1, 2)}))
    found = dict(read_exr(tmp_path / "a.exr").attributes)
    assert len(found.pop(PIXEL_DIGEST)) == 64
    assert found == {
        "owner": "né",
        "n": (1, 2),
    }


def test_a_camera_beyond_float32_is_written_without_a_warning(tmp_path):
    matrix = tuple(np.diag([1.0, 1.0, 1e200, 1.0]).ravel().tolist())
    path = make_film(metadata={"worldToCamera": matrix}).write(tmp_path / "a.exr")
    assert Film.read(path).metadata["worldToCamera"][10] == np.inf


def test_an_attribute_of_an_unknown_type_does_not_keep_an_exr_from_being_read(tmp_path):
    """The package gives its bytes, which are not always text."""
    path = make_film().write(tmp_path / "a.exr")
    kind = b"pixelDigest\0string\0"
    data = path.read_bytes()
    place = data.index(kind) + len(kind) + 4
    data = data.replace(kind, b"pixelDigest\0strimg\0")
    path.write_bytes(data[:place] + b"\xe7\xff" + data[place + 2 :])
    assert np.array_equal(Film.read(path).rgba, make_film().rgba)


def test_a_tag_that_says_nothing_of_the_pixels_may_be_damaged(tmp_path, recwarn):
    image = Image.new("RGB", (4, 4), (255, 0, 0))
    image.save(tmp_path / "a.tif", tiffinfo={270: "a description", 305: "a program"})
    data = (tmp_path / "a.tif").read_bytes()
    entry = struct.pack("<HHI", 305, 2, 10)
    assert entry in data
    (tmp_path / "a.tif").write_bytes(data.replace(entry, struct.pack("<HHI", 305, 2, 10**6)))
    assert np.array_equal(read_image(tmp_path / "a.tif"), np.full((4, 4, 3), [1, 0, 0]))
    assert not recwarn.list
