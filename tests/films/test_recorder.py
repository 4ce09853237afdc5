"""Stage "record": what spans add is the film, whatever the way, the pools and the tiles."""

from __future__ import annotations

import numpy as np
import pytest
from support.closed_forms import UNIT_CAMERA
from support.effect_scenes import mesh, plan
from support.kernels import builds_without
from support.nightly import nightly
from support.oclgrind_scenes import LENS, ROLL, SCENES, colorful, seen_through, triangles
from support.shadow_scenes import AMBIENT, CAMERA, LAMP, plate

import mbinterval as mb
from mbinterval.device import records
from mbinterval.errors import CapacityError
from mbinterval.film.aovs import RECORDED
from mbinterval.plan import buffers
from mbinterval.rendering import recorder, tiles
from mbinterval.rendering.tiles import EVENTS_FULL
from mbinterval.scene.model import Camera, Light, Scene, Shutter

SIZE = (40, 24)
LIGHTS = (Light("ambient", intensity=0.3), Light("directional", direction=(0, -1, -1)))
FLOOR = plate((0, 0, 0), 4.0)
WHOLE = {"aovs": RECORDED, "event_steps": 1}
"""Everything that is made of spans, none of them in parts."""
NO_TIMES = {"aovs": tuple(name for name in RECORDED if name != "events")}


def film(meshes, camera=UNIT_CAMERA, shutter=None, lights=LIGHTS, crop=None, **settings) -> mb.Film:
    fields = {} if shutter is None else {"shutter": shutter}
    of = Scene(meshes=meshes, camera=camera, lights=lights, **fields)
    chosen = mb.Settings(**({"samples": 2, "transparent": True, "texture_samples": 4} | settings))
    return mb.render(of, width=SIZE[0], height=SIZE[1], settings=chosen, crop=crop)


def everything(of: mb.Film) -> dict[str, bytes]:
    """Bytes of all that was made of the film's spans."""
    found = {name: pixels.tobytes() for name, pixels in of.layers.items()}
    found["deep"] = b"".join(
        values.tobytes() for values in (of.deep.counts, of.deep.z, of.deep.z_back, of.deep.rgba)
    )
    if of.events is not None:
        found["events"] = of.events.digest().encode()
    return found


WAYS = {
    "exact": (colorful, WHOLE, {}),
    "translucent": (seen_through, WHOLE, {}),
    "lens and filter": (
        colorful,
        WHOLE | {"pattern": "sobol", "filter": "gaussian"},
        {"camera": Camera(**LENS)},
    ),
    "rolling, with a curve": (seen_through, WHOLE, {"shutter": ROLL}),
    "mask": (colorful, NO_TIMES | {"occlusion": 64, "partial_bits": True}, {}),
    "triangulated": (colorful, NO_TIMES | {"paths": "triangulated"}, {}),
    "nothing moves": (lambda: [triangles(6, moving=False)], WHOLE, {}),
    "shadows": (
        lambda: [*seen_through(), FLOOR, plate((-0.6, 0.9, 0), 0.8, (1.1, 0.2, 0.3))],
        WHOLE,
        {"lights": (AMBIENT, LAMP), "camera": CAMERA},
    ),
    "shadows, nothing moves": (
        lambda: [FLOOR, plate((0, 0.9, 0), 0.8)],
        WHOLE,
        {"lights": (AMBIENT, LAMP), "camera": CAMERA},
    ),
    "empty": (list, WHOLE, {}),
}


AT_NIGHT = ("mask", "shadows, nothing moves", "triangulated", "lens and filter")


@pytest.mark.parametrize("way", [nightly(way) if way in AT_NIGHT else way for way in WAYS])
def test_what_spans_add_is_the_films_colour_and_alpha(way):
    meshes, settings, scene = WAYS[way]
    found = film(meshes(), **scene, **settings)
    assert found.rgba.any() == (way != "empty")
    deep = found.deep.flatten()
    assert np.abs(deep - found.rgba).max() < 1e-6
    for name in ("crypto_object", "crypto_material"):  # six ranks are enough for these scenes
        ids, coverage = found.layers[name][..., ::2], found.layers[name][..., 1::2]
        assert np.abs(coverage.sum(axis=2) - found.rgba[..., 3]).max() < 1e-6
        assert (np.diff(coverage, axis=2) <= 0).all()
        assert ((ids != 0) == (coverage > 0)).all()
    if "events" not in settings["aovs"]:
        return
    events = found.events
    for index, name in enumerate("rgba"):
        added = np.bincount(events.pixel, events["weight"] * events[name], SIZE[0] * SIZE[1])
        assert np.abs(added - found.rgba[..., index].ravel()).max() < 2e-6
    assert (events["t0"] >= 0).all()
    assert (events["t1"] <= 1).all()
    assert (events["t0"] < events["t1"]).all()
    same = np.diff(events.sample) == 0
    stacked = same & (np.diff(events["t0"]) == 0)
    assert (events["t0"][1:] >= events["t1"][:-1])[same & ~stacked].all()
    # Alpha of a sample is never more than 1, at any time: layers add what those before let through.
    most = np.bincount(events.sample, events["a"] * (events["t1"] - events["t0"]))
    assert (most < 1 + 1e-5).all()


