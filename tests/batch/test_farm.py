"""Batches on Dask's workers and as Open Job Description, with real processes, some of them killed.

Workers and tasks of the tests run this code before their own (`Runtime.run` is where work goes to a
device's queue), so that a kill meets a frame whose kernel runs.
"""

from __future__ import annotations

import itertools
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from support.batch_processes import OPTIONS, ROOT, SCENE, finish, images, start
from support.nightly import nightly

from mbinterval.batch.job_template import frame_ranges, job_template, render_options
from mbinterval.errors import UsageError
from mbinterval.film.bands import join, split
from mbinterval.film.frame_ranges import parse_frames

ENVIRONMENT = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}

PNG = bytes.fromhex(
    "89504e470d0a1a0a0000000d4948445200000001000000010802000000907753de0000000c4944415408d763f8cfc0"
    "00000301010018dd8db00000000049454e44ae426082"
)
"""One red pixel."""

COUNTED = """
import os
from mbinterval.device import runtime
from mbinterval.scene.formats import load
def noted(name, real):
    def call(*arguments, **options):
        with open({file!r}, "a") as file:
            file.write(f"{{name}} {{os.getpid()}}\\n")
        return real(*arguments, **options)
    return call
if runtime.Runtime.__init__.__name__ == "__init__":  # Dask may run this more than once
    runtime.Runtime.__init__ = noted("context", runtime.Runtime.__init__)
    load.load_file = noted("scene", load.load_file)
"""

KILLED = """
import os, signal
from mbinterval.device.runtime import Runtime
count = 0
def run(self, kernel, *arguments, real=Runtime.run):
    global count
    event = real(self, kernel, *arguments)
    count += kernel.name == "tile"
    if count == 2 and not os.path.exists({file!r}):
        open({file!r}, "w").close()
        os.kill(os.getpid(), signal.SIGKILL)
    return event
Runtime.run = run
"""

FAILING = """
from mbinterval.device.runtime import Runtime
from mbinterval.errors import DeviceError
count = 0
def run(self, kernel, *arguments, real=Runtime.run):
    global count
    count += kernel.name == "tile"
    if count >= 2:
        open({file!r}, "w").close()
        raise DeviceError("a kernel: the device failed: OUT_OF_RESOURCES")
    return real(self, kernel, *arguments)
Runtime.run = run
"""


