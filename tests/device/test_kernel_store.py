"""What PoCL would end the process for is noticed before: cache, disk, linker, threads, fork."""

from __future__ import annotations

import itertools
import os
import resource
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.nightly import nightly
from support.processes import mbinterval, python, renderer

from mbinterval.device import kernel_store
from mbinterval.device.choose import devices
from mbinterval.device.kernel_store import KernelStore, RunFolder, store_folder

IS_POCL = any("Portable Computing" in device.platform for device in devices())
FILES = {"AB/CD/program.bc": bytes(range(256)), "AB/CD/f/1/f.so": b"", "AB/CD/g/1/g.so": b"\n{"}


def mounted(folder: Path, options: str) -> bool:
    folder.mkdir(exist_ok=True)
    command = ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(folder)]
    return not subprocess.run(command, capture_output=True, check=False).returncode


@pytest.fixture
def mount(tmp_path) -> Iterator[object]:
    """Mounts a file system in memory, for which it takes root; says whether that was possible."""
    made: list[Path] = []

    def mount(folder: Path, options: str) -> bool:
        made.append(folder)
        return shutil.which("mount") is not None and mounted(folder, options)

    yield mount
    for folder in made:
        subprocess.run(["umount", str(folder)], capture_output=True, check=False)


def kept_files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file())


# The store.


def test_what_is_kept_comes_back_and_replaces_what_was_there(tmp_path):
    store = KernelStore(tmp_path)
    assert store.load("abc") == {}
    store.save("abc", FILES)
    assert KernelStore(tmp_path).load("abc") == FILES
    store.save("abc", {"x": b"1"})
    assert store.load("abc") == {"x": b"1"}
    assert store.load("abd") == {}
    assert len(kept_files(tmp_path)) == 1


DAMAGE = {
    "cut": lambda path: os.truncate(path, path.stat().st_size * 2 // 3),
    "empty": lambda path: path.write_bytes(b""),
    "one bit": lambda path: path.write_bytes(flipped(path.read_bytes())),
    "zeros": lambda path: path.write_bytes(bytes(path.stat().st_size)),
    "longer": lambda path: path.write_bytes(path.read_bytes() + b"\0"),
    "a folder": lambda path: (path.unlink(), path.mkdir()),
}


def flipped(content: bytes) -> bytes:
    place = len(content) * 3 // 4
    return content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :]


@pytest.mark.parametrize("damage", DAMAGE)
def test_damaged_files_are_said_once_and_made_again(tmp_path, damage, caplog):
    store = KernelStore(tmp_path)
    for key in ("abc", "abd"):
        store.save(key, FILES)
    for path in kept_files(tmp_path):
        DAMAGE[damage](path)
    assert store.load("abc") == store.load("abd") == {}
    (said,) = caplog.messages
    assert str(tmp_path) in said
    if damage != "a folder":
        store.save("abc", FILES)
        assert KernelStore(tmp_path).load("abc") == FILES


def test_names_that_lead_out_of_the_folder_are_not_unpacked(tmp_path):
    run = RunFolder(tmp_path / "run")
    run.path.mkdir()
    run.put({"../out": b"x", str(tmp_path / "absolute"): b"x", "AB/in.so": b"y"})
    assert [path.name for path in kept_files(tmp_path)] == ["in.so"]


def test_the_store_is_where_the_environment_says(monkeypatch, tmp_path):
    monkeypatch.setenv("POCL_CACHE_DIR", "/a/b")
    assert store_folder() == Path("/a/b")
    monkeypatch.delenv("POCL_CACHE_DIR")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert store_folder() == tmp_path / "mbinterval" / "kernels"
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert store_folder() == Path.home() / ".cache" / "mbinterval" / "kernels"


# In processes.

WARM = """
import sys
from mbinterval.device.kernel_store import KernelStore, RunFolder
RunFolder.check_room = KernelStore.save = None  # called where a program is compiled
from mbinterval import cli
sys.exit(cli.main(sys.argv[1:]))
"""


