"""The command line: what it asks of the API, what it says, and the exit code it leaves."""

import logging
import signal
import sys
import threading
import types
from dataclasses import fields

import numpy as np
import pytest

import mbinterval
from mbinterval import cli, errors
from mbinterval.film.events import COLUMNS, Events
from mbinterval.film.film import Film
from mbinterval.scene.formats.load import RenderDefaults
from mbinterval.scene.model import Scene
from mbinterval.settings.settings import Settings


def no_events(height, width):
    columns = {name: np.zeros(0, kind) for name, kind in COLUMNS.items()}
    return Events((height, width, 1), np.zeros(height * width + 1, np.int64), columns)


class FakeApi:
    """Stands in for scene reader and renderer; remembers what was asked."""

    def __init__(self):
        self.loaded = types.SimpleNamespace(
            scene=Scene(meshes=()), settings={}, render=RenderDefaults(), files={}
        )
        self.calls = []
        self.error = None
        self.fail_at = None
        self.notes = ()

    def load_file(self, path, overruled=(), **animation):
        self.overruled, self.animation = overruled, animation
        return self.loaded

    def render(self, scene, **arguments):
        self.calls.append({"scene": scene, **arguments})
        if self.error is not None and self.fail_at in (None, arguments["frame"]):
            raise self.error
        size = (3, 4)
        return Film(
            rgba=np.full((*size, 4), 0.5, np.float32),
            depth=np.ones(size),
            intervals=np.ones(size),
            timings={"paths": 0.25},
            resolution=(arguments["width"], arguments["height"]),
            metadata={"software": "mbinterval test"},
            notes=self.notes,
            events=no_events(*size),
        )


@pytest.fixture
def api(monkeypatch, tmp_path):
    fake = FakeApi()
    loader = types.ModuleType("mbinterval.scene.formats.load")
    loader.load_file = fake.load_file
    monkeypatch.setitem(sys.modules, "mbinterval.scene.formats.load", loader)
    monkeypatch.setattr("mbinterval.batch.batch.render", fake.render)
    monkeypatch.chdir(tmp_path)
    return fake


def test_render_writes_the_scene_at_its_defaults(api, tmp_path, capsys):
    assert cli.main(["render", "dir/wheel.toml"]) == 0
    assert [p.name for p in tmp_path.iterdir()] == ["wheel.0001.exr"]
    (call,) = api.calls
    assert call == {
        "scene": api.loaded.scene,
        "frame": 1,
        "width": 1024,
        "height": 768,
        "settings": Settings(),
        "device": None,
        "crop": None,
        "memory": None,
        "progress": None,
    }
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert "frame 1 (1/1): " in err
    assert "wheel.0001.exr" in err


def test_several_frames_and_outputs_are_written_in_one_go(api, tmp_path):
    arguments = ["--frames", "1-5x2", "--output", "a/b.####.exr,c.%02d.png", "-o", "####.png"]
    assert cli.main(["render", "s.toml", *arguments]) == 0
    written = {str(p.relative_to(tmp_path)) for p in tmp_path.rglob("*.*")}
    assert written == {
        f"{name}" for n in "135" for name in (f"a/b.000{n}.exr", f"c.0{n}.png", f"000{n}.png")
    }
    assert [call["frame"] for call in api.calls] == [1, 3, 5]


def test_the_command_line_overrules_the_scene_file(api):
    given = {"samples": 8, "seed": 3, "max_intervals": 90, "paths": "triangulated"}
    api.loaded.settings = given
    api.loaded.render = RenderDefaults(320, 240, frames="7-9", output="x.#.exr")
    assert cli.main(["render", "s.toml"]) == 0
    assert [call["frame"] for call in api.calls] == [7, 8, 9]
    first = api.calls[0]
    stored = Settings(**given)
    assert (first["width"], first["height"], first["settings"]) == (320, 240, stored)

    options = "--samples 2 --max-intervals none --no-transparent --width 640 --frames 2 -o y.exr"
    assert cli.main(["render", "s.toml", *options.split()]) == 0
    last = api.calls[-1]
    assert (last["width"], last["height"], last["frame"]) == (640, 480, 2)
    assert last["settings"] == Settings(samples=2, seed=3, paths="triangulated")


