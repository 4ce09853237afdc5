"""A frame in parts: bands of rows that are rendered by themselves, and joined to the same film.

A pixel of a crop is that of the whole frame, bit for bit, so the bands of a frame are too.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mbinterval.film.deep import DeepImage
from mbinterval.film.events import Events
from mbinterval.film.film import Film

Crop = tuple[int, int, int, int]

_ROWS = 32
"""Fewest rows of a band: bands end where tiles do, and each finds its own paths again."""


def split(region: Crop, count: int) -> list[Crop]:
    """Cut a region, column, row, width and height in pixels, into ``count`` bands or fewer."""
    x, y, width, height = region
    rows = max(-(-height // max(count, 1)), 1)
    rows = -(-rows // _ROWS) * _ROWS
    return [(x, top, width, min(rows, y + height - top)) for top in range(y, y + height, rows)]


def join(films: Sequence[Film]) -> Film:
    """Film of all bands of a frame: pixels of each, sums of seconds and counts, notes once."""
    if len(films) == 1:
        return films[0]
    films = sorted(films, key=lambda film: film.origin[1])
    timings: Counter[str] = Counter()
    stats: Counter[str] = Counter()
    for film in films:
        timings.update(film.timings)
        stats.update(film.stats)
    return replace(
        films[0],
        rgba=np.concatenate([film.rgba for film in films]),
        depth=np.concatenate([film.depth for film in films]),
        intervals=np.concatenate([film.intervals for film in films]),
        layers={
            name: np.concatenate([film.layers[name] for film in films]) for name in films[0].layers
        },
        deep=_joined_deep([film.deep for film in films if film.deep is not None]),
        events=_joined_events([film.events for film in films if film.events is not None]),
        timings=dict(timings),
        stats=dict(stats),
        notes=tuple(dict.fromkeys(note for film in films for note in film.notes)),
        device=", ".join(dict.fromkeys(film.device for film in films)),
    )


def _joined_deep(images: Sequence[DeepImage]) -> DeepImage | None:
    if not images:
        return None
    return replace(
        images[0],
        counts=np.concatenate([image.counts for image in images]),
        z=np.concatenate([image.z for image in images]),
        z_back=np.concatenate([image.z_back for image in images]),
        rgba=np.concatenate([image.rgba for image in images]),
    )


def _joined_events(tables: Sequence[Events]) -> Events | None:
    if not tables:
        return None
    height = sum(table.shape[0] for table in tables)
    counts = np.concatenate([np.diff(table.offsets) for table in tables])
    return replace(
        tables[0],
        shape=(height, *tables[0].shape[1:]),
        offsets=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        columns={
            name: np.concatenate([table[name] for table in tables]) for name in tables[0].columns
        },
    )
