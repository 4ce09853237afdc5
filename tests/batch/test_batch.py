"""Batches: which frames are complete, what is rendered again, and where the files go."""

from __future__ import annotations

import fcntl
import json
import random
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from support.nightly import nightly

import mbinterval
from mbinterval import cli
from mbinterval.cli import option_values
from mbinterval.files.atomic import remove_leftovers, replacing
from mbinterval.files.exr import read_exr
from mbinterval.film.deep import DeepImage
from mbinterval.film.events import Events
from mbinterval.film.film import Film

SCENE = """
background = "sky.png"
[camera]
position = [0, 0, 4]
look_at = [0, 0, 0]
[[objects]]
name = "box"
primitive = { kind = "box", size = [1, 1, 1] }
transform.keys = [
  { frame = 0, translation = [-1, 0, 0] },
  { frame = 9, translation = [1, 0.5, 0], euler = [30, 40, 0] },
]
"""
OPTIONS = ("--width", "40", "--height", "30", "--samples", "1")


class Batch:
    """Runs the command line in a folder, and tells which frames were rendered."""

    def __init__(self, folder, monkeypatch, capsys):
        self.folder, self.capsys, self.frames = folder, capsys, []
        real = mbinterval.render

        def render(scene, **arguments):
            self.frames.append(arguments["frame"])
            return real(scene, **arguments)

        monkeypatch.setattr("mbinterval.batch.batch.render", render)

    def __call__(self, *arguments, scene="s.toml"):
        """Exit code, frames that were rendered, and what was said."""
        self.frames.clear()
        self.capsys.readouterr()
        try:
            code = cli.main(["render", scene, *OPTIONS, *arguments])
        except SystemExit as ended:
            code = ended.code
        return code, list(self.frames), self.capsys.readouterr().err

    def files(self, pattern="*"):
        return {path.name: path.read_bytes() for path in sorted(self.folder.glob(pattern))}


@pytest.fixture
def batch(tmp_path, monkeypatch, capsys):
    (tmp_path / "s.toml").write_text(SCENE)
    Image.fromarray(np.full((4, 4, 3), 99, np.uint8)).save(tmp_path / "sky.png")
    monkeypatch.chdir(tmp_path)
    return Batch(tmp_path, monkeypatch, capsys)


BOTH = ("-o", "a.####.exr,a.####.png")


def test_frames_that_are_complete_stay_and_the_others_come(batch):
    assert batch("--frames", "1-3", *BOTH)[:2] == (0, [1, 2, 3])
    before = {path: path.stat().st_mtime_ns for path in batch.folder.glob("a.*")}
    code, frames, said = batch("--frames", "1-5:2,2", *BOTH)
    assert (code, frames) == (0, [5])
    assert said.startswith("3 of 4 frames are complete and stay; --overwrite renders them again\n")
    assert {path: path.stat().st_mtime_ns for path in before} == before
    code, frames, said = batch("--frames", "1-3", *BOTH)
    assert (code, frames) == (0, [])
    assert said == "all 3 frames are complete and stay; --overwrite renders them again\n"
    assert batch("--frames", "1-3", "--overwrite", *BOTH)[:2] == (0, [1, 2, 3])
    assert all(path.stat().st_mtime_ns > time for path, time in before.items())


def test_a_frame_is_complete_only_with_all_of_its_files(batch):
    batch("--frames", "1-2", *BOTH)
    whole = batch.files("a.*")
    (batch.folder / "a.0001.png").unlink()
    (batch.folder / "a.0002.exr").unlink()
    assert batch("--frames", "1-2", *BOTH)[1] == [1, 2]
    assert batch.files("a.*") == whole


