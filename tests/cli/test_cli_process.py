"""The command line in a process of its own: signals, terminals, a scene for real."""

import os
import pty
import signal
import subprocess
import sys
import termios
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mbinterval.film.film import Film

ROOT = Path(__file__).parents[2]

SLOW = """
import sys, time, types
import numpy as np, mbinterval.batch.batch
from mbinterval import cli
from mbinterval.film.film import Film
from mbinterval.scene.formats.load import SceneFile
from mbinterval.scene.model import Scene

loader = types.ModuleType("mbinterval.scene.formats.load")
loader.load_file = lambda path, **_: SceneFile(Scene(meshes=()))
sys.modules["mbinterval.scene.formats.load"] = loader

def render(scene, *, frame, width, height, progress, **_):
    if frame == 2:
        print("working", flush=True)
        time.sleep(60)
    if frame == 3 and progress:
        for part in (0.25, 0.5, 0.25, 1.0):
            time.sleep(0.2)
            progress(part)
    pixels = np.ones((height, width))
    made = {"software": "mbinterval test"}
    return Film(np.ones((height, width, 4)), pixels, pixels, {}, (width, height), metadata=made)

mbinterval.batch.batch.render = render
sys.exit(cli.main(["render", "s.toml", "--frames", "1-3", "--width", "8", *sys.argv[1:]]))
"""


def start(folder, *arguments, **options):
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}
    command = [sys.executable, "-c", SLOW, *arguments]
    return subprocess.Popen(command, cwd=folder, env=environment, text=True, **options)


@pytest.mark.parametrize(
    ("number", "code", "said"),
    [
        (signal.SIGINT, 130, "mbinterval: interrupted"),
        (signal.SIGTERM, 143, "mbinterval: terminated"),
    ],
)
def test_ctrl_c_leaves_whole_frames_only(tmp_path, number, code, said):
    process = start(tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout.readline() == "working\n"
    process.send_signal(number)
    _, err = process.communicate(timeout=600)
    assert process.returncode == code
    assert err.splitlines()[-1] == said
    assert "Traceback" not in err
    assert [p.name for p in tmp_path.iterdir()] == ["s.0001.exr"]
    Film.read(tmp_path / "s.0001.exr")


LONG = """
import mbinterval
from mbinterval.scene.generators import fast_cubes
settings = mbinterval.Settings(samples=256)
mbinterval.render(
    fast_cubes(2000, seed=1), width=1024, height=768, settings=settings,
    progress=lambda part: print(part, flush=True),
)
"""


def test_a_frame_of_minutes_is_interrupted_soon(tmp_path):
    path = os.pathsep.join([str(ROOT), *sys.path])
    process = subprocess.Popen(
        [sys.executable, "-c", LONG], cwd=tmp_path, env=os.environ | {"PYTHONPATH": path},
        text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    parts = [float(process.stdout.readline()) for _ in range(2)]
    assert 0.0 < parts[0] < parts[1] < 0.05
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=600)
    assert all(float(part) < 0.1 for part in out.split())
    assert err.splitlines()[-1] == "KeyboardInterrupt"


def seen_on_a_terminal(folder, *arguments):
    """What the command line says on a terminal of 80 columns."""
    ours, theirs = pty.openpty()
    termios.tcsetwinsize(theirs, (24, 80))
    process = start(folder, *arguments, stdout=subprocess.DEVNULL, stderr=theirs)
    os.close(theirs)
    seen = b""
    with suppress(OSError):  # once the other end is closed
        while True:
            seen += os.read(ours, 4096)
    os.close(ours)
    assert process.wait() == 0
    return seen.decode()


def test_a_bar_on_a_terminal_goes_on_within_a_frame_and_none_is_elsewhere(tmp_path):
    seen = seen_on_a_terminal(tmp_path, "--frames", "1,3")
    # The second of two frames: its quarter is five eighths of the job; nothing is taken back.
    bars = [part.split("%")[0] for part in seen.split("frame 3 (2/2) ")[1:] if "%" in part]
    assert [int(bar) for bar in bars][:4] == [50, 62, 75, 75]
    assert "to go" in seen
    assert "frame 3 (2/2): " in seen
    single = seen_on_a_terminal(tmp_path, "--frames", "3")
    assert " 25% |" in single
    assert " 50% |" in single
    plain = start(tmp_path, "--frames", "1,3", stderr=subprocess.PIPE)
    assert len(plain.communicate(timeout=600)[1].splitlines()) == 2


def test_a_scene_of_the_repository_is_described_and_rendered_for_real(tmp_path):
    def mbinterval(*arguments):
        command = [sys.executable, "-m", "mbinterval", *map(str, arguments)]
        environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}
        return subprocess.run(
            command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=600
        )

    scene = ROOT / "scenes" / "slab_behind_slit.toml"
    info = mbinterval("info", scene)
    assert (info.returncode, info.stderr) == (0, "")
    assert "stages: paths bin" in info.stdout
    size = ("--width", 64, "--height", 48)
    render = mbinterval("render", scene, *size, "--transparent", "-o", "a.png,a.exr")
    assert render.returncode == 0, render.stderr
    assert render.stdout == ""
    with Image.open(tmp_path / "a.png") as image:
        assert (image.mode, image.size) == ("RGBA", (64, 48))
    film = Film.read(tmp_path / "a.exr")
    assert film.transparent
    assert film.metadata["settings.transparent"] == 1
    crop = mbinterval("render", scene, *size, "--transparent", "--crop", "8,4,30,20", "-o", "b.exr")
    assert crop.returncode == 0, crop.stderr
    part = Film.read(tmp_path / "b.exr")
    assert (part.origin, part.resolution) == ((8, 4), (64, 48))
    assert np.array_equal(part.rgba, film.rgba[4:24, 8:38])
    outside = mbinterval("render", scene, *size, "--crop", "60,4,30,20", "-o", "c.exr")
    assert outside.returncode == 2
    assert "crop 60,4,30,20 does not lie in the frame" in outside.stderr
