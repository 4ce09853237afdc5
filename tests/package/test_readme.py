"""What the README tells people to type is right."""

import re
import shlex
from pathlib import Path

import numpy as np
import pytest
from support.kernels import ready_for

import mbinterval
from mbinterval.batch.batch import plan_tasks
from mbinterval.cli import program as cli
from mbinterval.cli.commands import make_job
from mbinterval.errors import MbintervalError, Terminated, exit_code
from mbinterval.film.aovs import AOVS
from mbinterval.scene.formats.load import load_file

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```", README, re.MULTILINE | re.DOTALL)


def test_its_commands_are_those_that_ci_runs_and_name_files_that_are_there(monkeypatch):
    start, develop, data = blocks("sh")
    assert start.startswith("python3 -m venv venv && . venv/bin/activate && pip install . && ")
    install, test = develop.strip().split(" && ")
    ci = (ROOT / ".ci" / "run").read_text(encoding="utf-8").splitlines()
    assert install.replace("install", "install --quiet") in ci
    assert test in ci
    assert ci[-1].startswith(f"{test} -m ")  # its summary ends the output
    render = shlex.split(start.strip().split(" && ")[-1])
    assert render[0] == "mbinterval"
    monkeypatch.chdir(ROOT)
    example = make_job(cli._parser().parse_args(shlex.split(data)[1:]))
    assert (len(example.frames), example.resolution) == (48, (640, 480))
    assert {"sharp", "forward", "object"} <= set(example.settings.aovs)
    job = make_job(cli._parser().parse_args(render[1:]))
    assert job.scene.meshes
    assert [Path(output).suffix for output in job.outputs] == [".exr", ".png"]


def test_its_batch_is_one_that_can_be_run(monkeypatch):
    (block,) = blocks("console")
    monkeypatch.chdir(ROOT)
    prompt, *command = shlex.split(block)
    assert prompt == "$"
    assert command[0] == "mbinterval"
    job = make_job(cli._parser().parse_args(command[1:]))
    tasks = plan_tasks(job)
    assert [str(path) for path in tasks[-1].paths] == ["out/fox.0027.exr", "out/fox.0027.png"]
    assert len(tasks) == 27


def test_its_python_example_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = {}
    code, data, made_later = blocks("python")
    exec(code, names)
    assert names["film"].rgba.shape == (240, 320, 4)
    assert (tmp_path / "triangle.exr").is_file()
    scene = load_file(ROOT / "scenes" / "walking_fox.toml")
    settings = mbinterval.Settings.from_mapping({**scene.settings, "samples": 1})
    film = mbinterval.render(scene.scene, width=64, height=48, settings=settings)
    film.write("render/walking_fox.0001.exr")
    exec(data, names)
    assert names["flow"].shape == (48, 64, 2)
    assert 0.1 < names["fox"].mean() < 0.5
    assert not np.array_equal(names["blurred"], names["sharp"])
    settings = mbinterval.Settings(samples=1, aovs="events")
    film = mbinterval.render(scene.scene, width=64, height=48, settings=settings)
    film.write("render/fox.0001.npz")
    exec(made_later, names)
    assert len(names["sharper"]) == 7
    assert np.abs(np.mean(names["sharper"], axis=0)[..., 3] - film.rgba[..., 3]).max() < 1e-5
    assert {"x", "y", "polarity"} < names["changes"].keys()
    assert len(names["changes"]["t"]) > 100
    assert names["alpha"] == pytest.approx(film.rgba[30, 20, 3], abs=1e-5)


def test_it_says_of_every_shipped_scene_who_wins():
    told = re.findall(r"^\| (\w+) \| exact time \|", README, re.MULTILINE)
    assert sorted(told) == sorted(path.stem for path in (ROOT / "scenes").glob("*.toml"))


def test_its_table_of_layers_is_complete():
    table = re.findall(r"^\| (\w+) \| `(\w+\.\w+)`((?: `\w+`)*) \|", README, re.MULTILINE)
    documented = {}
    for name, first, rest in table:
        layer = first.split(".")[0]
        others = [f"{layer}.{channel.strip('` ')}" for channel in rest.split()]
        documented[name] = (first, *others)
    assert documented == {name: aov.channels for name, aov in AOVS.items()}


def test_its_scene_file_is_valid(tmp_path):
    text, keys, rolling = blocks("toml")
    (tmp_path / "box.toml").write_text(text)
    loaded = load_file(tmp_path / "box.toml")
    assert [mesh.name for mesh in loaded.scene.meshes] == ["box", "floor"]
    assert loaded.render.frames == "1-24"
    (tmp_path / "keys.toml").write_text(f"[[objects]]\nprimitive = {{ kind = 'plane' }}\n{keys}")
    (plane,) = load_file(tmp_path / "keys.toml").scene.meshes
    assert plane.transform.translation.interpolation == "cubic"
    (tmp_path / "rolling.toml").write_text(rolling)
    assert load_file(tmp_path / "rolling.toml").scene.shutter.rolling == "down"


def test_its_exit_codes_are_those_of_the_errors_and_of_the_help():
    documented = {int(code) for code in re.findall(r"^\| (\d+) \|", README, re.MULTILINE)}
    kinds = [MbintervalError, *MbintervalError.__subclasses__()]
    codes = {exit_code(error()) for error in (*kinds, KeyboardInterrupt, Terminated)}
    assert documented == {0, *codes}
    for code, meaning in re.findall(r"^\| (\d+) \| (.*?) \|$", README, re.MULTILINE):
        assert f"  {code:<4} {meaning}\n" in cli._EXIT_CODES


def test_its_tables_of_stages_are_what_renders_time():
    documented = set(re.findall(r"^\| `(\w+)` \|", README, re.MULTILINE))
    faces = np.array([[0, 1, 2]])
    still = np.array([[-1.0, 0, 0], [0, 0, 0], [0, 1, 0]])
    meshes = [mbinterval.Mesh(still, faces), mbinterval.Mesh(np.stack([still, still + 1]), faces)]
    camera = mbinterval.Camera(position=(0, 0, 5), look_at=(0, 0, 0))
    scene = mbinterval.Scene(meshes=meshes, camera=camera)
    timed = set()
    glass = mbinterval.Mesh(still, faces, material=mbinterval.Material(opacity=0.5))
    around = mbinterval.Environment(np.ones((4, 8, 3)))
    seen_through = mbinterval.Scene(meshes=[glass], camera=camera, environment=around)
    timed |= set(mbinterval.render(seen_through, width=16, height=16).timings)
    ways = (
        {"pattern": "sobol"},
        {"occlusion": 32, "aovs": "crypto_object"},
        {"paths": "triangulated", "occlusion": 32},
        {"samples": 1, "filter": "five_point", "aovs": "depth"},
        {"method": "stochastic", "pattern": "rgss"},
    )
    sun = mbinterval.Light("directional", direction=(0, 0, -1), shadows=True)
    lit = mbinterval.Scene(meshes=meshes, camera=camera, lights=[sun])
    for values in ({}, {"method": "stochastic", "shadow_map": 64}):
        timed |= set(ready_for(lit, mbinterval.Settings(**values), 16, 16).plan.stages)
    for values in ways:
        settings = mbinterval.Settings(**values)
        timed |= set(mbinterval.render(scene, width=16, height=16, settings=settings).timings)
    assert timed == documented


@pytest.mark.parametrize("word", ["TODO", "FIXME", "XXX"])
def test_it_promises_nothing_unfinished(word):
    assert word not in README