class Cluster:
    """A scheduler and workers, each a process; ``before`` is what a worker runs first."""

    def __init__(self, folder: Path, before: list[str]) -> None:
        self.folder, self.file = folder, folder / "scheduler.json"
        where = ["--scheduler-file", str(self.file)]
        quiet = ["--no-dashboard", "--host", "127.0.0.1"]
        self.processes = [self._start("scheduler", *where, *quiet, "--port", "0")]
        while not self.file.exists():
            assert self.processes[0].poll() is None, (folder / "log").read_text()
            time.sleep(0.05)
        for number, code in enumerate(before):
            preload = folder / f"before{number}.py"
            preload.write_text(code)
            options = ["--nthreads", "1", "--no-nanny", "--preload", str(preload)]
            options += ["--local-directory", str(folder)]
            self.processes.append(self._start("worker", *where, *quiet, *options))
        self.address = json.loads(self.file.read_text())["address"]
        waiting = f"Client({self.address!r}).wait_for_workers({len(before)})"
        code = f"from distributed import Client; {waiting}"
        subprocess.run([sys.executable, "-c", code], check=True, env=ENVIRONMENT)

    def _start(self, kind: str, *options: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", f"distributed.cli.dask_{kind}", *options]
        with (self.folder / "log").open("a") as log:
            return subprocess.Popen(command, env=ENVIRONMENT, stdout=log, stderr=log)

    def stop(self) -> None:
        for process in reversed(self.processes):
            process.kill()
            process.wait()


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("one")
    assert finish(start(folder))[0] == 0
    return images(folder)


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    """Two workers that note down each context that is made, and each scene that is read."""
    folder = tmp_path_factory.mktemp("cluster")
    made = Cluster(folder, [COUNTED.format(file=str(folder / "noted"))] * 2)
    yield made
    made.stop()


def workers_of(folder):
    lines = [json.loads(line) for line in (folder / "log.jsonl").read_text().splitlines()]
    return [line["device"].split(" at ")[1] for line in lines if line.get("status") == "rendered"]


def test_frames_of_workers_are_those_of_one_machine(tmp_path, cluster, undisturbed):
    arguments = ("--dask", cluster.address, "--log", "log.jsonl")
    code, said = finish(start(tmp_path, *arguments))
    assert code == 0, said
    assert images(tmp_path) == undisturbed
    assert len(workers_of(tmp_path)) == 6
    assert len(set(workers_of(tmp_path))) == 2
    code, said = finish(start(tmp_path, *arguments))
    assert (code, said.count("all 6 frames are complete")) == (0, 1)


def test_a_frame_in_parts_is_the_same_frame(tmp_path, cluster):
    """With layers, a filter that reaches beyond a part's edge, a crop, and an uneven number."""
    more = ("--frames", "3", "--filter", "gaussian", "--pattern", "sobol")
    more += ("--aovs", "sharp,depth,normal,forward,object,crypto_object", "--crop", "7,5,140,110")
    more += ("--output", "a.####.deep.exr,a.####.npz")
    for folder, options in ((tmp_path / "one", ()), (tmp_path / "parts", ("--parts", "3"))):
        folder.mkdir()
        where = ("--dask", cluster.address, "--log", "log.jsonl") if options else ()
        code, said = finish(start(folder, *more, *where, *options))
        assert code == 0, said
    assert images(tmp_path / "parts") == images(tmp_path / "one")
    endings = ("exr", "png", "deep.exr", "npz")
    assert images(tmp_path / "one").keys() == {f"a.0003.{ending}" for ending in endings}
    line = (tmp_path / "parts" / "log.jsonl").read_text().splitlines()[1]
    assert json.loads(line)["device"].count(" at tcp://") == 2  # both workers had some


FARM = """
import sys
import mbinterval as mb
films = dict(mb.farm("s.toml", "1-3x2", dask=sys.argv[1], width=40, height=30, parts=2))
assert sorted(films) == [1, 3]
for frame, film in films.items():
    alone = mb.render(mb.load("s.toml"), frame=frame, width=40, height=30)
    for name in ("rgba", "depth", "intervals"):
        assert getattr(film, name).tobytes() == getattr(alone, name).tobytes(), name
print("equal")
"""


def test_from_python_films_are_those_of_render(tmp_path, cluster):
    (tmp_path / "s.toml").write_text(SCENE)
    run = subprocess.run(
        [sys.executable, "-c", FARM, cluster.address],
        cwd=tmp_path, env=ENVIRONMENT, text=True, capture_output=True, check=False,
    )  # fmt: skip
    assert run.stdout == "equal\n", run.stderr


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("path.write_text(path.read_text() + '# a word')", "is another file than where the job"),
        ("path.unlink()", "is not there; a scene's files must be at the same path on every worker"),
        ("pathlib.Path('none.png').write_bytes(PNG)", "is here, and not where the job was started"),
    ],
)
def test_files_that_differ_on_a_worker_are_told_of(tmp_path, cluster, change, said):
    """Here they change when the job has read them; elsewhere they would be another machine's."""
    (tmp_path / "none.obj").write_text(
        "mtllib none.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
    )
    (tmp_path / "none.mtl").write_text("newmtl m\nmap_Kd none.png\n")
    before = f"""
import mbinterval.batch.dask_farm as farm, pathlib
PNG = {PNG!r}
with open("s.toml", "a") as file:
    file.write("[[objects]]\\nfile='none.obj'")
def on_dask(*arguments, real=farm.on_dask):
    path = pathlib.Path("s.toml")
    {change}
    return real(*arguments)
farm.on_dask = on_dask
"""
    code, told = finish(start(tmp_path, "--dask", cluster.address, before=before))
    assert code == 3
    assert f"{'none.png' if 'PNG' in change else 's.toml'}: {said}" in told
    assert "on tcp://" in told
    assert "Traceback" not in told
    assert not images(tmp_path)


EDITED = """
import sys, pathlib
import mbinterval as mb
path = pathlib.Path("m.usda")
for corner in ("1", "-0.5", "1"):
    path.write_text(MESH.replace("CORNER", corner))
    (_, film), = mb.farm("m.usda", "1", dask=sys.argv[1], width=40, height=30, parts=1)
    alone = mb.render(mb.load("m.usda"), frame=1, width=40, height=30)
    print(film.rgba.tobytes() == alone.rgba.tobytes(), film.rgba[..., 3].sum())
"""
MESH = """#usda 1.0
def Mesh "q" {
 point3f[] points = [(-1,-1,0), (CORNER,-1,0), (-1,1,0)]
 int[] faceVertexCounts = [3]
 int[] faceVertexIndices = [0,1,2]
 uniform bool doubleSided = 1
}
"""


