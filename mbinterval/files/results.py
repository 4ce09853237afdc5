"""Results of measurements: tables for people, and JSON files."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from mbinterval.files.atomic import prepare_output, write_file
from mbinterval.files.ownership import check_replaceable


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Rows as a Markdown table, columns aligned; the first row is the head."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    lines = [
        f"| {' | '.join(cell.ljust(w) for cell, w in zip(row, widths, strict=True))} |"
        for row in rows
    ]
    lines.insert(1, f"|{'|'.join('-' * (width + 2) for width in widths)}|")
    return lines


def check_result(path: str | Path) -> None:
    """Raise ``OutputError`` where a result can't be written to ``path``, or isn't to replace it."""
    prepare_output(path)
    check_replaceable(path, ".json", "give another name")


def write_result(path: str | Path, result: Mapping[str, Any]) -> None:
    """Write ``result`` as JSON: all of it or nothing, and over no other's file.

    Raises ``OutputError``.
    """
    check_replaceable(path, ".json", "give another name")
    write_file(path, (json.dumps(result, indent=1) + "\n").encode())
