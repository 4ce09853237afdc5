"""Outputs of processes: full disks, pipes, devices, folders that cannot be written to, kills."""

from __future__ import annotations

import json
import os
import random
import shlex
import signal
import stat
import subprocess
import sys
import time
from pathlib import Path

import pytest
from support.nightly import nightly

ROOT = Path(__file__).parents[2]
SCENE = """
[camera]
position = [0, 0, 4]
look_at = [0, 0, 0]
[[lights]]
kind = "ambient"
[[objects]]
primitive = { kind = "plane", size = [1, 1] }
transform.keys = [{ frame = 0, translation = [-1, 0, 0] }, { frame = 9, translation = [1, 0, 0] }]
[render]
width = 64
height = 48
"""
MBINTERVAL = [sys.executable, "-m", "mbinterval"]
ENVIRONMENT = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "s.toml").write_text(SCENE)
    return tmp_path


def run(folder, *command, **options):
    """Run a command in ``folder``: exit code, and what it printed and said."""
    done = subprocess.run(
        command, cwd=folder, env=ENVIRONMENT, text=True, capture_output=True, timeout=120, **options
    )
    return done.returncode, done.stdout, done.stderr


def render(folder, *arguments, **options):
    return run(folder, *MBINTERVAL, "render", "s.toml", "-q", *arguments, **options)


def files(folder, pattern="*"):
    return {path.name: path.read_bytes() for path in folder.glob(pattern) if path.is_file()}


# Full disks

EVERY_WRITER = """
import json, os, resource, sys
from pathlib import Path
import numpy as np
import mbinterval as mb
from mbinterval.files.ownership import SOFTWARE
from mbinterval.files.results import write_result
from mbinterval.batch.stats_file import StatsFile
from mbinterval.study import reference, run

scene = mb.load("s.toml")
film = mb.render(scene, frame=2, width=64, height=48, settings=mb.Settings(aovs=("deep", "events")))
made = reference.Reference(np.zeros((2, 5, 5, 3), np.float32), "made")
rows = [{"frame": 1, "seconds": {"paths": 0.1}}]
result = {"sweeps": {"samples": {"series": "exact", "rows": [{"name": "exact"}]}}}

def write_stats(path):
    with StatsFile(path, overwrite=True) as stats:
        stats.add(rows[0])

writers = {f"a.{end}": film.write for end in ("exr", "deep.exr", "png", "npz", "parquet")}
writers |= {
    "bench.json": lambda path: write_result(path, {"format": 1, "software": SOFTWARE}),
    "stats.json": write_stats,
    "study.csv": lambda path: run.write_csv(path, result),
    "reference.npz": lambda path: reference._write(Path(path), made),
}
found = {}
for name, write in writers.items():
    write(name)
    whole = Path(name).read_bytes()
    for room in sorted({0, 1, 512, len(whole) // 2, len(whole) - 1}):
        if room >= len(whole):
            continue
        resource.setrlimit(resource.RLIMIT_FSIZE, (room, resource.RLIM_INFINITY))
        try:
            write(name)
            said = "no error"
        except mb.OutputError as error:
            said = str(error)
        resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY,) * 2)
        found[f"{name} {room}"] = [said, Path(name).read_bytes() == whole]
print(json.dumps(found))
"""


def test_no_writer_cuts_a_file_where_there_is_no_room_for_all_of_it(folder):
    """A limit of the file size fails as a full disk does: what fits is written, no more."""
    code, out, said = run(folder, sys.executable, "-c", EVERY_WRITER)
    assert code == 0, said
    found = json.loads(out)
    assert len(found) > 9 * 3
    for place, outcome in found.items():
        name = place.split(" ")[0]
        assert outcome == [f"{name}: cannot be written (File too large)", True], place
    assert not [name for name in files(folder) if name.startswith(".")]


IN_FORTY_KILOBYTES = """
mount -t tmpfs -o size=40k none disk || exit 99
cd disk
{command}
echo "exit $?" >&2
for file in $(ls -A); do sha256sum $file; done
"""


