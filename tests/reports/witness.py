"""The witness's table: how far scenes of each kind of effect are from an independent reference.

    python tests/reports/witness.py [--scenes 4] [--kinds NAME ...] [--out tests/reports/witness.md]

Scenes are those of ``tests/reference/witness/kinds.py``, 16 x 12 pixels, with seeds from 1 on. RMSE
is over linear colour; "noise" is the RMSE that the noise of both sides alone makes, known from
independent repeats; the largest error of a pixel is given with its own noise's deviation. "yes" is
that noise, and what the README allows, explain all of it.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from reference.witness.compare import compare
from reference.witness.kinds import KINDS, kind_case

HEAD = """| effect | scenes | RMSE | noise | largest error | its noise | explained | worst scene |
|---|---|---|---|---|---|---|---|
"""


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
    return (
        f"| {name} | {scenes} | {rmse:.1e} | {own:.1e} | {worst[0]:.1e} | {worst[1]:.1e} "
        f"| {explained} | {worst[2]} |\n"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--scenes", type=int, default=4)
    parser.add_argument("--kinds", nargs="*", default=list(KINDS), metavar="NAME")
    parser.add_argument("--out", type=Path, default=Path(__file__).with_suffix(".md"))
    given = parser.parse_args()
    table = HEAD
    for name in given.kinds:
        line = row(name, given.scenes)
        print(line, end="", flush=True)
        table += line
    about = __doc__.split("\n\n", 2)
    given.out.write_text(f"# {about[0]}\n\n{about[2]}\n{table}", encoding="utf-8")


if __name__ == "__main__":
    main()
