"""What each effect costs where a scene calls for it: a table of times with it and without.

    python tests/reports/effects.py [--rounds 5] [--effects NAME ...]

Frames of 384 x 288 of the shipped scenes, each as it is, and again without one effect, as the
studies switch it off (`mbinterval.study.switches`); medians of kernels built. A study of a scene
(``mbinterval study scenes/NAME.toml``) shows the same with pictures, in its section "Effects".
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from gallery import FRAMES

from mbinterval.bench.bench import measure
from mbinterval.bench.cases import Case, make_case
from mbinterval.bench.meter import MeteredRuntime
from mbinterval.device.choose import choose_device
from mbinterval.study.costs import METHODS, active_effects
from mbinterval.study.switches import SWITCHES

SCENES = Path(__file__).resolve().parents[2] / "scenes"
FIRST = (
    "fast_cubes",
    "fly_by",
    "lanterns",
    "propeller",
    "glass",
    "metals",
    "shadows",
    "milk_truck",
)
"""Scenes that an effect is looked for in before all others, in this order."""
ROWS = {name: METHODS[name] for name in ("exact, 1 sample", "stochastic, 64 samples")}


def case_of(name: str) -> Case:
    """A shipped scene at a frame in which much is seen."""
    path = str(SCENES / f"{name}.toml")
    return replace(make_case(path, width=384, height=288), frame=float(FRAMES[name]))


def scenes_of_effects() -> dict[str, str]:
    """The first scene that calls for each effect, by effect in the order of the pipeline."""
    found: dict[str, str] = {}
    for name in dict.fromkeys((*FIRST, *sorted(FRAMES))):
        for effect in active_effects(case_of(name)):
            found.setdefault(effect.name, name)
    return {effect: found[effect] for effect in SWITCHES if effect in found}


def seconds(case: Case, rounds: int, meter: MeteredRuntime) -> list[float]:
    """Median of each of `ROWS`."""
    rows = measure([case], ROWS, rounds, meter)["scenes"][0]["rows"]
    return [float(row["median"]) for row in rows]


def main() -> None:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5, help="renders of each row [5]")
    parser.add_argument("--effects", nargs="*", help="these only")
    given = parser.parse_args()
    meter = MeteredRuntime(choose_device())
    print("| effect | scene | exact time: without, with | point samples: without, with |")
    print("|---|---|---|---|")
    whole: dict[str, list[float]] = {}
    for effect, name in scenes_of_effects().items():
        if given.effects and effect not in given.effects:
            continue
        case = case_of(name)
        if name not in whole:
            whole[name] = seconds(case, given.rounds, meter)
        without = replace(case, scene=SWITCHES[effect][1](case.scene, case.frame))
        cells = [
            f"{off:.3f}, {on:.3f} s: x {on / off:.2f}"
            for off, on in zip(seconds(without, given.rounds, meter), whole[name], strict=True)
        ]
        print(f"| {effect} | {name} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
