"""``mbinterval study`` through the command line: folders, going on, and Ctrl-C."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from support.nightly import nightly
from support.studies import with_rows

from mbinterval import cli
from mbinterval.study.sweeps import SWEEPS

CUBES = str(Path(__file__).parents[2] / "scenes" / "ho17_cubes.toml")
SMALL = ("--width", "32", "--height", "24", "--rounds", "1", "--reference-error", "0.01")


def run(*arguments):
    try:
        return cli.main(["study", *map(str, arguments)])
    except SystemExit as error:
        return error.code


@pytest.mark.parametrize(("step", "rows"), [(3, 4), nightly(1, 8)])
def test_a_study_leaves_a_report_and_goes_on(tmp_path, capsys, monkeypatch, step, rows):
    for name in ("slices-4", "limit"):
        monkeypatch.setitem(SWEEPS, name, with_rows(SWEEPS[name], step))
    folder = tmp_path / "here"
    options = (CUBES, *SMALL, "--no-costs", "-o", folder, "--references", tmp_path / "references")
    assert run(*options, "--sweeps", "five-point,slices-4") == 0
    assert {path.name for path in folder.iterdir()} == {
        *("films", "study.json", "study.csv", "report.html")
    }
    assert len(list((tmp_path / "references").iterdir())) == 3
    err = capsys.readouterr().err
    assert "reference of point samples: 2 renders, error" in err
    assert f"1 of {rows} rows, about" in err
    first = json.loads((folder / "study.json").read_text())
    assert run(*options, "--sweeps", "five-point,slices-4,limit") == 0
    second = json.loads((folder / "study.json").read_text())
    assert list(second["sweeps"]) == ["five-point", "slices-4", "limit"]
    assert second["sweeps"]["slices-4"] == first["sweeps"]["slices-4"]
    assert "renders, error" not in capsys.readouterr().err


def test_ctrl_c_leaves_a_report_of_what_was_done(tmp_path):
    options = [CUBES, *SMALL, "--sweeps", "five-point,pairing,samples", "-o", str(tmp_path)]
    command = [sys.executable, "-m", "mbinterval", "study", *options]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=os.environ)
    try:
        stored = tmp_path / "study.json"
        for _ in range(1200):
            if stored.is_file() and len(json.loads(stored.read_text())["sweeps"]) > 1:
                break
            time.sleep(0.1)
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=600)
    finally:
        process.kill()
    assert process.returncode == 130
    assert "stopped; the same command goes on from here" in err
    assert "stopped before its end" in (tmp_path / "report.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("arguments", "code", "what"),
    [
        ((CUBES, *SMALL, "--sweeps", "sample"), 2, "did you mean samples?"),
        ((CUBES, "--row-seconds", "0"), 2, "value=0"),
        (("nowhere", *SMALL), 2, "neither a file nor a generated scene"),
        (("missing.toml", *SMALL), 3, "no such file"),
    ],
)
def test_what_is_wrong_is_said_before_anything_is_rendered(arguments, code, what, tmp_path, capsys):
    assert run(*arguments, "-o", tmp_path / "folder") == code
    err = capsys.readouterr().err
    assert what in err
    assert "renders, error" not in err
