"""Build the programs of one device: from kernel files, or from what an earlier process compiled."""

from __future__ import annotations

import hashlib
import json
import logging
import os
import threading
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mbinterval.device.kernel_effects import effect_options
from mbinterval.device.opencl import opencl, start
from mbinterval.device.pocl_cpu import name_cpu
from mbinterval.device.sources import include_folder, kernel_root, source_digest
from mbinterval.errors import KernelBuildError

_log = logging.getLogger(__name__)

POCL = "Portable Computing Language"

_building = threading.RLock()
"""Held while a program is built: what is done about warnings then is the whole process's."""

_UNNAMED = ("POCL_CACHE_DIR", "POCL_DEBUG", "POCL_MAX_PTHREAD_COUNT", "POCL_CPU_MAX_CU_COUNT")
"""Variables of PoCL's that change no kernel."""

_PROBE = """
kernel void probe(global ulong *out)
{
    __builtin_prefetch((const void *)(size_t)(out + 1), 0, 3);
    out[0] = __builtin_readcyclecounter();
}
"""


Parameters = tuple[tuple[str, str], ...]
"""What a kernel takes, in order: the name and the kind of each, such as ``Vertex*`` or ``uint``."""


@dataclass(frozen=True, eq=False)
class Program:
    """A program that is built, and what its kernels take, as they declare it themselves."""

    program: Any
    parameters: Mapping[str, Parameters]


class _NoKernelError(KernelBuildError):
    """A program was built, and a kernel of it cannot be made."""


class Programs:
    """Programs of one context and device, each built once and shared between threads.

    Attributes
    ----------
    has_clang_builtins
        Whether the device's compiler knows clang's built-ins, and kernels are told so.
    """

    def __init__(self, context: Any, device: Any) -> None:
        started = start()
        self._context, self._device = context, device
        self._store = started.store
        is_pocl = POCL in device.platform.name
        self._run = started.run if is_pocl else None
        self._keeps = self._run is not None or not is_pocl
        self._compiled: dict[str, tuple[str, dict[str, bytes]]] = {}
        self.has_clang_builtins = self._probe_clang_builtins()

    def build(self, source: str, file: str, options: tuple[str, ...]) -> Program:
        """Return the program of ``source``, which messages call ``file``, built with ``options``.

        What it includes is looked for from the kernels' folder on.

        Raises
        ------
        KernelBuildError
            With the compiler's log.
        DeviceError
            Where there is no room to compile in.
        """
        cl = opencl()
        flags = ["-cl-std=CL1.2", "-cl-kernel-arg-info", "-I", include_folder(), *options]
        if self.has_clang_builtins:
            flags += effect_options(("CLANG_BUILTINS",))
        with _building:
            try:
                with warnings.catch_warnings(record=True) as caught:
                    warnings.simplefilter("always")
                    program = self._built(source, flags)
            except (cl.LogicError, cl.RuntimeError) as error:
                log = str(error).replace(include_folder(), str(kernel_root()))
                raise KernelBuildError(
                    f"kernel file {file} does not build for device {self._device.name.strip()!r} "
                    f"with {' '.join(options)}:\n{log}"
                ) from None
        if caught:
            log = program.program.get_build_info(self._device, cl.program_build_info.LOG).strip()
            # Some compilers tell of every step that went well.
            level = logging.WARNING if "warning:" in log.lower() else logging.DEBUG
            _log.log(level, "kernel file %s: %s\n%s", file, caught[0].message, log)
        return program

    def keep(self) -> None:
        """Keep what PoCL has compiled since; it compiles a kernel when that first runs."""
        if not self._compiled or self._run is None:
            return
        with _building:
            for key, (program, before) in list(self._compiled.items()):
                files = self._run.files(program)
                if files.keys() - before.keys():
                    self._compiled[key] = program, files
                    # Another process may have kept other kernels of the program meanwhile.
                    self._store.save(key, self._store.load(key) | files)

    def _probe_clang_builtins(self) -> bool:
        cl = opencl()
        try:
            with _building, warnings.catch_warnings():
                warnings.simplefilter("ignore")
                self._built(_PROBE, ["-cl-std=CL1.2", "-cl-kernel-arg-info"])
        except _NoKernelError:
            return False  # Oclgrind compiles it, but knows no such instructions
        except (cl.LogicError, cl.RuntimeError) as error:
            if "__builtin_" in str(error):
                return False
            raise KernelBuildError(
                f"device {self._device.name.strip()!r} cannot build the smallest kernel:\n{error}"
            ) from None
        return True

    def _built(self, source: str, flags: list[str]) -> Program:
        key = self._key(source, flags)
        kept = self._store.load(key) if self._keeps else {}
        if self._run is not None:
            return _with_parameters(self._built_by_pocl(key, kept, source, flags))
        if "binary" in kept:
            program = self._from_binary(kept["binary"])
            if program is not None:  # of binaries drivers don't tell the parameters
                return Program(program, json.loads(kept["parameters"]))
        made = _with_parameters(self._from_source(source, flags))
        if self._keeps:
            parameters = json.dumps(made.parameters).encode()
            self._store.save(key, {"binary": made.program.binaries[0], "parameters": parameters})
        return made

    def _built_by_pocl(
        self, key: str, kept: dict[str, bytes], source: str, flags: list[str]
    ) -> Any:
        """Have PoCL look into its folder, in which all that was kept of the program is."""
        assert self._run is not None
        before = self._run.programs()
        if kept:
            self._run.put(kept)
        else:
            self._run.check_room()
        program = self._from_source(source, flags)
        made = self._run.programs() - before
        if len(made) == 1:
            self._compiled[key] = made.pop(), kept
        return program

    def _from_source(self, source: str, flags: list[str]) -> Any:
        """Build ``source``, past pyopencl's options: its own folder may have blanks in its name."""
        cl = opencl()
        program = cl._cl._Program(self._context, source)
        program.build(" ".join(flags).encode(), [self._device])
        return cl.Program(program)

    def _from_binary(self, binary: bytes) -> Any:
        """Build a binary; None where the driver doesn't take it any more."""
        cl = opencl()
        try:
            program = cl._cl._Program(self._context, [self._device], [binary])
            program.build(b"", [self._device])
        except cl.Error as error:
            _log.debug("a kept binary is not taken: %s", error)
            return None
        return cl.Program(program)

    def _key(self, source: str, flags: list[str]) -> str:
        """Digest of all that decides what is compiled."""
        device = self._device
        named = {
            name: value
            for name, value in os.environ.items()
            if name.startswith("POCL_") and name not in _UNNAMED
        }
        parts = (
            (device.name, device.version, device.driver_version, device.platform.version),
            name_cpu(device), sorted(named.items()), source_digest(source), flags,
        )  # fmt: skip
        return hashlib.sha256(json.dumps(parts).encode()).hexdigest()


def _with_parameters(program: Any) -> Program:
    cl = opencl()
    info, found = cl.kernel_arg_info, {}
    for name in program.get_info(cl.program_info.KERNEL_NAMES).split(";"):
        try:
            kernel = cl.Kernel(program, name)
        except cl.LogicError as error:
            raise _NoKernelError(f"kernel {name} was built, and cannot be made: {error}") from None
        try:
            found[name] = tuple(
                (kernel.get_arg_info(place, info.NAME), kernel.get_arg_info(place, info.TYPE_NAME))
                for place in range(kernel.num_args)
            )
        except cl.Error as error:
            raise KernelBuildError(
                f"the device tells nothing of kernels' arguments: kernel {name}: {error}"
            ) from None
    return Program(program, found)
