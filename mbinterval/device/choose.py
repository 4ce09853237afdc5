"""Choose an OpenCL device, and explain it where there is none."""

from __future__ import annotations

import os
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mbinterval.device.pocl_cpu import name_cpu
from mbinterval.errors import DeviceError

_POCL = "Portable Computing Language"
_POCL_THREADS = ("POCL_MAX_PTHREAD_COUNT", "POCL_CPU_MAX_CU_COUNT")  # before PoCL 5, and since
_KERNEL_BYTES = 1 << 20  # of a program in PoCL's cache, more or less
THREADS = "MBINTERVAL_THREADS"
"""Variable of the environment that limits the threads of CPU devices."""


@dataclass(frozen=True)
class DeviceDescription:
    """One device as ``mbinterval devices`` lists it; ``index`` selects it."""

    index: int
    name: str
    platform: str
    version: str
    kind: str
    compute_units: int
    memory_bytes: int
    usable: bool


def devices() -> list[DeviceDescription]:
    """List all OpenCL devices, in the order in which an index selects them."""
    return [
        DeviceDescription(
            index=index,
            name=device.name.strip(),
            platform=device.platform.name.strip(),
            version=device.platform.version.strip(),
            kind=_kind(device),
            compute_units=device.max_compute_units,
            memory_bytes=device.global_mem_size,
            usable=bool(device.double_fp_config),
        )
        for index, device in enumerate(_all_devices())
    ]


def choose_device(wanted: Any = None) -> Any:
    """Return a ``pyopencl.Device``.

    Parameters
    ----------
    wanted
        A ``pyopencl.Device``; an index into ``devices()``; part of a device's or platform's name
        (any case); or None: ``MBINTERVAL_DEVICE`` if set (index or name), else ``PYOPENCL_CTX``
        as pyopencl reads it, else the CPU device of PoCL, else the first usable device.

    Raises
    ------
    DeviceError
        No device, none that fits, one without double precision, or a CPU with more threads than
        ``MBINTERVAL_THREADS``, if that is set, allows.
    """
    import pyopencl as cl

    if isinstance(wanted, cl.Device):
        return _checked(wanted)
    if wanted is not None and (isinstance(wanted, bool) or not isinstance(wanted, str | int)):
        raise DeviceError(
            f"device={wanted!r}: expected a pyopencl.Device, an index, or part of a name"
        )
    if wanted is None or wanted == "":
        wanted = os.environ.get("MBINTERVAL_DEVICE") or None
    if wanted is None and os.environ.get("PYOPENCL_CTX"):
        return _checked(_from_pyopencl_ctx())
    found = _all_devices()
    if not found:
        raise DeviceError(_why_none())
    if wanted is None:
        usable = [device for device in found if device.double_fp_config]
        pocl = [device for device in usable if _POCL in device.platform.name]
        return _checked((pocl or usable or found)[0])
    text = str(wanted).strip()
    if text.isdigit():
        if int(text) >= len(found):
            count = "there is 1, index 0" if len(found) == 1 else f"there are {len(found)}"
            raise DeviceError(f"device {text}: {count}; see 'mbinterval devices'")
        return _checked(found[int(text)])
    for device in found:
        if text.lower() in f"{device.platform.name} {device.name}".lower():
            return _checked(device)
    names = ", ".join(f"{index}: {device.name.strip()}" for index, device in enumerate(found))
    are = "the only device is" if len(found) == 1 else "the devices are"
    raise DeviceError(f"no device is called {text!r}; {are} {names}")


def choose_devices(wanted: str) -> tuple[Any, ...]:
    """Return the devices that ``wanted`` names with commas between them; ``all`` usable ones.

    Each is an index or a part of a name, as for `choose_device`; none is taken twice.

    Raises
    ------
    DeviceError
        As `choose_device`.
    """
    if wanted.strip().lower() == "all":
        found = [choose_device(device.index) for device in devices() if device.usable]
        return tuple(found) or (choose_device(),)
    named = [choose_device(name.strip()) for name in wanted.split(",")]
    return tuple({device.int_ptr: device for device in named}.values())


def _all_devices() -> list[Any]:
    import pyopencl as cl

    _limit_threads()
    try:
        platforms = cl.get_platforms()
    except cl.Error:
        return []
    found = []
    for platform in platforms:
        try:
            found += platform.get_devices()
        except cl.Error:
            continue
    return found


def _from_pyopencl_ctx() -> Any:
    import pyopencl as cl

    _limit_threads()
    try:
        return cl.create_some_context(interactive=False).devices[0]
    except (cl.Error, RuntimeError, ValueError) as error:
        value = os.environ["PYOPENCL_CTX"]
        raise DeviceError(f"PYOPENCL_CTX={value!r} selects no device: {error}") from None


def _checked(device: Any) -> Any:
    if not device.double_fp_config:
        raise DeviceError(
            f"device {device.name.strip()!r} has no double precision, which exact times need; "
            "choose another with --device (see 'mbinterval devices')"
        )
    most = _most_threads()
    if most and _kind(device) == "CPU" and device.max_compute_units > most:
        raise DeviceError(
            f"device {device.name.strip()!r} uses {device.max_compute_units} threads and can't be "
            f"held to {most}: only PoCL can, and only before it has started"
        )
    if _POCL in device.platform.name:
        name_cpu(device)
    return device


def _most_threads() -> int | None:
    text = os.environ.get(THREADS)
    if not text:
        return None
    if not text.isdecimal() or int(text) < 1:
        raise DeviceError(f"{THREADS}={text!r}: expected a whole number from 1 up")
    return int(text)


def _limit_threads() -> None:
    """Tell PoCL, which looks once when it starts, how many threads it may use."""
    most = _most_threads()
    for name in _POCL_THREADS if most else ():
        os.environ[name] = str(most)


def _kind(device: Any) -> str:
    import pyopencl as cl

    if device.type & cl.device_type.CPU:
        return "CPU"
    return "GPU" if device.type & cl.device_type.GPU else "other"


def _why_none() -> str:
    """Explain why no device was found, as far as it can be known."""
    import pyopencl as cl

    cache = pocl_cache_folder()
    try:
        names = [platform.name for platform in cl.get_platforms()]
    except cl.Error:
        names = []
    if any(_POCL in name for name in names):
        cannot = "cannot be written" if not _writable(cache) else "may not be usable"
        return (
            f"PoCL offers no device: its kernel cache {cache} {cannot}; make it writable, or set "
            "POCL_CACHE_DIR to a folder that is"
        )
    platforms = f" (platforms: {', '.join(names)})" if names else ""
    return f"no OpenCL device was found{platforms}; install one with: pip install 'pyopencl[pocl]'"


def cache_trouble(device: Any) -> str:
    """Say what keeps PoCL from building kernels, if its cache does; else the empty text."""
    cache = pocl_cache_folder()
    if _POCL not in device.platform.name or _writable(cache):
        return ""
    return (
        f"; PoCL's kernel cache {cache} cannot be written, or its disk is full: make room, or set "
        "POCL_CACHE_DIR to a folder that can be"
    )


def pocl_cache_folder() -> Path:
    """Return the folder in which PoCL keeps compiled kernels."""
    if "POCL_CACHE_DIR" in os.environ:
        return Path(os.environ["POCL_CACHE_DIR"])
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "pocl" / "kcache"


def _writable(folder: Path) -> bool:
    """Whether a file can be written there: permission bits say nothing to root, nor of room."""
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(bytes(_KERNEL_BYTES))
            file.flush()
            return True
    except OSError:
        return False
