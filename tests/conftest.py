"""What all tests share: their environment, the folder beside the checkout, and their order."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

SHARED = Path(__file__).resolve().parents[2] / "shared"
"""Benchmarks and larger models, which are no part of the repository."""

LONG = (
    *("witness", "witness_kinds"),
    *("packaging", "shadows", "stochastic_culling", "mirrors", "transparency", "exact_films"),
    *("environment", "aovs", "stochastic_agreement", "all_effects", "shutter_lens", "study"),
    *("transparency_stochastic", "glossy_mirrors", "hypothesis_scenes", "farm", "recommend"),
)
"""Files that take longest: workers begin with them, so that none of them ends alone."""

# Each worker has a core; set before NumPy is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

for name in [name for name in os.environ if name.startswith(("MBINTERVAL_", "PYOPENCL_CTX"))]:
    del os.environ[name]  # what a user has chosen is not what tests expect


@pytest.fixture
def shared_file() -> Callable[[str], Path]:
    """Path of a file in ``../shared``; the test skips where it isn't there."""

    def find(name: str) -> Path:
        if not (SHARED / name).exists():
            pytest.skip(f"needs ../shared/{name}, which is not beside this checkout")
        return SHARED / name

    return find


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if "shared_file" in getattr(item, "fixturenames", ()):
            item.add_marker("shared")
    names = [f"test_{name}" for name in LONG]
    items.sort(key=lambda item: names.index(item.path.stem) if item.path.stem in names else 99)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: Any, log: Any) -> Any:
    from xdist.scheduler import LoadScopeScheduling

    class ByFile(LoadScopeScheduling):
        """By file, whose tests share what is made once; Oclgrind's, each a process, one by one."""

        def _split_scope(self, nodeid: str) -> str:
            file = nodeid.split("::")[0]
            return nodeid if file.endswith("test_oclgrind.py") else file

    config.option.loadscopereorder = False  # which is by how many tests a file has
    return ByFile(config, log)
