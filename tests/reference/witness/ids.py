"""IDs of names as Cryptomatte 1.2 has them: MurmurHash3 (x86, 32 bits, seed 0) as a float."""

from __future__ import annotations

import numpy as np


def name_id(name: str) -> float:
    data, value, mask = name.encode(), 0, 0xFFFFFFFF

    def turned(x: int, by: int) -> int:
        return ((x << by) | (x >> (32 - by))) & mask

    def mixed(word: int) -> int:
        return turned(word * 0xCC9E2D51 & mask, 15) * 0x1B873593 & mask

    whole = len(data) // 4 * 4
    for at in range(0, whole, 4):
        value = turned(value ^ mixed(int.from_bytes(data[at : at + 4], "little")), 13)
        value = (value * 5 + 0xE6546B64) & mask
    if data[whole:]:
        value ^= mixed(int.from_bytes(data[whole:], "little"))
    value ^= len(data)
    for shift, factor in ((16, 0x85EBCA6B), (13, 0xC2B2AE35)):
        value = (value ^ value >> shift) * factor & mask
    value ^= value >> 16
    if (value >> 23) & 0xFF in (0, 0xFF):
        value ^= 1 << 23
    return float(np.uint32(value).view(np.float32))
