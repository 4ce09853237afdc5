"""Batches in processes of their own: killed, interrupted, without room, and held to threads."""

from __future__ import annotations

import json
import random
import signal
import time

import pytest
from support.batch_processes import finish, images, start

from mbinterval.device.choose import choose_device
from mbinterval.film.film import Film


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("undisturbed")
    assert finish(start(folder))[0] == 0
    found = images(folder)
    assert len(found) == 12
    return found


def test_killed_at_any_moment_it_loses_the_frame_in_work_at_most(tmp_path, undisturbed):
    """After every kill the files that are there are whole; in the end all are as undisturbed."""
    chance = random.Random(5)
    kills, complete = 0, 0
    while kills < 6:
        process = start(tmp_path, "--log", "log.jsonl")
        for _ in range(chance.randrange(3)):
            process.stderr.readline()  # one for each frame, and one for those that are complete
        time.sleep(chance.uniform(0.0, 0.3))
        process.kill()
        finish(process)
        kills += process.returncode == -signal.SIGKILL
        found = images(tmp_path)
        assert all(undisturbed[name] == data for name, data in found.items())
        now = sum(f"a.000{n}.exr" in found and f"a.000{n}.png" in found for n in range(1, 7))
        assert len(found) - 2 * now in (0, 1)  # of the frame in work one file may be there
        assert now >= complete
        complete = now
        if process.returncode == 0:
            break
    code, _ = finish(start(tmp_path, "--log", "log.jsonl"))
    assert code == 0
    assert images(tmp_path) == undisturbed
    assert not list(tmp_path.glob(".*"))
    lines = [json.loads(line) for line in (tmp_path / "log.jsonl").read_text().splitlines()]
    started = [line["event"] for line in lines].count("start")
    assert started - [line["event"] for line in lines].count("end") <= kills
    rendered = [line["frame"] for line in lines if line.get("status") == "rendered"]
    assert set(rendered) == set(range(1, 7))
    assert len(rendered) <= 6 + kills  # no more than the frame in work is done again


KILLED_WHILE_WRITING = """
import os, signal
count = 0
def replace(*_, real=os.replace):
    global count
    count += 1
    if count == 4:  # the PNG of the second frame
        os.kill(os.getpid(), signal.SIGKILL)
    real(*_)
os.replace = replace
"""


def test_killed_while_it_writes_it_leaves_no_half_file_under_its_name(tmp_path, undisturbed):
    assert finish(start(tmp_path, before=KILLED_WHILE_WRITING))[0] == -signal.SIGKILL
    found = images(tmp_path)
    assert list(found) == ["a.0001.exr", "a.0001.png", "a.0002.exr"]
    assert all(undisturbed[name] == data for name, data in found.items())
    (leftover,) = tmp_path.glob(".mbinterval-*.part")
    code, said = finish(start(tmp_path))
    assert code == 0
    assert said.startswith("1 of 6 frames are complete")
    assert not leftover.exists()
    assert images(tmp_path) == undisturbed


STOPPED_WHILE_WRITING = """
import os, signal
count = 0
def fsync(*_, real=os.fsync):
    global count
    count += 1
    if count == 3:  # the EXR of the second frame
        os.kill(os.getpid(), signal.{})
    real(*_)
os.fsync = fsync
"""


@pytest.mark.parametrize(("name", "code"), [("SIGINT", 130), ("SIGTERM", 143)])
def test_stopped_while_it_writes_it_ends_after_that_frame(tmp_path, undisturbed, name, code):
    before = STOPPED_WHILE_WRITING.format(name)
    assert finish(start(tmp_path, "--log", "log.jsonl", before=before))[0] == code
    found = images(tmp_path)
    assert found == {name: undisturbed[name] for name in list(undisturbed)[:4]}
    lines = [json.loads(line) for line in (tmp_path / "log.jsonl").read_text().splitlines()]
    assert [line.get("frame") for line in lines if line.get("status") == "rendered"] == [1, 2]
    assert [line["event"] for line in lines] == ["start", "frame", "frame", "end"]
    assert lines[-1]["exit"] == code


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_stopped_at_any_moment_it_leaves_whole_frames(tmp_path, undisturbed, number, code):
    process = start(tmp_path)
    process.stderr.readline()
    time.sleep(random.Random(code).uniform(0.0, 0.1))
    process.send_signal(number)
    ended, said = finish(process)
    found = images(tmp_path)
    assert len(found) % 2 == 0
    assert all(undisturbed[name] == data for name, data in found.items())
    assert not list(tmp_path.glob(".*"))
    if len(found) < 12:  # or it was done before the signal came
        assert ended == code
        assert "Traceback" not in said