def damage(path: Path, how: str, chance: random.Random) -> None:
    data = bytearray(path.read_bytes())
    if how == "cut":
        data = data[: chance.randrange(len(data))]
    elif how == "flip":
        data[chance.randrange(len(data) // 2, len(data))] ^= 1 << chance.randrange(8)
    elif how == "zeros":  # what a power cut can leave of a file
        data[len(data) // 2 :] = bytes(len(data) - len(data) // 2)
    else:
        data = bytearray()
    path.write_bytes(data)


@pytest.mark.parametrize("how", ["cut", "flip", "zeros", "empty"])
@pytest.mark.parametrize("ending", ["exr", "png", "deep.exr", "npz", "parquet"])
def test_what_is_damaged_is_noticed_and_replaced_where_it_still_says_whose_it_is(
    batch, how, ending
):
    output = ("-o", f"a.####.{ending}")
    batch("--frames", "1-8", *output)
    whole, chance = batch.files("a.*"), random.Random(f"{how} {ending}")
    for name in whole:
        damage(batch.folder / name, how, chance)
    kept, refused = set(), set()
    for name, damaged in batch.files("a.*").items():
        code, frames, said = batch("--frames", name[2:6], *output)
        if code == 6:
            assert re.search(f"{name}: is there, .*by mbinterval; --overwrite replaces it", said)
            assert (frames, batch.files()[name]) == ([], damaged)
            refused.add(name)
        elif frames:
            assert (code, batch.files()[name]) == (0, whole[name])
        else:
            assert code == 0
            kept.add(name)
    # A flipped bit of padding, or one that decoders don't look at: headers of archives have more.
    assert len(kept) <= (4 if ending == "npz" else 2)
    for name in kept if ending == "exr" else ():
        (batch.folder / "whole.exr").write_bytes(whole[name])
        found, was = (Film.read(batch.folder / file) for file in (name, "whole.exr"))
        assert found.rgba.tobytes() == was.rgba.tobytes()
    least, most = REFUSED.get((how, ending), {"cut": (8, 8), "empty": (0, 0)}.get(how, (0, 8)))
    assert least <= len(refused) <= most
    assert batch("--frames", "1-8", "--overwrite", *output)[0] == 0
    assert batch.files("a.*") == whole


@pytest.mark.parametrize("ending", ["exr", "png", "deep.exr", "npz", "parquet"])
def test_a_frame_without_its_last_bytes_is_not_complete(batch, ending):
    output = ("-o", f"a.####.{ending}")
    batch("--frames", "1", *output)
    path = batch.folder / f"a.0001.{ending}"
    whole = path.read_bytes()
    assert batch("--frames", "1", *output)[:2] == (0, [])
    for missing in range(1, 33):
        path.write_bytes(whole[:-missing])
        code, frames, _ = batch("--frames", "1", *output)
        assert (code, frames) == (6, []), missing
        assert path.read_bytes() == whole[:-missing]


REFUSED = {("flip", "exr"): (0, 1), ("flip", "deep.exr"): (0, 1), ("zeros", "png"): (8, 8)}
"""Of eight files at least and at most how many: where what says whose a file is can be hit."""


def test_what_is_made_of_spans_has_files_of_its_own_and_belongs_to_the_frame(batch):
    outputs = "a.####.exr,a.####.deep.exr,a.####.npz"
    assert batch("--frames", "1-2", "-o", outputs)[:2] == (0, [1, 2])
    whole = batch.files("a.*")
    assert sorted(whole) == sorted(
        f"a.000{frame}.{ending}" for frame in (1, 2) for ending in ("exr", "deep.exr", "npz")
    )
    assert batch("--frames", "1-2", "-o", outputs)[1] == []
    (batch.folder / "a.0002.npz").unlink()
    assert batch("--frames", "1-2", "-o", outputs)[1] == [2]
    assert batch.files("a.*") == whole
    events, film = Events.read(batch.folder / "a.0001.npz"), Film.read(batch.folder / "a.0001.exr")
    assert events.metadata["identity"] == film.metadata["identity"]
    assert np.abs(events.integrate()[..., 3] - film.rgba[..., 3]).max() < 1e-5
    deep = DeepImage.read(batch.folder / "a.0001.deep.exr")
    assert np.abs(deep.flatten()[..., 3] - film.rgba[..., 3]).max() < 1e-6
    code, frames, said = batch("-o", "a.####.npz", "--event-steps", "3", "-v")
    assert (code, frames) == (0, [1])
    assert "was rendered from another scene, or with other settings" in said


def test_what_would_go_to_no_file_is_refused_before_anything_is_rendered(batch):
    for name, ending in (("deep", r"name.####.deep.exr"), ("events", "name.####.npz")):
        code, frames, said = batch("--aovs", f"uv,{name}", "-o", "a.####.exr")
        assert (code, frames) == (2, [])
        assert f"{name} goes to files of its own; add an output such as {ending}" in said
        assert cli.main(["info", "s.toml", *OPTIONS, "--aovs", name]) == 0
    code, _, said = batch("-o", "a.npz", "--method", "stochastic")
    assert code == 2
    assert "aovs=('events',) with method='stochastic'" in said
    assert not batch.files("a.*")


def test_another_frame_under_its_name_is_not_it(batch):
    batch("--frames", "1-2", *BOTH)
    whole = batch.files("a.*")
    for ending in ("exr", "png"):
        shutil.copy(batch.folder / f"a.0001.{ending}", batch.folder / f"a.0002.{ending}")
    assert batch("--frames", "1-2", *BOTH)[1] == [2]
    assert batch.files("a.*") == whole


def test_pixels_that_were_edited_are_noticed(batch):
    """Also where the program that did it kept what the file says about itself."""
    batch(*BOTH)
    whole = batch.files("a.*")
    with Image.open(batch.folder / "a.0001.png") as image:
        image.load()
        text, pixels = image.info, np.array(image)
    pixels[0, 0] += 1
    from PIL.PngImagePlugin import PngInfo

    info = PngInfo()
    for name in ("software", "identity", "pixelDigest"):
        info.add_itxt(name, text[name])
    Image.fromarray(pixels).save(batch.folder / "a.0001.png", pnginfo=info)
    code, frames, said = batch("-v", *BOTH)
    assert (code, frames) == (0, [1])
    assert "a.0001.png has pixels that were changed" in said
    assert batch.files("a.*") == whole


CHANGES = {
    "the scene": lambda folder: (folder / "s.toml").write_text(SCENE + "# words\n"),
    "a file that it names": lambda folder: Image.new("RGB", (4, 4)).save(folder / "sky.png"),
}


@pytest.mark.parametrize("what", CHANGES)
def test_what_comes_of_other_files_is_rendered_again(batch, what):
    batch(*BOTH)
    assert batch(*BOTH)[1] == []
    CHANGES[what](batch.folder)
    code, frames, said = batch("-v", *BOTH)
    assert (code, frames) == (0, [1])
    assert "a.0001.exr was rendered from another scene, or with other settings" in said
    assert batch(*BOTH)[1] == []


@pytest.mark.parametrize(
    "option",
    [
        nightly("--samples=2"),
        "--width=41",
        "--crop=1,2,8,8",
        "--shutter=0,0.5",
        "--transparent",
        "--seed=1",
    ],
)
def test_what_is_asked_for_differently_is_rendered_again(batch, option):
    batch(*BOTH)
    assert batch(option, *BOTH)[1] == [1]
    assert batch(option, *BOTH)[1] == []
    assert batch(*BOTH)[1] == [1]


def test_what_changes_speed_alone_is_not(batch, monkeypatch):
    batch(*BOTH)
    assert batch("--tile-size", "8", "--memory", "8G", "--device", "0", *BOTH)[1] == []
    monkeypatch.setattr("mbinterval.batch.identity.program_digest", lambda: "another program")
    assert batch(*BOTH)[1] == [1]


def test_a_project_may_move_as_a_whole(batch):
    batch(*BOTH)
    elsewhere = batch.folder / "elsewhere"
    elsewhere.mkdir()
    for name in ("s.toml", "sky.png"):
        shutil.move(batch.folder / name, elsewhere / name)
    assert batch(*BOTH, scene="elsewhere/s.toml")[1] == []


def test_images_of_other_programs_are_replaced_only_when_asked_to(batch):
    Image.new("RGB", (3, 3)).save("a.0002.png")
    photo = Path("a.0002.png").read_bytes()
    code, frames, said = batch("--frames", "1-2", *BOTH)
    assert (code, frames) == (6, [])
    assert "a.0002.png: is there, and not by mbinterval; --overwrite replaces it" in said
    assert Path("a.0002.png").read_bytes() == photo
    assert batch("--frames", "1-2", "--overwrite", *BOTH)[:2] == (0, [1, 2])
    assert batch("--frames", "1-2", *BOTH)[:2] == (0, [])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--frames", "1-2", "-o", "a.exr"), "2 frames would overwrite each other; put ####"),
        (("-o", "a.exr,./b/../a.exr"), "output 'b/../a.exr' is given twice"),
        (("--frames", "1,11", "-o", "#1.exr,#.exr"), "output '11.exr' of frame 11 is that of"),
        (("-o", "sky.png", "--overwrite"), "output 'sky.png' is a file that the scene is read"),
        (("--camera", "0", "--camera", "side", "-o", "a.exr"), "no camera 'side'; the scene has"),
        (("-o", "a.{shot}.exr"), "{shot} is unknown; known are {frame}, {frame:04} and {camera}"),
        (("--threads", "0"), "'0' is not a whole number from 1 to 4096"),
        (("--memory", "much"), "'much' is not a size such as 800M or 2G"),
        (("--memory", "0G"), "'0G' is not a size"),
    ],
)
def test_what_cannot_be_is_said_before_any_work(batch, arguments, message):
    code, frames, said = batch(*arguments)
    assert (code, frames) == (2, [])
    assert message in said
    assert {path.name for path in batch.folder.iterdir()} == {"s.toml", "sky.png"}


@pytest.mark.parametrize(
    ("text", "size"),
    [("2G", 2 << 30), ("1.5g", 3 << 29), ("800M", 800 << 20), ("64 KiB", 1 << 16), ("9", 9)],
)
def test_sizes_of_memory(text, size):
    assert option_values.size(text) == size


TWO_CAMERAS = """
[[cameras]]
name = "front"
position = [0, 0, 4]
look_at = [0, 0, 0]
[[cameras]]
name = "from the/side"
position = [4, 0, 0]
look_at = [0, 0, 0]
"""


def test_cameras_see_the_same_frames(batch):
    table, objects = SCENE.split("[[objects]]")
    sky = table.split("[camera]")[0]
    (batch.folder / "s.toml").write_text(f"{sky}{TWO_CAMERAS}[[objects]]{objects}")
    assert batch("--frames", "1-2", "--cameras", "all")[:2] == (0, [1, 2, 1, 2])
    found = batch.files("s.*.exr")
    assert list(found) == [
        f"s.{name}.000{n}.exr" for name in ("from the_side", "front") for n in (1, 2)
    ]
    assert len(set(found.values())) == 4
    cameras = [read_exr(batch.folder / name).attributes["camera"] for name in found]
    assert cameras == ["from the/side"] * 2 + ["front"] * 2
    assert batch("--frames", "1-2", "--camera", "from the/side", "-o", "b.#.exr")[1] == [1, 2]
    assert batch.files("b.1.exr")["b.1.exr"] == found["s.from the_side.0001.exr"]
    # The first camera is what is used where none is chosen: the frame is the same.
    shutil.copy(batch.folder / "s.front.0001.exr", batch.folder / "c.exr")
    assert batch("-o", "c.exr")[1] == []
    code, frames, said = batch("--camera", "0", "--camera", "1", "-o", "d.#.exr")
    assert (code, frames) == (2, [])
    assert "2 cameras would overwrite each other; put {camera} where the camera's name" in said


def test_the_log_has_a_line_for_the_job_and_for_each_frame(batch):
    batch("--frames", "1-2", "--log", "log/a.jsonl", *BOTH)
    (batch.folder / "a.0002.png").unlink()
    code, _, _ = batch("--frames", "1-2", "--log", "log/a.jsonl", *BOTH)
    assert code == 0
    lines = [json.loads(line) for line in Path("log/a.jsonl").read_text().splitlines()]
    start, first, second, end, *again = lines
    assert [line["event"] for line in lines] == ["start", "frame", "frame", "end"] * 2
    assert start["version"] == mbinterval.__version__
    assert start["settings"]["samples"] == 1
    assert set(start["files"]) == {"s.toml", "sky.png"}
    assert (end["exit"], end["rendered"], end["complete"]) == (0, 2, 0)
    assert (first["frame"], first["status"]) == (1, "rendered")
    assert first["outputs"] == ["a.0001.exr", "a.0001.png"]
    assert first["bytes"] == [Path(path).stat().st_size for path in first["outputs"]]
    assert first["identity"] == read_exr("a.0001.exr").attributes["identity"]
    with Image.open("a.0001.png") as image:
        assert image.info["identity"] == first["identity"]
    assert first["identity"] != second["identity"]
    assert {"expose", "paths", "bin", "solve", "write"} <= first["timings"].keys()
    assert 0 < sum(first["timings"].values()) <= first["seconds"] * 1.01
    assert first["stats"]["hits"] > 0
    assert first["device"] in {device.name for device in mbinterval.devices()}
    assert first["notes"] == ["no lights: a headlight was added"]
    assert [line.get("status") for line in again[1:3]] == ["complete", "rendered"]
    assert again[2]["reason"] == "a.0002.png is missing"


def test_the_log_of_a_failure_has_its_exit_code(batch):
    broken = SCENE.replace("[1, 0.5, 0]", "[1e35, 0.5, 0]")
    (batch.folder / "s.toml").write_text(broken)
    code, _, said = batch("--frames", "1-9", "--log", "a.jsonl", *BOTH)
    assert code == 3
    lines = [json.loads(line) for line in Path("a.jsonl").read_text().splitlines()]
    failed, end = lines[-2:]
    assert (failed["status"], failed["exit"], end["exit"]) == ("failed", 3, 3)
    assert failed["error"] == end["error"]
    assert end["error"] in said


def test_a_line_of_the_log_that_was_cut_off_costs_no_other(batch):
    Path("a.jsonl").write_text('{"event": "start"}\n{"event": "fra')
    batch("--log", "a.jsonl", *BOTH)
    lines = Path("a.jsonl").read_text().splitlines()
    assert lines[:2] == ['{"event": "start"}', '{"event": "fra']
    assert [json.loads(line)["event"] for line in lines[2:]] == ["start", "frame", "end"]


def test_what_is_no_log_is_not_written_to(batch):
    code, frames, said = batch("--log", "s.toml", *BOTH)
    assert (code, frames) == (6, [])
    assert "s.toml: is there, and no log of mbinterval; give another name" in said
    assert Path("s.toml").read_text() == SCENE


def test_leftovers_of_killed_processes_go_and_those_of_live_ones_stay(batch):
    live = batch.folder / ".mbinterval-live.part"
    for name in ("dead", "live"):
        (batch.folder / f".mbinterval-{name}.part").write_bytes(b"half")
    with live.open() as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        batch(*BOTH)
        assert {path.name for path in batch.folder.glob(".*")} == {live.name}
    assert remove_leftovers(batch.folder) == [live]


def test_a_file_that_is_being_written_is_no_leftover(tmp_path):
    with replacing(tmp_path / "a.exr") as temporary:
        temporary.write_bytes(b"new")
        assert remove_leftovers(tmp_path) == []
        assert temporary.exists()
    assert [path.name for path in tmp_path.iterdir()] == ["a.exr"]


def test_a_lens_and_triangulated_paths_are_bad_usage_wherever_they_are_said(batch):
    lens = "f_stop = 2.0\nfocus_distance = 4.0\n[[objects]]"
    (batch.folder / "s.toml").write_text(SCENE.replace("[[objects]]", lens))
    assert batch("--paths", "triangulated", *BOTH)[0] == 2
    (batch.folder / "s.toml").write_text(
        SCENE.replace("[[objects]]", lens) + '\n[settings]\npaths = "triangulated"'
    )
    code, _, said = batch(*BOTH)
    assert code == 2
    assert re.search("paths='triangulated' has no lens; use paths='exact'", said)
