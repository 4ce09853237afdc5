"""``mbinterval compare``: renders and files in, through the command line; table and files out."""

import json
from pathlib import Path

import numpy as np
import pytest
from support.films import make_film

import mbinterval as mb
from mbinterval import cli

WHEEL = str(Path(__file__).parents[2] / "scenes" / "rolling_wheel.toml")
SMALL = ("--frames", "12", "--width", "64", "--height", "36")


def run(*arguments):
    try:
        return cli.main(["compare", *map(str, arguments)])
    except SystemExit as error:
        return error.code


def test_settings_of_a_scene_are_compared_with_the_first(tmp_path, capsys):
    written = tmp_path / "result.json"
    maps = tmp_path / "maps"
    code = run(WHEEL, "--with", "samples=64", "--with", "samples=1", "--with",
               "samples=4,paths=triangulated,occlusion=128", *SMALL,
               "--json", written, "--maps", maps)  # fmt: skip
    assert code == 0
    out = capsys.readouterr().out
    assert "reference: rolling_wheel samples=64" in out
    scene = mb.load(WHEEL)
    films = [
        mb.render(scene, frame=12, width=64, height=36, settings=mb.Settings(samples=count))
        for count in (64, 1)
    ]
    stored = json.loads(written.read_text())
    rows = stored["images"]
    assert list(rows) == [
        "rolling_wheel samples=1",
        "rolling_wheel samples=4,paths=triangulated,occlusion=128",
    ]
    expected = mb.compare(films[1], films[0]).as_dict()
    assert rows["rolling_wheel samples=1"] == expected
    assert f"{expected['metrics']['rmse']:.3e}" in out
    assert "no verdict" in out
    assert sorted(path.name for path in maps.iterdir()) == [
        "rolling_wheel_samples=1",
        "rolling_wheel_samples=4,paths=triangulated,occlusion=128",
    ]
    assert (maps / "rolling_wheel_samples=1" / "rms.png").is_file()


def test_repeats_give_a_verdict(capsys):
    code = run(WHEEL, "--with", "samples=4,pattern=sobol", "--with", "samples=2,pattern=sobol",
               "--repeats", "6", *SMALL)  # fmt: skip
    assert code == 0
    assert "samples=2,pattern=sobol: explained by sampling noise" in capsys.readouterr().out


def test_files_and_patterns_of_repeats_are_compared(tmp_path, capsys):
    reference = make_film(metadata={})
    reference.write(tmp_path / "reference.exr")
    rng = np.random.default_rng(0)
    for seed in range(6):
        rgba = reference.rgba + rng.normal(0.3, 0.01, reference.rgba.shape)
        make_film(rgba=rgba, metadata={}).write(tmp_path / f"seed{seed}.exr")
    pattern = tmp_path / "seed*.exr"
    code = run(tmp_path / "reference.exr", pattern, "--assume-samples", "64", "--level", "0.05")
    out = capsys.readouterr().out
    assert code == 0
    assert "seed*: not explained by sampling noise" in out
    assert "at level 0.05" in out


@pytest.mark.parametrize(
    ("arguments", "code", "what"),
    [
        ((WHEEL, *SMALL), 2, "one image is nothing to compare"),
        ((WHEEL, "--with", "sample=3"), 2, "did you mean samples?"),
        ((WHEEL, "--with", "samples"), 2, "is not NAME=VALUE"),
        ((WHEEL, "--with", "samples=0"), 2, "samples=0"),
        ((WHEEL, "--with", "occlusion=exact,partial_bits=true", *SMALL), 2, "no bits"),
        ((WHEEL, "--level", "2"), 2, "level=2"),
        (("missing*.exr", WHEEL), 2, "matches no file"),
        (("missing.exr", WHEEL), 6, "no such file"),
        (("missing.toml", WHEEL), 3, "no such file"),
    ],
)
def test_what_is_wrong_is_said(arguments, code, what, capsys):
    assert run(*arguments) == code
    assert what in capsys.readouterr().err
