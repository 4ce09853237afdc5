"""What every method does on the device.

The scene goes up, vertices are transformed, paths are listed by tile, tiles are rendered from a
queue a part at a time, and pixels come back.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.device import records
from mbinterval.device.runtime import DeviceArray, Runtime, seconds
from mbinterval.errors import CapacityError
from mbinterval.exposure.exposure import Exposure
from mbinterval.layout.appearance import appearance, casting, fit_background
from mbinterval.layout.motion import Motion
from mbinterval.plan.buffers import film_bytes, tile_grid
from mbinterval.plan.plan import Crop, Plan, shutter_keys
from mbinterval.plan.prepare import Prepared
from mbinterval.plan.sampling import filter_of, slots_of

if TYPE_CHECKING:
    from mbinterval.exposure.mirrors import Mirror
    from mbinterval.film.deep import DeepImage
    from mbinterval.film.events import Events

_PLACES = {"maps": "CubeMap", "map_texels": "float4", "sky": "Sky"} | dict.fromkeys(
    ("forward", "backward"), "double"
)
"""Kinds of what `Motion` has in ``places``."""

_BIN_CHUNKS = 64
PATHS_PER_ITEM = 256
"""Paths that a work-item of "paths" or "bounds" is for, as the kernels have it."""
SECONDS_AT_A_TIME = 0.5
_FIRST_LOAD = 100_000  # paths of tiles times samples: a fifth of a second, more or less


@dataclass(frozen=True, eq=False)
class Pixels:
    """What the kernels leave behind: arrays of the film's size, seconds by stage, and counts."""

    rgba: NDArray[np.float32]
    depth: NDArray[np.float32]
    intervals: NDArray[np.uint32]
    timings: Mapping[str, float]
    stats: Mapping[str, int]
    layers: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    deep: DeepImage | None = None
    events: Events | None = None


@dataclass(eq=False)
class Work:
    """A frame in work: the plan, and on the device what kernels take by the names they give it.

    Attributes
    ----------
    arrays
        Arrays on the device by name.
    numbers
        Fields of the record ``Numbers``, but for the plan's.
    timings
        Seconds by stage so far.
    """

    runtime: Runtime
    plan: Plan
    exposure: Exposure
    arrays: dict[str, DeviceArray] = field(default_factory=dict)
    numbers: dict[str, int] = field(default_factory=dict)
    timings: dict[str, float] = field(default_factory=dict)

    def upload(self, kind: str, name: str, array: NDArray[Any]) -> None:
        """Give the device an array to read."""
        self.arrays[name] = self.runtime.upload(kind, array, name)

    def allocate(self, kind: str, name: str, count: int, what: str = "") -> None:
        """Make an array of ``count`` elements on the device; what had the name before goes."""
        self.arrays.pop(name, None)
        self.arrays[name] = self.runtime.allocate(kind, count, what or name, self.plan.active)

    def run(self, file: str, name: str, options: Sequence[str], items: int, **more: Any) -> Any:
        """Run a kernel on the arrays and numbers that are here, and ``more``; returns its event."""
        kernel = self.runtime.kernel(file, name, options)
        return self.runtime.run(kernel, items, {**self.arrays, "numbers": self.record(), **more})

    def record(self) -> NDArray[np.void]:
        """Return what the kernels are told in numbers."""
        fields = dict.fromkeys(records.NUMBERS.names or (), 0)
        return records.pack("Numbers", **(fields | dict(self.plan.numbers) | self.numbers))


def start_work(runtime: Runtime, ready: Prepared) -> Work:
    """Give the device everything that the kernels read of a scene."""
    exposure, motion, plan = ready.exposure, ready.motion, ready.plan
    work = Work(runtime, plan, exposure)
    shape = filter_of(plan.settings)
    # Lights are placed relative to the eye, so that they are as exact far from the origin.
    casters = casting(exposure, plan.settings) if shadow_count(plan) else ()
    eye = exposure.cameras[0].eye[0]
    mirrored = [mirror.light(light) for mirror in exposure.mirrors for light in exposure.lights]
    looks = appearance(motion.materials, (*exposure.lights, *mirrored), eye, casters)
    own = looks.lights["shadow"][: len(exposure.lights)]
    looks.lights["shadow"] = np.tile(own, 1 + len(exposure.mirrors))
    background = np.zeros(0, np.float32)
    if "BACKGROUND_IMAGE" in plan.active:
        x, y, width, height = plan.region
        image = fit_background(np.asarray(exposure.background), plan.width, plan.height)
        # The region may reach out of the frame by a pixel.
        rows = np.clip(np.arange(y, y + height), 0, plan.height - 1)
        columns = np.clip(np.arange(x, x + width), 0, plan.width - 1)
        background = np.ascontiguousarray(image[rows[:, None], columns])
    table = np.zeros(0) if shape is None else shape.table
    work.upload("double", "positions", motion.positions)
    work.upload("VertexJob", "jobs", motion.jobs)
    work.upload("Camera", "cameras", motion.cameras)
    work.upload("Path", "paths", motion.paths)
    work.upload("Mesh", "meshes", motion.meshes)
    work.upload("float", "vertex_colors", motion.color)
    work.upload("double" if motion.uv.dtype == np.float64 else "float", "uvs", motion.uv)
    work.upload("float", "normals", motion.normal)
    work.upload("Material", "materials", looks.materials)
    work.upload("Texture", "textures", looks.textures)
    work.upload("float4", "texels", looks.texels)
    work.upload("Light", "lights", looks.lights)
    work.upload("Slot", "slots", slots_of(plan.settings))
    work.upload("float", "filter", table.astype(np.float32))
    work.upload("ShutterKey", "shutter", shutter_keys(exposure.shutter))
    work.upload("float", "background", background)
    work.upload("MirrorPlane", "mirror_planes", mirror_planes(exposure.mirrors))
    for name, kind in _PLACES.items():
        if name in motion.places:
            work.upload(kind, name, motion.places[name])
    work.numbers = {
        "light_count": len(exposure.lights),
        "static_paths": motion.static_paths,
        "path_count": len(motion.paths),
        "sky_count": len(motion.places.get("sky", ())),
    }
    return work


