"""Images of the twin against closed forms of motion blur."""

from __future__ import annotations

import numpy as np
import pytest
from support.closed_forms import (
    UNIT_CAMERA,
    overlap,
    pivoting,
    rectangle,
    scene,
    slab,
    slab_pixel_coverage,
    slab_times,
    world,
)

from mbinterval.exposure.exposure import Exposure, expose
from mbinterval.scene.model import Camera, Mesh, Scene
from mbinterval.scene.tracks import Track
from reference.paths import paths_of
from reference.render import render

SIZE = (32, 16)


def exposed(meshes: list[Mesh], background: tuple[float, ...] = (0.0, 0.0, 0.0)) -> Exposure:
    return expose(scene(meshes, background), 0, SIZE[0] / SIZE[1])


def slab_image(speed: tuple[float, float], start=(3.25, 9.25), **options) -> np.ndarray:
    mesh = slab(rectangle(*start, -1, 17), speed, 2.0, SIZE)
    return render(exposed([mesh]), *SIZE, **options).rgba[8, :, 3]


@pytest.mark.parametrize("speed", [13.0, -13.0, 0.7, 200.0])
@pytest.mark.parametrize("paths", ["triangulated", "exact"])
def test_a_sliding_slab_covers_each_sample_for_its_closed_form_time(speed, paths):
    x = np.arange(32) + 0.5
    t0, t1 = slab_times(x, 3.25, 9.25, speed)
    assert slab_image((speed, 0), bits=None, paths=paths) == pytest.approx(t1 - t0, abs=1e-9)
    t0, t1 = slab_times(x, 3.25 + 0.01 * speed, 9.25 + 0.01 * speed, speed)
    assert np.abs(slab_image((speed, 0), bits=None) - (t1 - t0)).max() > 5e-3


@pytest.mark.parametrize("bits", [32, 128])
def test_a_mask_counts_the_bit_centres_within_the_closed_form_time(bits):
    t0, t1 = slab_times(np.arange(32) + 0.5, 3.25, 9.25, 13.0)
    centres = (np.arange(bits) + 0.5)[:, None] / bits
    want = ((t0 <= centres) & (centres < t1)).mean(axis=0)
    assert slab_image((13.0, 0), bits=bits) == pytest.approx(want, abs=1e-12)


def test_many_samples_converge_to_the_closed_form_over_the_pixel():
    offsets = np.stack([(np.arange(64) + 0.5) / 64, np.full(64, 0.5)], axis=1)
    want = slab_pixel_coverage(np.arange(32), 3.25, 9.25, 13.0)
    got = slab_image((13.0, 0), bits=None, offsets=offsets)
    assert got == pytest.approx(want, abs=2e-5)
    shifted = slab_pixel_coverage(np.arange(32), 3.25 + 0.13, 9.25 + 0.13, 13.0)
    assert np.abs(got - shifted).max() > 5e-3


@pytest.mark.parametrize("segments", [1, 3])
def test_two_slabs_in_opposite_directions_hide_each_other_exactly(segments):
    front = slab(rectangle(2.25, 8.25, -1, 17), (17, 0), 2.0, SIZE, (1, 0, 0), segments)
    back = slab(rectangle(20.25, 28.25, -1, 17), (-19, 0), 3.0, SIZE, (0, 1, 0))
    image = render(exposed([back, front], (0, 0, 0.5)), *SIZE, bits=None).rgba[3]
    x = np.arange(32) + 0.5
    a, b = slab_times(x, 2.25, 8.25, 17), slab_times(x, 20.25, 28.25, -19)
    red, green = a[1] - a[0], b[1] - b[0] - overlap(a, b)
    assert image[:, 0] == pytest.approx(red, abs=1e-9)
    assert image[:, 1] == pytest.approx(green, abs=1e-9)
    assert image[:, 2] == pytest.approx(0.5 * (1 - red - green), abs=1e-9)
    assert np.any(overlap(a, b) > 0.1)


def test_a_slab_behind_a_slit_is_seen_through_the_slit_only():
    moving = slab(rectangle(2.25, 8.25, -1, 17), (17, 0), 3.0, SIZE, (0, 1, 0))
    walls = [
        slab(rectangle(*ends, -1, 17), (0, 0), 2.0, SIZE, (0.25, 0.25, 0.25))
        for ends in ((-1, 10), (14, 33))
    ]
    image = render(exposed([moving, *walls]), *SIZE, bits=None).rgba[5]
    x = np.arange(32) + 0.5
    t0, t1 = slab_times(x, 2.25, 8.25, 17)
    open_ = (x > 10) & (x < 14)
    assert image[:, 1] == pytest.approx(np.where(open_, t1 - t0, 0.25), abs=1e-9)
    assert image[:, 3] == pytest.approx(np.where(open_, t1 - t0, 1.0), abs=1e-9)


def test_exact_paths_meet_the_closed_form_of_a_pivoting_edge():
    turning, time = pivoting(SIZE)
    covered = np.clip(time, 0, 1)
    assert np.count_nonzero((time > 0.01) & (time < 0.99)) > 100
    frozen = expose(turning, 0, 2.0)
    image = render(frozen, *SIZE, bits=None, paths="exact")
    assert image.rgba[..., 3] == pytest.approx(covered, abs=1e-9)
    assert np.abs(image.rgba[..., 3] - np.clip(time + 0.01, 0, 1)).max() > 5e-3
    ours = render(frozen, *SIZE, bits=None).rgba[..., 3]
    error = np.abs(ours - covered)[(time > 0) & (time < 1)]
    assert 0.005 < error.mean() < 0.2
    assert error.max() <= 0.5


def test_motion_segments_join_without_gap_or_overlap():
    single = slab_image((13.0, 0), bits=None)
    mesh = slab(rectangle(3.25, 9.25, -1, 17), (13, 0), 2.0, SIZE, segments=5)
    many = render(exposed([mesh]), *SIZE, bits=None).rgba[8, :, 3]
    assert many == pytest.approx(single, abs=1e-9)


def test_a_moving_camera_moves_what_rests():
    rest = slab(rectangle(8, 20, -1, 17), (0, 0), 2.0, SIZE)
    moved = world(np.array([[0.0, 0], [6.0, 0]]), 2.0, SIZE)
    shift = moved[1] - moved[0]
    camera = Camera(
        position=Track([-0.25, 0.25], [[0.0, 0, 0], -shift]), focal_length=UNIT_CAMERA.focal_length
    )
    frozen = expose(Scene(meshes=[rest], camera=camera), 0, 2.0)
    assert paths_of(frozen, *SIZE).segments.tolist() == [1, 1]
    image = render(frozen, *SIZE, bits=None).rgba[8, :, 3]
    t0, t1 = slab_times(np.arange(32) + 0.5, 8, 20, 6.0)
    assert image == pytest.approx(t1 - t0, abs=1e-9)
