"""``mb.compare``: what it takes, what it says, and its verdict on renders of shipped scenes."""

import dataclasses
import json
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from support.films import make_film
from support.nightly import nightly

import mbinterval as mb
from mbinterval.comparison import metrics
from mbinterval.comparison.comparison import MAP_RANGE, METRICS, false_colour

SCENES = Path(__file__).parents[2] / "scenes"


def noisy(seed, sigma=0.02, shift=0.0, size=(24, 32)):
    base = np.linspace(0, 1, size[1])[None, :, None] * np.ones((*size, 3))
    noise = np.random.default_rng(seed).normal(shift, sigma, (*size, 3))
    return (base + noise).astype(np.float32)


def test_films_arrays_and_files_give_the_same(tmp_path):
    a, b = make_film(seed=1), make_film(seed=2)
    paths = [film.write(tmp_path / f"{name}.exr") for film, name in ((a, "a"), (b, "b"))]
    results = [
        mb.compare(a, b),
        mb.compare(a.rgba, b.rgba[..., :3]),
        mb.compare(paths[0], str(paths[1])),
    ]
    assert tuple(results[0].metrics) == METRICS
    for result in results[1:]:
        assert result.metrics == results[0].metrics
    colours = a.rgba[..., :3].astype(float), b.rgba[..., :3].astype(float)
    assert results[0].metrics["rmse"] == metrics.rmse(*colours)
    np.testing.assert_allclose(results[0].difference, colours[0] - colours[1], atol=1e-7)
    np.testing.assert_allclose(results[0].maps["rms"], metrics.rms_map(*colours), rtol=1e-6)


def test_without_repeats_there_is_no_verdict_and_a_note():
    result = mb.compare(noisy(1), noisy(2), which=["rmse"])
    assert result.verdict is None
    assert result.notes == ("no verdict: neither side has independent repeats",)
    assert list(result.metrics) == ["rmse"]


def test_metrics_are_of_the_first_repeat_against_the_mean_of_the_references():
    images, references = ([noisy(i) for i in range(s, s + 5)] for s in (0, 10))
    result = mb.compare(images, references, which=["rmse"], samples=16)
    expected = metrics.rmse(images[0], np.mean(references, axis=0, dtype=float))
    assert result.metrics["rmse"] == pytest.approx(expected, rel=1e-6)
    assert result.verdict.explained
    assert result.notes == ()
    stacked = mb.compare(np.array(images), np.array(references), which=["rmse"], samples=16)
    assert stacked.verdict.p_value == result.verdict.p_value


def test_films_tell_their_samples_and_arrays_are_told_them():
    """With fewer samples the allowance for what none has met is larger."""
    fields = {"metadata": {"settings.samples": 256}}
    films = [make_film(rgba=np.dstack([noisy(i), noisy(i)[..., :1]]), height=24, width=32,
                       depth=np.ones((24, 32)), intervals=np.zeros((24, 32)), **fields)
             for i in range(8)]  # fmt: skip
    arrays = [film.rgba for film in films]
    detectable = [
        mb.compare(images, arrays[0] * 0, which=[], samples=samples).verdict.detectable[1]
        for images, samples in ((films, None), (arrays, 256), (arrays, None))
    ]
    assert detectable[0] == detectable[1] < detectable[2]
    assert "1 is taken" in mb.compare(arrays, arrays[0], which=[]).notes[0]


def test_repeats_that_are_all_equal_are_no_noise():
    result = mb.compare([noisy(0)] * 4, noisy(1), which=["mae"])
    assert result.verdict is None
    assert "the repeats of the image are all equal" in result.notes[0]


@pytest.mark.parametrize(
    ("image", "reference", "what"),
    [
        (noisy(0), noisy(0)[:-1], "image is 32 x 24 pixels, reference is 32 x 23 pixels"),
        (make_film(origin=(2, 1), resolution=(99, 99)), make_film(), r"from \(2, 1\)"),
        (np.zeros((4, 5)), noisy(0), "image=.*expected a film"),
        ("3", noisy(0), "no such file"),
        (3, noisy(0), "image=3: expected a film"),
        ([], noisy(0), "image: an empty list"),
        ([noisy(0), noisy(0)[1:]], noisy(0), r"image\[1\]: its size or its place"),
        (noisy(0), np.full((24, 32, 3), np.nan), "reference: the pixel in column 0, row 0"),
    ],
)
def test_what_cannot_be_compared_is_said(image, reference, what):
    with pytest.raises(mb.MbintervalError, match=what):
        mb.compare(image, reference)


@pytest.mark.parametrize(
    ("options", "what"),
    [({"which": ["rsme"]}, "did you mean rmse"), ({"level": 0}, "level=0"),
     ({"level": 1}, "level=1"), ({"tolerance": -1}, "tolerance=-1"), ({"samples": 0}, "samples=0")],
)  # fmt: skip
def test_options_out_of_range_are_said(options, what):
    with pytest.raises(mb.UsageError, match=what):
        mb.compare(noisy(0), noisy(1), **options)