@pytest.mark.parametrize(
    "outputs",
    ["a.####.exr", "a.####.npz,a.####.png", nightly("a.####.deep.exr"), nightly("a.####.parquet")],
)
def test_a_full_disk_ends_a_batch_and_all_frames_before_are_whole(folder, outputs):
    """Frames of some KB on a disk of 40."""
    assert render(folder, "--frames", "1-30", "-o", outputs)[0] == 0
    (folder / "disk").mkdir()
    options = ["../s.toml", "--frames", "1-30", "-o", outputs]
    command = shlex.join([*MBINTERVAL, "render", *options])
    script = IN_FORTY_KILOBYTES.format(command=command)
    for namespace in (["unshare", "-m"], ["unshare", "-rm"]):
        code, out, said = run(folder, *namespace, "sh", "-c", script)
        if code not in (1, 99):
            break
    else:
        pytest.skip("no file system can be mounted here")
    assert "exit 6\n" in said
    assert "cannot be written (No space left on device)" in said
    there = dict(reversed(line.split()) for line in out.splitlines())
    sums = run(folder, "sh", "-c", "sha256sum a.*")[1]
    whole = dict(reversed(line.split()) for line in sums.splitlines())
    assert len(there) > 2
    assert there.items() <= whole.items()


LOGS = """
import resource, sys
from pathlib import Path
from mbinterval import cli

def render(name):
    return cli.main(["render", "s.toml", "-q", "--overwrite", "-o", "a.png", "--log", name])

assert render("whole.jsonl") == 0
lines = Path("whole.jsonl").read_bytes().splitlines(keepends=True)
assert len(lines) == 3
most = sum(map(len, lines))
for size in (len(lines[0]) // 2, most - len(lines[2]) + 9):
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))
    print(render(f"{size}.jsonl"))
    resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY,) * 2)
"""


def test_a_log_that_finds_no_room_for_a_line_ends_the_job(folder):
    """Also where a part of the line has room, and where it is the last one."""
    code, out, said = run(folder, sys.executable, "-c", LOGS)
    assert (code, out) == (0, "6\n6\n"), said
    assert said.count("error: ") == 2
    assert said.count(".jsonl: cannot be written (File too large)\n") >= 2


@pytest.mark.parametrize("command", [["devices"], ["info", "s.toml"], ["openjd", "s.toml"]])
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_what_is_printed_onto_a_full_disk_is_an_error(folder, command, unbuffered):
    with open("/dev/full", "wb") as full:
        done = subprocess.run(
            [*MBINTERVAL, *command],
            cwd=folder,
            env=ENVIRONMENT | {"PYTHONUNBUFFERED": unbuffered},
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            timeout=120,
        )
    assert done.returncode == 6
    text = "mbinterval: error: standard output: cannot be written (No space left on device)\n"
    assert done.stderr == text


# Pipes and devices


def test_a_pipe_gets_the_statistics_of_all_frames_once(folder):
    os.mkfifo(folder / "pipe")
    with subprocess.Popen(["cat", "pipe"], cwd=folder, stdout=subprocess.PIPE) as reader:
        options = "--frames", "1-3", "-o", "a.#.exr", "--stats", "pipe"
        assert render(folder, *options) == (0, "", "")
        got = reader.communicate(timeout=60)[0]
    assert [row["frame"] for row in json.loads(got)] == [1, 2, 3]
    assert stat.S_ISFIFO((folder / "pipe").stat().st_mode)


def test_a_pipe_gets_a_log_to_its_end(folder):
    os.mkfifo(folder / "pipe")
    with subprocess.Popen(["cat", "pipe"], cwd=folder, stdout=subprocess.PIPE) as reader:
        options = "--frames", "1-3", "-o", "a.#.exr", "--log", "pipe"
        assert render(folder, *options) == (0, "", "")
        got = reader.communicate(timeout=60)[0]
    events = [json.loads(line)["event"] for line in got.splitlines()]
    assert events == ["start", "frame", "frame", "frame", "end"]


def test_a_pipe_gets_a_film_each_time(folder):
    """No frame in it is complete, and what is in it is not read to see."""
    os.mkfifo(folder / "a.png")
    for _ in range(2):
        with subprocess.Popen(["cat", "a.png"], cwd=folder, stdout=subprocess.PIPE) as reader:
            assert render(folder, "-o", "a.png,b.png")[0] == 0
            got = reader.communicate(timeout=60)[0]
        assert got == (folder / "b.png").read_bytes()
    assert {path.name for path in folder.iterdir()} == {"a.png", "b.png", "s.toml"}


def test_standard_output_can_take_the_statistics(folder):
    """By a link as /dev/stdout is one, which root could replace."""
    (folder / "stdout").symlink_to("/proc/self/fd/1")
    for name in ("stdout", "/dev/fd/1"):
        code, out, _ = render(folder, "-o", "a.exr", "--stats", name)
        assert (code, len(json.loads(out))) == (0, 1)
    command = f"echo before; {shlex.join(MBINTERVAL)} render s.toml -q -o a.exr --stats stdout"
    assert run(folder, "sh", "-c", f"({command}; echo after) > out")[0] == 0
    lines = (folder / "out").read_text().splitlines()
    assert (lines[0], lines[-1]) == ("before", "after")
    assert json.loads("".join(lines[1:-1]))[0]["frame"] == 1
    assert (folder / "stdout").is_symlink()


