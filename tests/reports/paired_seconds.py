"""Seconds of two versions of mbinterval, in pairs of renders: how much slower one is at the most.

    python tests/reports/paired_seconds.py BEFORE AFTER [SCENE ...]

BEFORE and AFTER are checkouts. Of each scene there are ``--pairs`` pairs of processes, one of each
version, since two processes of one version can differ by several per cent for as long as they live
(where their memory lies). Both of a pair render each row in turn, the first alternately, after one
render that prepares. What one takes is the least of as many renders as fill ``--seconds``, and of
one at least, in processes that keep their memory. No pair is dropped. A line for each row: the
median seconds of both, the geometric mean of the ratios after to before, and its one-sided upper
bound of 95 % (Student's t of the logarithms). Ends with exit code 1 where a bound is above
``--most``.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import statistics
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

SCENES = ("ho17_cubes", "fast_cubes:1000", "fast_cubes:2000", "blades", "dense_sphere")
_EXACT = {"paths": "exact", "occlusion": "exact", "filter": "box"}
ROWS: dict[str, dict[str, Any]] = {
    "exact 1": {**_EXACT, "samples": 1},
    "five-point 1": {**_EXACT, "samples": 1, "filter": "five_point"},
    "exact 2": {**_EXACT, "samples": 2},
    "exact 4": {**_EXACT, "samples": 4},
    "hong-oh": {**_EXACT, "paths": "triangulated", "occlusion": 128, "samples": 1},
    "point samples 64": {"method": "stochastic", "samples": 64},
    "jittered 16": {"method": "stochastic", "samples": 16, "pattern": "jittered"},
    "z-buffer 4": {"method": "accumulation", "slices": 1, "pattern": "fixed", "samples": 4},
}

WORKER = """
import json, os, sys, time
import mbinterval as mb
from mbinterval.scene.generators import GENERATORS

answers = os.fdopen(os.dup(1), "w")
os.dup2(2, 1)
source, width, height, span = json.loads(sys.argv[1])
name, _, count = source.partition(":")
if name not in GENERATORS:
    scene = mb.load(source)
else:
    scene = GENERATORS[name](int(count)) if count else GENERATORS[name]()

def seconds(settings):
    start = time.perf_counter()
    mb.render(scene, frame=1, width=width, height=height, settings=settings)
    return time.perf_counter() - start

for line in sys.stdin:
    try:
        settings = mb.Settings(**json.loads(line))
        seconds(settings)
        taken = [seconds(settings)]
        while sum(taken) < span:
            taken.append(seconds(settings))
        answer = min(taken)
    except mb.UsageError as error:
        answer = str(error)
    print(json.dumps(answer), file=answers, flush=True)
"""

KEEP = {
    "MALLOC_MMAP_THRESHOLD_": str(1 << 32),
    "MALLOC_TRIM_THRESHOLD_": str(1 << 32),
    "MALLOC_TOP_PAD_": str(1 << 28),
}
"""Has glibc keep memory: to take it from the system for every frame is most of the noise."""


class Version:
    """A process of one checkout, with one scene."""

    def __init__(self, checkout: Path, task: Sequence[Any]) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-c", WORKER, json.dumps(task)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=os.environ | KEEP | {"PYTHONPATH": str(checkout)},
            cwd=checkout,
        )

    def seconds(self, row: str) -> float | str:
        """The least of some renders; the error's text where the scene does not allow the row."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        print(json.dumps(ROWS[row]), file=self._process.stdin, flush=True)
        return json.loads(self._process.stdout.readline())

    def close(self) -> None:
        self._process.communicate()


def measure(
    checkouts: Sequence[Path], task: Sequence[Any], rows: Sequence[str], pairs: int
) -> dict[str, list[list[float | str]]]:
    """Seconds by row of both versions, a list each with one for each pair."""
    found: dict[str, list[list[float | str]]] = {row: [[], []] for row in rows}
    for pair in range(pairs):
        versions = [Version(checkout, task) for checkout in checkouts]
        for row in rows:
            for which in (0, 1) if pair % 2 == 0 else (1, 0):
                found[row][which].append(versions[which].seconds(row))
        for version in versions:
            version.close()
    return found


def judge(before: Sequence[Any], after: Sequence[Any], most: float) -> tuple[str, bool]:
    """The rest of a row's line, and whether the row is slower than that."""
    if isinstance(before[0], str) or isinstance(after[0], str):
        return f"{before[0]} | {after[0]} | | |", before[0] != after[0]
    from scipy.stats import t

    logs = [math.log(b / a) for a, b in zip(before, after, strict=True)]
    mean = statistics.fmean(logs)
    error = statistics.stdev(logs) / math.sqrt(len(logs))
    bound = math.exp(mean + t.ppf(0.95, len(logs) - 1) * error)
    mark = " !" if bound > most else ""
    middle = f"{statistics.median(before):.3f} | {statistics.median(after):.3f}"
    return f"{middle} | {math.exp(mean):.3f} | {bound:.3f}{mark} |", bound > most


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("before", type=Path)
    parser.add_argument("after", type=Path)
    parser.add_argument("scenes", nargs="*", default=SCENES)
    parser.add_argument("--pairs", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=0.2)
    parser.add_argument("--rows", help="names, with commas between; all of them by default")
    parser.add_argument("--width", type=int, default=1024)
    parser.add_argument("--height", type=int, default=768)
    parser.add_argument("--most", type=float, default=1.03)
    given = parser.parse_args()
    rows = [row.strip() for row in given.rows.split(",")] if given.rows else list(ROWS)
    checkouts = [given.before.resolve(), given.after.resolve()]
    print("| scene | row | before, s | after, s | ratio | at most |")
    print("|---|---|---|---|---|---|")
    slower = 0
    for scene in given.scenes:
        source = str(Path(scene).resolve()) if Path(scene).suffix else scene
        task = (source, given.width, given.height, given.seconds)
        for row, found in measure(checkouts, task, rows, given.pairs).items():
            line, worse = judge(*found, given.most)
            slower += worse
            print(f"| {scene} | {row} | {line}", flush=True)
    return int(slower > 0)


if __name__ == "__main__":
    sys.exit(main())
