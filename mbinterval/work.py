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

from mbinterval.aovs import plane_count
from mbinterval.appearance import appearance, casting, fit_background
from mbinterval.device import records
from mbinterval.device.runtime import Runtime, seconds
from mbinterval.errors import CapacityError
from mbinterval.motion import Motion
from mbinterval.plan import Crop, Plan, shutter_keys
from mbinterval.sampling import filter_of, slots_of
from mbinterval.scene.exposure import Exposure

if TYPE_CHECKING:
    from mbinterval.deep import DeepImage
    from mbinterval.events import Events
    from mbinterval.scene.mirrors import Mirror

_FILM_BYTES = 24  # of a pixel: colour, depth, intervals

_BIN_CHUNKS = 64
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
    """A frame in work: the plan, the device's buffers by name, and seconds by stage so far."""

    runtime: Runtime
    plan: Plan
    buffers: dict[str, Any]
    exposure: Exposure
    timings: dict[str, float] = field(default_factory=dict)


def upload_scene(
    runtime: Runtime, exposure: Exposure, motion: Motion, plan: Plan
) -> dict[str, Any]:
    """Buffers of everything that the kernels read, and a few counts."""
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
    arrays = {
        "positions": motion.positions,
        "jobs": motion.jobs,
        "cameras": motion.cameras,
        "paths": motion.paths,
        "meshes": motion.meshes,
        "color": motion.color,
        "uv": motion.uv,
        "normal": motion.normal,
        "materials": looks.materials,
        "textures": looks.textures,
        "texels": looks.texels,
        "lights": looks.lights,
        "slots": slots_of(plan.settings),
        "filter": np.zeros(0) if shape is None else shape.table.astype(np.float32),
        "shutter": shutter_keys(exposure.shutter),
        "background": background,
        "mirror_planes": mirror_planes(exposure.mirrors),
        **motion.places,
    }
    buffers: dict[str, Any] = {}
    for name, array in arrays.items():
        buffers[name] = runtime.upload(array, name)
    buffers["light_count"], buffers["static_paths"] = len(exposure.lights), motion.static_paths
    buffers["sky_count"] = np.uint32(len(motion.places.get("sky", ())))
    return buffers


def mirror_planes(mirrors: tuple[Mirror, ...]) -> NDArray[np.void]:
    """Return ``MirrorPlane`` records, in the order of the worlds that are seen in them."""
    table = np.zeros(len(mirrors), records.MIRROR_PLANE)
    for row, mirror in zip(table, mirrors, strict=True):
        row["normal"], row["tangents"] = mirror.normal, mirror.tangents.reshape(6)
    return table


CUBE_MAPS = ("maps", "map_texels", "sky", "sky_count", "mirror_planes")
"""Arguments of kernels where the plan has the stage "cube_map"."""


def shadow_count(plan: Plan) -> int:
    """Return how many lights cast shadows in the plan."""
    return int(plan.size("SHADOWS"))


def transform_vertices(work: Work, motion: Motion) -> float:
    """Make ``vertices``, in homogeneous pixel space at the ends of each segment; in seconds."""
    runtime, buffers = work.runtime, work.buffers
    size = motion.vertex_count * records.VERTEX.itemsize
    buffers["vertices"] = runtime.allocate(size, "vertices")
    if not len(motion.jobs):
        return 0.0
    kernel = runtime.kernel("shared/vertices.cl", "vertices", work.plan.flags("LENS"))
    names = ("jobs", "positions", "cameras", "vertices")
    return seconds(runtime.run(kernel, len(motion.jobs), *(buffers[name] for name in names)))


