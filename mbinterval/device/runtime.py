"""A device at work: its queue, its programs, its buffers, and the time that kernels take."""

from __future__ import annotations

import logging
import operator
import threading
from collections.abc import Container, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.device import records
from mbinterval.device.choose import choose_device
from mbinterval.device.opencl import opencl, start
from mbinterval.device.programs import Parameters, Program, Programs
from mbinterval.errors import CapacityError, DeviceError

_log = logging.getLogger(__name__)

_runtimes: dict[int, Runtime] = {}
_lock = threading.Lock()


@dataclass(frozen=True, eq=False)
class DeviceArray:
    """Elements on the device, of one ``kind`` as the kernels call it: ``Vertex``, ``uint``."""

    buffer: Any
    kind: str
    nbytes: int


@dataclass(frozen=True, eq=False)
class Kernel:
    """A kernel of one thread, and what it takes: name and kind of each, in order."""

    handle: Any
    name: str
    parameters: Parameters


class _OfThread(threading.local):
    """What each thread has of its own: its queue, its kernels, and which of these have run."""

    def __init__(self) -> None:
        self.queue: Any = None
        self.kernels: dict[tuple[tuple[str, tuple[str, ...]], str], Kernel] = {}
        self.launched: set[Kernel] = set()
        self.unkept = False


