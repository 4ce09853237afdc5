"""Seconds and counts of frames as a JSON file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from mbinterval.files.atomic import output_place, prepare_output, write_file
from mbinterval.files.ownership import SOFTWARE, check_replaceable
from mbinterval.film.film import Film
from mbinterval.settings.settings import Settings


def stats_row(frame: int, film: Film, settings: Settings) -> dict[str, Any]:
    """Return one frame's row: its settings, seconds by stage, and counts.

    ``sample_test_efficiency`` is hits over tests (Laine et al. 2011, 1), where both were counted.
    """
    row: dict[str, Any] = {
        "software": SOFTWARE,
        "frame": frame,
        "settings": settings.given | {"cull": settings.cull},
        "seconds": dict(film.timings),
        "counts": dict(film.stats),
    }
    if film.stats.get("tests"):
        row["sample_test_efficiency"] = film.stats["hits"] / film.stats["tests"]
    return row


class StatsFile:
    """Rows as a JSON list, in a file that is whole after each; None writes nothing.

    A pipe or a device gets the list once, at the end of a job that did not fail. Raises
    ``OutputError``.
    """

    def __init__(self, path: str | Path | None, overwrite: bool) -> None:
        self._path, self._rows = path, list[dict[str, Any]]()
        self._overwrite = overwrite
        self._waits = path is not None and output_place(path) is None
        if path is not None:
            prepare_output(path)
            self._check()

    def __enter__(self) -> StatsFile:
        return self

    def __exit__(self, _kind: Any, error: BaseException | None, _: Any) -> None:
        if self._waits and error is None:
            self._write()

    def add(self, row: dict[str, Any]) -> None:
        """Write another row."""
        self._rows.append(row)
        if not self._waits:
            self._write()

    def _write(self) -> None:
        if self._path is not None:
            self._check()
            write_file(self._path, (json.dumps(self._rows, indent=2) + "\n").encode())

    def _check(self) -> None:
        if self._path is not None and not self._overwrite:
            check_replaceable(self._path, ".json", "--overwrite replaces it")