def test_without_its_package_flip_is_left_out_and_noted(monkeypatch):
    monkeypatch.setattr(metrics, "has_flip", lambda: False)
    result = mb.compare(noisy(0), noisy(1))
    assert "flip" not in result.metrics
    assert "FLIP is left out" in result.notes[0]
    with pytest.raises(mb.UsageError, match="pip install"):
        mb.compare(noisy(0), noisy(1), which=["flip"])


def test_a_result_can_be_stored_as_json():
    images = [noisy(seed, shift=0.5) for seed in range(4)]
    stored = json.loads(json.dumps(mb.compare(images, noisy(9)).as_dict(), allow_nan=False))
    assert not stored["verdict"]["explained"]
    assert stored["verdict"]["regions"][0]["size"] > 1
    same = mb.compare(noisy(0), noisy(0)).as_dict()
    assert same["metrics"]["psnr"] is None
    assert same["metrics"]["rmse"] == 0


def test_maps_are_written_in_colours_that_do_not_depend_on_the_image(tmp_path):
    image = noisy(0)
    image[3, 4] += 10
    paths = mb.compare([image, noisy(1), noisy(2)], noisy(3) * 0, which=["rmse"]).write_maps(
        tmp_path / "maps"
    )
    assert [path.name for path in paths] == ["rms.png", "verdict.png"]
    picture = np.asarray(Image.open(paths[0]))
    assert picture[3, 4].tolist() == [0xFC, 0xFF, 0xA4]  # 1 or more
    low, high = MAP_RANGE
    colours = false_colour(np.array([[0.0, low, (low * high) ** 0.5, high, 99.0]]))[0]
    assert np.array_equal(colours[0], colours[1])
    assert np.array_equal(colours[3], colours[4])
    light = colours @ [0.2126, 0.7152, 0.0722]
    assert light[1] < light[2] < light[3]


SAMPLES = 16
SHIPPED = {"rolling_wheel": (120, 90, 12), "fly_by": (160, 120, 16)}
"""Width, height and repeats that show a later shutter; the camera's flight is the slower one."""


def films(name, first_seed, change=lambda scene: scene):
    scene = change(mb.load(SCENES / f"{name}.toml"))
    width, height, repeats = SHIPPED[name]
    return [
        mb.render(
            scene, frame=12, width=width, height=height,
            settings=mb.Settings(samples=SAMPLES, pattern="sobol", seed=first_seed + i),
        )
        for i in range(repeats)
    ]  # fmt: skip


@lru_cache
def renders(name, first_seed):
    return films(name, first_seed)


def later(scene):
    """The scene with its shutter moved by a hundredth of its length."""
    shutter = scene.shutter
    step = 0.01 * (shutter.close - shutter.open)
    moved = dataclasses.replace(shutter, open=shutter.open + step, close=shutter.close + step)
    return dataclasses.replace(scene, shutter=moved)


def with_triangle(scene):
    """The scene with one more triangle, a grey one of about 20 pixels, before the camera."""
    camera = scene.camera
    eye = np.array(camera.position.at(12) if hasattr(camera.position, "at") else camera.position)
    corners = [[0.0, 0.0, 0.0], [0.045, 0.0, 0.0], [0.0, 0.045, 0.0]]
    mesh = mb.Mesh(
        positions=np.array(corners) + eye - [0, 0, 1.2], faces=[[0, 1, 2]], color=(0.5, 0.5, 0.5),
        shading="unlit",
    )  # fmt: skip
    return dataclasses.replace(scene, meshes=[*scene.meshes, mesh])


@pytest.mark.parametrize("name", ["rolling_wheel", nightly("fly_by")])
def test_the_verdict_accepts_other_seeds_and_rejects_a_later_shutter_and_more_light(name):
    again, reference = renders(name, 0), renders(name, 1000)
    assert mb.compare(again, reference, which=[]).verdict.explained
    assert not mb.compare(films(name, 0, later), reference, which=[]).verdict.explained
    brighter = [film.rgba * np.float32(1.01) for film in again]
    verdict = mb.compare(brighter, reference, which=[], samples=SAMPLES).verdict
    assert not verdict.explained


def test_a_wrong_triangle_of_twenty_pixels_is_found_where_it_is():
    name = "rolling_wheel"
    wrong = films(name, 0, with_triangle)
    pairs = zip(wrong, renders(name, 0), strict=True)
    touched = np.any([np.any(a.rgba != b.rgba, axis=2) for a, b in pairs], axis=0)
    assert 20 <= touched.sum() <= 40
    verdict = mb.compare(wrong, renders(name, 1000), which=[]).verdict
    assert not verdict.explained
    assert verdict.pixels.sum() >= 15
    assert not (verdict.pixels & ~touched).any()
