"""Choosing a device, and explaining it when there is none or a kernel does not build."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pyopencl as cl
import pytest
from support.closed_forms import rectangle, scene, slab

import mbinterval as mb
from mbinterval.device import choose
from mbinterval.device.choose import choose_device, devices
from mbinterval.device.runtime import Runtime, runtime
from mbinterval.errors import DeviceError, KernelBuildError
from mbinterval.scene.generators import fast_cubes

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(autouse=True)
def _no_choice_in_the_environment(monkeypatch):
    for name in ("MBINTERVAL_DEVICE", "PYOPENCL_CTX"):
        monkeypatch.delenv(name, raising=False)


def fake_device(name: str, platform: str = "Platform", fp64: int = 63) -> SimpleNamespace:
    return SimpleNamespace(
        name=name, platform=SimpleNamespace(name=platform, version="OpenCL 3.0 test"),
        double_fp_config=fp64,
    )  # fmt: skip


THREE = [
    fake_device("Fast GPU", "Vendor OpenCL", fp64=0),
    fake_device("Big CPU", "Vendor OpenCL"),
    fake_device("pthread-cpu", "Portable Computing Language"),
]


@pytest.fixture
def _three_devices(monkeypatch):
    monkeypatch.setattr(choose, "_all_devices", lambda: THREE)


def test_the_default_is_a_device_that_lists_itself_as_usable():
    listed = devices()
    assert [device.index for device in listed] == list(range(len(listed)))
    chosen = choose_device()
    assert chosen.name.strip() in [device.name for device in listed if device.usable]
    assert choose_device(chosen) is chosen
    first = listed[0]
    assert first.compute_units >= 1
    assert first.memory_bytes > 2**20
    assert first.kind in ("CPU", "GPU", "other")


def test_a_device_is_found_by_index_and_by_part_of_its_or_its_platforms_name():
    (index, name) = next((d.index, d.name) for d in devices() if d.usable)
    for wanted in (index, str(index), name, name.upper(), name[2:-2]):
        assert choose_device(wanted).name.strip() == name
    platform = devices()[index].platform
    assert choose_device(platform[:8].lower()).platform.name.strip() == platform


@pytest.mark.usefixtures("_three_devices")
def test_among_several_pocl_is_the_default_and_names_and_indices_select():
    assert choose_device() is THREE[2]
    assert choose_device(1) is THREE[1]
    assert choose_device("big") is THREE[1]
    assert choose_device("vendor opencl big") is THREE[1]
    assert choose_device("portable") is THREE[2]


@pytest.mark.usefixtures("_three_devices")
def test_the_environment_selects_and_an_argument_overrules_it(monkeypatch):
    monkeypatch.setenv("MBINTERVAL_DEVICE", "big cpu")
    assert choose_device() is THREE[1]
    monkeypatch.setenv("MBINTERVAL_DEVICE", "1")
    assert choose_device() is THREE[1]
    assert choose_device("pthread") is THREE[2]
    monkeypatch.setenv("MBINTERVAL_DEVICE", "no such thing")
    with pytest.raises(DeviceError, match="no such thing"):
        choose_device()


@pytest.mark.usefixtures("_three_devices")
@pytest.mark.parametrize("wanted", ["Quantum", 3, "3", "99"])
def test_a_device_that_is_not_there_is_an_error_that_says_what_there_is(wanted):
    with pytest.raises(DeviceError) as caught:
        choose_device(wanted)
    message = str(caught.value)
    assert str(wanted) in message
    if wanted == "Quantum":
        assert "the devices are 0: Fast GPU, 1: Big CPU, 2: pthread-cpu" in message
    else:
        assert "there are 3" in message


@pytest.mark.usefixtures("_three_devices")
def test_a_device_without_double_precision_is_refused_with_the_reason():
    with pytest.raises(DeviceError, match=r"Fast GPU.*double precision.*--device"):
        choose_device(0)


def test_pyopencl_ctx_selects_as_pyopencl_reads_it(monkeypatch):
    platform = next(i for i, d in enumerate(devices()) if d.usable)
    monkeypatch.setenv("PYOPENCL_CTX", str(platform))
    assert choose_device().name.strip() in [device.name for device in devices()]
    monkeypatch.setenv("PYOPENCL_CTX", "no such platform")
    with pytest.raises(DeviceError, match=r"PYOPENCL_CTX='no such platform'"):
        choose_device()
    monkeypatch.setenv("MBINTERVAL_DEVICE", "0")  # comes first
    assert choose_device().name.strip() == devices()[0].name


def test_no_device_at_all_says_how_to_install_one(monkeypatch):
    monkeypatch.setattr(choose, "_all_devices", list)
    monkeypatch.setattr(cl, "get_platforms", list)
    with pytest.raises(DeviceError, match=r"no OpenCL device .*pip install 'pyopencl\[pocl\]'"):
        choose_device()


def python(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run ``code`` in a process of its own, in which OpenCL starts anew."""
    inherited = {k: v for k, v in os.environ.items() if k not in ("MBINTERVAL_POCL_CPU",)}
    path = os.pathsep.join([str(ROOT), str(ROOT / "tests"), os.environ.get("PYTHONPATH", "")])
    return subprocess.run(
        [sys.executable, "-c", code], env=inherited | {"PYTHONPATH": path} | environment,
        capture_output=True, text=True, timeout=600, check=False,
    )  # fmt: skip


