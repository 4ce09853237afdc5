"""A device that notes what a render allocates, and estimates of the bytes that it moves."""

from __future__ import annotations

import resource
import time
from collections.abc import Container
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.device import records
from mbinterval.device.programs import Program
from mbinterval.device.runtime import DeviceArray, Runtime, seconds
from mbinterval.film.film import Film
from mbinterval.settings.settings import Settings

MEMBERS = "paths by tile"
"""Name of the buffer of path indices that tiles list, four bytes each."""

_COPY_BYTES = 1 << 27
_VECTOR_BYTES = 64
_MADE = ("vertices", "shapes", "depths", MEMBERS)
_LISTED = records.PATH.itemsize + records.SHAPE.itemsize + 6 * records.VERTEX.itemsize
_FILM_BYTES = 24


class MeteredRuntime(Runtime):
    """A ``Runtime`` that notes what a render needs; `clear` before each.

    Attributes
    ----------
    uploaded, allocated
        Bytes of every named buffer.
    building
        Seconds that programs were built in; what a cache on the disk holds takes less.
    transferring
        Seconds in which scene and film went to the device and back, without the work before it.
    """

    def __init__(self, device: Any) -> None:
        super().__init__(device)
        self.uploaded: dict[str, int] = {}
        self.allocated: dict[str, int] = {}
        self.building = self.transferring = 0.0

    def clear(self) -> None:
        """Forget the render so far."""
        self.uploaded.clear()
        self.allocated.clear()
        self.building = self.transferring = 0.0

    @cached_property
    def copied(self) -> float:
        """The device's `copy_bandwidth`, measured when it is first asked for."""
        return copy_bandwidth(self)

    def upload(self, kind: str, array: NDArray[Any], what: str = "") -> DeviceArray:
        """Upload as `Runtime.upload` does, and note the bytes."""
        self.uploaded[what] = max(self.uploaded.get(what, 0), array.nbytes)
        started = time.perf_counter()
        uploaded = super().upload(kind, array, what)
        self.transferring += time.perf_counter() - started
        return uploaded

    def download(self, array: DeviceArray, shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
        """Download as `Runtime.download` does, and note the seconds once the work is done."""
        self.finish()
        started = time.perf_counter()
        found = super().download(array, shape, dtype)
        self.transferring += time.perf_counter() - started
        return found

    def _build(self, source: str, file: str, options: tuple[str, ...]) -> Program:
        started = time.perf_counter()
        program = super()._build(source, file, options)
        self.building += time.perf_counter() - started
        return program

    def allocate(
        self, kind: str, count: int, what: str = "", active: Container[str] = ()
    ) -> DeviceArray:
        """Allocate as `Runtime.allocate` does, and note the bytes."""
        made = super().allocate(kind, count, what, active)
        self.allocated[what] = max(self.allocated.get(what, 0), made.nbytes)
        return made


def moved_bytes(meter: MeteredRuntime, film: Film, settings: Settings) -> int:
    """Bytes that the render of ``film`` read and wrote, estimated from below.

    Counted are: what was uploaded, read once; vertices, shapes and depths of paths and the tiles'
    lists of paths, written once and read once; the records of a path (path, shape, six vertices,
    and with exact paths the depth), read once for each tile that lists it; the records of an
    interval, written once and read once, for each interval met (``film.intervals``); and the film,
    written once and read once. Records of an interval are a visit, a front and a span with exact
    paths, without the front under a mask; two fragments, an interval before and one after sorting,
    and a span with triangulated ones.

    Not counted are further readings, for example of depths when intervals are compared, textures
    beyond the first reading of each texel, and lists written again because they had no room. A
    tile's lists mostly stay in cache, so that a share of the copy bandwidth above 1 is possible.
    """
    members = meter.allocated.get(MEMBERS, 0) // records.RUN["start"].itemsize
    exact = settings.paths == "exact"
    path = _LISTED + (records.DEPTH.itemsize if exact else 0)
    made = sum(meter.allocated.get(name, 0) for name in _MADE)
    lists = int(film.intervals.sum(dtype=np.int64)) * _interval_bytes(settings)
    film_bytes = _FILM_BYTES * film.intervals.size
    return sum(meter.uploaded.values()) + 2 * (made + lists + film_bytes) + members * path


def _interval_bytes(settings: Settings) -> int:
    """Bytes of the records that one interval leaves behind on its way to the film."""
    if settings.paths == "triangulated":
        kinds = [records.FRAGMENT] * 2 + [records.INTERVAL] * 2 + [records.SPAN]
    elif settings.occlusion == "exact":
        kinds = [records.VISIT, records.FRONT, records.SPAN]
    else:
        kinds = [records.VISIT, records.SPAN]
    return sum(kind.itemsize for kind in kinds)


def copy_bandwidth(runtime: Runtime, rounds: int = 20) -> float:
    """Bytes per second, read and written, of a copy of 128 MiB on the device; best of ``rounds``.

    All work-items that a render would have copy at once.
    """
    share = _COPY_BYTES // _VECTOR_BYTES // runtime.workers
    size = share * runtime.workers * _VECTOR_BYTES
    given = {
        "from": runtime.allocate("float", size // 4, "copied"),
        "to": runtime.allocate("float", size // 4, "copy"),
    }
    for array in given.values():
        runtime.fill(array)
    kernel, arguments = runtime.kernel("shared/copy.cl", "copy"), {**given, "share": share}
    took = [seconds(runtime.run(kernel, runtime.workers, arguments)) for _ in range(rounds)]
    return float(2 * size / min(took))


def clear_peak_memory() -> None:
    """Let `peak_memory` start anew, where the system can do that (Linux)."""
    try:
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    except OSError:
        return


def peak_memory() -> int:
    """Most resident bytes of this process since `clear_peak_memory`, or else since its start."""
    try:
        for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024
    except OSError:
        pass
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
