"""The door to OpenCL: it is started once in a process, after a look at what could kill that.

PoCL ends the whole process where it finds no linker, no room or no right to execute in the folder
that it compiles in, a damaged file there, or too few threads. So that folder is this process's own
(`kernel_store`), a linker is looked for (`linker`), and the threads are tried, before PoCL starts.
Its threads do not survive a fork: a child that is forked later is told so at once.
"""

from __future__ import annotations

import ctypes
import importlib.util
import os
import sys
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mbinterval.device.kernel_store import KernelStore, RunFolder, store_folder
from mbinterval.device.linker import provide_linker
from mbinterval.errors import DeviceError

THREADS = "MBINTERVAL_THREADS"
"""Variable of the environment that limits the threads of CPU devices."""

MOST_THREADS = 4096

_POCL_THREADS = ("POCL_MAX_PTHREAD_COUNT", "POCL_CPU_MAX_CU_COUNT")  # before PoCL 5, and since
_lock = threading.Lock()
_process: int | None = None
_started: Started | None = None


@dataclass(frozen=True)
class Started:
    """How OpenCL was started in this process.

    Attributes
    ----------
    run
        The folder that PoCL compiles in; None where there is none, or where other code had started
        PoCL before, with a folder of its own choice.
    store
        Where compiled kernels are kept from one process to the next.
    trouble
        Why PoCL cannot compile here, and what to do; empty where it can.
    """

    run: RunFolder | None
    store: KernelStore
    trouble: str


def opencl() -> Any:
    """Return the package pyopencl, once all is ready for its use.

    Raises
    ------
    DeviceError
        In a process that was forked from one in which OpenCL had started, and where the system does
        not give the threads that were asked for.
    """
    start()
    import pyopencl

    return pyopencl


def start() -> Started:
    """Start OpenCL in this process, unless it is; raises as `opencl`."""
    global _process, _started
    if _process is None:
        _process = os.getpid()
    if _process != os.getpid():  # before the lock, which another thread may have held at the fork
        raise DeviceError(
            f"OpenCL was started in process {_process}, and process {os.getpid()} was forked from "
            "it, where OpenCL's threads are missing. Start workers by the method 'spawn', as "
            "multiprocessing.get_context('spawn') or DataLoader(multiprocessing_context='spawn') "
            "do, or use no OpenCL, 'mbinterval.devices' included, before the fork"
        )
    if _started is None:
        with _lock:
            _started = _started or _start()
    return _started


def most_threads() -> int | None:
    """Threads that ``MBINTERVAL_THREADS`` allows, if that is set; `DeviceError` if it is wrong."""
    text = os.environ.get(THREADS)
    if not text:
        return None
    if not text.isdecimal() or not 1 <= int(text) <= MOST_THREADS:
        raise DeviceError(f"{THREADS}={text!r}: expected a whole number from 1 to {MOST_THREADS}")
    return int(text)


def _start() -> Started:
    most = most_threads()
    _check_threads(most or os.cpu_count() or 1)
    store = KernelStore(store_folder())
    early = _pocl_is_loaded()
    run, trouble = (None, "") if early else RunFolder.make(store.folder)
    if run is not None:
        _load_pocl(run.path)
        trouble = provide_linker(run.path / "bin")
    told = dict.fromkeys(_POCL_THREADS, str(most)) if most else {}
    if run is not None:
        told["POCL_CACHE_DIR"] = str(run.path)
    # pyopencl keeps what it generates under the home folder, and fails where it can't.
    unkept = {} if "pyopencl" in sys.modules else {"PYOPENCL_NO_CACHE": "1"}
    with _environment(told | unkept):
        try:
            import pyopencl
        except UnicodeEncodeError:  # since Python 3.12, for extension modules of the older kind
            raise DeviceError(
                "this Python does not load pyopencl from a folder whose name is not UTF-8; install "
                "it in another place"
            ) from None
        try:
            for platform in pyopencl.get_platforms():
                platform.get_devices()
        except pyopencl.Error:
            pass  # a platform without devices; `choose` says what that means
    return Started(run, store, trouble)


def _check_threads(count: int) -> None:
    """Start as many threads as PoCL is about to start, which ends the process if it can't."""
    gate, threads = threading.Event(), []
    try:
        for _ in range(count):
            thread = threading.Thread(target=gate.wait, daemon=True)
            thread.start()
            threads.append(thread)
    except RuntimeError:
        raise DeviceError(
            f"the system gives this process {len(threads)} of the {count} threads that a CPU "
            f"device would start; ask for fewer with --threads or {THREADS}, or raise the limit "
            "(ulimit -u and -v, or a container's limits of processes and memory)"
        ) from None
    finally:
        gate.set()
        for thread in threads:
            thread.join()


def _load_pocl(folder: Path) -> None:
    """Load PoCL through a link in ``folder``, where its own name does not do.

    PoCL finds its headers beside itself, by the name it was loaded by, and clang includes them with
    that between quotation marks.
    """
    found = importlib.util.find_spec("pyopencl")
    if found is None or found.origin is None or '"' not in found.origin:
        return
    packages = Path(found.origin).parents[1]
    link = folder / "packages"
    link.symlink_to(packages)
    for library in link.glob("pyopencl/.libs/libpocl*.so"):
        ctypes.CDLL(str(library))


def _pocl_is_loaded() -> bool:
    """Whether other code of this process has started PoCL."""
    try:
        return "libpocl" in Path("/proc/self/maps").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return False


@contextmanager
def _environment(changes: Mapping[str, str]) -> Iterator[None]:
    """Have variables of the environment for the block, and not for processes started later."""
    before = {name: os.environ.get(name) for name in changes}
    os.environ.update(changes)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