@pytest.mark.parametrize("way", ["exact", nightly("rolling, with a curve")])
def test_spans_in_parts_leave_the_others_and_the_film_as_they_are(way):
    meshes, settings, scene = WAYS[way]
    plain = film(meshes(), **scene)
    whole = film(meshes(), **scene, **settings)
    parts = film(meshes(), **scene, **(settings | {"event_steps": 5}))
    for other in (whole, parts):
        for name in ("rgba", "depth", "intervals"):
            assert getattr(other, name).tobytes() == getattr(plain, name).tobytes()
    one, five = everything(whole), everything(parts)
    assert one.pop("events") != five.pop("events")
    assert one == five
    assert len(parts.events) > len(whole.events)
    if way == "exact":  # where something is clear for a part, that is no event
        seen = [np.bincount(e.sample, e["t1"] - e["t0"]) for e in (whole.events, parts.events)]
        assert np.abs(seen[0] - seen[1]).max() < 1e-5


@pytest.mark.parametrize("size", [8, nightly(32)])
def test_two_films_and_tiles_of_any_size_give_the_same(size):
    want = everything(film(seen_through(), **WHOLE))
    assert everything(film(seen_through(), **WHOLE)) == want
    assert everything(film(seen_through(), **WHOLE, tile_size=size)) == want


def test_pools_and_crops_of_any_size_give_the_same(monkeypatch):
    want = film(seen_through(), **WHOLE)
    grown = []
    real = recorder.Recorder.make_room
    monkeypatch.setattr(buffers, "_MOST_EVENTS", 64)
    monkeypatch.setattr(buffers, "LEAST_EVENTS", 64)

    def noting(self, some_fitted, alone):
        grown.append(some_fitted)
        return real(self, some_fitted, alone)

    monkeypatch.setattr(recorder.Recorder, "make_room", noting)
    assert everything(film(seen_through(), **WHOLE)) == everything(want)
    assert False in grown  # it grew
    assert True in grown  # and tiles were done again in what it was
    part = film(seen_through(), **WHOLE, crop=(7, 3, 20, 13))
    for name, pixels in part.layers.items():
        assert np.array_equal(pixels, want.layers[name][3:16, 7:27])
    assert np.array_equal(part.deep.counts, want.deep.counts[3:16, 7:27])
    inside = np.zeros(want.events.shape, bool)
    inside[3:16, 7:27] = True
    inside = inside.ravel()[want.events.sample]
    for name, values in part.events.columns.items():
        assert np.array_equal(values, want.events[name][inside]), name


