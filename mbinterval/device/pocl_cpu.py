"""Make PoCL 3.0 compile for the CPU that its kernel library was built for, where it does not.

The PoCL 3.0 that installs with pyopencl asks LLVM 14, which is older than many CPUs in use, for the
CPU's name, and compiles kernels for that. Its built-ins (fma, fabs, select ...) come from one of
eight kernel libraries, chosen by the CPU's instructions and each compiled for a CPU of its own. The
two may not go together:

- a CPU that LLVM 14 does not know (AMD Zen 5) is "generic", for which clang compiles nothing;
- one that it takes for a narrower CPU (AMD Zen 4, with AVX-512, for "znver3", without), or for a
  wider one (a Xeon whose AVX-512 a hypervisor hides), passes vectors to the built-ins in other
  registers than they take them from: LLVM aborts the process;
- one whose name stands for fewer instructions of some kind (AMD Zen 1 to 3, Alder Lake, Rocket
  Lake) gets built-ins that are called and not inlined, at three to ten times an operator's cost:
  renders take 1.1 to 2 times as long, 1.25 to 1.33 in the mean of seventeen.

PoCL 3.1 names the CPU after the library (pocl_get_distro_cpu_name in lib/CL/pocl_llvm_utils.cc) and
is left alone. On these CPUs this module does the same to a loaded 3.0: it finds the CPU's name in
the device's record by its neighbour, the target triple, and points it at the library's. Memory is
inspected through /proc/self/mem, where a wrong guess is an error code and not a crash.

``MBINTERVAL_POCL_CPU`` gives a name, which must be one that works; empty, it leaves PoCL 3.0 alone.
"""

from __future__ import annotations

import ctypes
import itertools
import logging
import os
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mbinterval.errors import DeviceError

_log = logging.getLogger(__name__)

SWITCH = "MBINTERVAL_POCL_CPU"
"""Variable of the environment with LLVM's name of the CPU that PoCL 3.0 compiles for."""

_TRIPLE = "x86_64-unknown-linux-gnu"
_RECORD_BYTES = 2048


@dataclass(frozen=True)
class _Library:
    """A kernel library of PoCL 3.0, named for the CPU that it was compiled for.

    ``lanes`` floats fill a register, ``needs`` are flags of /proc/cpuinfo beside that, and
    ``alike`` are CPUs of LLVM 14 for which the library's functions are inlined as well: measured.
    """

    cpu: str
    lanes: int
    needs: str = ""
    alike: str = ""


_LIBRARIES = (
    _Library("skylake-avx512", 16,
             alike="cascadelake cooperlake icelake-server sapphirerapids tigerlake"),
    _Library("haswell", 8, "avx2 fma bmi1 bmi2 f16c abm popcnt cx16", "broadwell skylake"),
    _Library("bdver1", 8, "xop fma4 popcnt cx16", "bdver2 bdver3"),
    _Library("ivybridge", 8, "f16c popcnt cx16"),
    _Library("sandybridge", 8),
    _Library("penryn", 4, "sse4_1 cx16",
             "goldmont goldmont-plus nehalem silvermont tremont westmere"),
    _Library("core2", 4, "ssse3 cx16", "bonnell btver1"),
    _Library("athlon64", 4, alike="amdfam10 barcelona k8 k8-sse3 opteron"),
)  # fmt: skip
"""The best first, as PoCL chooses."""

_WIDE = {
    16: "cannonlake icelake-client knl knm rocketlake",
    8: "alderlake bdver4 btver2 znver1 znver2 znver3",
}
"""What else LLVM 14 calls CPUs with these many lanes."""

_names: dict[str, ctypes.Array[ctypes.c_char]] = {}
"""Names handed to PoCL; it keeps the pointers as long as the process lives."""


def name_cpu(device: Any) -> str | None:
    """Give PoCL 3.0's ``device`` a CPU name that it can compile for, if its own is none.

    Returns the name that was given; None where PoCL keeps its own, and for every other device.

    Raises
    ------
    DeviceError
        ``MBINTERVAL_POCL_CPU`` is a name that does not go with PoCL's kernel library, or is empty
        where PoCL's own does not; or a name is needed and cannot be given.
    """
    version = device.platform.version
    if "PoCL 3.0" not in version or "DISTRO" not in version:
        return None
    key = device.int_ptr, os.environ.get(SWITCH)
    if key not in _known:
        _known[key] = _name(device, key[1])
    return _known[key]