FULL = """
import resource, signal, mbinterval.batch.batch
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
def render(*_, real=mbinterval.render, **arguments):
    if arguments["frame"] == 3:
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
    return real(*_, **arguments)
mbinterval.batch.batch.render = render
"""


def test_where_files_have_no_room_earlier_frames_stay(tmp_path, undisturbed):
    """A limit to the size of files, between those of the log and of an EXR, stands in for a disk
    that is full: a write comes back short."""
    code, said = finish(start(tmp_path, "--log", "log.jsonl", before=FULL))
    assert code == 6
    assert "a.0003.exr: cannot be written" in said
    assert "Traceback" not in said
    assert images(tmp_path) == {name: undisturbed[name] for name in list(undisturbed)[:4]}
    assert not list(tmp_path.glob(".*"))
    assert finish(start(tmp_path))[0] == 0
    assert images(tmp_path) == undisturbed


# Root may write anywhere, unless it gives that up (CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH).
AS_ANYONE = """
import ctypes
header, data = (ctypes.c_uint32 * 2)(0x20080522, 0), (ctypes.c_uint32 * 6)()
ctypes.CDLL(None).capget(header, data)
for index in range(3):
    data[index] &= ~6
ctypes.CDLL(None).capset(header, data)
"""


def test_a_folder_that_cannot_be_written_to_is_said_before_any_work(tmp_path):
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / "a.0001.exr").write_bytes(b"before")
    folder.chmod(0o555)
    try:
        code, said = finish(start(tmp_path, "-o", "out/a.####.exr", before=AS_ANYONE))
    finally:
        folder.chmod(0o755)
    assert code == 6
    assert "out/a.0001.exr: cannot be written (Permission denied)" in said
    assert [path.name for path in folder.iterdir()] == ["a.0001.exr"]
    assert not images(tmp_path)  # frames go to all outputs or to none


def on_pocl() -> bool:
    return "Portable Computing Language" in choose_device().platform.name


THREADS = """
import atexit, mbinterval
atexit.register(lambda: print(mbinterval.devices()[0].compute_units, file=sys.stderr))
"""


@pytest.mark.parametrize("count", [1, 3])
def test_a_batch_is_held_to_its_threads_and_writes_the_same(tmp_path, undisturbed, count):
    code, said = finish(start(tmp_path, "--threads", str(count), before=THREADS))
    units = choose_device().max_compute_units
    if not on_pocl() and count < units:
        assert (code, images(tmp_path)) == (4, {})
        assert f"can't be held to {count}: only PoCL can" in said
        return
    assert code == 0
    assert said.splitlines()[-1] == str(count if on_pocl() else units)
    assert images(tmp_path) == undisturbed


def test_threads_that_are_asked_for_too_late_are_refused(tmp_path):
    before = "import mbinterval; mbinterval.render(mbinterval.Scene(meshes=()), width=8, height=8)"
    code, said = finish(start(tmp_path, "--threads", "1", before=f"import os\n{FOUR}\n{before}"))
    assert code == 4
    count = 4 if on_pocl() else choose_device().max_compute_units
    assert f"uses {count} threads and can't be held to 1: only PoCL can, and only before" in said
    assert not images(tmp_path)


FOUR = "os.environ.pop('MBINTERVAL_THREADS', 0); os.environ['POCL_MAX_PTHREAD_COUNT'] = '4'"


def test_films_of_a_batch_are_read_back_whole(tmp_path, undisturbed):
    (tmp_path / "a.exr").write_bytes(undisturbed["a.0003.exr"])
    film = Film.read(tmp_path / "a.exr")
    assert film.metadata["frame"] == 3.0
    assert len(film.metadata["identity"]) == 64


NO_MEMORY = """
import resource, mbinterval.batch.batch
from pathlib import Path
def render(*_, real=mbinterval.render, **arguments):
    if arguments["frame"] == 3:
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        limit = pages * resource.getpagesize() + (8 << 20)
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
        arguments |= {"width": 1600, "height": 1200}
    return real(*_, **arguments)
mbinterval.batch.batch.render = render
"""


def test_a_device_that_runs_out_of_memory_ends_the_job_and_earlier_frames_stay(
    tmp_path, undisturbed
):
    """The process may take 8 MB more, the film's buffers of the CPU device take 46."""
    code, said = finish(start(tmp_path, "--log", "log.jsonl", before=NO_MEMORY))
    assert code == 5
    assert "out of memory" in said
    assert "Traceback" not in said
    assert images(tmp_path) == {name: undisturbed[name] for name in list(undisturbed)[:4]}
    assert not list(tmp_path.glob(".*"))
    failed, end = (
        json.loads(line) for line in (tmp_path / "log.jsonl").read_text().splitlines()[-2:]
    )
    assert (failed["frame"], failed["status"], failed["exit"], end["exit"]) == (3, "failed", 5, 5)
