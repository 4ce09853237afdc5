"""Stretches of time without a gap, of which masks with partial bits lose none that they meet."""

from __future__ import annotations

import numpy as np


def stretches(times: np.ndarray) -> np.ndarray:
    """Ends ``(n, 2)`` of what intervals ``(m, 2)`` cover together; those that touch are one."""
    found: list[list[float]] = []
    for start, end in times[np.argsort(times[:, 0], kind="stable")]:
        if found and start <= found[-1][1]:
            found[-1][1] = max(found[-1][1], end)
        else:
            found.append([start, end])
    return np.array(found).reshape(-1, 2)


def light_of_bits(times: np.ndarray, bits: int) -> float:
    """The length of the stretches that hold a bit's centre: all that a mask sees anything of."""
    whole = stretches(times)
    first = np.ceil(whole[:, 0] * bits - 0.5)
    held = (first + 0.5) / bits < whole[:, 1]
    return float(np.diff(whole[held]).sum())