def mirror_planes(mirrors: tuple[Mirror, ...]) -> NDArray[np.void]:
    """Return ``MirrorPlane`` records, in the order of the worlds that are seen in them."""
    table = np.zeros(len(mirrors), records.MIRROR_PLANE)
    for row, mirror in zip(table, mirrors, strict=True):
        row["normal"], row["tangents"] = mirror.normal, mirror.tangents.reshape(6)
    return table


def shadow_count(plan: Plan) -> int:
    """Return how many lights cast shadows in the plan."""
    return int(plan.size("SHADOW_LIGHTS"))


def transform_vertices(work: Work, motion: Motion) -> float:
    """Make ``vertices``, in homogeneous pixel space at the ends of each segment; in seconds."""
    work.allocate("Vertex", "vertices", motion.vertex_count)
    if not len(motion.jobs):
        return 0.0
    options = work.plan.flags("LENS")
    return seconds(work.run("shared/vertices.cl", "vertices", options, len(motion.jobs)))


def list_grid(
    tiles: tuple[int, int, int, int],
    size: int,
    paths: int,
    chunk: int,
    reach: tuple[float, float, float, float],
) -> NDArray[np.void]:
    """Return the ``ListGrid`` of ``tiles``: first pixel, columns and rows, ``size`` pixels each."""
    return records.pack(
        "ListGrid",
        **dict(zip(("x", "y", "columns", "rows"), tiles, strict=True)),
        **dict(zip(("x_low", "x_high", "y_low", "y_high"), reach, strict=True)),
        **{"size": size, "paths": paths, "chunk": chunk},
    )


