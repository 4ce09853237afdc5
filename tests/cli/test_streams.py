"""Standard streams that are closed, full or of another encoding, and names in any script."""

from __future__ import annotations

import os
import subprocess
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from support.nightly import nightly, nightly_but
from support.processes import BOX, mbinterval, renderer

NAME = "Kühler 車"


def closing(*numbers: int):
    """What a child does before it starts: closes these of its streams."""

    def close() -> None:
        for number in numbers:
            os.close(number)

    return close


@pytest.mark.parametrize("numbers", [nightly((1,)), (2,), (0, 1, 2)], ids=str)
def test_closed_streams_hinder_nothing_and_reach_no_file(tmp_path, numbers):
    """The next file that is opened would get a closed stream's number, and what is said there."""
    given = {"capture_output": False, "preexec_fn": closing(*numbers)}
    whole = renderer(tmp_path)()
    first = (tmp_path / "film.exr").read_bytes()
    assert whole.returncode == 0, whole.stderr
    run = renderer(tmp_path)("-v", "--shutter", "0,0.5", **given)  # another film, and much is said
    assert run.returncode == 0
    again = renderer(tmp_path)("-v", **given)
    assert again.returncode == 0
    assert (tmp_path / "film.exr").read_bytes() == first
    assert mbinterval("info", tmp_path / "box.toml", **given).returncode == 0
    assert mbinterval("info", tmp_path / "none.toml", **given).returncode == 3


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="only Linux has /dev/full")
def test_a_full_standard_output_is_an_error_that_is_said_once(tmp_path):
    (tmp_path / "box.toml").write_text(BOX)
    with open("/dev/full", "w") as full:
        given = {"capture_output": False, "stdout": full, "stderr": subprocess.PIPE}
        run = mbinterval("info", tmp_path / "box.toml", **given)
    assert run.returncode == 6
    assert run.stderr.splitlines() == [
        "mbinterval: error: standard output: cannot be written (No space left on device)"
    ]


@pytest.mark.parametrize("encoding", ["latin-1", "ascii:strict", "cp437"])
def test_what_a_terminal_cannot_show_is_printed_with_escapes(tmp_path, encoding):
    (tmp_path / "box.toml").write_text(BOX.replace('"plate"', f'"{NAME}"'))
    environment = {"PYTHONIOENCODING": encoding}
    run = mbinterval("info", tmp_path / "box.toml", environment=environment, encoding="latin-1")
    assert (run.returncode, run.stderr) == (0, "")
    missing = mbinterval("info", tmp_path / NAME, environment=environment, encoding="latin-1")
    assert missing.returncode == 3
    assert "\\u8eca" in missing.stderr


FOLDERS = [NAME.encode(), b"bytes \xff\xfe", b"new\nline", b"\"quotes\" and 'these'", b"{x} #%d"]


@pytest.mark.parametrize("name", nightly_but(FOLDERS, *FOLDERS[:3]))
def test_files_are_read_and_written_in_folders_of_any_name(tmp_path, name):
    folder = tmp_path / os.fsdecode(name)
    folder.mkdir()
    (folder / "box.toml").write_text(BOX)
    endings = ("exr", "deep.exr", "png", "npz", "parquet")
    outputs = [part for ending in endings for part in ("-o", f"{folder}/film.{ending}")]
    extra = ("--log", folder / "log.jsonl", "--stats", folder / "stats.json", "--samples", 1)
    run = mbinterval("render", folder / "box.toml", *outputs, *extra, cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    written = {f"film.{ending}" for ending in endings} | {"log.jsonl", "stats.json", "box.toml"}
    assert {path.name for path in folder.iterdir()} == written
    again = mbinterval("render", folder / "box.toml", *outputs, "--samples", 1, cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    assert "complete" in again.stderr  # every file was read back
    assert mbinterval("compare", folder / "film.exr", folder / "film.exr").returncode == 0


@pytest.mark.nightly
def test_a_process_that_reads_parquet_back_ends_well(tmp_path):
    """With the file as a stream of Python's one in sixty aborted (134), at five at a time."""
    (tmp_path / "box.toml").write_text(BOX)
    given = ("render", tmp_path / "box.toml", "-q", "--samples", 1, "-o", tmp_path / "a.parquet")
    assert mbinterval(*given).returncode == 0
    with ThreadPoolExecutor(5) as pool:
        runs = list(pool.map(lambda _: mbinterval(*given), range(300)))
    assert {(run.returncode, run.stderr) for run in runs} == {(0, "")}