def test_a_kernel_that_does_not_build_raises_with_file_options_and_log(tmp_path):
    file = tmp_path / "broken.cl"
    file.write_text("kernel void f(global float *p) { p[0] = no_such_name; }\n")
    with pytest.raises(KernelBuildError) as caught:
        runtime().kernel(str(file), "f", ("-DSOME_OPTION",))
    for part in (str(file), "-DSOME_OPTION", runtime().device.name.strip(), "no_such_name"):
        assert part in str(caught.value)
    assert isinstance(caught.value, DeviceError)
    assert KernelBuildError.exit_code == 4


class Gone(cl.RuntimeError):
    """What OpenCL raises then."""

    code = cl.status_code.DEVICE_NOT_AVAILABLE


class Dead:
    """What OpenCL has of a device that is gone: nothing can be made or done."""

    def __getattr__(self, name):
        def fail(*_, **__):
            raise Gone(f"{name} failed: DEVICE_NOT_AVAILABLE")

        return fail


def test_a_device_that_dies_in_a_render_is_a_device_error(monkeypatch):
    monkeypatch.setattr(Runtime, "queue", Dead())
    monkeypatch.setattr(cl, "enqueue_copy", Dead().enqueue_copy)
    monkeypatch.setattr(cl, "enqueue_nd_range_kernel", Dead().enqueue_kernel)
    with pytest.raises(DeviceError, match=r"the device failed: enqueue\w+ failed"):
        mb.render(scene([]), width=8, height=8)


@pytest.mark.parametrize("of", ["Context", "CommandQueue", "Kernel"])
def test_a_device_that_is_gone_before_is_a_device_error(of, monkeypatch, tmp_path):
    file = tmp_path / "three.cl"
    file.write_text("kernel void three(global int *p) { p[0] = 3; }\n")
    made = Runtime(choose_device())
    made._program(str(file), ())
    monkeypatch.setattr(cl, of, getattr(Dead(), of))
    use = {
        "Context": lambda: Runtime(choose_device()),
        "CommandQueue": lambda: made.queue,
        "Kernel": lambda: made.kernel(str(file), "three"),
    }
    with pytest.raises(DeviceError, match=f"the device failed: {of} failed"):
        use[of]()


def test_a_device_that_tells_nothing_of_arguments_is_one_that_builds_no_kernel(monkeypatch):
    for error in (cl.LogicError, cl.RuntimeError):

        def fail(*_, error=error):
            raise error("KERNEL_ARG_INFO_NOT_AVAILABLE")

        monkeypatch.setattr(cl.Kernel, "get_arg_info", fail)
        with pytest.raises(KernelBuildError, match="nothing of kernels' arguments"):
            Runtime(choose_device())


