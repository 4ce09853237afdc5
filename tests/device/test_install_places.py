"""The package works in every folder that an environment can be in, and finds its kernels there."""

from __future__ import annotations

import importlib.util
import os
import shutil
from pathlib import Path

import pytest
from support.processes import ROOT, python, renderer

from mbinterval.device.sources import kernel_root, source_digest

PLACES = [
    b"my venv #1", b"it's \"100%d\"", b"a;b&c $HOME `id` \\", b" -I", "größe 車".encode(), b"\xff",
]  # fmt: skip


def installed(name: str) -> Path:
    spec = importlib.util.find_spec(name)
    assert spec is not None
    assert spec.origin is not None
    return Path(spec.origin).parent


def copy(source: Path, target: Path) -> None:
    def link(one: str, other: str) -> None:
        try:
            os.link(one, other)
        except OSError:  # another file system
            shutil.copy2(one, other)

    shutil.copytree(source, target, copy_function=link, symlinks=True)


@pytest.mark.parametrize("name", PLACES)
def test_it_renders_wherever_it_and_its_opencl_are_installed(tmp_path, name):
    place = tmp_path / os.fsdecode(name) / "site-packages"
    copy(ROOT / "mbinterval", place / "mbinterval")
    copy(kernel_root(), place / "mbinterval" / "cl")
    for package in ("pyopencl", "pocl_binary_distribution"):
        if importlib.util.find_spec(package):
            copy(installed(package), place / package)
    code = "import mbinterval; print(ascii(mbinterval.__file__))"
    where = python("-c", code, path=(place,), cwd=tmp_path)
    assert where.stdout.strip() == ascii(str(place / "mbinterval" / "__init__.py"))
    run = renderer(tmp_path)(path=(place,), cwd=tmp_path)
    if python("-c", "import pyopencl", path=(place,), cwd=tmp_path).returncode:
        assert name == b"\xff"  # which newer Pythons take no extension modules from
        assert run.returncode == 4
        assert "not UTF-8; install it in another place" in run.stderr
        return
    assert (run.returncode, run.stderr) == (0, "")
    assert (tmp_path / "film.exr").stat().st_size > 1000


def test_a_programs_digest_is_of_all_that_it_includes_and_of_nothing_else(tmp_path):
    from mbinterval.device import sources

    copied = shutil.copytree(kernel_root(), tmp_path / "cl")
    file = '#include "analytic/resolve.cl"'
    assert source_digest(file) == source_digest(file) != source_digest(file + " ")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sources, "kernel_root", lambda: copied)
        kept = source_digest(file)
        (copied / "stochastic" / "trace.h").write_text("// not included")
        assert source_digest(file) == kept
        header = copied / "shared" / "records.h"
        header.write_text(header.read_text() + "\n")
        assert source_digest(file) != kept
    assert source_digest(file) == kept