def test_every_setting_has_an_option_with_help_and_reaches_the_render(api, capsys):
    values = {
        "method": "analytic",
        "paths": "triangulated",
        "pairing": "depth",
        "occlusion": 32,
        "partial_bits": True,
        "max_intervals": 90,
        "samples": 2,
        "pattern": "fixed",
        "filter": "box",
        "filter_radius": 0.5,
        "texture_samples": 3,
        "shading_error": 0.01,
        "anisotropy": 4,
        "motion_segments": 4,
        "motion_error": 0.25,
        "shadows": "all",
        "seed": 5,
        "transparent": True,
        "tile_size": 8,
        "aovs": "uv,depth,crypto_object",
        "aov_time": 0.25,
        "cryptomatte_levels": 4,
        "deep_tolerance": 0.1,
    }
    sampled = {"method": "stochastic", "cull": "bbox", "cull_tile": 2, "test": "edges",
               "hybrid": True, "frameless": 4, "shadow_map": 64,
               "shadow_strata": 2, "shadow_bias": 1.5, "statistics": True}  # fmt: skip
    slices = {"method": "accumulation", "slices": 7, "slice_times": "jittered",
              "slice_lens": "line", "shading_rate": "pixel"}  # fmt: skip
    seen = {"aovs": "events", "event_steps": 7}
    ways = (values, sampled, slices, seen)
    assert set().union(*ways) == {setting.name for setting in fields(Settings)}
    for index, way in enumerate(ways):
        arguments = []
        for name, value in way.items():
            option = f"--{name.replace('_', '-')}"
            arguments += [option] if value is True else [option, str(value)]
        output = "a.npz" if way is seen else "a.exr"
        assert cli.main(["render", "s.toml", "-o", output, *arguments]) == 0
        assert api.calls[index]["settings"] == Settings(**way)
    with pytest.raises(SystemExit):
        cli.main(["render", "--help"])
    text = capsys.readouterr().out
    assert all(f"--{name.replace('_', '-')}" in text for name in set().union(*ways))


EXPECTED = "expected .exr, .png, .npz or .parquet"


def test_crop_and_device_are_passed_on(api):
    assert cli.main(["render", "s.toml", "--crop", "1,2,30,40", "--device", "pocl"]) == 0
    assert api.calls[0]["crop"] == (1, 2, 30, 40)
    assert api.calls[0]["device"] == "pocl"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--frames", "a"], "'a' is no frame or range"),
        (["--crop", "1,2,3"], "'1,2,3' is not X,Y,W,H"),
        (["--crop", "1,2,0,3"], "width and height must be 1 or more"),
        (["--width", "0"], "'0' is not a whole number from 1 to 65536"),
        (["--height", "many"], "'many' is not"),
        (["--width", "-5"], "argument --width: '-5' is not"),
        (["--width", "64.0"], "argument --width: '64.0' is not"),
        (["--sample", "3"], "unknown option --sample, did you mean --samples?"),
        (["--ocllusion=64"], "unknown option --ocllusion, did you mean --occlusion?"),
        (["--zzz"], "unknown option --zzz, --help lists all"),
        (["other.toml"], "unexpected argument 'other.toml'"),
        (["--output", ""], "argument -o/--output: output '': a file's name is empty"),
        (["-o", "a.exr,,b.exr"], "output 'a.exr,,b.exr': a file's name is empty"),
        (
            ["--output", "a.tif"],
            "a.tif: unknown ending '.tif'; expected .exr, .png, .npz or .parquet",
        ),
        (
            ["--output", "a"],
            "argument -o/--output: a: no ending; expected .exr, .png, .npz or .parquet",
        ),
    ],
)
def test_bad_arguments_exit_2_and_name_the_option(api, capsys, arguments, message):
    with pytest.raises(SystemExit) as caught:
        cli.main(["render", "s.toml", *arguments])
    assert caught.value.code == 2
    assert message in capsys.readouterr().err
    assert not api.calls


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--samples", "0"], "samples=0: expected a whole number from 1 to 4096"),
        (["--samples", "2.5"], "samples=2.5: expected a whole number"),
        (["--paths", "wiggly"], "paths='wiggly': expected one of"),
        (["--frames", "1-2", "-o", "a.exr"], "put #### where the frame's number belongs"),
        (["--output", "a.exr,./a.exr"], "output 'a.exr' is given twice"),
    ],
)
def test_bad_settings_and_outputs_exit_2_before_anything_is_rendered(
    api, capsys, arguments, message, tmp_path
):
    assert cli.main(["render", "s.toml", *arguments]) == 2
    err = capsys.readouterr().err
    assert message in err
    assert "Traceback" not in err
    assert not api.calls
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["rendr", "s.toml"], "unknown command 'rendr', did you mean render?"),
        (
            ["s.toml"],
            "unknown command 's.toml', known here: render, info, compare, study, recommend, bench, "
            "openjd, devices",
        ),
        (["--samples", "4", "render"], "--samples: options come after the command"),
        ([], "the following arguments are required: COMMAND"),
    ],
)
def test_unknown_commands_exit_2_and_name_the_nearest(capsys, arguments, message):
    with pytest.raises(SystemExit) as caught:
        cli.main(arguments)
    assert caught.value.code == 2
    assert message in capsys.readouterr().err


