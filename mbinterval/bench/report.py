"""What a benchmark's result says: tables for people, a file to keep, a comparison with another."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mbinterval.errors import UsageError
from mbinterval.files.results import aligned

FORMAT = 1
_COLUMNS = (
    *("row", "settings", "median s", "least s", "spread", "processor s", "ratio"),
    *("intervals per sample", "tests", "hits", "moved MB", "of copy", "M samples/s", "memory MB"),
    "RMSE",
)


def table(result: Mapping[str, Any]) -> str:
    """Lines of text with the result of ``measure``: where, then for each scene two tables."""
    device, machine = result["device"], result["machine"]
    versions = ", ".join(f"{name} {text}" for name, text in result["versions"].items())
    lines = [
        f"{device['name']} ({device['platform']}), {device['compute_units']} compute units, "
        f"copies {device['copy_bandwidth'] / 1e9:.1f} GB/s",
        f"{machine['processor']}, {machine['cores']} cores, {machine['system']}, "
        f"load {result['load']:.1f} before",
        versions,
        f"{result['rounds']} rounds, interleaved; seconds from scene to film, kernels built",
    ]
    for scene in result["scenes"]:
        size = f"{scene['width']} x {scene['height']}"
        lines += ["", f"{scene['name']}: {scene['triangles']:,} triangles, {size}", ""]
        lines += aligned([_COLUMNS, *map(_cells, scene["rows"])])
        lines += ["", *aligned(_stage_cells(scene["rows"]))]
    return "\n".join(lines)


def _cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    if "error" in row:
        return (row["name"], row["error"], *[""] * (len(_COLUMNS) - 2))
    tested = row.get("tests", 0)
    return (
        row["name"],
        row["settings"],
        f"{row['median']:.3f}",
        f"{row['minimum']:.3f}",
        f"{row['spread']:.0%}",
        f"{row['processor']:.3f}",
        f"{row['ratio']:.2f}",
        f"{row['intervals']:.2f}" if "intervals" in row else "",
        f"{tested:,}" if tested else "",
        f"{row['hits'] / tested:.1%}" if tested else "",
        f"{row['moved'] / 1e6:.0f}" if "moved" in row else "",
        f"{row['bandwidth']:.0%}" if "bandwidth" in row else "",
        f"{row['rate'] / 1e6:.1f}" if "rate" in row else "",
        f"{row['memory'] / 1e6:.0f}",
        f"{row['rmse']:.5f}" if "rmse" in row else "",
    )


def _stage_cells(rows: Sequence[Mapping[str, Any]]) -> list[tuple[str, ...]]:
    """Milliseconds of each stage, stages in the order of the pipelines."""
    measured = [row for row in rows if "stages" in row]
    stages = list(dict.fromkeys(name for row in measured for name in row["stages"]))
    last = [name for name in ("shade", "resolve", "host") if name in stages]
    stages = [name for name in stages if name not in last] + last
    return [
        ("ms", *stages),
        *(
            (row["name"], *(_milliseconds(row["stages"].get(name)) for name in stages))
            for row in measured
        ),
    ]


def _milliseconds(seconds: float | None) -> str:
    return "" if seconds is None else f"{1e3 * seconds:.1f}"


def read_result(path: str | Path) -> dict[str, Any]:
    """Read what `write_result` wrote.

    Raises
    ------
    UsageError
        For a file that is missing or is no such result.
    """
    try:
        result = json.loads(Path(path).read_text(encoding="utf-8"))
        if result["format"] != FORMAT or not all(scene["rows"] for scene in result["scenes"]):
            raise ValueError("of another format")
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise UsageError(
            f"baseline {path}: not a result of mbinterval bench --json ({error!r:.80})"
        ) from None
    return dict(result)


@dataclass(frozen=True)
class Change:
    """One row now and in a baseline: seconds, and their ratio, above 1 where it is slower now.

    ``beyond`` says that the ratio is larger than the spread of both explains.
    """

    scene: str
    row: str
    before: float
    now: float
    beyond: bool

    @property
    def ratio(self) -> float:
        """Median now over median before."""
        return self.now / self.before


def changes(result: Mapping[str, Any], baseline: Mapping[str, Any]) -> list[Change]:
    """Compare the medians of the rows that both have, with the same settings and size."""
    before = dict(_medians(baseline))
    return [
        Change(
            scene=key[0],
            row=key[1],
            before=before[key]["median"],
            now=row["median"],
            beyond=_beyond(row, before[key]),
        )
        for key, row in _medians(result)
        if key in before
    ]


def _medians(result: Mapping[str, Any]) -> list[tuple[tuple[Any, ...], Mapping[str, Any]]]:
    return [
        ((scene["name"], row["name"], row["settings"], scene["width"], scene["height"]), row)
        for scene in result["scenes"]
        for row in scene["rows"]
        if "median" in row
    ]


def _beyond(row: Mapping[str, Any], before: Mapping[str, Any]) -> bool:
    ratio = row["median"] / before["median"]
    return bool(max(ratio, 1.0 / ratio) > 1.0 + row["spread"] + before["spread"])


def comparison(found: Sequence[Change], result: Mapping[str, Any], baseline: Any) -> str:
    """Lines of text with the changes, and what else differs between the two runs."""
    rows = [("scene", "row", "before s", "now s", "ratio", "")]
    for change in found:
        flag = ("slower" if change.ratio > 1.0 else "faster") if change.beyond else ""
        numbers = (f"{change.before:.3f}", f"{change.now:.3f}", f"{change.ratio:.2f}")
        rows.append((change.scene, change.row, *numbers, flag))
    lines = ["against the baseline; slower and faster: beyond the spread of both", ""]
    lines += aligned(rows)
    missing = len(_medians(result)) - len(found)
    if missing:
        lines.append(f"{missing} rows are not in the baseline with these settings and sizes")
    for name in ("machine", "device", "versions"):
        theirs, ours = baseline.get(name, {}), result[name]
        differ = [key for key in ours if key != "copy_bandwidth" and ours[key] != theirs.get(key)]
        lines += [f"{name}: {key} was {theirs.get(key)}, is {ours[key]}" for key in differ]
    return "\n".join(lines)