def test_a_worker_renders_what_a_usd_file_is_now(tmp_path):
    """Not what it was in the job before, whose layers usd-core would keep."""
    made = Cluster(tmp_path, [""])
    code = f"MESH = {MESH!r}\n{EDITED}"
    try:
        run = subprocess.run(
            [sys.executable, "-c", code, made.address],
            cwd=tmp_path, env=ENVIRONMENT, text=True, capture_output=True, check=False,
        )  # fmt: skip
    finally:
        made.stop()
    first, second, third = run.stdout.splitlines()
    assert first == third != second, run.stderr
    assert first.startswith("True ")
    assert second.startswith("True ")


CHANGING = """
from mbinterval.scene.formats import load
def load_file(path, *given, real=load.load_file, **more):
    with open(path, "a") as file:
        file.write("# a word\\n")
    return real(path, *given, **more)
if load.load_file.__name__ == "load_file":
    load.load_file = load_file
"""


def test_a_file_that_changes_on_a_worker_between_check_and_reading_is_told_of(tmp_path):
    folder = tmp_path / "cluster"
    folder.mkdir()
    made = Cluster(folder, [CHANGING])
    try:
        code, told = finish(start(tmp_path, "--dask", made.address))
    finally:
        made.stop()
    assert code == 3
    assert "s.toml: is another file than where the job was started" in told
    assert not images(tmp_path)


IMPATIENT = """
import distributed
class Client(distributed.Client):
    def __init__(self, *given, timeout, **more):
        super().__init__(*given, timeout=1, **more)
distributed.Client = Client
"""


def test_where_no_scheduler_answers_it_is_said(tmp_path):
    code, said = finish(start(tmp_path, "--dask", "tcp://127.0.0.1:9", before=IMPATIENT))
    assert code == 2
    assert "no Dask scheduler answers at tcp://127.0.0.1:9" in said
    assert "Traceback" not in said


def test_a_job_that_is_stopped_leaves_whole_frames_and_workers_that_go_on(
    tmp_path, cluster, undisturbed
):
    process = start(tmp_path, "--dask", cluster.address)
    process.stderr.readline()
    process.send_signal(signal.SIGTERM)
    code, said = finish(process)
    found = images(tmp_path)
    assert code == 143 or len(found) == 12
    assert "Traceback" not in said
    assert all(undisturbed[name] == data for name, data in found.items())
    assert len(found) % 2 == 0
    assert finish(start(tmp_path, "--dask", cluster.address))[0] == 0
    assert images(tmp_path) == undisturbed


def test_a_worker_makes_its_context_once_and_reads_a_scene_once(tmp_path, cluster):
    """Over two jobs of one scene, beside whatever it did before."""
    noted = cluster.folder / "noted"
    before = noted.read_text().splitlines() if noted.exists() else []
    for size in ("40", "50"):
        assert finish(start(tmp_path, "--dask", cluster.address, "--width", size))[0] == 0
    lines = noted.read_text().splitlines()
    contexts = [line for line in lines if line.startswith("context")]
    assert len(contexts) == len(set(contexts)) <= 2
    scenes = [line for line in lines[len(before) :] if line.startswith("scene")]
    assert len(scenes) == len(set(scenes)) == 2


@pytest.mark.parametrize("before", [KILLED, nightly(FAILING)], ids=["killed", "failing"])
def test_a_worker_that_is_lost_in_a_frame_costs_no_frame(tmp_path, undisturbed, before):
    """Killed while a kernel runs; or its device fails, which is injected at its queue."""
    folder, mark = tmp_path / "cluster", tmp_path / "mark"
    folder.mkdir()
    made = Cluster(folder, [before.format(file=str(mark)), ""])
    try:
        code, said = finish(start(tmp_path, "--dask", made.address, "--log", "log.jsonl"))
        ended = made.processes[1].poll()
    finally:
        made.stop()
    assert code == 0, said
    assert mark.exists()
    assert images(tmp_path) == undisturbed
    if before is KILLED:
        assert ended == -signal.SIGKILL
    else:
        assert ended is None
        assert said.count("OUT_OF_RESOURCES; it gets no more frames") == 1
    assert len(workers_of(tmp_path)) == 6


