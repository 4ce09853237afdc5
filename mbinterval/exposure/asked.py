"""How finely motion is to be cut."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Asked:
    """How finely motion is to be cut.

    ``segments`` in each stretch, or None for as few as leave ``error`` pixels, at most ``most``.
    What is there at ``moment`` of the shutter, if one is given, is met exactly.
    """

    segments: int | None = None
    error: float = math.inf
    most: int = 128
    moment: float | None = None

    @property
    def moments(self) -> tuple[float, ...]:
        """The moment, if there is one, as float32 holds it."""
        return () if self.moment is None else (float(np.float32(self.moment)),)


AS_FEW = Asked()
"""One segment between keys that are told of, whatever that leaves."""
