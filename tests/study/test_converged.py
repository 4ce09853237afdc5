"""Converged references: their error is what they say, and a kept one is of the same renders."""

import dataclasses
import logging
import shutil
from pathlib import Path

import numpy as np
import pytest

import mbinterval as mb
from mbinterval.bench.cases import make_case
from mbinterval.study import reference
from mbinterval.study.reference import Reference, converged, fingerprint

SCENES = Path(__file__).parents[2] / "scenes"
NOISY = mb.Settings(samples=2, pattern="sobol")


def case_of(count=40, **fields):
    return dataclasses.replace(make_case(f"fast_cubes:{count}", width=48, height=36), **fields)


@pytest.fixture(scope="module")
def truth():
    """Its own error, 256 samples per pixel, is a third of that of the 32 that are measured."""
    settings = mb.Settings(samples=256, pattern="sobol", seed=10**6)
    return mb.render(case_of().scene, width=48, height=36, settings=settings).rgba[..., :3]


def rms(difference):
    return float(np.sqrt(np.mean(np.square(difference, dtype=float))))


def test_its_error_is_that_against_a_far_finer_image(truth):
    told = []
    found = converged(case_of(), NOISY, 1e-9, most=16, progress=lambda *so_far: told.append(so_far))
    actual = rms(found.image - truth)
    assert found.error == pytest.approx(actual, rel=0.25)
    assert found.renders == 16
    assert [count for count, _error in told] == list(range(2, 17, 2))
    assert told[-1] == (16, pytest.approx(found.error, rel=1e-5))


def test_it_ends_when_its_error_is_as_asked():
    found = converged(case_of(), NOISY, 3e-3)
    assert found.error <= 3e-3
    assert found.renders < 1024
    coarser = converged(case_of(), NOISY, 3e-3, most=found.renders - 2)
    assert coarser.error > 3e-3


def test_an_images_error_is_measured_without_the_references_own():
    """By simulation: halves with noise as large as the image's error."""
    rng = np.random.default_rng(0)
    truth, error = rng.random((60, 80, 3)), 0.01
    halves = truth + rng.normal(0, 0.02, (2, *truth.shape))
    reference = Reference(halves.astype(np.float32), "simulated")
    image = truth + rng.normal(0, error, truth.shape)
    assert reference.rmse_of(image) == pytest.approx(error, rel=0.1)
    assert rms(image - reference.image) > 1.5 * error
    assert reference.error == pytest.approx(0.02 / np.sqrt(2), rel=0.05)
    assert reference.rmse_of(reference.image) == 0.0


def test_an_error_below_the_references_own_is_resolved_where_pixels_are_many():
    """False alarms on images without error are as rare as three standard errors say."""
    rng = np.random.default_rng(1)
    truth = rng.random((60, 80, 3))
    found = {0.0: 0, 0.006: 0}
    for _ in range(200):
        halves = truth + rng.normal(0, 0.02, (2, *truth.shape))
        reference = Reference(halves.astype(np.float32), "simulated")
        for error in found:
            image = truth + rng.normal(0, error, truth.shape)
            found[error] += reference.resolves(image)
    assert found[0.0] <= 2  # 0.27 expected
    assert found[0.006] > 190  # less than half of the reference's own error, 0.014


def test_an_image_from_elsewhere_is_a_reference_of_unknown_error():
    image = np.random.default_rng(0).random((6, 8, 3))
    reference = Reference.of_image(image, "another renderer")
    assert reference.error is None
    assert reference.rmse_of(image + 0.01) == pytest.approx(0.01, rel=1e-4)


def test_a_seed_that_changes_nothing_is_an_error():
    with pytest.raises(mb.UsageError, match="the seed changes nothing"):
        converged(case_of(), mb.Settings(samples=4), 1e-3)


def test_it_is_kept_and_read_back_and_refined(tmp_path, monkeypatch, caplog):
    made = converged(case_of(), NOISY, 1e-9, most=4, folder=tmp_path)
    assert "1.0e-09 was asked for" in caplog.text
    (file,) = tmp_path.iterdir()
    assert "fast_cubes-40-" in file.name
    with monkeypatch.context() as patch:
        patch.setattr(reference, "render", None)  # and would raise
        kept = converged(case_of(), NOISY, 1e-9, most=4, folder=tmp_path)
    assert np.array_equal(kept.halves, made.halves)
    assert (kept.renders, kept.seconds) == (4, made.seconds)
    finer = converged(case_of(), NOISY, 1e-9, most=8, folder=tmp_path)
    assert finer.renders == 8
    assert list(tmp_path.iterdir()) == [file]


@pytest.mark.parametrize("damage", ["cut", "other", "empty"])
def test_a_broken_file_is_made_again(tmp_path, caplog, damage):
    made = converged(case_of(), NOISY, 1e-9, most=4, folder=tmp_path)
    (file,) = tmp_path.iterdir()
    whole = file.read_bytes()
    file.write_bytes({"cut": whole[:-200], "other": b"hello", "empty": b""}[damage])
    caplog.set_level(logging.WARNING)
    again = converged(case_of(), NOISY, 1e-9, most=4, folder=tmp_path)
    assert np.array_equal(again.halves, made.halves)
    assert "it is made again" in caplog.text


def test_the_fingerprint_changes_with_all_that_matters(tmp_path, monkeypatch):
    case = case_of()
    first = fingerprint(case, NOISY)
    assert first == fingerprint(case_of(), mb.Settings(samples=2, pattern="sobol"))
    moved = case.scene.meshes[0].positions.copy()
    moved[1, 5, 2] += 1e-9
    mesh = dataclasses.replace(case.scene.meshes[0], positions=moved)
    meshes = [mesh, *case.scene.meshes[1:]]
    shutter = dataclasses.replace(case.scene.shutter, open=-0.24)
    others = [
        fingerprint(case_of(scene=dataclasses.replace(case.scene, meshes=meshes)), NOISY),
        fingerprint(case_of(scene=dataclasses.replace(case.scene, shutter=shutter)), NOISY),
        fingerprint(case_of(frame=2.0), NOISY),
        fingerprint(case_of(width=49), NOISY),
        fingerprint(case, dataclasses.replace(NOISY, seed=1)),
    ]
    from mbinterval.study import reference

    root = reference.kernel_root()
    shutil.copytree(root, tmp_path / "cl")
    kernel = next((tmp_path / "cl").rglob("*.h"))
    kernel.write_bytes(kernel.read_bytes() + b"\n")
    monkeypatch.setattr(reference, "kernel_root", lambda: tmp_path / "cl")
    others.append(fingerprint(case, NOISY))
    assert len({first, *others}) == len(others) + 1


@pytest.mark.parametrize("path", sorted(SCENES.glob("*.toml")), ids=lambda path: path.stem)
def test_every_shipped_scene_has_a_fingerprint_that_stays(path):
    prints = {fingerprint(make_case(str(path), width=8, height=8), NOISY) for _ in range(2)}
    assert len(prints) == 1