def tile_grid(plan: Plan) -> tuple[int, int, int, int]:
    """Return the first pixel, and columns and rows, of the tiles that cover the region.

    Tiles lie on multiples of their size in the frame.
    """
    x, y, width, height = plan.region
    left, top = x // plan.tile * plan.tile, y // plan.tile * plan.tile
    columns = -(-(x + width - left) // plan.tile)
    return left, top, columns, -(-(y + height - top) // plan.tile)


class Lists:
    """Paths by tile of a grid: counted at first, and filed when they are asked for.

    The kernels of ``file`` take the buffers ``given``, of ``count`` paths, and the ``Grid`` of
    ``cl/shared/grid.h``: first pixel, columns and rows of ``tiles``, ``size`` pixels along an edge.
    ``starts`` has where each tile's paths begin, and where all end; `records.NONE` if they are
    2**32 or more. ``places`` is its buffer.
    """

    def __init__(
        self,
        runtime: Runtime,
        file: str,
        options: Sequence[str],
        given: Sequence[Any],
        count: int,
        tiles: tuple[int, int, int, int],
        size: int,
        reach: tuple[float, float, float, float],
    ) -> None:
        chunk = max(1, -(-count // _BIN_CHUNKS))
        self._runtime, self._file, self._options = runtime, file, tuple(options)
        self._chunks, number = -(-count // chunk), tiles[2] * tiles[3]
        grid = packed("iiiiiIIffff", *tiles, size, count, chunk, *reach)
        self._counts = runtime.allocate(4 * self._chunks * number, "counts of paths by tile")
        self._given = (*given, grid, self._counts)
        self.places = runtime.allocate(4 * (number + 1), "starts")
        self._events = []
        if self._chunks:
            kernel = runtime.kernel(file, "bin_count", self._options)
            self._events.append(runtime.run(kernel, self._chunks, *self._given))
        scan = runtime.kernel("shared/scan.cl", "bin_scan")
        numbers = np.uint32(number), np.uint32(self._chunks)
        self._events.append(runtime.run(scan, 1, *numbers, self._counts, self.places))
        self.starts = runtime.download(self.places, (number + 1,), np.uint32)

    def file(self) -> Any:
        """Return the buffer of the paths, tile after tile."""
        runtime = self._runtime
        members = runtime.allocate(4 * int(self.starts[-1]), "paths by tile")
        if self._chunks:
            kernel = runtime.kernel(self._file, "bin_file", self._options)
            self._events.append(runtime.run(kernel, self._chunks, *self._given, members))
        return members

    def seconds(self) -> float:
        """Return the seconds that its kernels ran."""
        return sum(seconds(event) for event in self._events)


def list_paths(
    work: Work,
    file: str,
    options: Sequence[str],
    given: Sequence[Any],
    count: int,
    reach: tuple[float, float, float, float],
) -> NDArray[np.int64]:
    """Stage "bin": ``members`` of every tile, from ``starts[tile]`` to ``starts[tile + 1]``.

    The kernels of ``file`` take the buffers ``given``, of ``count`` paths, and the ``Grid`` of
    ``cl/shared/grid.h``; ``reach`` says where samples may lie relative to their pixels, x from and
    to, y from and to. Returns how many paths each tile lists.
    """
    plan = work.plan
    lists = Lists(work.runtime, file, options, given, count, tile_grid(plan), plan.tile, reach)
    starts = lists.starts
    if starts[-1] == records.NONE:
        larger = ", or with a larger tile_size" if plan.settings.method == "analytic" else ""
        raise CapacityError(
            f"the {len(starts) - 1} tiles list 2**32 paths or more; render in crops{larger}"
        )
    check_members(work, 4 * int(starts[-1]))
    work.buffers["starts"], work.buffers["members"] = lists.places, lists.file()
    work.timings["bin"] = lists.seconds()
    return np.asarray(np.diff(starts.astype(np.int64)))


def layer_bytes(plan: Plan) -> dict[str, int]:
    """Bytes of the buffers that hold the layers asked for."""
    pixels, asked = plan.region[2] * plan.region[3], plan.settings.aovs
    sizes = {"sharp": 16 * pixels * ("sharp" in asked), "planes": 4 * pixels * plane_count(asked)}
    return {name: size for name, size in sizes.items() if size}


def film_bytes(plan: Plan) -> int:
    """Bytes of the film with its layers, on the device and again on the host."""
    return _FILM_BYTES * plan.region[2] * plan.region[3] + sum(layer_bytes(plan).values())


def memory_room(work: Work, besides: Container[str] = ()) -> int:
    """Bytes that are left beside all buffers, but for those named, and the film on the host.

    Without a limit to memory half of what the device has is taken for free.
    """
    room = work.runtime.device.global_mem_size // 2
    if work.plan.memory is None:
        return int(room)
    kept = [item for name, item in work.buffers.items() if name not in besides]
    used = sum(getattr(item, "size", 0) for item in kept)
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
    counted = work.runtime.download(work.buffers["counters"], (workers, len(names)), np.uint64)
    sums = dict(zip(names, counted.sum(axis=0).tolist(), strict=True))
    ticks = sum(sums[stage] for stage in stages) or 1
    for stage in work.timings.keys() & stages:
        work.timings[stage] += took * sums[stage] / ticks
    for name in stats:
        stats[name] += sums[name]


def frame_record(region: Crop, background: Any) -> NDArray[np.void]:
    """Return the ``Frame`` of a part of the frame, over a colour or an image ``background``."""
    constant = background if isinstance(background, tuple) else (0.0, 0.0, 0.0)
    return packed("iiiifff", *region, *constant)


def packed(kinds: str, *values: Any) -> NDArray[np.void]:
    """Pack a small argument record of 4-byte numbers: i, I or f each."""
    types = {"i": "i4", "I": "u4", "f": "f4"}
    record = np.zeros(1, [(f"value{i}", types[kind]) for i, kind in enumerate(kinds)])
    record[0] = values
    return record