def test_notes_on_the_scene_are_shown_once_per_job_even_when_quiet(api, capsys):
    api.notes = ("no lights: a headlight was added", "no visible mesh")
    assert cli.main(["render", "s.toml", "--frames", "1-3", "-q"]) == 0
    assert capsys.readouterr().err.splitlines() == [f"mbinterval: note: {n}" for n in api.notes]


@pytest.fixture
def job(monkeypatch, tmp_path, capsys):
    """Run the command line on a scene file with real reading and no rendering.

    Gives exit code, settings that were asked for, and what was said.
    """
    fake = FakeApi()
    monkeypatch.setattr("mbinterval.batch.batch.render", fake.render)
    monkeypatch.chdir(tmp_path)

    def run(text, *arguments):
        fake.calls.clear()
        (tmp_path / "s.toml").write_text(text)
        code = cli.main(["render", "s.toml", *arguments])
        return code, [call["settings"] for call in fake.calls], capsys.readouterr().err

    return run


def test_bad_values_of_a_scene_file_are_the_scenes_fault(job):
    code, _, said = job("[settings]\nsamples = 0", "--samples", "2")
    assert (code, said) == (
        3,
        "mbinterval: error: s.toml: settings.samples: 0: expected a whole number from 1 to 4096\n",
    )
    code, _, said = job('[render]\nframes = "1..3"\nwidth = 70000\noutput = "a.tif"')
    assert code == 3
    assert "render.frames: frames '1..3': '1..3' is no frame or range" in said
    assert "render.width: expected less than or equal to 65536, got 70000" in said
    assert f"render.output: a.tif: unknown ending '.tif'; {EXPECTED}" in said
    both = '[render]\nframes = "1-3"\noutput = "a.exr"'
    code, _, said = job(both)
    assert code == 3
    assert "s.toml: render: output 'a.exr': 3 frames would overwrite each other" in said
    assert job(both, "--frames", "2")[0] == 0
    assert job(both, "-o", "a.#.exr")[0] == 0
    assert job(both, "--frames", "1-2")[0] == 2


def test_settings_that_go_together_only_after_the_command_line_are_no_error(job):
    """What counts is the combination that is rendered; the file's half may be half."""
    limit = "[settings]\nmax_intervals = 90"
    code, _, said = job(limit)
    assert code == 3
    assert "settings.max_intervals: max_intervals=90 with paths='exact': exact paths lose" in said
    assert job(limit, "--samples", "2")[0] == 3
    code, used, _ = job(limit, "--paths", "triangulated")
    assert (code, used) == (0, [Settings(max_intervals=90, paths="triangulated")])
    code, used, _ = job(limit, "--max-intervals", "none")
    assert (code, used) == (0, [Settings()])
    code, used, _ = job("[settings]\npartial_bits = true", "--occlusion", "64")
    assert (code, used) == (0, [Settings(partial_bits=True, occlusion=64)])


def test_settings_of_file_and_command_line_that_clash_are_the_command_lines_fault(job):
    both = "[settings]\nmax_intervals = 90\npaths = 'triangulated'"
    assert job(both)[0] == 0
    code, used, said = job(both, "--paths", "exact")
    assert (code, used) == (2, [])
    assert "max_intervals=90 with paths='exact': exact paths lose no interval" in said
    assert "(max_intervals is from s.toml; --max-intervals overrules it)" in said
    code, _, said = job("", "--partial-bits")
    assert code == 2
    assert "partial_bits=True with occlusion='exact'" in said
    assert "is from" not in said
    code, _, said = job("fps = 0", "--samples", "0")  # ours first: the file isn't even read
    assert code == 2
    assert "samples=0" in said


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (errors.MbintervalError("why"), 1),
        (errors.UsageError("why"), 2),
        (errors.SceneError("why"), 3),
        (errors.DeviceError("why"), 4),
        (errors.KernelBuildError("why"), 4),
        (errors.CapacityError("why"), 5),
        (errors.OutputError("why"), 6),
        (ValueError("why"), 1),
        (MemoryError(), 5),
        (KeyboardInterrupt(), 130),
        (errors.Terminated(), 143),
    ],
)
def test_each_error_has_its_exit_code_and_one_line(api, capsys, error, code):
    api.error = error
    assert cli.main(["render", "s.toml"]) == code
    err = capsys.readouterr().err
    assert err.startswith("mbinterval: ")
    assert err.count("\n") == 1
    assert cli.main(["render", "s.toml", "-v"]) == code
    assert "Traceback" in capsys.readouterr().err


