"""How finely motion is to be cut."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, eq=False)
class Asked:
    """How finely motion is to be cut.

    ``segments`` in each stretch, or None for as few as leave ``error`` pixels, at most ``most``.
    What is there at ``moment`` is met exactly.
    """

    segments: int | None
    error: float
    most: int
    moment: float