def run_openjd(folder, command="mbinterval"):
    """Run all tasks of ``job.yaml`` in ``folder`` on this machine."""
    program = Path(sys.executable).with_name("openjd")
    arguments = [program, "run", "job.yaml", "--step", "Render", "-p", f"Command={command}"]
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    temporary = folder / "temporary"  # Open Job Description's own is that user's who came first
    temporary.mkdir(exist_ok=True)
    own = {"PATH": path, "TMPDIR": str(temporary)}
    return subprocess.run(
        arguments, cwd=folder, env=ENVIRONMENT | own, text=True, capture_output=True, check=False
    )


def write_template(folder, *more):
    """Write ``job.yaml`` for the frames of `OPTIONS`."""
    (folder / "s.toml").write_text(SCENE)
    command = [sys.executable, "-m", "mbinterval", "openjd", "s.toml", *OPTIONS, *more]
    made = subprocess.run(
        command, cwd=folder, env=ENVIRONMENT, text=True, capture_output=True, check=True
    )
    (folder / "job.yaml").write_text(made.stdout)
    program = Path(sys.executable).with_name("openjd")
    checked = subprocess.run([program, "check", "job.yaml"], cwd=folder, capture_output=True)
    assert checked.returncode == 0, checked.stdout


def test_a_template_is_valid_and_its_frames_are_those_of_one_machine(tmp_path, undisturbed):
    write_template(tmp_path, "--per-task", "4")
    run = run_openjd(tmp_path)
    assert run.returncode == 0, run.stdout
    assert images(tmp_path) == undisturbed
    assert "run: 2" in run.stdout


def test_a_task_that_is_killed_in_a_frame_is_repeated(tmp_path, undisturbed):
    mark, program = tmp_path / "mark", tmp_path / "program"
    code = f"import sys\n{KILLED.format(file=str(mark))}\nfrom mbinterval import cli\n"
    program.write_text(f"#!{sys.executable}\n{code}sys.exit(cli.main())\n")
    program.chmod(0o755)
    write_template(tmp_path, "--per-task", "3")
    run = run_openjd(tmp_path, str(program))
    assert run.returncode != 0
    assert mark.exists()
    found = images(tmp_path)
    assert list(found) == ["a.0001.exr", "a.0001.png"]
    assert all(undisturbed[name] == data for name, data in found.items())
    written = (tmp_path / "a.0001.exr").stat().st_mtime_ns
    again = run_openjd(tmp_path, str(program))
    assert again.returncode == 0, again.stdout
    assert images(tmp_path) == undisturbed
    assert (tmp_path / "a.0001.exr").stat().st_mtime_ns == written


@pytest.mark.parametrize("text", ["7", "1-24", "1-24x2", "-5--1,3", "1,5,9-12"])
def test_ranges_of_a_template_are_frames_again(text):
    frames = parse_frames(text)
    assert parse_frames(frame_ranges(frames)) == frames


def test_options_of_a_template_are_those_given_but_for_scene_frames_and_outputs():
    given = ["--frames=1-3", "s.toml", "-oa.exr", "--samples", "4", "--output", "b.png", "-v"]
    given += ["--per-task", "2", "--transparent", "--log", "log.jsonl"]
    log = f"--log={Path('log.jsonl').absolute()}"
    assert render_options(given, "s.toml") == ["--samples", "4", "-v", "--transparent", log]


def test_more_tasks_than_a_template_may_have_are_refused_with_the_remedy():
    from mbinterval.batch.batch import Job
    from mbinterval.scene.model import Scene
    from mbinterval.settings.settings import Settings

    job = Job(Scene(meshes=()), "s.toml", tuple(range(4000)), (8, 8), Settings(), ("a.#.exr",))
    with pytest.raises(UsageError, match="2000 tasks are too many; --per-task 4 or more"):
        job_template(job, [], 2)
    assert '"range": "0-3999"' in job_template(job, [], 1)
    with pytest.raises(UsageError, match="for its own"):
        job_template(job, ["--camera={{x}}"], 1)


@pytest.mark.parametrize("count", [1, 2, 3, 7, 100])
@pytest.mark.parametrize("region", [(0, 0, 9, 768), (3, 17, 5, 40), (0, 0, 1, 1)])
def test_bands_cover_a_region_once(region, count):
    bands = split(region, count)
    assert len(bands) <= count
    assert bands[0][1] == region[1]
    for before, after in itertools.pairwise(bands):
        assert before[1] + before[3] == after[1]
    assert bands[-1][1] + bands[-1][3] == region[1] + region[3]
    assert all(band[0] == region[0] and band[2] == region[2] and band[3] > 0 for band in bands)


def test_a_film_of_one_part_is_itself():
    film = object()
    assert join([film]) is film