def test_kernels_are_compiled_once_and_damaged_ones_again(tmp_path):
    render, cache = renderer(tmp_path), {"POCL_CACHE_DIR": str(tmp_path / "cache")}
    film = tmp_path / "film.exr"
    assert render(environment=cache).stderr == ""
    first, kept = film.read_bytes(), kept_files(tmp_path / "cache")
    assert kept
    scene = ("render", tmp_path / "box.toml", "--samples", 1, "--overwrite", "-q", "-o", film)
    warm = python("-c", WARM, *scene, environment=cache)
    assert (warm.returncode, warm.stderr) == (0, "")
    for path in kept:
        os.truncate(path, 3000)
    again = render(environment=cache)
    assert again.returncode == 0
    assert len(again.stderr.splitlines()) == 1
    assert "holds damaged files" in again.stderr
    assert film.read_bytes() == first
    assert render(environment=cache).stderr == ""


@pytest.mark.parametrize("place", ["full", "noexec", nightly("below a file"), nightly("read-only")])
def test_a_cache_that_cannot_be_used_is_left_out_with_one_line(tmp_path, mount, place):
    """Where mounting is refused, below a regular file stands in: root can't write there either."""
    folder = tmp_path / "cache"
    options = {"full": "size=40k", "read-only": "ro", "noexec": "noexec"}.get(place)
    if options is None or not mount(folder, options):
        (tmp_path / "file").touch()
        folder, place = tmp_path / "file" / "cache", "below a file"
    run = renderer(tmp_path)(environment={"POCL_CACHE_DIR": str(folder)})
    assert run.returncode == 0, run.stderr
    said = run.stderr.splitlines()
    assert len(said) == (place != "noexec")
    assert all(str(folder) in line for line in said)
    assert (tmp_path / "film.exr").stat().st_size > 1000


def test_folders_to_compile_in_are_tried_one_after_the_other(tmp_path, mount):
    """Temporary files first; one that is full or noexec is passed by, in silence."""
    place, store = tmp_path / "temporary", tmp_path / "store"
    for options in ("size=40k", "noexec", "ro"):
        if not mount(place, options):
            place.rmdir()
            place.touch()
        code = (
            "from mbinterval.device.opencl import opencl, start; opencl(); run = start().run\n"
            "print(run.path.parent)"
        )
        environment = {"TMPDIR": str(place), "POCL_CACHE_DIR": str(store)}
        run = python("-c", code, environment=environment)
        assert run.returncode == 0, run.stderr
        assert run.stdout.strip() != str(place)
        subprocess.run(["umount", str(place)], capture_output=True, check=False)
        if place.is_file():
            place.unlink()


def test_no_folder_at_all_is_an_error_that_says_what_to_do(tmp_path, monkeypatch):
    full = tmp_path / "full"
    monkeypatch.setattr(kernel_store, "_places", lambda store: [full, tmp_path / "file" / "x"])
    monkeypatch.setattr(kernel_store, "_unfit", lambda folder: "has no room (No space left)")
    (tmp_path / "file").touch()
    run, trouble = RunFolder.make(None)
    assert run is None
    assert f"{full} has no room (No space left)" in trouble
    assert f"{tmp_path / 'file' / 'x'} cannot be written (Not a directory)" in trouble
    assert "Set TMPDIR" in trouble
    assert list(full.iterdir()) == []


NO_ROOM = """
import resource, signal, sys
import mbinterval as mb
if sys.argv[1] == "later":
    mb.devices()
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 20, resource.RLIM_INFINITY))
try:
    print("rendered", mb.render(mb.Scene(meshes=()), width=4, height=4).device)
except mb.DeviceError as error:
    print("error", error)
"""


@pytest.mark.parametrize("when", ["first", "later"])
def test_no_room_for_a_kernel_is_an_error_before_it_kills(tmp_path, when):
    """A limit to the size of files stands in for a full disk."""
    run = python("-c", NO_ROOM, when, environment={"POCL_CACHE_DIR": str(tmp_path)})
    assert run.returncode == 0, run.stderr
    if IS_POCL:
        assert run.stdout.startswith("error ")
        assert "has no room" in run.stdout
        assert "TMPDIR" in run.stdout
    else:
        assert run.stdout.startswith("rendered")