@pytest.mark.parametrize(
    "option",
    [["-o"], ["-o", "a.png", "--log"], nightly(["-o", "a.png", "--stats"])],
    ids=["film", "log", "statistics"],
)
def test_devices_are_never_replaced(folder, option):
    """Nodes of the test's own: as /dev/null and /dev/full, and that of a disk that is not there."""
    character, block = (stat.S_IFCHR, 1), (stat.S_IFBLK, 7)
    nodes = {"null": (*character, 3), "full": (*character, 7), "disk": (*block, 99)}
    try:
        for name, (kind, major, minor) in nodes.items():
            os.mknod(folder / f"{name}.exr", kind | 0o666, os.makedev(major, minor))
        (folder / "null.exr").open("wb").close()
    except PermissionError:
        pytest.skip("no device nodes can be made here")
    (folder / "link.exr").symlink_to("full.exr")
    said = {
        "null": (0, ""),
        "full": (6, "full.exr: cannot be written (No space left on device)"),
        "link": (6, "link.exr: cannot be written (No space left on device)"),
        "disk": (6, "disk.exr: is a socket or a disk; give the name of a file, or a pipe"),
    }
    for name, (code, text) in said.items():
        found = render(folder, "--overwrite", *option, f"{name}.exr")
        assert found[0] == code, (name, found)
        assert text in found[2]
    for name, (kind, major, minor) in nodes.items():
        found = (folder / f"{name}.exr").stat()
        assert (stat.S_IFMT(found.st_mode), found.st_rdev) == (kind, os.makedev(major, minor))
    assert (folder / "link.exr").is_symlink()


# Root may write anywhere, unless it gives that up (CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH).
AS_ANYONE = """
import ctypes, sys
header, data = (ctypes.c_uint32 * 2)(0x20080522, 0), (ctypes.c_uint32 * 6)()
ctypes.CDLL(None).capget(header, data)
for index in range(3):
    data[index] &= ~6
ctypes.CDLL(None).capset(header, data)
from mbinterval import cli
sys.exit(cli.main(["render", "s.toml", "-q", *sys.argv[1:]]))
"""


def test_a_link_into_a_folder_that_cannot_be_written_to_is_said_before_any_work(folder):
    (folder / "disk").mkdir()
    (folder / "disk" / "a.exr").write_bytes(b"")
    (folder / "link.exr").symlink_to("disk/a.exr")
    (folder / "disk").chmod(0o555)
    try:
        command = [sys.executable, "-c", AS_ANYONE, "-o", "b.exr,link.exr"]
        code, _, said = run(folder, *command)
    finally:
        (folder / "disk").chmod(0o755)
    assert code == 6
    place = f"link.exr: cannot be written to {folder.resolve()}/disk/a.exr (Permission denied)"
    assert place in said
    assert (folder / "link.exr").is_symlink()
    assert not (folder / "b.exr").exists()
    assert files(folder / "disk") == {"a.exr": b""}


# Kills


def test_killed_at_any_moment_links_stay_and_no_file_is_lost(folder):
    """Outputs are links into another folder, to files that are there and to some that aren't."""
    (folder / "disk").mkdir()
    names = [f"a.{frame}.exr" for frame in range(1, 7)]
    options = "--frames", "1-6", "--width", "160", "--height", "120", "-o", "a.#.exr"
    assert render(folder, *options)[0] == 0
    whole = files(folder, "a.*")
    assert set(whole) == set(names)
    for name in names:
        (folder / name).unlink()
        (folder / name).symlink_to(f"disk/{name}")
    chance, kills = random.Random(16), 0
    for _ in range(6):
        command = [*MBINTERVAL, "render", "s.toml", *options]
        with subprocess.Popen(
            command, cwd=folder, env=ENVIRONMENT, stderr=subprocess.PIPE, text=True
        ) as process:
            for _ in range(chance.randrange(3)):
                process.stderr.readline()
            time.sleep(chance.uniform(0.0, 0.3))
            process.kill()
        kills += process.returncode == -signal.SIGKILL
        found = files(folder / "disk", "a.*")
        assert found.items() <= whole.items()
        assert all((folder / name).is_symlink() for name in names)
    assert kills > 0
    assert render(folder, *options)[0] == 0
    assert files(folder / "disk", "*") == whole
    assert not list(folder.rglob(".mbinterval*"))
