"""Seconds and counts of frames as a JSON file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mbinterval.atomic import replacing
from mbinterval.film import Film
from mbinterval.settings import Settings


def stats_row(frame: int, film: Film, settings: Settings) -> dict[str, Any]:
    """Return one frame's row: its settings, seconds by stage, and counts.

    ``sample_test_efficiency`` is hits over tests (Laine et al. 2011, 1), where both were counted.
    """
    row: dict[str, Any] = {
        "frame": frame,
        "settings": settings.given | {"cull": settings.cull},
        "seconds": dict(film.timings),
        "counts": dict(film.stats),
    }
    if film.stats.get("tests"):
        row["sample_test_efficiency"] = film.stats["hits"] / film.stats["tests"]
    return row


def write_stats(path: str | Path, rows: Sequence[dict[str, Any]]) -> None:
    """Write rows as a JSON list; all of it or nothing. Raises ``OutputError``."""
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(list(rows), indent=2) + "\n", encoding="utf-8")
