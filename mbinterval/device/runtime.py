"""A device at work: its queue, its programs, its buffers, and the time that kernels take."""

from __future__ import annotations

import logging
import threading
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.device.choose import cache_trouble, choose_device
from mbinterval.device.sources import kernel_root
from mbinterval.errors import CapacityError, DeviceError, KernelBuildError

_log = logging.getLogger(__name__)
_runtimes: dict[int, Runtime] = {}
_lock = threading.Lock()
_building = threading.RLock()
"""Held while a program is built: what is done about warnings then is the whole process's."""

_PROBE = """
kernel void probe(global ulong *out)
{
    __builtin_prefetch((const void *)(size_t)(out + 1), 0, 3);
    out[0] = __builtin_readcyclecounter();
}
"""


class Runtime:
    """An OpenCL context with one device, kept for the life of the process.

    Programs are shared between threads; kernels are made per thread and kept, since an OpenCL
    kernel object holds its arguments.
    """

    def __init__(self, device: Any) -> None:
        import pyopencl as cl

        self.device = device
        self.context = cl.Context([device])
        self._programs: dict[tuple[str, tuple[str, ...]], Any] = {}
        self._local = threading.local()
        self.is_cpu = device.type & ~cl.device_type.DEFAULT == cl.device_type.CPU
        self.workers = device.max_compute_units * (1 if self.is_cpu else 64)
        self.has_clang_builtins = self._probe_clang_builtins()

    @property
    def queue(self) -> Any:
        """The thread's in-order queue, with profiling."""
        import pyopencl as cl

        if not hasattr(self._local, "queue"):
            self._local.queue = cl.CommandQueue(
                self.context, properties=cl.command_queue_properties.PROFILING_ENABLE
            )
        return self._local.queue

    def kernel(self, file: str, name: str, options: Iterable[str] = ()) -> Any:
        """Return kernel ``name`` of ``file`` (relative to the kernel root), built as needed."""
        key = (file, tuple(options))
        kernels = self._local.__dict__.setdefault("kernels", {})
        if (key, name) not in kernels:
            import pyopencl as cl

            kernels[key, name] = cl.Kernel(self._program(*key), name)
        return kernels[key, name]

    def _program(self, file: str, options: tuple[str, ...]) -> Any:
        with _building:
            if (file, options) not in self._programs:
                source = f'#include "{file}"\n'
                self._programs[file, options] = self._build(source, file, options)
            return self._programs[file, options]

    def _build(self, source: str, file: str, options: tuple[str, ...]) -> Any:
        import pyopencl as cl

        flags = ["-cl-std=CL1.2", "-I", str(kernel_root()), *options]
        if self.has_clang_builtins:
            flags.append("-DCLANG_BUILTINS")
        try:
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                program = cl.Program(self.context, source).build(options=flags)
        except cl.RuntimeError as error:
            raise KernelBuildError(
                f"kernel file {file} does not build for device {self.device.name.strip()!r} "
                f"with {' '.join(options)}{cache_trouble(self.device)}:\n{error}"
            ) from None
        if caught:
            log = program.get_build_info(self.device, cl.program_build_info.LOG).strip()
            # Some compilers tell of every step that went well.
            level = logging.WARNING if "warning:" in log.lower() else logging.DEBUG
            _log.log(level, "kernel file %s: %s\n%s", file, caught[0].message, log)
        return program

    def _probe_clang_builtins(self) -> bool:
        import pyopencl as cl

        try:
            with _building, warnings.catch_warnings():
                warnings.simplefilter("ignore")
                program = cl.Program(self.context, _PROBE).build(options=["-cl-std=CL1.2"])
                cl.Kernel(program, "probe")
        except cl.LogicError:
            return False  # Oclgrind compiles it, but knows no such instructions
        except cl.RuntimeError as error:
            if "__builtin_" in str(error):
                return False
            raise KernelBuildError(
                f"device {self.device.name.strip()!r} cannot build the smallest kernel"
                f"{cache_trouble(self.device)}:\n{error}"
            ) from None
        return True

    def upload(self, array: NDArray[Any], what: str = "") -> Any:
        """Return a read-only buffer with the contents of ``array``; no copy on a CPU device.

        On a CPU the buffer refers to the array's own memory: keep it unchanged until the render
        is done (pyopencl keeps it alive).
        """
        import pyopencl as cl

        if array.nbytes == 0:
            return self.allocate(16)
        self._check_size(array.nbytes, what)
        host = cl.mem_flags.USE_HOST_PTR if self.is_cpu else cl.mem_flags.COPY_HOST_PTR
        return self._guarded(
            what, cl.Buffer, cl.mem_flags.READ_ONLY | host, hostbuf=np.ascontiguousarray(array)
        )

    def allocate(self, nbytes: int, what: str = "") -> Any:
        """Return an uninitialized read-write buffer; ``what`` it is goes into error messages."""
        import pyopencl as cl

        self._check_size(nbytes, what)
        # PoCL else takes memory when a kernel first needs it, and crashes where there is none.
        at_once = cl.mem_flags.ALLOC_HOST_PTR if self.is_cpu else 0
        flags = cl.mem_flags.READ_WRITE | at_once
        return self._guarded(what, cl.Buffer, flags, size=max(nbytes, 16))

    def download(self, buffer: Any, shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
        """Return the contents of ``buffer`` as a new array, once all work is done."""
        import pyopencl as cl

        array = np.empty(shape, dtype)
        with _device_errors("reading results"):
            if array.nbytes:
                cl.enqueue_copy(self.queue, array, buffer)
        return array

    def finish(self) -> None:
        """Wait until all work that this thread gave the device is done."""
        with _device_errors("a kernel"):
            self.queue.finish()

    def fill(self, buffer: Any, nbytes: int, value: int = 0) -> None:
        """Set the first ``nbytes`` (a multiple of 4) of ``buffer`` to a repeated 32-bit value."""
        import pyopencl as cl

        with _device_errors("filling a buffer"):
            cl.enqueue_fill_buffer(self.queue, buffer, np.array(value, np.int32), 0, nbytes)

    def run(self, kernel: Any, items: int, *arguments: Any) -> Any:
        """Enqueue ``kernel`` over ``items`` work-groups of one work-item; returns its event.

        One item per group: a CPU device runs groups on its threads, and PoCL would compile a
        kernel again for every other group size.
        """
        with _device_errors(f"kernel {kernel.function_name}"):
            return kernel(self.queue, (items,), (1,), *arguments)

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
    import pyopencl as cl

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
    if isinstance(wanted, Runtime):
        return wanted
    with _lock:
        device = choose_device(wanted)
        if device.int_ptr not in _runtimes:
            _runtimes[device.int_ptr] = Runtime(device)
        return _runtimes[device.int_ptr]
