"""Workers of pytest-xdist take tests by file: what a file's tests share is made once."""

from __future__ import annotations

from typing import Any

import pytest


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: Any, log: Any) -> Any:
    from xdist.scheduler import LoadScopeScheduling

    class ByFile(LoadScopeScheduling):
        """Only Oclgrind's tests, each a process of its own, are taken one by one."""

        def _split_scope(self, nodeid: str) -> str:
            file = nodeid.split("::")[0]
            return nodeid if file.endswith("test_oclgrind.py") else file

    return ByFile(config, log)
