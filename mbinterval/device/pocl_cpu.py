"""Make PoCL 3.0 compile for the CPU that its kernel library was built for.

The PoCL 3.0 that installs with pyopencl names the CPU by asking LLVM 14, which is older than
many CPUs in use. Two things go wrong. On a CPU that LLVM 14 does not know (AMD Zen 5, for one)
the name is "generic", which clang refuses: no kernel builds at all. On one that it does know the
name differs from the one that the kernel library was compiled for, and then LLVM does not inline
the built-ins (fma, fabs, select ... cost three to ten times an operator).

PoCL 3.1 mends both by naming the CPU after the library (pocl_get_distro_cpu_name in
lib/CL/pocl_llvm_utils.cc). This module does the same to a loaded 3.0: it finds the CPU's name in
the device's record by its neighbour, the target triple, and points it at the right name. Memory
is inspected through /proc/self/mem, where a wrong guess is an error code and not a crash.
``MBINTERVAL_POCL_CPU`` gives another LLVM CPU name; empty, it leaves PoCL alone.
"""

from __future__ import annotations

import ctypes
import itertools
import logging
import os
import struct
from pathlib import Path
from typing import Any

_log = logging.getLogger(__name__)

_TRIPLE = b"x86_64-unknown-linux-gnu"
_RECORD_BYTES = 2048
_LIBRARIES: tuple[tuple[str, frozenset[str]], ...] = (
    ("skylake-avx512", frozenset({"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"})),
    ("haswell", frozenset({"avx2", "fma", "bmi1", "bmi2", "f16c", "abm", "popcnt", "cx16"})),
    ("sandybridge", frozenset({"avx", "popcnt", "cx16"})),
    ("core2", frozenset({"ssse3", "cx16"})),
)
_names: dict[str, ctypes.Array[ctypes.c_char]] = {}
"""Names handed to PoCL; it keeps the pointers as long as the process lives."""


def name_cpu(device: Any) -> str | None:
    """Give PoCL 3.0's ``device`` a CPU name that it can compile for; returns the name if set."""
    version = device.platform.version
    if "PoCL 3.0" not in version or "DISTRO" not in version:
        return None
    name = os.environ.get("MBINTERVAL_POCL_CPU", _library_cpu())
    if not name:
        return None
    try:
        slot = _cpu_slot(device.int_ptr)
    except OSError as error:
        _log.debug("PoCL's device record cannot be inspected: %s", error)
        return None
    if slot is None:
        _log.debug("PoCL's device record does not look as expected; CPU name left alone")
        return None
    if name not in _names:
        _names[name] = ctypes.create_string_buffer(name.encode())
    ctypes.c_void_p.from_address(slot).value = ctypes.addressof(_names[name])
    return name


def _library_cpu() -> str | None:
    """Return the CPU that PoCL's best kernel library for this machine was compiled for."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="ascii", errors="replace")
    except OSError:
        return None
    for line in text.splitlines():
        if line.startswith("flags"):
            flags = set(line.partition(":")[2].split())
            return next((cpu for cpu, needed in _LIBRARIES if needed <= flags), None)
    return None


def _cpu_slot(record: int) -> int | None:
    """Address of the pointer to the CPU's name in the device record, or None."""
    with open("/proc/self/mem", "rb", buffering=0) as memory:

        def read(address: int, size: int) -> bytes:
            memory.seek(address)
            return memory.read(size)

        words = struct.unpack(f"<{_RECORD_BYTES // 8}Q", read(record, _RECORD_BYTES))
        for index, (triple, cpu) in enumerate(itertools.pairwise(words)):
            try:
                if (
                    0x1000 < triple < 1 << 47
                    and 0x1000 < cpu < 1 << 47
                    and read(triple, len(_TRIPLE) + 1) == _TRIPLE + b"\0"
                    and _looks_like_name(read(cpu, 32))
                ):
                    return record + 8 * (index + 1)
            except OSError:
                continue
    return None


def _looks_like_name(text: bytes) -> bool:
    name, end, _ = text.partition(b"\0")
    return bool(end) and len(name) > 2 and all(c in b"-_0123456789" or 97 <= c < 123 for c in name)
