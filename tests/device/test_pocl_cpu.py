"""The CPU that PoCL 3.0 compiles for (mbinterval/device/pocl_cpu.py); newer ones are left alone."""

from __future__ import annotations

import ctypes
from pathlib import Path
from types import SimpleNamespace

import pyopencl as cl
import pytest
from support import processes

from mbinterval.device import pocl_cpu
from mbinterval.device.choose import choose_device, devices
from mbinterval.errors import DeviceError

OLD = "OpenCL 3.0 PoCL 3.0-rc2  Linux, Release, RELOC, LLVM 14.0.6, SLEEF, DISTRO, POCL_DEBUG"
NEW = "OpenCL 3.0 PoCL 3.1+debian  Linux, None+Asserts, RELOC, SPIR, LLVM 15.0.6, SLEEF, DISTRO"
TRIPLE = "x86_64-unknown-linux-gnu"
SSE = "ssse3 sse4_1 cx16 popcnt"
AVX2 = f"{SSE} avx f16c fma abm bmi1 bmi2 avx2"
AVX512 = f"{AVX2} avx512f avx512bw avx512cd avx512dq avx512vl"


class Fake:
    """A device whose record has the CPU's name beside the target triple, as PoCL's has."""

    def __init__(
        self, own: str, lanes: int, fused: bool = True, version: str = OLD, triple: str = TRIPLE
    ) -> None:
        self._texts = [ctypes.create_string_buffer(t.encode(), 64) for t in (triple, own)]
        self.record = (ctypes.c_uint64 * 512)()
        self.record[100:102] = [ctypes.addressof(text) for text in self._texts]
        self.before = bytes(self.record)
        self.platform = SimpleNamespace(version=version)
        self.version = f"OpenCL 3.0 PoCL HSTR: pthread-{triple}-{own}"
        self.int_ptr = ctypes.addressof(self.record)
        self.native_vector_width_float = lanes
        self.single_fp_config = cl.device_fp_config.FMA if fused else cl.device_fp_config.DENORM

    @property
    def cpu(self) -> str:
        return ctypes.string_at(self.record[101]).decode()


@pytest.fixture(autouse=True)
def _nothing_is_known(monkeypatch):
    """A fake's record may lie where that of another did."""
    monkeypatch.setattr(pocl_cpu, "_known", {})


@pytest.fixture
def flags(monkeypatch):
    """Sets the flags of /proc/cpuinfo; no switch is set."""
    monkeypatch.delenv(pocl_cpu.SWITCH, raising=False)

    def set_flags(text: str) -> None:
        lines = f"processor : 0\nflags\t\t: fpu {text} nx\nflags\t\t: other\n"
        monkeypatch.setattr(Path, "read_text", lambda self, **options: lines)

    return set_flags


CPUS = [
    ("AMD Zen 5", "generic", 16, AVX512, "skylake-avx512"),
    ("AMD Zen 4", "znver3", 16, AVX512, "skylake-avx512"),
    ("Ice Lake of a laptop", "icelake-client", 16, AVX512, "skylake-avx512"),
    ("Sapphire Rapids", "sapphirerapids", 16, AVX512, None),
    ("Skylake server", "skylake-avx512", 16, AVX512, None),
    ("the same, AVX-512 hidden", "skylake-avx512", 8, AVX2, "haswell"),
    ("AMD Zen 3", "znver3", 8, AVX2, "haswell"),
    ("Alder Lake", "alderlake", 8, AVX2, "haswell"),
    ("Haswell", "haswell", 8, AVX2, None),
    ("Skylake", "skylake", 8, AVX2, None),
    ("Jaguar", "btver2", 8, f"{SSE} avx f16c", "ivybridge"),
    ("Bulldozer", "bdver1", 8, f"{SSE} avx xop fma4", None),
    ("Pentium without AVX", "skylake", 4, SSE, "penryn"),
    ("Nehalem", "nehalem", 4, SSE, None),
    ("Core 2", "core2", 4, "ssse3 cx16", None),
    ("unknown, old", "generic", 4, "cx16", "athlon64"),
    ("an emulator's, on AVX-512", "k8-sse3", 8, AVX512, "haswell"),
    ("Haswell, emulated on AVX-512", "haswell", 8, AVX512, None),
    ("unknown, cpuinfo without flags", "generic", 8, "", "sandybridge"),
]
"""A CPU, what LLVM 14 calls it, floats in its registers, flags, and the name that it is given."""


