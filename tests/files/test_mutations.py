"""Broken scenes, models and images give a render or a clear error: no crash, hang or half file.

``MB_MUTATIONS=1000 pytest tests/files/test_mutations.py`` tries so many; some are tried always.
Warnings are errors there. A crash is one of usd-core on a binary USD file, whose memory is that of
this process: it leaves no file, and is counted.
"""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest
from support import mutations
from support.mutation_runner import LIMIT

from mbinterval.film.film import Film

ROOT = Path(__file__).parents[2]
COUNT = int(os.environ.get("MB_MUTATIONS", "60"))
REFUSED = {2, 3, 5}
"""Exit codes for bad settings, a bad scene, and one that is too large."""
CRASHES = {-signal.SIGSEGV, -signal.SIGBUS, -signal.SIGABRT}
SOURCES = {
    "scene": lambda _: mutations.scene_sources(),
    "gltf": mutations.gltf_sources,
    "usd": mutations.usd_sources,
    "image": mutations.image_sources,
    "mesh": mutations.mesh_sources,
}


@dataclass(frozen=True)
class Outcome:
    """What a mutant did: an exit code, or less than 0 for the signal that ended the process."""

    code: int
    said: str
    seconds: float


def outcomes(mutants: list[mutations.Mutant], folder: Path) -> list[Outcome]:
    """Render ``mutants`` in processes of their own, a new one after each that crashed."""
    for number, mutant in enumerate(mutants):
        mutant.write(folder / str(number))
    found: list[Outcome] = []
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}
    while len(found) < len(mutants):
        names = [
            text
            for number in range(len(found), len(mutants))
            for text in (str(folder / str(number)), mutants[number].scene)
        ]
        command = [
            sys.executable,
            "-W",
            "error",
            str(ROOT / "tests" / "support" / "mutation_runner.py"),
            *names,
        ]
        with (folder / "said").open("w") as said:
            ended = subprocess.run(
                command, env=environment, stdout=subprocess.PIPE, stderr=said, text=True
            )
        found += [Outcome(**json.loads(line)) for line in ended.stdout.splitlines()]
        if ended.returncode:
            tail = (folder / "said").read_text(errors="replace")[-2000:]
            found.append(Outcome(min(-1, ended.returncode), tail, LIMIT))
    return found


def wrong(mutant: mutations.Mutant, outcome: Outcome, folder: Path) -> str:
    """What is wrong with an outcome; empty where nothing is."""
    left = {path.name for path in folder.iterdir()} - {*mutant.files, "assets"}
    if outcome.code == 0:
        if left != {"out.exr"}:
            return f"leaves {left}"
        film = Film.read(folder / "out.exr")
        return "" if film.rgba.shape == (16, 24, 4) else f"is of shape {film.rgba.shape}"
    if outcome.code in CRASHES and mutant.broken.endswith((".usdc", ".usdz")) and not left:
        return ""
    if outcome.code not in REFUSED:
        return f"ends with {outcome.code}: {outcome.said[-3000:]}"
    if left:
        return f"fails and leaves {left}"
    message = outcome.said.rpartition("mbinterval: error: ")[2]
    if outcome.code == 3 and not message.startswith((mutant.scene, mutant.broken)):
        return f"does not name the file: {message}"
    if not mutant.label.startswith(("usd", "mesh")) and re.search(r"[a-z]Error\b", message):
        return f"speaks of Python: {message}"  # other projects' parsers may
    return "" if len(message) < 3000 else f"says too much: {message}"


@pytest.mark.parametrize("kind", SOURCES)
def test_what_is_broken_is_rendered_or_refused(kind, tmp_path):
    (tmp_path / "sources").mkdir()
    sources = SOURCES[kind](tmp_path / "sources")
    count = COUNT // len(SOURCES)
    mutants = [mutations.mutant(sources, kind, number) for number in range(count)]
    found = outcomes(mutants, tmp_path)
    problems = [
        f"{mutant.label}: {text}"
        for number, (mutant, outcome) in enumerate(zip(mutants, found, strict=True))
        if (text := wrong(mutant, outcome, tmp_path / str(number)))
    ]
    assert not problems, "\n\n".join(problems)
    codes = [outcome.code for outcome in found]
    assert 0 < codes.count(0) < count
    assert sum(code in CRASHES for code in codes) <= count // 100
