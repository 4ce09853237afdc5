"""Seconds of two versions of mbinterval, in pairs of renders: how much slower one is at the most.

    python tests/reports/paired_seconds.py BEFORE AFTER [SCENE ...]

BEFORE and AFTER are checkouts. Each version has a process of its own that keeps its kernels; of
each row both render in turn, the first of a pair alternately, ``--pairs`` times after one render
that builds. No pair is dropped. A line for each row: the median seconds of both, the geometric
mean of the ratios after to before, and its one-sided upper bound of 95 % (Student's t of the
logarithms). Ends with exit code 1 where a bound is above ``--most``.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import statistics
import subprocess
import sys
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
scenes = {}

def scene_of(source):
    name, _, count = source.partition(":")
    if name not in GENERATORS:
        return mb.load(source)
    return GENERATORS[name](int(count)) if count else GENERATORS[name]()

for line in sys.stdin:
    source, width, height, values = json.loads(line)
    if source not in scenes:
        scenes = {source: scene_of(source)}
    try:
        settings = mb.Settings(**values)
        start = time.perf_counter()
        mb.render(scenes[source], frame=1, width=width, height=height, settings=settings)
        answer = time.perf_counter() - start
    except mb.UsageError as error:
        answer = str(error)
    print(json.dumps(answer), file=answers, flush=True)
"""


class Version:
    """A checkout in a process of its own."""

    def __init__(self, checkout: Path) -> None:
        environment = os.environ | {"PYTHONPATH": str(checkout)}
        self._process = subprocess.Popen(
            [sys.executable, "-c", WORKER],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
            cwd=checkout,
        )

    def seconds(self, *task: Any) -> float | str:
        """Render once; the error's text where the scene does not allow the row."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        print(json.dumps(task), file=self._process.stdin, flush=True)
        return json.loads(self._process.stdout.readline())


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("before", type=Path)
    parser.add_argument("after", type=Path)
    parser.add_argument("scenes", nargs="*", default=SCENES)
    parser.add_argument("--pairs", type=int, default=20)
    parser.add_argument("--rows", help="names, with commas between; all of them by default")
    parser.add_argument("--width", type=int, default=1024)
    parser.add_argument("--height", type=int, default=768)
    parser.add_argument("--most", type=float, default=1.03)
    given = parser.parse_args()
    rows = [row.strip() for row in given.rows.split(",")] if given.rows else list(ROWS)
    from scipy.stats import t

    versions = [Version(given.before.resolve()), Version(given.after.resolve())]
    slower = 0
    print("| scene | row | before, s | after, s | ratio | at most |")
    print("|---|---|---|---|---|---|")
    for scene in given.scenes:
        source = str(Path(scene).resolve()) if Path(scene).suffix else scene
        for row in rows:
            task = (source, given.width, given.height, ROWS[row])
            first = [version.seconds(*task) for version in versions]
            if any(isinstance(seconds, str) for seconds in first):
                print(f"| {scene} | {row} | {first[0]} | {first[1]} | | |")
                slower += first[0] != first[1]
                continue
            found = [[], []]
            for pair in range(given.pairs):
                for which in (0, 1) if pair % 2 == 0 else (1, 0):
                    found[which].append(versions[which].seconds(*task))
            logs = [math.log(b / a) for a, b in zip(*found, strict=True)]
            mean = statistics.fmean(logs)
            error = statistics.stdev(logs) / math.sqrt(len(logs))
            bound = math.exp(mean + t.ppf(0.95, len(logs) - 1) * error)
            slower += bound > given.most
            before, after = map(statistics.median, found)
            mark = " !" if bound > given.most else ""
            print(
                f"| {scene} | {row} | {before:.3f} | {after:.3f} | {math.exp(mean):.3f} "
                f"| {bound:.3f}{mark} |",
                flush=True,
            )
    return int(slower > 0)


if __name__ == "__main__":
    sys.exit(main())
