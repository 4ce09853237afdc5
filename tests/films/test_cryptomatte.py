"""Cryptomatte: known hashes, coverage in closed form, ranks, names, readers that are not ours."""

from __future__ import annotations

import json
from dataclasses import replace

import cryptomatte_api
import numpy as np
import OpenImageIO as oiio
import pytest
from support.closed_forms import UNIT_CAMERA, overlap, slab_times
from support.panes import pane

import mbinterval as mb
from mbinterval.device import records
from mbinterval.film import cryptomatte
from mbinterval.film.cryptomatte import Ranks, id_of, murmur3
from mbinterval.scene.model import Material, Mesh, Scene

X = np.arange(32) + 0.5
BOTH = ("crypto_object", "crypto_material")


def film(*meshes: Mesh, aovs=BOTH, **settings: object) -> mb.Film:
    of = Scene(meshes=meshes, camera=UNIT_CAMERA)
    chosen = mb.Settings(aovs=aovs, **({"samples": 1} | settings))
    return mb.render(of, width=32, height=16, settings=chosen)


def float_of(name: str) -> np.float32:
    return np.uint32(id_of(name)).view(np.float32)


def matte(layer: np.ndarray, name: str) -> np.ndarray:
    """Coverage ``(H, W)`` of a name, by a reader that knows the specification alone."""
    ids = np.ascontiguousarray(layer[..., ::2]).view(np.uint32)
    return np.where(ids == id_of(name), layer[..., 1::2], 0.0).sum(axis=2)


# Hashes


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("", 0),
        ("test", 0xBA6BD213),
        ("Hello, world!", 0xC0363E43),
        ("The quick brown fox jumps over the lazy dog", 0x2E4FF723),
    ],
)
def test_hashes_are_those_that_are_known_of_murmur3(text, found):
    assert murmur3(text.encode()) == found


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("hello", 6.0705627102400005616e-17),
        ("cube", -4.08461912519e15),
        ("sphere", 2.79018604383e15),
        ("plane", 3.66557617593e-11),
        ("равнина", -1.3192631212399999468e-25),
        ("mädchen", 6.2361298211599995797e25),
    ],
)
def test_ids_are_those_of_the_specifications_own_tests(name, value):
    assert float_of(name) == np.float32(value)


def test_no_id_is_a_float_that_programs_change():
    """Denormal, infinite and NaN ones differ in one bit from their hash, others in none."""
    changed = 0
    for number in range(3000):
        name = f"name {number}"
        exponent = murmur3(name.encode()) >> 23 & 255
        special = exponent in (0, 255)
        assert id_of(name) == murmur3(name.encode()) ^ (special << 23)
        assert np.isfinite(float_of(name))
        assert abs(float_of(name)) >= np.finfo(np.float32).tiny
        changed += special
    assert 5 < changed < 60


def test_the_key_is_that_of_other_renderers_for_the_same_name():
    found = cryptomatte.metadata("crypto_object", ["a", "ß"])
    assert list(found) == [
        f"cryptomatte/f834d0a/{key}" for key in ("name", "hash", "conversion", "manifest")
    ]
    manifest = json.loads(found["cryptomatte/f834d0a/manifest"])
    assert manifest == {name: f"{id_of(name):08x}" for name in ("a", "ß")}


# Coverage


def test_coverage_is_exact_over_time_and_what_hides_counts():
    near, far = pane("near", 4.25, 9.25, 12, 2.0), pane("far", -3.5, 40.0, -20, 4.0)
    layer = film(near, far).layers["crypto_object"]
    front, back = slab_times(X, 4.25, 9.25, 12), slab_times(X, -3.5, 40.0, -20)
    want = front[1] - front[0], back[1] - back[0] - overlap(front, back)
    for name, coverage in zip(("near", "far"), want, strict=True):
        assert np.abs(matte(layer, name) - coverage).max() < 1e-6
    with pytest.raises(AssertionError):
        assert np.abs(matte(layer, "near") - want[0] * 0.99).max() < 1e-6
    assert not np.allclose(want[0], np.round(want[0]), atol=0.01)  # no mask of hits


def test_what_is_seen_through_covers_by_what_it_adds():
    meshes = pane("front", 4, 20, 6, 2.0, 0.3), pane("middle", -5, 40, -3, 3.0, 0.6)
    wall = pane("wall", -90, 90, 1, 5.0)
    found = film(*meshes, wall)
    times = [slab_times(X, *ends) for ends in ((4, 20, 6), (-5, 40, -3))]
    front, middle = (t[1] - t[0] for t in times)
    both = overlap(*times)
    want = {
        "front": 0.3 * front,
        "middle": 0.6 * (middle - both + 0.7 * both),
        "wall": 1 - 0.3 * front - 0.6 * (middle - 0.3 * both),
    }
    for name, coverage in want.items():
        for layer, key in (("crypto_object", name), ("crypto_material", f"paint of {name}")):
            assert np.abs(matte(found.layers[layer], key) - coverage).max() < 1e-6, name