def test_what_is_wrong_in_a_frame_of_a_scene_names_file_and_frame(api, capsys):
    api.error, api.fail_at = errors.SceneError("camera: up is parallel to the view"), 2
    assert cli.main(["render", "s.toml", "--frames", "1-3"]) == 3
    said = capsys.readouterr().err.splitlines()[-1]
    assert said == "mbinterval: error: s.toml: frame 2: camera: up is parallel to the view"


def test_usage_is_short_enough_for_the_error_to_be_seen(capsys):
    with pytest.raises(SystemExit):
        cli.main(["render", "s.toml", "--sample", "3"])
    assert capsys.readouterr().err == (
        "usage: mbinterval render SCENE [options]\n"
        "mbinterval render: error: unknown option --sample, did you mean --samples?\n"
    )


def test_frames_before_an_error_stay(api, tmp_path):
    api.error, api.fail_at = errors.CapacityError("full"), 2
    assert cli.main(["render", "s.toml", "--frames", "1-3"]) == 5
    assert [p.name for p in tmp_path.iterdir()] == ["s.0001.exr"]


def test_an_output_that_cannot_be_written_exits_6_before_rendering(api, tmp_path, capsys):
    (tmp_path / "file").touch()
    assert cli.main(["render", "s.toml", "-o", "file/a.exr"]) == 6
    assert "file/a.exr: cannot be written" in capsys.readouterr().err
    assert not api.calls


def test_quiet_says_nothing_and_verbose_lists_the_stages(api, capsys):
    assert cli.main(["render", "s.toml", "-q"]) == 0
    assert capsys.readouterr().err == ""
    assert cli.main(["render", "s.toml", "-v"]) == 0
    assert "paths           0.2500 s" in capsys.readouterr().err


def test_the_log_of_a_caller_is_left_as_it_was(api):
    logger = logging.getLogger("mbinterval")
    before = (list(logger.handlers), logger.level, signal.getsignal(signal.SIGTERM))
    cli.main(["render", "s.toml", "-v"])
    assert (list(logger.handlers), logger.level, signal.getsignal(signal.SIGTERM)) == before


def test_it_runs_outside_the_main_thread_too(api):
    codes = []
    thread = threading.Thread(target=lambda: codes.append(cli.main(["render", "s.toml"])))
    thread.start()
    thread.join()
    assert codes == [0]


def test_devices_lists_one_line_each(capsys):
    assert cli.main(["devices"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in lines] == [str(i) for i in range(len(lines))]
    assert lines
    assert "compute units" in lines[0]


@pytest.mark.parametrize("arguments", [["--version"], ["--help"], ["render", "--help"]])
def test_help_and_version(capsys, arguments):
    with pytest.raises(SystemExit) as caught:
        cli.main(arguments)
    assert caught.value.code == 0
    out = capsys.readouterr().out
    if arguments == ["--version"]:
        assert out == f"mbinterval {mbinterval.__version__}\n"
    else:
        assert all(f"  {code} " in out for code in (0, 1, 2, 3, 4, 5, 6, 130, 143))


def test_public_names_are_there_and_others_are_not():
    assert set(dir(mbinterval)) == set(mbinterval.__all__)
    for name in mbinterval.__all__:
        assert getattr(mbinterval, name) is not None
    assert callable(mbinterval.render)
    with pytest.raises(AttributeError, match="no attribute 'rendr'"):
        _ = mbinterval.rendr


@pytest.mark.parametrize(("given", "clip"), [("Walk", "Walk"), ("2", 2)])
def test_clip_and_frames_per_second_of_a_model_are_passed_on(api, given, clip):
    assert cli.main(["render", "fox.glb", "--clip", given, "--fps", "12.5", "--frames", "1"]) == 0
    assert api.animation == {"clip": clip, "fps": 12.5}


def test_stats_are_written_as_json_frame_by_frame(api, tmp_path):
    import json

    arguments = ["--frames", "1-2", "-o", "f.####.exr", "--stats", "deep/stats.json"]
    assert cli.main(["render", "s.toml", *arguments, "--method", "stochastic"]) == 0
    rows = json.loads((tmp_path / "deep/stats.json").read_text())
    assert [row["frame"] for row in rows] == [1, 2]
    assert rows[0]["seconds"] == {"paths": 0.25}
    assert rows[0]["settings"]["method"] == "stochastic"
    assert api.calls[0]["settings"].statistics is True
    assert cli.main(["render", "s.toml", "-o", "g.####.exr", "--stats", "."]) == 6
