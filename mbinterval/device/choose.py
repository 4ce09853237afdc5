"""Choose an OpenCL device, and explain it where there is none."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any

from mbinterval.device.opencl import most_threads, opencl, start
from mbinterval.device.pocl_cpu import name_cpu
from mbinterval.device.programs import POCL
from mbinterval.errors import DeviceError


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
    cl = opencl()
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
        pocl = [device for device in usable if POCL in device.platform.name]
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
    cl = opencl()
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
    cl = opencl()
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
    most = most_threads()
    if most and _kind(device) == "CPU" and device.max_compute_units > most:
        raise DeviceError(
            f"device {device.name.strip()!r} uses {device.max_compute_units} threads and can't be "
            f"held to {most}: only PoCL can, and only before it has started"
        )
    if POCL in device.platform.name:
        if start().trouble:
            raise DeviceError(start().trouble)
        name_cpu(device)
    return device


def _kind(device: Any) -> str:
    cl = opencl()
    if device.type & cl.device_type.CPU:
        return "CPU"
    return "GPU" if device.type & cl.device_type.GPU else "other"


def _why_none() -> str:
    """Explain why no device was found, as far as it can be known."""
    cl = opencl()
    try:
        names = [platform.name for platform in cl.get_platforms()]
    except cl.Error:
        names = []
    if any(POCL in name for name in names):
        wanted = os.environ.get("POCL_DEVICES")
        if wanted is not None:
            return (
                f"PoCL offers no device: POCL_DEVICES={wanted!r} names none that it has; unset it, "
                "or set it to pthread"
            )
        return start().trouble or "PoCL offers no device; POCL_DEBUG=all says why"
    platforms = f" (platforms: {', '.join(names)})" if names else ""
    return f"no OpenCL device was found{platforms}; install one with: pip install 'pyopencl[pocl]'"