def test_a_runtime_is_shared_by_device_and_programs_are_built_once(tmp_path):
    device = choose_device()
    assert runtime(device) is runtime() is runtime(runtime())
    file = tmp_path / "one.cl"
    file.write_text("kernel void one(global int *p) { p[0] = 1; }\n")
    kernel = runtime().kernel(str(file), "one")
    file.write_text("this would not build")
    assert runtime().kernel(str(file), "one") is kernel


def test_kernels_are_made_per_thread(tmp_path):
    from concurrent.futures import ThreadPoolExecutor

    file = tmp_path / "two.cl"
    file.write_text("kernel void two(global int *p) { p[0] = 2; }\n")
    mine = runtime().kernel(str(file), "two")
    with ThreadPoolExecutor(1) as pool:
        other = pool.submit(lambda: runtime().kernel(str(file), "two")).result()
    assert other is not mine


def test_two_runtimes_that_build_at_once_say_nothing_and_leave_warnings_as_they_are(tmp_path):
    """What a compiler remarks goes to the log: pyopencl warns of it, as of an error here."""
    import warnings
    from concurrent.futures import ThreadPoolExecutor

    def build(device: Runtime) -> None:
        for number in range(8):
            device.kernel(str(tmp_path / f"{number}.cl"), "f", (f"-DBY={id(device)}",))

    for number in range(8):
        text = '#warning "a remark"\nkernel void f(global long *p) { p[0] = BY; }\n'
        (tmp_path / f"{number}.cl").write_text(text)
    before = list(warnings.filters)
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(build, [Runtime(choose_device()) for _ in range(2)]))
    assert warnings.filters == before


def test_renders_in_two_threads_at_once_are_those_of_one():
    from concurrent.futures import ThreadPoolExecutor

    scenes = [scene([slab(rectangle(3, 9, -1, 17), (v, 0), 2.0, (32, 16))]) for v in (5, 9, 13, 17)]
    alone = [mb.render(s, width=32, height=16).rgba for s in scenes]
    with ThreadPoolExecutor(2) as pool:
        together = list(pool.map(lambda s: mb.render(s, width=32, height=16).rgba, scenes * 3))
    for index, image in enumerate(together):
        assert np.array_equal(image, alone[index % 4])


def test_render_takes_a_device_by_name_and_by_object():
    picture = scene([slab(rectangle(3, 9, -1, 17), (5, 0), 2.0, (32, 16))])
    films = [
        mb.render(picture, width=32, height=16, device=device).rgba
        for device in (None, 0, devices()[0].name, choose_device(0))
    ]
    assert all(np.array_equal(film, films[0]) for film in films)
    with pytest.raises(DeviceError, match="Quantum"):
        mb.render(picture, width=32, height=16, device="Quantum")


def test_uploaded_arrays_come_back_and_empty_ones_are_allowed():
    device: Runtime = runtime()
    values = np.arange(1000, dtype=np.float32)
    for given in (values, np.arange(2000, dtype=np.float32)[::2]):
        there = device.upload("float", given)
        assert np.array_equal(device.download(there, (1000,), np.float32), given)
    device.upload("double", np.zeros(0))
    filled = device.allocate("int", 16)
    device.fill(filled, 7)
    assert device.download(filled, (16,), np.int32).tolist() == [7] * 16


@pytest.mark.parametrize("method", ["analytic", "stochastic", "accumulation"])
def test_stages_account_for_most_of_a_render(method):
    cubes, settings = fast_cubes(200), mb.Settings(method=method, samples=4)
    shares = []
    for _ in range(12):  # the first builds the kernels; the rest, for what others may do meanwhile
        started = time.perf_counter()
        film = mb.render(cubes, width=384, height=288, settings=settings)
        shares.append(sum(film.timings.values()) / (time.perf_counter() - started))
    assert 0.5 < max(shares[1:]) < 1.05
