"""Stage "record" on the host: visible spans come back from the device, and go to who takes them.

After each part of the tiles the device's pool of events is emptied, so that it never holds more
than a part's. Tiles that found it full are done again; what they left is dropped, so that every
span is taken once. Those of a pixel come in one go, and of each sample in order of time and, at
one time, from front to back; so what is made of them is the same whatever the order of tiles.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from mbinterval.device import records
from mbinterval.errors import CapacityError
from mbinterval.film.aovs import RECORDED
from mbinterval.film.cryptomatte import Ranks
from mbinterval.film.deep import Slices
from mbinterval.film.events import EventTable
from mbinterval.layout.motion import Motion
from mbinterval.plan import buffers
from mbinterval.plan.buffers import tile_grid
from mbinterval.plan.plan import Plan
from mbinterval.rendering.shared_steps import SECONDS_AT_A_TIME, Work, memory_room

DONE, POOLS_FULL, EVENTS_FULL = range(3)
"""What became of a tile (``cl/analytic/tile.cl``)."""

_GROWTH = 4
_FULL = 0.7  # part of the pool that is to be used


class Collector(Protocol):
    """Makes something of visible spans, in ``parts`` where these have colours of their own."""

    parts: bool

    def take(self, events: NDArray[np.void]) -> None:
        """Take all ``events`` (``records.EVENT``) of some pixels."""

    def result(self) -> Any:
        """Return what was made of them, once all are taken."""


def collectors_of(work: Work, motion: Motion) -> dict[str, Collector]:
    """Return what the plan's settings ask for, by name."""
    plan = work.plan
    settings, shape = plan.settings, (plan.crop[3], plan.crop[2])
    found: dict[str, Collector] = {}
    for name in settings.aovs:
        if name == "deep":
            found[name] = Slices(settings.deep_tolerance, shape)
        elif name == "events":
            objects = motion.objects[motion.paths["mesh"] + np.uint32(1)]
            table = objects, np.ascontiguousarray(motion.paths["face"])
            found[name] = EventTable(*table, settings.samples, shape, memory_room(work))
        elif name in RECORDED:
            ids = motion.hashes[name][motion.paths["mesh"]]
            found[name] = Ranks(ids, settings.cryptomatte_levels, shape)
    return found


class Recorder:
    """The device's pool of events, and the ``collectors`` that take them."""

    def __init__(self, work: Work, collectors: tuple[Collector, ...]) -> None:
        self._work, self._collectors = work, collectors
        self.capacity = buffers.first_events(work.plan)

    def allocate(self) -> None:
        """Make the pool; a smaller one where memory is short."""
        room = memory_room(self._work) // 4
        least, size = buffers.LEAST_EVENTS, records.EVENT.itemsize
        while self.capacity > least and self.capacity * size > room:
            self.capacity //= 2
        self._allocate_pool()
        for name in ("event_count", "event_end"):
            self._work.allocate("uint", name, 1)

    def _allocate_pool(self) -> None:
        self._work.allocate("Event", "events", self.capacity, "pool of events")

    def empty(self) -> None:
        """Empty the pool."""
        self._work.runtime.fill(self._work.arrays["event_count"])
        self._work.runtime.fill(self._work.arrays["event_end"], self.capacity)

    def drain(self, tiles: NDArray[np.uint32]) -> float:
        """Hand on the events of ``tiles`` that are done.

        Returns how long these would have taken if time were what limits how many tiles are
        rendered in one go, so that the pool gets nearly full and seldom more than that.
        """
        arrays, runtime = self._work.arrays, self._work.runtime
        pair = (arrays[name] for name in ("event_count", "event_end"))
        asked, count = (int(runtime.download(buffer, (1,), np.uint32)[0]) for buffer in pair)
        full, count = asked / (_FULL * self.capacity), min(asked, count)
        if not count:
            return 0.0
        events = runtime.download(arrays["events"], (count,), records.EVENT)
        _, _, columns, rows = tile_grid(self._work.plan)
        failed = runtime.download(arrays["failed"], (columns * rows,), np.uint32)
        if failed[tiles].any():
            events = events[failed[self._tile_of(events["pixel"])] == DONE]
        for collector in self._collectors:
            collector.take(_chosen(events, collector.parts))
        return full * SECONDS_AT_A_TIME

    def _tile_of(self, pixel: NDArray[np.uint32]) -> NDArray[np.int64]:
        plan = self._work.plan
        left, top, columns, _ = tile_grid(plan)
        y, x = np.divmod(pixel.astype(np.int64), plan.region[2])
        column = (x + plan.region[0] - left) // plan.tile
        return np.asarray((y + plan.region[1] - top) // plan.tile * columns + column)

    def make_room(self, some_fitted: bool, alone: bool) -> bool:
        """Prepare for tiles that found the pool full: where no tile fitted it grows.

        Returns False where there is no memory for that, and tiles must be rendered ``alone``:
        several at once can keep each other from fitting.
        """
        if some_fitted:
            return True
        size = _GROWTH * self.capacity * records.EVENT.itemsize
        room = memory_room(self._work, besides=("events",)) // 2
        if size > min(room, self._work.runtime.device.max_mem_alloc_size):
            if not alone:
                return False
            raise CapacityError(
                f"the visible spans of a tile take more than {size // _GROWTH / 2**20:.1f} MiB, "
                f"which the {', '.join(_asked(self._work.plan))} asked for are made of, and there "
                "is no memory for more: allow more, or use a smaller tile_size or fewer samples"
            )
        self.capacity *= _GROWTH
        self._allocate_pool()
        return True


def _chosen(events: NDArray[np.void], parts: bool) -> NDArray[np.void]:
    """Whole spans, or the parts of those that have parts."""
    both = np.uint32(records.EVENT_WHOLE | records.EVENT_PART)
    if not (events["sample"] & both).any():
        return events
    other = np.uint32(records.EVENT_WHOLE if parts else records.EVENT_PART)
    chosen: NDArray[np.void] = events[(events["sample"] & other) == 0]
    chosen["sample"] &= ~both
    return chosen


def _asked(plan: Plan) -> list[str]:
    return [name for name in plan.settings.aovs if name in RECORDED]
