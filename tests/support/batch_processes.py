"""Batches in processes of their own: their scene, their start, and their end."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
SCENE = """
[camera]
position = [0, 0, 4]
look_at = [0, 0, 0]
[[lights]]
kind = "ambient"
[[objects]]
primitive = { kind = "sphere", radius = 1 }
transform.keys = [{ frame = 0, translation = [-1, 0, 0] }, { frame = 9, translation = [1, 0, 0] }]
"""
OPTIONS = ("--frames", "1-6", "--width", "160", "--height", "120", "-o", "a.####.exr,a.####.png")
RUN = """
import sys
from mbinterval import cli
{}
sys.exit(cli.main(["render", "s.toml", *sys.argv[1:]]))
"""


def start(folder, *arguments, before="", **options):
    """Start ``mbinterval render`` in ``folder``, after the Python code ``before``."""
    (folder / "s.toml").write_text(SCENE)
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}
    command = [sys.executable, "-c", RUN.format(before), *OPTIONS, *arguments]
    return subprocess.Popen(
        command, cwd=folder, env=environment, text=True, stderr=subprocess.PIPE, **options
    )


def finish(process):
    """Exit code, and what was said."""
    _, said = process.communicate(timeout=600)
    return process.returncode, said


def images(folder):
    return {path.name: path.read_bytes() for path in sorted(folder.glob("a.*"))}
