"""Programs in processes of their own, in which OpenCL starts anew."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]

BOX = """
[camera]
position = [0, 0, 4]
look_at = [0, 0, 0]
[[objects]]
name = "plate"
primitive = { kind = "plane", size = [1, 1] }
material = { shading = "unlit" }
[objects.transform]
keys = [ { frame = 0, translation = [-1, 0, 0] }, { frame = 2, translation = [1, 0, 0] } ]
[render]
width = 32
height = 24
frames = "1"
"""
"""A scene that asks little of the kernels' compiler."""

Run = subprocess.CompletedProcess[str]


def python(*arguments: object, path: tuple[Path, ...] = (), **options: Any) -> Run:
    """Run Python; ``environment`` changes variables (None removes one), ``path`` comes first."""
    changes = options.pop("environment", {})
    given = os.environ | {k: v for k, v in changes.items() if v is not None}
    environment = {k: v for k, v in given.items() if changes.get(k, "") is not None}
    places = [*map(str, path), str(ROOT), str(ROOT / "tests"), os.environ.get("PYTHONPATH", "")]
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, places))
    given_options = {"capture_output": True, "text": True, "timeout": 180, "check": False}
    command = [sys.executable, *map(str, arguments)]
    return subprocess.run(command, env=environment, **(given_options | options))


def mbinterval(*arguments: object, **options: Any) -> Run:
    """Run the command line."""
    return python("-m", "mbinterval", *arguments, **options)


def renderer(folder: Path) -> Callable[..., Run]:
    """Write a scene into ``folder``; returns what renders it there, to ``film.exr``."""
    (folder / "box.toml").write_text(BOX)

    def render(*arguments: object, **options: Any) -> Run:
        given = ("--samples", 1, "--overwrite", "-q", "-o", folder / "film.exr")
        return mbinterval("render", folder / "box.toml", *given, *arguments, **options)

    return render
