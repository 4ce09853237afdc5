"""The witness's table: how far scenes of each kind of effect are from an independent reference.

    python tests/reports/witness.py [--scenes 4] [--kinds NAME ...] [--workers 2] [--out FILE]

Scenes are those of ``tests/reference/witness/kinds.py``, 16 x 12 pixels, with seeds from 1 on: a
few meshes of triangles before a wall, each of which moves in one of a dozen ways, with the effect
that is named and nothing else. RMSE is over linear colour; "noise" is the RMSE that the noise of
both sides alone makes, known from independent repeats: 24 films of each side with 64 samples or
instants each, but what is sampled at pixels' centres has no noise of the product's. The largest
error of a pixel is given with its own noise's deviation. "yes" is that noise, and what the README
allows, explain all of it: colour, alpha and depth, and what a kind has besides, by Student's t over
pixels, tiles, the image and patterns, at a level of 1e-7. How small an error would be told shows
``tests/witness/test_witness_kinds.py``: in one scene of each kind a shutter that is a hundredth
late, and 1 % more light.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from reference.witness.compare import compare
from reference.witness.kinds import KINDS, kind_case

COLUMNS = ("effect", "what is looked at", "scenes", "RMSE", "noise", "largest error", "its noise",
           "explained", "worst scene")  # fmt: skip


def line(cells: Sequence[object]) -> str:
    return f"| {' | '.join(map(str, cells))} |\n"


def row(name: str, scenes: int) -> str:
    """One line of the table, of so many scenes of a kind."""
    squares, noise, agree, worst = [], [], [], (0.0, 0.0, 0)
    for seed in range(1, scenes + 1):
        result = compare(kind_case(name, seed))
        verdict = result.verdicts["color"]
        squares.append(verdict.rmse**2)
        noise.append(verdict.noise**2)
        agree.append(result.agrees)
        worst = max(worst, (verdict.worst, verdict.spread, seed))
    explained = "yes" if all(agree) else f"{sum(agree)} of {scenes}"
    rmse, own = (np.sqrt(np.mean(values)) for values in (squares, noise))
    return line((
        name, KINDS[name].about, scenes, f"{rmse:.1e}", f"{own:.1e}", f"{worst[0]:.1e}",
        f"{worst[1]:.1e}", explained, worst[2],
    ))  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--scenes", type=int, default=4)
    parser.add_argument("--kinds", nargs="*", default=list(KINDS), metavar="NAME")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path(__file__).with_suffix(".md"))
    given = parser.parse_args()
    table = line(COLUMNS) + line(["---"] * len(COLUMNS))
    # PoCL does not survive a fork.
    with ProcessPoolExecutor(given.workers, get_context("spawn")) as pool:
        for done in pool.map(partial(row, scenes=given.scenes), given.kinds):
            print(done, end="", flush=True)
            table += done
    about = __doc__.split("\n\n", 2)
    given.out.write_text(f"# {about[0]}\n\n{about[2]}\n{table}", encoding="utf-8")


if __name__ == "__main__":
    main()