@pytest.mark.parametrize(
    ("own", "lanes", "has", "given"), [row[1:] for row in CPUS], ids=[row[0] for row in CPUS]
)
def test_a_name_is_given_where_pocls_own_does_not_go_with_its_library(
    flags, own, lanes, has, given
):
    flags(has)
    device = Fake(own, lanes)
    assert pocl_cpu.name_cpu(device) == given
    assert device.cpu == (given or own)
    changed = [i for i, word in enumerate(device.record) if word]
    assert changed == [100, 101]
    assert bytes(device.record)[:808] == device.before[:808]
    assert (bytes(device.record) == device.before) == (given is None)


def test_sandy_bridge_emulated_on_a_cpu_with_fused_multiply_add_is_not_given_one(flags):
    flags(AVX512)
    own, unknown = Fake("sandybridge", 8, fused=False), Fake("generic", 8, fused=False)
    assert pocl_cpu.name_cpu(own) is None
    assert pocl_cpu.name_cpu(unknown) == "ivybridge"


def test_without_cpuinfo_a_name_is_given_by_what_pocl_tells(monkeypatch):
    def missing(self, **options):
        raise OSError

    monkeypatch.delenv(pocl_cpu.SWITCH, raising=False)
    monkeypatch.setattr(Path, "read_text", missing)
    wide, narrow = Fake("generic", 16), Fake("generic", 1)
    assert pocl_cpu.name_cpu(wide) == "skylake-avx512"
    assert pocl_cpu.name_cpu(narrow) is None  # no x86 that PoCL has a library for


@pytest.mark.parametrize(
    ("own", "lanes", "wanted", "given"),
    [
        ("sapphirerapids", 16, "skylake-avx512", "skylake-avx512"),
        ("sapphirerapids", 16, "sapphirerapids", "sapphirerapids"),
        ("sapphirerapids", 16, "", None),
        ("znver3", 8, "sandybridge", "sandybridge"),
        ("znver3", 8, "", None),  # slow, but it works
    ],
)
def test_the_switch_gives_a_name_or_leaves_pocl_alone(
    flags, monkeypatch, own, lanes, wanted, given
):
    flags(AVX512)
    monkeypatch.setenv(pocl_cpu.SWITCH, wanted)
    device = Fake(own, lanes)
    assert pocl_cpu.name_cpu(device) == given
    assert device.cpu == (given or own)


@pytest.mark.parametrize(
    ("own", "lanes", "wanted", "works"),
    [
        ("znver3", 16, "haswell", "skylake-avx512"),  # PoCL ends the process
        ("znver3", 16, "", "skylake-avx512"),
        ("znver3", 16, "znver3", "skylake-avx512"),
        ("sapphirerapids", 16, "icelake-server", "skylake-avx512, sapphirerapids"),
        ("generic", 16, "", "skylake-avx512"),
        ("skylake-avx512", 8, "skylake-avx512", "haswell, ivybridge, sandybridge"),
        ("znver2", 8, "penryn", "haswell, ivybridge, sandybridge, znver2"),
        ("nehalem", 4, "haswell", "penryn, core2, athlon64, nehalem"),
        ("haswell", 8, "no-such-cpu", "haswell, ivybridge, sandybridge"),
        ("haswell", 8, " ", "haswell, ivybridge, sandybridge"),
    ],
)
def test_a_name_that_does_not_go_with_the_library_is_refused(
    flags, monkeypatch, own, lanes, wanted, works
):
    flags(AVX512)
    monkeypatch.setenv(pocl_cpu.SWITCH, wanted)
    device = Fake(own, lanes)
    with pytest.raises(DeviceError) as caught:
        pocl_cpu.name_cpu(device)
    message = str(caught.value)
    assert f"these do: {works};" in message
    assert (f"{pocl_cpu.SWITCH}={wanted!r}" if wanted else f"own {own!r}") in message
    assert bytes(device.record) == device.before


