"""Events: what each sample of a pixel sees, from when until when, and what that adds to it.

This is the film before it is summed up. A time integral over any part of the exposure, the image
that a camera with that shutter would have taken, is a sum over events; so is the moment at which a
pixel's brightness changes. Nothing is sampled in time: events begin and end where visibility does.

An event's colour is its average in time, as the film's is (`Settings.texture_samples` times). It
is constant where the surface is of one colour. Where it varies along the span (textures, vertex
colours, light), the span is cut at multiples of 1 / ``event_steps`` of the exposure; integrals
whose limits are such multiples are then what a render of that exposure is, and others take the
part in which a limit lies for constant. The colours of parts are found at more times than the
film's; with ``event_steps=1`` the film is the sum of its events but for rounding.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.errors import CapacityError, UsageError
from mbinterval.files.exr import AttributeValue
from mbinterval.film.event_files import COLUMNS, digest_of, read_parts
from mbinterval.film.formats import format_of
from mbinterval.values import number

_LUMINANCE = (0.2126, 0.7152, 0.0722)


@dataclass(frozen=True, eq=False)
class Events:
    """All visible spans of a film.

    Attributes
    ----------
    shape
        Rows, columns and samples of each pixel.
    offsets
        ``(H * W * S + 1,)`` int64: the events of sample s of the pixel in row y and column x are
        those from ``offsets[i]`` to ``offsets[i + 1]``, ``i = (y * W + x) * S + s``. They come in
        order of time and, where several are seen through each other at one time, front to back.
    columns
        ``(N,)`` each. ``t0``, ``t1`` float32: when it is seen, from 0 where the shutter opens to 1
        where it closes, of a rolling shutter the pixel's line's. ``weight`` float32: its share of
        the pixel's light, by the filter and the shutter's curve; the film without background is
        the sum of weight times colour. ``share`` float32: of the sample in its pixel, always.
        ``object``, ``face`` uint32: 1 and the mesh's place in the scene, and the triangle of it.
        ``z0``, ``z1`` float32: depth at both ends. ``r``, ``g``, ``b``, ``a`` float32: what it adds
        on average while it is seen, premultiplied: alpha is 1 where it is opaque and nothing lies
        before it.
    resolution, origin, metadata
        As of a `Film`.
    """

    shape: tuple[int, int, int]
    offsets: NDArray[np.int64]
    columns: Mapping[str, NDArray[Any]]
    resolution: tuple[int, int] = (0, 0)
    origin: tuple[int, int] = (0, 0)
    metadata: Mapping[str, AttributeValue] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.columns["t0"])

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self.columns[name]

    @property
    def pixel(self) -> NDArray[np.int64]:
        """``(N,)`` int64: the pixel of each event, row by row."""
        return self.sample // self.shape[2]

    @property
    def sample(self) -> NDArray[np.int64]:
        """``(N,)`` int64: the sample of each event, of all pixels' samples."""
        return np.repeat(np.arange(len(self.offsets) - 1), np.diff(self.offsets))

    def integrate(self, start: float = 0.0, end: float = 1.0) -> NDArray[np.float32]:
        """Return the image of an exposure from ``start`` to ``end``, parts of the film's own.

        ``(H, W, 4)`` float32, scene-linear, premultiplied, without background: alpha is coverage
        over pixel and that time. The shutter is open throughout, whatever the film's curve. See the
        module for how exact it is.

        Raises
        ------
        UsageError
            Where the times do not follow each other in [0, 1].
        """
        start, end = number(start, "start", 0.0, 1.0), number(end, "end", 0.0, 1.0)
        if not start < end:
            raise UsageError(f"start={start:g}, end={end:g}: the end must come after the start")
        seen = np.minimum(self["t1"], end) - np.maximum(self["t0"], start, dtype=np.float64)
        part = np.flatnonzero(seen > 0.0)
        weight = self["share"][part] * seen[part] / (end - start)
        pixel, count = self.pixel[part], self.shape[0] * self.shape[1]
        planes = [np.bincount(pixel, weight * self[name][part], count) for name in "rgba"]
        return np.stack(planes, axis=1).reshape(*self.shape[:2], 4).astype(np.float32)

    def brightness_changes(
        self, threshold: float, background: Any = (0.0, 0.0, 0.0), floor: float = 1e-3
    ) -> dict[str, NDArray[Any]]:
        """Return what an event camera would report: steps of a pixel's logarithmic brightness.

        Each time that log(luminance + ``floor``) of a pixel has changed by ``threshold`` since its
        last report, it reports when, and in which direction; a larger step at one time is several
        reports. Brightness here changes where events begin and end, in steps.

        ``background`` is a colour or ``(H, W, 3)``. Returns ``t`` float64 and ``x``, ``y``,
        ``polarity`` int32 (1 or -1), in order of time, then of pixels.
        """
        threshold = number(threshold, "threshold", above=0.0)
        floor = number(floor, "floor", above=0.0)
        pixel, t, level = self._brightness(background, floor)
        first = np.flatnonzero(np.append(True, np.diff(pixel) != 0)[: len(pixel)])
        size = np.diff(np.append(first, len(pixel)))
        reported = level[first]  # of the pixels that see anything
        found = []
        for place in range(1, int(size.max(initial=0))):
            pixels = np.flatnonzero(size > place)
            at = first[pixels] + place
            steps = np.trunc((level[at] - reported[pixels]) / threshold)
            reported[pixels] += steps * threshold
            reports = np.stack([t[at], pixel[at], steps])
            found.append(np.repeat(reports, np.abs(steps).astype(np.int64), axis=1))
        when, where, steps = np.concatenate([np.zeros((3, 0)), *found], axis=1)
        order = np.lexsort((where, when))
        y, x = np.divmod(where[order].astype(np.int32), self.shape[1])
        polarity = np.sign(steps[order]).astype(np.int32)
        return {"t": when[order], "x": x, "y": y, "polarity": polarity}

    def _brightness(
        self, background: Any, floor: float
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
        """Pixels, times from which on, and logarithms of brightness; in order of both."""
        behind = np.asarray(background, np.float64).reshape(-1, 3) @ _LUMINANCE
        count = self.shape[0] * self.shape[1]
        if len(behind) not in (1, count):
            raise UsageError(
                f"background has {len(behind)} colours; expected one, or one for each of the "
                f"{count} pixels"
            )
        behind, pixel = np.broadcast_to(behind, count), self.pixel
        light = sum(self[name] * float(part) for name, part in zip("rgb", _LUMINANCE, strict=True))
        step = self["share"] * (light - self["a"] * behind[pixel])
        every = np.concatenate([np.arange(count), pixel, pixel])
        t = np.concatenate([np.zeros(count), self["t0"], self["t1"]]).astype(np.float64)
        change = np.concatenate([behind, step, -step])
        kept = t < 1.0
        every, t, change = every[kept], t[kept], change[kept]
        order = np.lexsort((t, every))
        every, t, change = every[order], t[order], change[order]
        first = np.flatnonzero(np.append(True, (np.diff(every) != 0) | (np.diff(t) != 0)))
        change, every, t = np.add.reduceat(change, first), every[first], t[first]
        total = np.cumsum(change)
        start = np.flatnonzero(np.append(True, np.diff(every) != 0))
        before = np.repeat(total[start] - change[start], np.diff(np.append(start, len(every))))
        return every, t, np.log(np.maximum(total - before, 0.0) + floor)

    def write(self, path: str | Path) -> Path:
        """Write an .npz or a .parquet by the ending of ``path``, all of it or nothing.

        An npz has ``offsets``, each of ``columns`` and, as JSON texts, ``shape``, ``resolution``,
        ``origin`` and ``metadata``. A Parquet file has a row for each event: ``x`` and ``y`` in the
        film, ``sample`` of the pixel and the columns; the same texts are metadata of its schema.
        Both say the digest of the events. Equal events give equal bytes.

        Raises
        ------
        UsageError
            For another ending, or where .parquet is asked for and pyarrow is missing.
        OutputError
            Where the file can't be written; nothing is left then, and an older file stays.
        """
        kind = format_of(path)
        if kind.part != "events":
            raise UsageError(f"{path}: events are written as .npz or .parquet")
        kind.write(Path(path), self)
        return Path(path)

    @classmethod
    def read(cls, path: str | Path) -> Events:
        """Read what `write` wrote.

        Raises
        ------
        OutputError
            Where the file is missing, broken, cut off or of another kind.
        """
        return cls(**read_parts(Path(path)))

    def digest(self) -> str:
        """SHA-256 of all events."""
        return digest_of(self.parts())

    def parts(self) -> dict[str, Any]:
        """Return the attributes by name."""
        return {item.name: getattr(self, item.name) for item in fields(self)}


class EventTable:
    """Gathers events, from visible spans.

    Parameters
    ----------
    objects, faces
        ``(paths,)`` uint32: object and face of each motion path.
    samples, shape
        Samples of a pixel; rows and columns of pixels.
    memory
        Bytes that the events may take.
    """

    parts = True

    def __init__(
        self,
        objects: NDArray[np.uint32],
        faces: NDArray[np.uint32],
        samples: int,
        shape: tuple[int, int],
        memory: int,
    ) -> None:
        self._objects, self._faces = objects, faces
        self._shape, self._memory = (*shape, samples), memory
        self._counts = np.zeros(shape[0] * shape[1] * samples, np.int64)
        self._parts: list[NDArray[np.void]] = []
        self._bytes = 0

    def take(self, events: NDArray[np.void]) -> None:
        """Keep the ``events`` of some pixels, but for those that add nothing."""
        events = events[(events["color"] != 0.0).any(axis=1)]
        samples = self._shape[2]
        place = events["pixel"].astype(np.int64) * samples + events["sample"]
        counts = np.bincount(place, minlength=len(self._counts))
        self._counts += counts
        self._parts.append(events)
        # The columns come on top of the parts, which go one after the other.
        self._bytes += 2 * events.nbytes
        if self._bytes > self._memory:
            done = np.count_nonzero(self._counts) / len(self._counts)
            raise CapacityError(
                f"the frame's events take more than the {self._memory / 2**20:.0f} MiB that there "
                f"are for them: {self._bytes / 2**20:.0f} MiB for {done:.0%} of the samples, so "
                f"up to about {self._bytes / done / 2**20:.0f} MiB in all, since tiles with the "
                "most come first; allow more memory, or render crops, or with fewer samples or "
                "event_steps"
            )

    def result(self) -> Events:
        """Return all events, sorted into the order of pixels and samples."""
        offsets = np.append(0, np.cumsum(self._counts))
        columns = {name: np.empty(int(offsets[-1]), kind) for name, kind in COLUMNS.items()}
        while self._parts:
            part = self._parts.pop()
            sample = part["pixel"].astype(np.int64) * self._shape[2] + part["sample"]
            first = np.flatnonzero(np.append(True, np.diff(sample) != 0)[: len(sample)])
            sizes = np.diff(np.append(first, len(sample)))
            place = offsets[sample] + np.arange(len(sample)) - np.repeat(first, sizes)
            for name in ("t0", "t1", "weight", "share", "z0", "z1"):
                columns[name][place] = part[name]
            columns["object"][place] = self._objects[part["path"]]
            columns["face"][place] = self._faces[part["path"]]
            for index, name in enumerate("rgba"):
                columns[name][place] = part["color"][:, index]
        return Events(self._shape, offsets, columns)