def test_the_largest_comes_first_equal_ones_by_id_and_the_least_are_dropped():
    events = np.zeros(7, records.EVENT)
    events["path"] = [0, 1, 2, 3, 4, 0, 1]
    events["sample"] = [0, 0, 0, 0, 0, 1, 1]
    events["weight"] = [0.1, 0.2, 0.2, 0.05, 0.2, 0.05, 0.0]
    events["color"] = 1.0
    ids = np.array([50, 40, 30, 20, 10], np.uint32)
    ranks = Ranks(ids, 4, (1, 2))
    ranks.take(events)
    layer = ranks.result()[0]
    assert layer[0, ::2].view(np.uint32).tolist() == [10, 30, 40, 50]
    assert layer[0, 1::2] == pytest.approx([0.2, 0.2, 0.2, 0.15])
    assert not layer[1].any()
    with pytest.raises(ValueError, match="shape"):  # a film has pairs of pairs
        mb.Film.__post_init__(replace(film(), layers={"crypto_object": layer[None, :, :6]}))


def test_levels_are_as_many_as_are_asked_for():
    walls = [pane(f"wall {k}", 4 * k, 4 * k + 4, 32.0, 2.0) for k in range(8)]
    few, many = film(*walls, cryptomatte_levels=2), film(*walls, cryptomatte_levels=8)
    assert few.layers["crypto_object"].shape == (16, 32, 4)
    assert many.layers["crypto_object"].shape == (16, 32, 16)
    assert np.array_equal(few.layers["crypto_object"], many.layers["crypto_object"][..., :4])
    kept, alpha = few.layers["crypto_object"][..., 1::2].sum(axis=2), many.rgba[..., 3]
    assert (kept < alpha - 0.1).any()
    assert np.abs(many.layers["crypto_object"][..., 1::2].sum(axis=2) - alpha).max() < 1e-6


# Names


def test_names_are_the_scenes_and_what_has_none_has_a_number():
    tin = Material("tin", shading="unlit")
    meshes = [
        replace(pane("", 0, 8, 1, 2.0), material=tin),
        replace(pane("same", 8, 16, 1, 2.0), material=tin),
        replace(pane("same", 16, 24, 1, 2.0), material=Material(shading="unlit")),
    ]
    found = film(*meshes)
    named = {
        found.metadata[key.replace("manifest", "name")]: json.loads(text)
        for key, text in found.metadata.items()
        if key.endswith("manifest")
    }
    assert {layer: list(names) for layer, names in named.items()} == {
        "crypto_object": ["object 1", "same"],
        "crypto_material": ["tin", "material 2"],
    }
    covered = matte(found.layers["crypto_object"], "same")
    assert covered[0, 20] == pytest.approx(1.0)
    assert covered[0, 12] == pytest.approx(1.0)
    assert found.notes == ()


def test_two_names_with_one_id_are_said(monkeypatch):
    monkeypatch.setattr(cryptomatte, "id_of", lambda name: 0x3F800000)
    found = film(pane("left", 0, 8, 1, 2.0), pane("right", 8, 16, 1, 2.0), aovs="crypto_object")
    assert found.notes == ("crypto_object: 'left' and 'right' have one ID; rename one of them",)


# Files


def test_readers_that_are_not_ours_find_every_matte(tmp_path):
    """cryptomatte-api (C++, by the specification 1.2.0), and OpenImageIO for the channels."""
    names = "near", "weiße Wand", 'say "far"'
    meshes = [
        pane(names[0], 4.25, 9.25, 12, 2.0, 0.4),
        pane(names[1], -3.5, 40.0, -20, 4.0),
        pane(names[2], 0.0, 90.0, 5, 8.0),
    ]
    found = film(*meshes, samples=2)
    path = found.write(tmp_path / "a.exr")
    mattes = {m.metadata().name(): m for m in cryptomatte_api.Cryptomatte.load(str(path))}
    assert set(mattes) == set(BOTH)
    total = 0.0
    for name in names:
        for layer, key in (("crypto_object", name), ("crypto_material", f"paint of {name}")):
            assert mattes[layer].num_levels() == 6
            mask = mattes[layer].mask(key)
            assert np.array_equal(mask, matte(found.layers[layer], key).astype(np.float32))
        total += mask
    assert np.abs(total - found.rgba[..., 3]).max() < 1e-6
    assert mask.any()
    file = oiio.ImageInput.open(str(path))
    spec = file.spec()
    ranks = [f"{layer}{k:02d}.{c}" for layer in BOTH for k in range(3) for c in "RGBA"]
    assert set(ranks) < set(spec.channelnames)
    assert all(spec.channelformat(spec.channelindex(name)) == oiio.FLOAT for name in ranks)
    assert spec.getattribute("cryptomatte/f834d0a/hash") == "MurmurHash3_32"
    assert spec.getattribute("cryptomatte/f834d0a/conversion") == "uint32_to_float32"
    index = spec.channelindex("crypto_object00.R")
    first = file.read_image(0, 0, index, index + 2, oiio.FLOAT)
    assert np.array_equal(first, found.layers["crypto_object"][..., :2])
    file.close()
    again = mb.Film.read(path)
    assert list(again.layers) == list(BOTH)
    for layer in BOTH:
        assert np.array_equal(again.layers[layer], found.layers[layer])
    assert again.write(tmp_path / "b.exr").read_bytes() == path.read_bytes()