_known: dict[tuple[int, str | None], str | None] = {}
"""What a device was named, by its record, which PoCL keeps as long as the process lives."""


def _name(device: Any, wanted: str | None) -> str | None:
    libraries = _libraries(device)
    if not libraries:
        return None
    own = device.version.partition(f"{_TRIPLE}-")[2].strip()
    name = _chosen(own, wanted, libraries)
    if name is not None and not _write(device.int_ptr, name):
        if own not in _working(own, libraries):
            raise DeviceError(
                f"PoCL 3.0 takes this CPU for {own!r}, with which its kernel library does not go, "
                f"and cannot be told that it is {name!r}; install a newer PoCL (Debian: "
                "pocl-opencl-icd)"
            )
        return None
    return name


def _chosen(own: str, wanted: str | None, libraries: list[_Library]) -> str | None:
    """The name to give a CPU that PoCL calls ``own``, or None where that is to stay."""
    if wanted is None:
        inlined = any(own in (entry.cpu, *entry.alike.split()) for entry in libraries)
        return None if inlined else libraries[0].cpu
    working = _working(own, libraries)
    if (wanted or own) not in working:
        name = (
            f"{SWITCH}={wanted!r}, a CPU that" if wanted
            else f"{SWITCH} is empty, and PoCL's own {own!r} for this CPU"
        )  # fmt: skip
        raise DeviceError(
            f"{name} does not go with PoCL's kernel library; these do: {', '.join(working)}; unset "
            "the variable to have the best"
        )
    return wanted or None


def _libraries(device: Any) -> list[_Library]:
    """The kernel libraries that can be the device's, and run on it, the best first.

    PoCL has looked at the CPU itself, and tells how wide registers are and whether there is a
    fused multiply-add; an emulator may leave /proc/cpuinfo as it is outside.
    """
    import pyopencl as cl

    flags = _cpuinfo_flags()
    if not device.single_fp_config & cl.device_fp_config.FMA:
        flags -= {"fma", "fma4"}
    lanes = device.native_vector_width_float
    return [
        entry
        for entry in _LIBRARIES
        if entry.lanes == lanes and flags.issuperset(entry.needs.split())
    ]


def _working(own: str, libraries: list[_Library]) -> list[str]:
    """Names that pass vectors to the library as it takes them, and that the CPU can run."""
    names = [entry.cpu for entry in libraries]
    lanes = libraries[0].lanes
    known = {n for e in _LIBRARIES if e.lanes == lanes for n in (e.cpu, *e.alike.split())}
    fits = own in known or own in _WIDE.get(lanes, "").split()
    return names if own in names or not fits else [*names, own]


def _cpuinfo_flags() -> set[str]:
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="ascii", errors="replace")
    except OSError:
        return set()
    for line in text.splitlines():
        if line.startswith("flags"):
            return set(line.partition(":")[2].split())
    return set()


def _write(record: int, name: str) -> bool:
    """Give the device with this record the name; False where the record is not as expected."""
    try:
        slot = _cpu_slot(record)
    except OSError as error:
        _log.debug("PoCL's device record cannot be inspected: %s", error)
        return False
    if slot is None:
        _log.debug("PoCL's device record does not look as expected; CPU name left alone")
        return False
    if name not in _names:
        _names[name] = ctypes.create_string_buffer(name.encode())
    ctypes.c_void_p.from_address(slot).value = ctypes.addressof(_names[name])
    return True


def _cpu_slot(record: int) -> int | None:
    """Address of the pointer to the CPU's name in the device record, or None."""
    with open("/proc/self/mem", "rb", buffering=0) as memory:

        def read(address: int, size: int) -> bytes:
            memory.seek(address)
            return memory.read(size)

        text = read(record, _RECORD_BYTES)
        words = struct.unpack_from(f"<{len(text) // 8}Q", text)
        for index, (triple, cpu) in enumerate(itertools.pairwise(words)):
            try:
                if (
                    0x1000 < triple < 1 << 47
                    and 0x1000 < cpu < 1 << 47
                    and read(triple, len(_TRIPLE) + 1) == _TRIPLE.encode() + b"\0"
                    and _looks_like_name(read(cpu, 32))
                ):
                    return record + 8 * (index + 1)
            except OSError:
                continue
    return None


def _looks_like_name(text: bytes) -> bool:
    name, end, _ = text.partition(b"\0")
    return bool(end) and len(name) > 2 and all(c in b"-_0123456789" or 97 <= c < 123 for c in name)