HELD = """
import sys
from mbinterval.device.opencl import start
print(start().run.path, flush=True)
sys.stdin.read()
"""


def test_folders_of_killed_processes_are_removed_and_those_of_others_stay(tmp_path):
    environment = os.environ | {"TMPDIR": str(tmp_path)}
    held = [
        subprocess.Popen(
            [sys.executable, "-c", HELD], env=environment, text=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        )
        for _ in range(2)
    ]  # fmt: skip
    paths = [Path(process.stdout.readline().strip()) for process in held]
    assert all(path.is_dir() for path in paths)
    held[0].send_signal(signal.SIGKILL)
    held[0].communicate()
    assert python("-c", HELD, environment=environment, stdin=subprocess.DEVNULL).returncode == 0
    assert [path.is_dir() for path in paths] == [False, True]
    held[1].communicate("")
    assert list(tmp_path.iterdir()) == []


def test_a_second_runtime_of_a_device_leaves_kernels_in_use_alone(tmp_path):
    """What PoCL has mapped into memory must not be written again: the process would end."""
    code = (
        "import mbinterval as mb\n"
        "from mbinterval.device.choose import choose_device\n"
        "from mbinterval.device.runtime import Runtime\n"
        "from mbinterval.scene.generators import fast_cubes\n"
        "one = mb.Settings(samples=1)\n"
        "def job(device): return mb.render(\n"
        "    fast_cubes(3), width=8, height=6, settings=one, device=device).rgba.tobytes()\n"
        "films = [job(Runtime(choose_device())) for _ in range(3)]\n"
        "print(len(set(films)))\n"
    )
    for _ in range(2):  # compiled, and kept
        run = python("-c", code, environment={"POCL_CACHE_DIR": str(tmp_path / "cache")})
        assert (run.returncode, run.stdout) == (0, "1\n"), run.stderr


# The linker.


def bare_path(tmp_path: Path, **programs: str) -> dict[str, str]:
    """An environment whose path has nothing but shell scripts of these contents."""
    folder = tmp_path / "bin"
    folder.mkdir()
    for name, text in programs.items():
        path = folder / name.replace("_", ".")
        path.write_text(f"#!/bin/sh\n{text}\n")
        path.chmod(0o755)
    return {"PATH": str(folder), "POCL_CACHE_DIR": str(tmp_path / "cache")}


def test_without_a_linker_it_says_how_to_get_one(tmp_path):
    run = renderer(tmp_path)(environment=bare_path(tmp_path))
    if not IS_POCL:
        assert run.returncode == 0, run.stderr
        return
    assert run.returncode == 4
    (said,) = run.stderr.splitlines()
    for remedy in ("apt install binutils", "dnf install binutils", "pip install ziglang"):
        assert remedy in said
    assert not (tmp_path / "film.exr").exists()


def test_another_linker_does_and_the_path_stays(tmp_path):
    ld = shutil.which("ld")
    if ld is None:  # then the suite itself has rendered by another one
        assert shutil.which("ld.lld")
        return
    environment = bare_path(tmp_path, ld_lld=f'echo linked >>{tmp_path}/log\nexec {ld} "$@"')
    run = renderer(tmp_path)(environment=environment)
    assert (run.returncode, run.stderr) == (0, "")
    assert (tmp_path / "log").exists() == IS_POCL


ZIG = """
import os, sys
place = os.environ["ZIG_TEST"]
with open(place, "a") as file:
    print(sys.argv[1], file=file)
os.execv(os.environ["ZIG_LD"], ["ld", *sys.argv[2:]])
"""


def test_zigs_package_has_a_linker(tmp_path):
    ld = shutil.which("ld") or shutil.which("ld.lld")
    package = tmp_path / "packages" / "ziglang"
    package.mkdir(parents=True)
    (package / "__init__.py").touch()
    (package / "__main__.py").write_text(ZIG)
    log = tmp_path / "log"
    environment = bare_path(tmp_path) | {"ZIG_TEST": str(log), "ZIG_LD": str(ld)}
    run = renderer(tmp_path)(environment=environment, path=(package.parent,))
    assert (run.returncode, run.stderr) == (0, "")
    if IS_POCL:
        assert set(log.read_text().split()) == {"ld.lld"}