class Runtime:
    """An OpenCL context with one device, kept for the life of the process.

    Programs are shared between threads; kernels are made per thread and kept, since an OpenCL
    kernel object holds its arguments.
    """

    def __init__(self, device: Any) -> None:
        cl = opencl()
        self.device = device
        with _device_errors("the context"):
            self.context = cl.Context([device])
        self._programs = Programs(self.context, device)
        self._built: dict[tuple[str, tuple[str, ...]], Program] = {}
        self._building = threading.Lock()
        self._local = _OfThread()
        self.is_cpu = device.type & ~cl.device_type.DEFAULT == cl.device_type.CPU
        self.workers = device.max_compute_units * (1 if self.is_cpu else 64)
        if not self.is_cpu:
            _log.info("%s: the kernels are shaped for CPUs, and need not be fast here", device.name)

    @property
    def queue(self) -> Any:
        """The thread's in-order queue, with profiling."""
        if self._local.queue is None:
            cl = opencl()
            with _device_errors("the queue"):
                self._local.queue = cl.CommandQueue(
                    self.context, properties=cl.command_queue_properties.PROFILING_ENABLE
                )
        return self._local.queue

    def kernel(self, file: str, name: str, options: Iterable[str] = ()) -> Kernel:
        """Return kernel ``name`` of ``file`` (relative to the kernel root), built as needed."""
        key = (file, tuple(options))
        kernels = self._local.kernels
        if (key, name) not in kernels:
            built = self._program(*key)
            with _device_errors(f"kernel {name}"):
                handle = opencl().Kernel(built.program, name)
            kernels[key, name] = Kernel(handle, name, built.parameters[name])
        return kernels[key, name]

    def _program(self, file: str, options: tuple[str, ...]) -> Program:
        with self._building:
            if (file, options) not in self._built:
                source = f'#include "{file}"\n'
                self._built[file, options] = self._build(source, file, options)
            return self._built[file, options]

    def _build(self, source: str, file: str, options: tuple[str, ...]) -> Program:
        return self._programs.build(source, file, options)

    def upload(self, kind: str, array: NDArray[Any], what: str = "") -> DeviceArray:
        """Return an array that kernels read, elements of ``kind``; no copy on a CPU device.

        ``what`` it is goes into error messages. On a CPU it refers to the given array's own memory:
        keep that unchanged until the render is done (pyopencl keeps it alive).
        """
        cl = opencl()
        if array.dtype.base != records.element(kind).base:
            raise TypeError(f"{what or 'an array'} of {array.dtype} is to be read as {kind}")
        if array.nbytes == 0:
            return self.allocate(kind, 0, what)
        self._check_size(array.nbytes, what)
        host = cl.mem_flags.USE_HOST_PTR if self.is_cpu else cl.mem_flags.COPY_HOST_PTR
        buffer = self._guarded(
            what, cl.Buffer, cl.mem_flags.READ_ONLY | host, hostbuf=np.ascontiguousarray(array)
        )
        return DeviceArray(buffer, kind, array.nbytes)

    def allocate(
        self, kind: str, count: int, what: str = "", active: Container[str] = ()
    ) -> DeviceArray:
        """Return an uninitialized array of ``count`` elements; records may grow with effects."""
        cl = opencl()
        nbytes = int(count) * records.element(kind, active).itemsize
        self._check_size(nbytes, what)
        # PoCL else takes memory when a kernel first needs it, and crashes where there is none.
        at_once = cl.mem_flags.ALLOC_HOST_PTR if self.is_cpu else 0
        flags = cl.mem_flags.READ_WRITE | at_once
        buffer = self._guarded(what, cl.Buffer, flags, size=max(nbytes, 16))
        return DeviceArray(buffer, kind, nbytes)

    def download(self, array: DeviceArray, shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
        """Return what begins ``array`` as a new array of the host, once all work is done."""
        cl = opencl()
        found = np.empty(shape, dtype)
        if found.dtype.base != records.element(array.kind).base:
            raise TypeError(f"elements of kind {array.kind} are to be read as {found.dtype}")
        with _device_errors("reading results"):
            if found.nbytes:
                cl.enqueue_copy(self.queue, found, array.buffer)
        if self._local.unkept:
            self._local.unkept = False
            self._programs.keep()
        return found

    def finish(self) -> None:
        """Wait until all work that this thread gave the device is done."""
        with _device_errors("a kernel"):
            self.queue.finish()

    def fill(self, array: DeviceArray, value: int = 0) -> None:
        """Set all of ``array`` to a repeated 32-bit value."""
        cl = opencl()
        with _device_errors("filling a buffer"):
            if array.nbytes:
                pattern = np.array(value, np.int32)
                cl.enqueue_fill_buffer(self.queue, array.buffer, pattern, 0, array.nbytes)

    def run(self, kernel: Kernel, items: int, arguments: Mapping[str, Any]) -> Any:
        """Enqueue ``kernel`` over ``items`` work-groups of one work-item; returns its event.

        ``arguments`` has what the kernel takes, by the names that it gives them, and may have more:
        arrays of the kinds that it declares, records from `records.pack`, and numbers.

        One item per group: a CPU device runs groups on its threads, and PoCL would compile a
        kernel again for every other group size.
        """
        cl = opencl()
        with _device_errors(f"kernel {kernel.name}"):
            for place, (name, kind) in enumerate(kernel.parameters):
                kernel.handle.set_arg(place, _argument(kernel.name, name, kind, arguments))
            if kernel not in self._local.launched:
                self._local.launched.add(kernel)
                self._local.unkept = True  # PoCL compiles a kernel when that first runs
            return cl.enqueue_nd_range_kernel(self.queue, kernel.handle, (items,), (1,))

    def _check_size(self, nbytes: int, what: str) -> None:
        if nbytes > self.device.max_mem_alloc_size:
            raise CapacityError(
                f"{what or 'a buffer'} takes {nbytes / 2**20:.0f} MiB, but device "
                f"{self.device.name.strip()!r} allows {self.device.max_mem_alloc_size / 2**20:.0f} "
                "MiB in one piece; render in crops where the film is too large, with fewer motion "
                "segments or faces where the scene is"
            )

    def _guarded(self, what: str, make: Any, flags: Any, **keywords: Any) -> Any:
        with _device_errors(f"the buffer of {what}" if what else "a buffer"):
            return make(self.context, flags, **keywords)


def _argument(kernel: str, name: str, kind: str, arguments: Mapping[str, Any]) -> Any:
    """Return what the kernel's parameter is set to; a `TypeError` where that does not fit it."""
    if name not in arguments:
        raise TypeError(f"kernel {kernel} takes {kind} {name}, which is not given")
    given = arguments[name]
    if isinstance(given, DeviceArray):
        if f"{given.kind}*" != kind:
            raise TypeError(f"kernel {kernel} takes {kind} {name}, not an array of {given.kind}")
        return given.buffer
    try:
        if kind.endswith("*"):
            raise TypeError
        element = records.element(kind)
        if element.names is None:
            return element.type((float if element.kind == "f" else operator.index)(given))
        if given.dtype != element:
            raise TypeError
    except (AttributeError, OverflowError, TypeError, ValueError):
        raise TypeError(f"kernel {kernel} takes {kind} {name}, not {given!r}") from None
    return given


@contextmanager
def _device_errors(what: str) -> Iterator[None]:
    """Turn what OpenCL raises into errors that say what the device was doing."""
    cl = opencl()
    try:
        yield
    except cl.Error as error:
        if isinstance(error, cl.MemoryError) or error.code == cl.status_code.OUT_OF_HOST_MEMORY:
            raise CapacityError(
                f"{what}: the device is out of memory ({error}); render in crops, or with a "
                "smaller tile_size, fewer samples or motion segments"
            ) from None
        raise DeviceError(f"{what}: the device failed: {error}") from None


def seconds(event: Any) -> float:
    """Seconds that ``event`` ran, once it is finished."""
    with _device_errors("a kernel"):
        event.wait()
        return float(event.profile.end - event.profile.start) * 1e-9


def runtime(wanted: Any = None) -> Runtime:
    """Return the process's runtime for the device that ``wanted`` selects."""
    start()  # before the lock, which another thread may have held when this process was forked
    if isinstance(wanted, Runtime):
        return wanted
    with _lock:
        device = choose_device(wanted)
        if device.int_ptr not in _runtimes:
            _runtimes[device.int_ptr] = Runtime(device)
        return _runtimes[device.int_ptr]