class Lists:
    """Paths by tile of a grid: counted at first, and filed when they are asked for.

    The kernels of ``file`` take what is ``given``, of ``count`` paths, and a ``ListGrid``: first
    pixel, columns and rows of ``tiles``, ``size`` pixels along an edge. ``starts`` has where each
    tile's paths begin, and where all end; `records.NONE` if they are 2**32 or more. ``places`` is
    that on the device.
    """

    def __init__(
        self,
        runtime: Runtime,
        file: str,
        options: Sequence[str],
        given: Mapping[str, Any],
        count: int,
        tiles: tuple[int, int, int, int],
        size: int,
        reach: tuple[float, float, float, float],
    ) -> None:
        chunk = max(1, -(-count // _BIN_CHUNKS))
        self._runtime, self._file, self._options = runtime, file, tuple(options)
        self._chunks, number = -(-count // chunk), tiles[2] * tiles[3]
        grid = list_grid(tiles, size, count, chunk, reach)
        self.places = runtime.allocate("uint", number + 1, "starts")
        counts = runtime.allocate("uint", self._chunks * number, "counts of paths by tile")
        self._given = {**given, "grid": grid, "counts": counts, "starts": self.places}
        self._events = []
        if self._chunks:
            kernel = runtime.kernel(file, "bin_count", self._options)
            self._events.append(runtime.run(kernel, self._chunks, self._given))
        scan = runtime.kernel("shared/scan.cl", "bin_scan")
        sizes = {"tiles": number, "chunks": self._chunks}
        self._events.append(runtime.run(scan, 1, {**self._given, **sizes}))
        self.starts = runtime.download(self.places, (number + 1,), np.uint32)

    def file(self) -> DeviceArray:
        """Return the paths on the device, tile after tile."""
        runtime = self._runtime
        members = runtime.allocate("uint", int(self.starts[-1]), "paths by tile")
        if self._chunks:
            kernel = runtime.kernel(self._file, "bin_file", self._options)
            given = {**self._given, "members": members}
            self._events.append(runtime.run(kernel, self._chunks, given))
        return members

    def seconds(self) -> float:
        """Return the seconds that its kernels ran."""
        return sum(seconds(event) for event in self._events)


def list_paths(
    work: Work,
    file: str,
    options: Sequence[str],
    order: DeviceArray,
    count: int,
    reach: tuple[float, float, float, float],
) -> NDArray[np.int64]:
    """Stage "bin": ``members`` of every tile, from ``starts[tile]`` to ``starts[tile + 1]``.

    The kernels of ``file`` list ``count`` paths in ``order``; ``reach`` says where samples may lie
    relative to their pixels, x from and to, y from and to. Returns how many paths each tile lists.
    """
    plan, given = work.plan, {**work.arrays, "order": order}
    lists = Lists(work.runtime, file, options, given, count, tile_grid(plan), plan.tile, reach)
    starts = lists.starts
    if starts[-1] == records.NONE:
        larger = ", or with a larger tile_size" if plan.settings.method == "analytic" else ""
        raise CapacityError(
            f"the {len(starts) - 1} tiles list 2**32 paths or more; render in crops{larger}"
        )
    check_members(work, 4 * int(starts[-1]))
    work.arrays["starts"], work.arrays["members"] = lists.places, lists.file()
    work.timings["bin"] = lists.seconds()
    return np.asarray(np.diff(starts.astype(np.int64)))


def memory_room(work: Work, besides: Container[str] = ()) -> int:
    """Bytes that are left beside all buffers, but for those named, and the film on the host.

    Without a limit to memory half of what the device has is taken for free.
    """
    room = work.runtime.device.global_mem_size // 2
    if work.plan.memory is None:
        return int(room)
    used = sum(array.nbytes for name, array in work.arrays.items() if name not in besides)
    return int(min(room, work.plan.memory - used - film_bytes(work.plan)))


def check_members(work: Work, size: int) -> None:
    """Refuse lists of paths by tile, of ``size`` bytes, that the plan's memory has no room for."""
    if work.plan.memory is None or size <= memory_room(work):
        return
    larger = "a larger tile_size, " if work.plan.settings.method == "analytic" else ""
    raise CapacityError(
        f"the lists of paths by tile take {size / 2**20:.0f} MiB, and "
        f"{max(memory_room(work), 0) / 2**20:.0f} MiB of the memory that is allowed are left: "
        f"allow more, or use {larger}fewer motion segments, or crops"
    )


def in_parts(
    queue: NDArray[np.uint32],
    loads: NDArray[np.int64],
    render: Callable[[NDArray[np.uint32]], float],
) -> Iterator[int]:
    """Render the queue of tiles a part at a time; yields how many of them are done.

    The device gets a fraction of a second's worth at a time, so that an interrupt is heard and
    progress is told. ``loads`` are the tiles' shares of the work; ``render`` returns seconds.
    """
    until, done, most = np.cumsum(loads), 0, float(_FIRST_LOAD)
    while done < len(queue):
        before = until[done - 1] if done else 0
        end = max(int(np.searchsorted(until, before + most, side="right")), done + 1)
        took = render(queue[done:end])
        load, done = float(until[end - 1] - before), end
        most = load * np.clip(SECONDS_AT_A_TIME / max(took, 1e-6), 0.1, 4.0)
        yield done


def add_counts(
    work: Work,
    stages: Sequence[str],
    more: Sequence[str],
    workers: int,
    took: float,
    stats: dict[str, int],
) -> None:
    """Share ``took`` out among ``stages`` by their ticks, and add up the other counts.

    ``counters`` has each worker's ticks by stage and then what ``more`` names; only what
    ``timings`` and ``stats`` have already is kept.
    """
    names = (*stages, *more)
    counted = work.runtime.download(work.arrays["counters"], (workers, len(names)), np.uint64)
    sums = dict(zip(names, counted.sum(axis=0).tolist(), strict=True))
    ticks = sum(sums[stage] for stage in stages) or 1
    for stage in work.timings.keys() & stages:
        work.timings[stage] += took * sums[stage] / ticks
    for name in stats:
        stats[name] += sums[name]


def grid_record(plan: Plan, queued: int, capacity: int = 0, events: int = 0) -> NDArray[np.void]:
    """Return the ``TileGrid`` of the plan's tiles, ``queued`` of which are rendered."""
    x, y, columns, rows = tile_grid(plan)
    place = {"x": x, "y": y, "columns": columns, "rows": rows}
    return records.pack(
        "TileGrid", **place, queued=queued, capacity=capacity, event_capacity=events
    )


def frame_record(region: Crop, background: Any) -> NDArray[np.void]:
    """Return the ``Frame`` of a part of the frame, over a colour or an image ``background``."""
    constant = background if isinstance(background, tuple) else (0.0, 0.0, 0.0)
    place = dict(zip(("x", "y", "width", "height"), region, strict=True))
    return records.pack("Frame", **place, background=constant)