def test_a_pool_that_cannot_grow_is_used_again_and_a_tile_that_has_no_room_is_refused(monkeypatch):
    most = len(film(seen_through(), **WHOLE).events)  # of all tiles together; one has less
    want = film(seen_through(), **NO_TIMES)
    monkeypatch.setattr(recorder, "memory_room", lambda work, besides=(): 0)
    monkeypatch.setattr(buffers, "LEAST_EVENTS", most // 2)
    monkeypatch.setattr(buffers, "_MOST_EVENTS", most // 2)
    assert everything(film(seen_through(), **NO_TIMES)) == everything(want)
    monkeypatch.setattr(buffers, "LEAST_EVENTS", 16)
    monkeypatch.setattr(buffers, "_MOST_EVENTS", 16)
    with pytest.raises(
        CapacityError, match=r"spans of a tile .* crypto_object, .* smaller tile_size"
    ):
        film(seen_through(), **NO_TIMES)


def test_tiles_that_keep_each_other_from_a_pool_that_cannot_grow_are_rendered_alone(monkeypatch):
    most = len(film(seen_through(), **WHOLE).events)
    want = film(seen_through(), **NO_TIMES)
    allocate, drain, at_once = tiles._allocate_pools, recorder.Recorder.drain, []

    def noting(work, capacity, workers):
        at_once.append(workers)
        allocate(work, capacity, workers)

    def starved(self, of):  # as if no tile that is rendered with others had found room
        if at_once[-1] > 1:
            work = self._work
            work.runtime.fill(work.arrays["failed"], EVENTS_FULL)
        return drain(self, of)

    monkeypatch.setattr(tiles, "_allocate_pools", noting)
    monkeypatch.setattr(recorder.Recorder, "drain", starved)
    monkeypatch.setattr(recorder, "memory_room", lambda work, besides=(): 0)
    monkeypatch.setattr(buffers, "LEAST_EVENTS", most)
    monkeypatch.setattr(buffers, "_MOST_EVENTS", most)
    assert everything(film(seen_through(), **NO_TIMES)) == everything(want)
    assert at_once[-1] == 1


def test_events_beyond_the_memory_that_is_allowed_are_refused_with_what_they_take():
    from mbinterval.film.events import EventTable

    half, more = (np.zeros(1000, records.EVENT) for _ in range(2))
    for index, part in enumerate((half, more)):
        part["color"] = 1.0
        part["pixel"], part["sample"] = np.arange(1000), index
    table = EventTable(np.ones(1, np.uint32), np.zeros(1, np.uint32), 2, (10, 100), 2 * 1500 * 52)
    table.take(half)
    with pytest.raises(CapacityError, match=r"events take more than .* 75% of the samples, so "):
        table.take(more[:501])


def test_what_is_not_asked_for_leaves_no_code_no_buffer_and_no_stage():
    names = ("record_spans", "EVENT_WHOLE", "reserve_events", "atomic_min")
    none, asked = plan(mesh()), plan(mesh(), aovs="crypto_object")
    assert builds_without(none, names, "shared/records.h")
    assert not builds_without(asked, names[:1], "shared/records.h")
    assert not [o for o in none.options if "EVENT" in o or "RECORD" in o]
    assert "record" not in none.stages
    assert asked.stages == (*none.stages[:-1], "record", "resolve")
    effect = {e.name: e for e in plan(mesh(), aovs="deep,uv").effects}["visible spans kept"]
    assert (effect.active, effect.reason) == (True, "deep")
    events = plan(mesh(), aovs="events", event_steps=7)
    assert "-DMB_EVENT_STEPS" in events.options
    assert dict(events.numbers)["event_steps"] == 7
    assert set(asked.options) - set(none.options) == {"-DMB_RECORDED"}


def test_oclgrind_sees_the_stage():
    """Its scenes are the ones that a checker of memory and races runs."""
    asked = [mb.Settings(**small.settings).aovs for small in SCENES.values()]
    assert sum(bool(set(RECORDED) & set(aovs)) for aovs in asked) > 2


def test_other_threads_do_not_matter_to_what_is_sorted():
    """The order in which tiles leave their events is taken out again."""
    rng = np.random.default_rng(3)
    events = np.zeros(600, records.EVENT)
    events["pixel"], events["sample"] = (
        np.repeat(np.arange(100), 6),
        np.tile([0, 0, 0, 1, 1, 1], 100),
    )
    events["path"], events["weight"] = rng.integers(0, 5, 600), rng.random(600)
    events["t0"] = np.tile([0, 0.25, 0.5], 200)
    events["t1"] = events["t0"] + 0.25
    events["z0"] = events["z1"] = rng.uniform(1, 2, 600)
    events["color"] = rng.random((600, 4)) / 6
    by_tile = np.split(events, np.arange(60, 600, 60))

    def made(order) -> list[bytes]:
        ids = np.array([9, 2, 7, 2, 5], np.uint32)
        takers = (
            recorder.Ranks(ids, 6, (10, 10)),
            recorder.Slices(0.05, (10, 10)),
            recorder.EventTable(ids, ids, 2, (10, 10), 10**9),
        )
        for taker in takers:
            taker.take(np.concatenate([by_tile[i] for i in order[:4]]))
            taker.take(np.concatenate([by_tile[i] for i in order[4:]]))
        ranks, deep, table = (taker.result() for taker in takers)
        return [ranks.tobytes(), deep.z.tobytes(), deep.rgba.tobytes(), table.digest().encode()]

    want = made(np.arange(10))
    assert made(rng.permutation(10)) == want
    assert made(np.arange(10)[::-1]) == want


def test_no_light_is_counted_twice_where_a_shutter_has_a_curve():
    shutter = Shutter(curve=(0.0, 1.0, 3.0, 0.5))
    found = film(colorful(), shutter=shutter, aovs="events")
    events = found.events
    weight = np.bincount(events.pixel, events["weight"], SIZE[0] * SIZE[1])
    assert np.abs(weight.reshape(SIZE[::-1]) - found.rgba[..., 3]).max() < 1e-5
    assert not np.allclose(events["weight"], events["share"] * (events["t1"] - events["t0"]), 0.1)