def test_a_name_that_is_needed_and_cannot_be_given_is_an_error(flags):
    flags(AVX512)
    for record in ((ctypes.c_uint64 * 512)(), None):
        device, slow = Fake("znver3", 16), Fake("rocketlake", 16)
        for one in (device, slow):
            one.int_ptr = ctypes.addressof(record) if record else 8  # blank; not mapped
        with pytest.raises(DeviceError, match=r"'znver3'.*'skylake-avx512'.*pocl-opencl-icd"):
            pocl_cpu.name_cpu(device)
        assert pocl_cpu.name_cpu(slow) is None
        assert record is None or not any(record)


@pytest.mark.parametrize("version", [NEW, OLD.replace(", DISTRO", ""), "OpenCL 3.0 LINUX"])
@pytest.mark.parametrize("triple", [TRIPLE, "x86_64-pc-linux-gnu"])
@pytest.mark.parametrize("wanted", [None, "", "haswell", "no-such-cpu"])
def test_other_versions_of_pocl_and_other_devices_are_left_alone(
    flags, monkeypatch, version, triple, wanted
):
    flags(AVX512)
    if wanted is not None:
        monkeypatch.setenv(pocl_cpu.SWITCH, wanted)
    device = Fake("generic", 16, version=version, triple=triple)
    assert pocl_cpu.name_cpu(device) is None
    assert bytes(device.record) == device.before


EVERY = """
import ctypes
from mbinterval.device.choose import _all_devices
from mbinterval.device.pocl_cpu import name_cpu
for device in _all_devices():
    before = ctypes.string_at(device.int_ptr, 1024)
    name = name_cpu(device)
    print(before == ctypes.string_at(device.int_ptr, 1024), name, device.platform.version)
"""


def test_devices_of_this_machine_are_left_alone_but_for_pocl_3_0():
    """Debian's PoCL 3.1 and newer ones, too, where they are installed."""
    run = processes.python("-c", EVERY, environment={pocl_cpu.SWITCH: None})
    assert run.returncode == 0, run.stderr
    lines = [line.split(maxsplit=2) for line in run.stdout.splitlines()]
    assert len(lines) == len(devices())
    for same, name, version in lines:
        assert "PoCL 3.0" in version or (same, name) == ("True", "None")


def of_other_registers() -> str:
    """A CPU whose registers are not as wide as this one's."""
    return "haswell" if choose_device().native_vector_width_float == 16 else "skylake-avx512"


@pytest.mark.parametrize("name", ["no-such-cpu", None], ids=["unknown", "other registers"])
def test_render_refuses_a_wrong_name_in_one_line_with_exit_code_4(tmp_path, name):
    name = name or of_other_registers()
    render = processes.renderer(tmp_path)
    run = render(environment={pocl_cpu.SWITCH: name})
    if "PoCL 3.0" not in choose_device().platform.version:
        assert run.returncode == 0, run.stderr  # no concern of theirs
        return
    assert run.returncode == 4, (run.returncode, run.stderr)
    (line,) = run.stderr.splitlines()
    assert line.startswith(f"mbinterval: error: {pocl_cpu.SWITCH}={name!r}")
    works = line.split("these do: ")[1].split(";")[0].split(", ")
    run = render(environment={pocl_cpu.SWITCH: works[0]})
    assert (run.returncode, run.stdout + run.stderr) == (0, "")
