"""The linker that PoCL needs to make a kernel executable, and would end the process without."""

from __future__ import annotations

import importlib.util
import os
import shlex
import shutil
import sys
from pathlib import Path

_OTHERS = ("ld.lld", "ld.bfd", "ld.gold", "ld.mold", "mold")
"""Linkers that take ``ld``'s options."""


def provide_linker(folder: Path) -> str:
    """See to it that PoCL finds a linker; return why it can't, and the remedy, or the empty text.

    ``ld`` on the path is used as it is. Otherwise ``folder`` is made, with a program ``ld`` that
    starts another linker, or that of Zig's package ``ziglang``, and clang, of which PoCL consists,
    is told of it by ``COMPILER_PATH``; the search path of this process stays as it is.
    """
    if shutil.which("ld"):
        return ""
    command = _other_linker()
    if not command:
        return (
            "PoCL needs a linker to make its kernels executable, and none (ld, ld.lld) is on the "
            "path; install one: 'apt install binutils' (Debian, Ubuntu), 'dnf install binutils' "
            "(Fedora), or, without root, 'pip install ziglang' (400 MB)"
        )
    program = folder / "ld"
    folder.mkdir(parents=True, exist_ok=True)
    program.write_text(f'#!/bin/sh\nexec {shlex.join(command)} "$@"\n', encoding="utf-8")
    program.chmod(0o700)
    paths = [str(folder), *filter(None, [os.environ.get("COMPILER_PATH")])]
    os.environ["COMPILER_PATH"] = os.pathsep.join(paths)
    return ""


def _other_linker() -> list[str]:
    for name in _OTHERS:
        found = shutil.which(name)
        if found:
            return [found]
    if importlib.util.find_spec("ziglang"):
        return [sys.executable, "-m", "ziglang", "ld.lld"]
    return []
