"""Cases that ``.ci/nightly`` alone tries, of tests whose other cases run each time.

A kernel takes two seconds to build. So of what is checked with many settings, each of which is
compiled in, a few run each time, and all of them at night.
"""

from collections.abc import Iterable
from typing import Any

import pytest


def nightly(*values: Any) -> Any:
    """A case of a parametrized test, for the night alone."""
    return pytest.param(*values, marks=pytest.mark.nightly)


def nightly_but(values: Iterable[Any], *daily: Any) -> list[Any]:
    """Cases with one value each; those named as ``daily`` run each time."""
    values = list(values)
    assert set(daily) <= set(values)
    return [value if value in daily else nightly(value) for value in values]
