"""Nothing is ever lost: a full pool is noticed, and the tile done again in halves or with more."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
import pytest
from support.busy_scenes import SIZE, WAYS, busy_scene
from support.closed_forms import UNIT_CAMERA
from support.kernels import render_with
from support.nightly import nightly_but
from support.plane_stacks import COUNT, stack

import mbinterval as mb
from mbinterval.device import records
from mbinterval.device.runtime import Runtime, runtime
from mbinterval.errors import CapacityError
from mbinterval.exposure import exposure as scene_exposure
from mbinterval.exposure import mesh_exposure
from mbinterval.scene.model import Mesh, Scene

WAYS = WAYS | {"triangulated, exact": {"paths": "triangulated", "occlusion": "exact"}}


@pytest.mark.parametrize("way", nightly_but(WAYS, "exact", "triangulated"))
def test_pools_of_any_size_give_the_same_bytes(way, caplog):
    caplog.set_level(logging.INFO, logger="mbinterval")
    settings = mb.Settings(samples=3, **WAYS[way])
    large = render_with(busy_scene(), settings, *SIZE)
    assert not any("need larger pools" in record.message for record in caplog.records)
    caplog.clear()
    grown = []
    for capacity in (1, 16, 300, 2000):
        small = render_with(busy_scene(), settings, *SIZE, capacity=capacity)
        for name in ("rgba", "depth", "intervals"):
            assert np.array_equal(getattr(small, name), getattr(large, name)), (capacity, name)
        grown.append(sum("need larger pools" in record.message for record in caplog.records))
        caplog.clear()
    assert large.intervals.max() > 20
    # The smallest need the host's help, several times; of 2,000 records a tile's pieces suffice.
    assert grown[0] > grown[1] > grown[3] == 0


def stacked_film(way: str, **settings: object) -> mb.Film:
    return mb.render(
        stack()[0], width=9, height=3, crop=(4, 1, 1, 1),
        settings=mb.Settings(samples=1, **WAYS[way], **settings),
    )  # fmt: skip


@pytest.mark.parametrize("way", WAYS)
def test_thousands_of_intervals_on_one_pixel_all_count(way):
    """Each of 3,000 is seen for its own 3,000th of the shutter, before the next one hides it."""
    _, color, arrival = stack()
    film = stacked_film(way)
    assert film.intervals.tolist() == [[COUNT]]
    if WAYS[way]["occlusion"] == "exact":
        want, limit = color.sum(axis=0) / COUNT - 0.5 / COUNT * color[0], 1e-5
    else:
        bits = WAYS[way]["occlusion"]
        centre = (np.arange(bits) + 0.5) / bits
        seen = np.argmax(arrival[:, None] <= centre, axis=0)
        want, limit = color[seen].mean(axis=0), 1e-4
    assert film.rgba[0, 0, :3] == pytest.approx(want, abs=limit)
    assert film.rgba[0, 0, 3] == pytest.approx(1.0, abs=1e-3)
    # One that is lost would show: those before it would be seen for longer.
    assert np.abs(want - np.roll(color, 1)[: COUNT // 2].mean(axis=0)).max() > 1e-3


def test_the_published_limit_of_90_intervals_loses_what_lies_behind_them():
    """Hong & Oh (2017) keep the nearest 90: these are here the last 90 that arrive."""
    full, limited = stacked_film("triangulated"), stacked_film("triangulated", max_intervals=90)
    assert limited.intervals.tolist() == [[COUNT]]  # what was met
    kept = np.mean((np.arange(128) + 0.5) / 128 >= 1 - 90 / COUNT)
    assert full.rgba[0, 0, 3] == pytest.approx(1.0, abs=1e-3)
    assert limited.rgba[0, 0, 3] == pytest.approx(kept, abs=1.5 / 128)
    enough = stacked_film("triangulated", max_intervals=COUNT)
    assert np.array_equal(enough.rgba, full.rgba)


class SmallDevice:
    """A device that says it has less memory than it has."""

    def __init__(self, device: Any, largest: int, total: int) -> None:
        self.device, self.max_mem_alloc_size, self.global_mem_size = device, largest, total

    def __getattr__(self, name: str) -> Any:
        return getattr(self.device, name)


def with_memory(monkeypatch: pytest.MonkeyPatch, largest: int, total: int) -> Runtime:
    device = runtime()
    monkeypatch.setattr(device, "device", SmallDevice(device.device, largest, total))
    return device


@pytest.mark.parametrize("way", WAYS)
def test_pools_that_the_device_cannot_hold_are_a_capacity_error(way, monkeypatch):
    scene, _, _ = stack()
    settings = mb.Settings(samples=1, **WAYS[way])
    crop = (4, 1, 1, 1)
    want = render_with(scene, settings, 9, 3, crop=crop, capacity=64)
    with monkeypatch.context() as patch:
        with_memory(patch, 2**20, 2**17)
        with pytest.raises(CapacityError, match=r"holds more than \d+ .*tile_size"):
            render_with(scene, settings, 9, 3, crop=crop, capacity=64)
    again = render_with(scene, settings, 9, 3, crop=crop, capacity=64)
    assert np.array_equal(want.rgba, again.rgba)


def test_fewer_work_items_are_used_where_the_pools_of_all_do_not_fit(monkeypatch):
    settings = mb.Settings(samples=2, **WAYS["triangulated"])
    want = render_with(busy_scene(), settings, *SIZE)
    asked: list[int] = []
    run = Runtime.run

    def noting(self: Runtime, kernel: Any, items: int, *arguments: Any) -> Any:
        asked.append(items)
        return run(self, kernel, items, *arguments)

    monkeypatch.setattr(Runtime, "run", noting)
    with_memory(monkeypatch, 2**22, 3 * 2**17)
    got = render_with(busy_scene(), settings, *SIZE, capacity=64)
    assert asked[-1] == 1
    assert np.array_equal(want.rgba, got.rgba)


def test_a_film_that_the_device_cannot_hold_is_a_capacity_error(monkeypatch):
    with_memory(monkeypatch, 2**20, 2**30)
    with pytest.raises(CapacityError, match=r"MiB.*crops"):
        mb.render(busy_scene(), width=2000, height=2000, settings=mb.Settings(samples=1))


def test_capacity_errors_have_an_exit_code_of_their_own():
    assert CapacityError.exit_code == 5


def big(name: str, times: int = 1, count: int = 100_000, **fields: Any) -> Mesh:
    """A mesh that claims ``count`` faces over 100 vertices."""
    faces = np.broadcast_to(np.array([[0, 1, 2]], np.int32), (count, 3))
    positions = np.random.default_rng(0).uniform(-1, 1, (times, 100, 3))
    return Mesh(positions=positions, faces=faces, shading="unlit", name=name, **fields)


def test_a_mesh_beyond_32_bits_is_refused_by_name_before_its_arrays_are_built(monkeypatch):
    monkeypatch.setattr(mesh_exposure, "_at_times", None)  # no array is touched
    scene = Scene(meshes=[big("swarm", 2, motion_segments=4096)], camera=UNIT_CAMERA)
    with pytest.raises(CapacityError, match=r"mesh 'swarm': 100 vertices and 100000 faces at 4097"):
        mb.render(scene, width=8, height=8)


def test_what_stands_still_has_no_segments_to_refuse():
    """4,096 motion segments are too many only for what moves."""
    mesh = big("rock", motion_segments=4096)
    exposure = scene_exposure.expose(Scene(meshes=[mesh], camera=UNIT_CAMERA), 1, 1.0)
    assert exposure.meshes[0].segments == 0


def test_a_scene_beyond_32_bits_names_its_largest_mesh(monkeypatch):
    monkeypatch.setattr(records, "MOST_PATHS", 4500)
    swarm = big("swarm", 2, 1000, motion_segments=2)
    parts = [big("dust", 1, 1000), swarm, big("rock", 2, 1000)]
    mb.render(Scene(meshes=parts, camera=UNIT_CAMERA), width=8, height=8)  # just fits
    crowd = Scene(meshes=[*parts, big("more", 1, 1000)], camera=UNIT_CAMERA)
    expected = r"5000 motion paths and 700 vertices, 2000 and 300 of them of mesh 'swarm'"
    with pytest.raises(CapacityError, match=expected):
        mb.render(crowd, width=8, height=8)
