"""A device at work: its queue, its programs, its buffers, and the time that kernels take."""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.device.choose import choose_device
from mbinterval.device.opencl import opencl, start
from mbinterval.device.programs import Programs
from mbinterval.errors import CapacityError, DeviceError

_log = logging.getLogger(__name__)

_runtimes: dict[int, Runtime] = {}
_lock = threading.Lock()


class _OfThread(threading.local):
    """What each thread has of its own: its queue, its kernels, and which of these have run."""

    def __init__(self) -> None:
        self.queue: Any = None
        self.kernels: dict[tuple[tuple[str, tuple[str, ...]], str], Any] = {}
        self.launched: set[int] = set()
        self.unkept = False


class Runtime:
    """An OpenCL context with one device, kept for the life of the process.

    Programs are shared between threads; kernels are made per thread and kept, since an OpenCL
    kernel object holds its arguments.
    """

    def __init__(self, device: Any) -> None:
        cl = opencl()
        self.device = device
        self.context = cl.Context([device])
        self._programs = Programs(self.context, device)
        self._built: dict[tuple[str, tuple[str, ...]], Any] = {}
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
            self._local.queue = cl.CommandQueue(
                self.context, properties=cl.command_queue_properties.PROFILING_ENABLE
            )
        return self._local.queue

    def kernel(self, file: str, name: str, options: Iterable[str] = ()) -> Any:
        """Return kernel ``name`` of ``file`` (relative to the kernel root), built as needed."""
        key = (file, tuple(options))
        kernels = self._local.kernels
        if (key, name) not in kernels:
            cl = opencl()
            kernels[key, name] = cl.Kernel(self._program(*key), name)
        return kernels[key, name]

    def _program(self, file: str, options: tuple[str, ...]) -> Any:
        with self._building:
            if (file, options) not in self._built:
                source = f'#include "{file}"\n'
                self._built[file, options] = self._build(source, file, options)
            return self._built[file, options]

    def _build(self, source: str, file: str, options: tuple[str, ...]) -> Any:
        return self._programs.build(source, file, options)

    def upload(self, array: NDArray[Any], what: str = "") -> Any:
        """Return a read-only buffer with the contents of ``array``; no copy on a CPU device.

        On a CPU the buffer refers to the array's own memory: keep it unchanged until the render
        is done (pyopencl keeps it alive).
        """
        cl = opencl()
        if array.nbytes == 0:
            return self.allocate(16)
        self._check_size(array.nbytes, what)
        host = cl.mem_flags.USE_HOST_PTR if self.is_cpu else cl.mem_flags.COPY_HOST_PTR
        return self._guarded(
            what, cl.Buffer, cl.mem_flags.READ_ONLY | host, hostbuf=np.ascontiguousarray(array)
        )

    def allocate(self, nbytes: int, what: str = "") -> Any:
        """Return an uninitialized read-write buffer; ``what`` it is goes into error messages."""
        cl = opencl()
        self._check_size(nbytes, what)
        # PoCL else takes memory when a kernel first needs it, and crashes where there is none.
        at_once = cl.mem_flags.ALLOC_HOST_PTR if self.is_cpu else 0
        flags = cl.mem_flags.READ_WRITE | at_once
        return self._guarded(what, cl.Buffer, flags, size=max(nbytes, 16))

    def download(self, buffer: Any, shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
        """Return the contents of ``buffer`` as a new array, once all work is done."""
        cl = opencl()
        array = np.empty(shape, dtype)
        with _device_errors("reading results"):
            if array.nbytes:
                cl.enqueue_copy(self.queue, array, buffer)
        if self._local.unkept:
            self._local.unkept = False
            self._programs.keep()
        return array

    def finish(self) -> None:
        """Wait until all work that this thread gave the device is done."""
        with _device_errors("a kernel"):
            self.queue.finish()

    def fill(self, buffer: Any, nbytes: int, value: int = 0) -> None:
        """Set the first ``nbytes`` (a multiple of 4) of ``buffer`` to a repeated 32-bit value."""
        cl = opencl()
        with _device_errors("filling a buffer"):
            cl.enqueue_fill_buffer(self.queue, buffer, np.array(value, np.int32), 0, nbytes)

    def run(self, kernel: Any, items: int, *arguments: Any) -> Any:
        """Enqueue ``kernel`` over ``items`` work-groups of one work-item; returns its event.

        One item per group: a CPU device runs groups on its threads, and PoCL would compile a
        kernel again for every other group size.
        """
        cl = opencl()
        with _device_errors(f"kernel {kernel.function_name}"):
            for place, argument in enumerate(arguments):
                kernel.set_arg(place, argument)
            if kernel.int_ptr not in self._local.launched:
                self._local.launched.add(kernel.int_ptr)
                self._local.unkept = True  # PoCL compiles a kernel when that first runs
            return cl.enqueue_nd_range_kernel(self.queue, kernel, (items,), (1,))

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