# Threads, and what PoCL is told.


@pytest.mark.parametrize("threads", ["0", "5000", "-1", "many", "1.5"])
def test_a_number_of_threads_that_is_none_is_an_error(threads):
    run = mbinterval("devices", environment={"MBINTERVAL_THREADS": threads})
    assert run.returncode == 4
    assert f"MBINTERVAL_THREADS='{threads}': expected a whole number from 1 to 4096" in run.stderr


@pytest.mark.parametrize("how", ["option", "variable"])
def test_threads_that_the_system_does_not_give_are_an_error(tmp_path, how):
    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (3 << 30, 3 << 30))

    given = ("--threads", 1000) if how == "option" else ()
    environment = {} if how == "option" else {"MBINTERVAL_THREADS": "1000"}
    run = renderer(tmp_path)(*given, environment=environment, preexec_fn=limit)
    assert run.returncode == 4
    assert "of the 1000 threads" in run.stderr
    assert "--threads or MBINTERVAL_THREADS" in run.stderr


def test_pocl_devices_that_name_none_are_told_from_a_broken_cache(tmp_path):
    run = renderer(tmp_path)(environment={"POCL_DEVICES": "nonsense"})
    if IS_POCL:
        assert run.returncode == 4
        assert "POCL_DEVICES='nonsense'" in run.stderr
        assert "cache" not in run.stderr
    else:
        assert run.returncode == 0


def test_what_pocl_is_told_is_not_told_to_other_processes(tmp_path):
    code = "import os, mbinterval; before = dict(os.environ); mbinterval.devices()\n"
    code += "print(before == dict(os.environ))"
    environment = {"MBINTERVAL_THREADS": "1", "PYOPENCL_NO_CACHE": None}
    assert python("-c", code, environment=environment).stdout == "True\n"


# Fork.

FORK = """
import concurrent.futures, multiprocessing, os, sys
import mbinterval as mb
scene = mb.load({"objects": [{"primitive": {"kind": "box", "size": [1, 1, 1]}}]})
one = mb.Settings(samples=1)

def job(number):
    try:
        return float(mb.render(scene, width=8, height=6, settings=one).rgba.sum())
    except mb.DeviceError as error:
        return str(error)

def pool():
    with multiprocessing.get_context("fork").Pool(2) as workers:
        return workers.map(job, [1, 2])

def executor():
    context = multiprocessing.get_context("fork")
    with concurrent.futures.ProcessPoolExecutor(2, mp_context=context) as workers:
        return list(workers.map(job, [1, 2]))

def bare():
    found = []
    for number in (1, 2):
        ours, theirs = os.pipe()
        if not os.fork():
            os.write(theirs, job(number).encode() if used else str(job(number)).encode())
            sys.exit()  # as scripts end: with what Python does at exit
        os.wait()
        text = os.read(ours, 4096).decode()
        found.append(text if used else float(text))
    return found

used = sys.argv[2] == "used"
if used:
    mb.devices() if sys.argv[3] == "listed" else job(0)
children = {"pool": pool, "executor": executor, "bare": bare}[sys.argv[1]]()
if used:
    assert all("'spawn'" in text and "forked" in text for text in children), children
print(children[0] if not used else job(0), len(children), children[0] == job(0))
"""


WAYS = ("pool", "executor", "bare")
BEFORE = ("unused", "rendered", "listed")
EACH_ONCE = tuple(zip(WAYS, BEFORE, strict=True))


@pytest.mark.parametrize(
    ("way", "before"),
    [case if case in EACH_ONCE else nightly(*case) for case in itertools.product(WAYS, BEFORE)],
)
def test_a_forked_child_renders_or_says_at_once_to_spawn(way, before):
    used = "unused" if before == "unused" else "used"
    run = python("-W", "ignore::DeprecationWarning", "-c", FORK, way, used, before, timeout=120)
    assert run.returncode == 0, run.stderr
    value, count, equal = run.stdout.split()
    assert float(value) > 0.0
    assert (count, equal) == ("2", str(used == "unused"))
