"""Outputs: whose files are replaced, and what links, pipes and devices get."""

from __future__ import annotations

import io
import json
import os
import socket
import stat
import threading
import zipfile
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from support.films import make_film

import mbinterval as mb
from mbinterval import cli
from mbinterval.errors import OutputError
from mbinterval.files.atomic import output_place, prepare_output, remove_leftovers, write_file
from mbinterval.files.ownership import SOFTWARE, software_of
from mbinterval.files.results import write_result

SCENE = """
[camera]
position = [0, 0, 4]
look_at = [0, 0, 0]
[[lights]]
kind = "ambient"
[[objects]]
primitive = { kind = "box", size = [1, 1, 1] }
"""
SMALL = ("--width", "16", "--height", "12", "--samples", "1", "-q")
KINDS = ("exr", "deep.exr", "png", "npz", "parquet")


@pytest.fixture
def scene(tmp_path, monkeypatch):
    (tmp_path / "s.toml").write_text(SCENE)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def said(capsys):
    """What was said since it was last asked."""
    return lambda: capsys.readouterr().err


def render(*arguments, scene="s.toml"):
    try:
        return cli.main(["render", scene, *SMALL, *arguments])
    except SystemExit as ended:
        return ended.code


# Whose files are replaced

USERS = {
    "exr": lambda path: make_film(metadata={"software": "another 1.0"}).write(path),
    "deep.exr": lambda path: make_film(metadata={}).write("flat.exr").rename(path),
    "png": lambda path: Image.new("RGB", (3, 3)).save(path),
    "npz": lambda path: np.savez(path, metadata=np.arange(9), x=np.arange(9)),
    "parquet": lambda path: user_table(path),
}
"""Files of a user, whole and of the kind that their names say."""


def user_table(path):
    import pyarrow
    import pyarrow.parquet

    pyarrow.parquet.write_table(pyarrow.table({"x": [1, 2], "metadata": [3, 4]}), path)


def archived(content, compression=zipfile.ZIP_STORED):
    """A zip archive with ``metadata.npy``."""
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", compression) as file:
        file.writestr("metadata.npy", content)
    return archive.getvalue()


def in_the_way(kind):
    """Files of somebody in place of one of ``kind``, by what they are."""
    assert render("-o", f"ours.{kind}") == 0
    ours = Path(f"ours.{kind}").read_bytes()
    USERS[kind](Path(f"user.{kind}"))
    text = b"a text\n"
    parts = {f"cut at {size}": ours[:size] for size in (1, 9, len(ours) // 2, len(ours) - 13)}
    zeros = ours[: len(ours) // 2].ljust(len(ours), b"\0")
    found = {"user's": Path(f"user.{kind}").read_bytes(), "text": text, **parts}
    if kind == "npz":  # NumPy's and zip's own readers end with errors of other modules
        header = b"{'descr': '<U3', 'fortran_order': False, 'shape': ("
        found["broken header"] = archived(b"\x93NUMPY\1\0" + bytes([len(header), 0]) + header)
        found["another packing"] = archived(b"", zipfile.ZIP_LZMA)
        damaged = bytearray(found["another packing"])
        damaged[damaged.index(b"metadata.npy") + 16] ^= 0xFF
        found["damaged packing"] = bytes(damaged)
    # The table of an EXR's blocks stays; that one of them is empty only decoders know.
    return found | ({} if kind.endswith("exr") else {"zeros": zeros})


@pytest.mark.parametrize("kind", KINDS)
def test_files_that_are_not_provably_ours_stay(scene, said, kind):
    for what, data in in_the_way(kind).items():
        path = scene / f"a.{kind}"
        path.write_bytes(data)
        said()
        assert render("-o", f"b.png,{path.name}") == 6, what
        assert path.read_bytes() == data, what
        assert f"{path.name}: is there, " in (message := said())
        assert message.endswith("by mbinterval; --overwrite replaces it\n")
        assert not (scene / "b.png").exists()  # nothing was rendered
        assert render("--overwrite", "-o", path.name) == 0, what
        assert path.read_bytes() == (scene / f"ours.{kind}").read_bytes(), what


@pytest.mark.parametrize("kind", [*KINDS, "json"])
def test_a_file_that_comes_while_a_frame_is_rendered_stays(scene, said, kind, monkeypatch):
    path, plain = scene / f"a.{kind}", mb.render

    def render_meanwhile(*arguments, **settings):
        path.write_bytes(b"mine")
        return plain(*arguments, **settings)

    outputs = ("-o", "b.png", "--stats", "a.json") if kind == "json" else ("-o", path.name)
    monkeypatch.setattr("mbinterval.batch.batch.render", render_meanwhile)
    assert render(*outputs) == 6
    assert path.read_bytes() == b"mine"
    assert f"{path.name}: is there, " in said()
    assert render("--overwrite", *outputs) == 0
    assert path.read_bytes() != b"mine"


@pytest.mark.parametrize("kind", KINDS)
def test_our_own_and_empty_files_are_replaced(scene, kind):
    path = scene / f"a.{kind}"
    path.touch()  # as mktemp makes them
    assert render("-o", path.name) == 0
    first = path.read_bytes()
    assert render("-o", path.name, "--seed", "1", "--frames", "2") == 0
    assert path.read_bytes() != first
    assert (software_of(path, path.suffix)) == SOFTWARE


def test_statistics_replace_statistics_alone(scene, said):
    for data in (b"[1]", b'{"software": "mine"}', b"text", b'[{"frame": 1}]', b"[" * 5000):
        Path("a.json").write_bytes(data)
        assert render("-o", "a.exr", "--stats", "a.json") == 6
        assert "a.json: is there, " in said()
        assert Path("a.json").read_bytes() == data
        assert not Path("a.exr").exists()
    assert render("-o", "a.exr", "--stats", "a.json", "--overwrite") == 0
    rows = json.loads(Path("a.json").read_text())
    assert [(row["frame"], row["software"]) for row in rows] == [(1, SOFTWARE)]
    assert render("-o", "a.exr", "--stats", "a.json", "--frames", "3") == 0
    assert json.loads(Path("a.json").read_text())[0]["frame"] == 3


@pytest.mark.parametrize(
    "others",
    [
        ("--stats", "s.toml"),
        ("--stats", "./a.exr"),
        ("--log", "a.exr"),
        ("--stats", "x", "--log", "x"),
    ],
)
def test_statistics_and_logs_are_no_other_file_of_the_job(scene, said, others):
    assert render("-o", "a.exr", "--overwrite", *others) == 2
    assert "is another file of the job; give another name" in said()
    assert (scene / "s.toml").read_text() == SCENE
    assert not Path("a.exr").exists()


def test_results_and_maps_of_comparisons_replace_their_own_alone(scene, said):
    for seed in "12":
        render("-o", f"{seed}.exr", "--seed", seed)
    compare = ["compare", "1.exr", "2.exr"]
    for option, path in (("--json", Path("r.json")), ("--maps", Path("m/2/rms.png"))):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("mine")
        assert cli.main([*compare, option, path.parts[0]]) == 6
        assert "is there, not a whole" in said()
        assert path.read_text() == "mine"
        path.unlink()
        for _ in range(2):
            assert cli.main([*compare, option, path.parts[0]]) == 0
        assert software_of(path, path.suffix) == SOFTWARE


def test_a_benchmark_replaces_its_own_result_alone(scene, said):
    for data in (b"mine", b'{"format": 1, "scenes": []}'):
        Path("r.json").write_bytes(data)
        assert cli.main(["bench", "--json", "r.json", "no such scene"]) == 6
        assert "r.json: is there, " in (message := said())
        assert message.endswith("give another name\n")
        with pytest.raises(OutputError, match=r"r\.json: is there, .*give another name"):
            write_result("r.json", {"format": 1, "software": SOFTWARE})  # it came meanwhile
        assert Path("r.json").read_bytes() == data
    Path("r.json").unlink()
    write_result("r.json", {"format": 1, "software": SOFTWARE})
    assert cli.main(["bench", "--json", "r.json", "no such scene"]) == 2


@pytest.mark.parametrize("name", ["study.json", "study.csv", "report.html", "films/mine.exr"])
def test_a_study_takes_no_folder_with_files_of_others(scene, said, name):
    path = scene / "out" / name
    path.parent.mkdir(parents=True)
    path.write_bytes(b"mine")
    assert cli.main(["study", "s.toml", "-o", "out"]) == 6
    assert f"out/{name}: is there, " in (message := said())
    assert message.endswith("give another folder\n")
    assert [p for p in (scene / "out").rglob("*") if p.is_file()] == [path]
    assert path.read_bytes() == b"mine"


def test_what_python_is_asked_to_write_it_writes(tmp_path):
    """As every library does: whoever names a file in a program means it."""
    path = tmp_path / "a.exr"
    path.write_bytes(b"mine")
    assert mb.Film.read(make_film().write(path)).rgba.shape == (21, 34, 4)


# Links, pipes, devices


def link_to(target, name="link.exr"):
    Path(name).symlink_to(target)
    return Path(name)


def test_links_stay_and_what_they_link_to_is_replaced(scene):
    Path("disk").mkdir()
    for target in ("disk/there.exr", "disk/not yet.exr", scene / "disk" / "new folder" / "a.exr"):
        second = link_to(target)
        first = link_to(second.name, "first.exr")
        if "there" in str(target):
            make_film(metadata={"software": SOFTWARE}).write(target)
        before = os.readlink(first), os.readlink(second)
        assert render("-o", "first.exr") == 0
        assert (os.readlink(first), os.readlink(second)) == before
        assert mb.Film.read(target).rgba.shape == (12, 16, 4)
        assert not Path(target).is_symlink()
        assert render("-o", "first.exr") == 0  # and is complete
        for link in (first, second):
            link.unlink()
    names = {path.name for path in (scene / "disk").rglob("*")}
    assert names == {"there.exr", "not yet.exr", "new folder", "a.exr"}
    assert not list(scene.rglob(".*"))


def test_a_link_to_a_file_of_somebody_is_not_written_through(scene, said):
    Path("mine.txt").write_text("mine")
    link_to("mine.txt")
    assert render("-o", "link.exr") == 6
    assert Path("mine.txt").read_text() == "mine"
    assert "link.exr: is there, not a whole .exr file" in said()


def test_links_in_a_circle_and_to_folders_are_errors(scene, said):
    link_to("b.exr", "a.exr")
    link_to("a.exr", "b.exr")
    link_to(".", "c.exr")
    assert render("-o", "a.exr") == 6
    assert "a.exr: cannot be written (Too many levels of symbolic links)" in said()
    assert render("-o", "c.exr") == 6
    assert "c.exr: is a folder" in said()


def test_two_names_of_one_file_clash(scene, said):
    link_to("a.exr")
    assert render("-o", "a.exr,link.exr") == 2
    assert "output 'link.exr' is given twice" in said()
    link_to("s.toml", "scene.exr")
    assert render("-o", "scene.exr", "--overwrite") == 2
    assert "'scene.exr' is a file that the scene is read from" in said()
    assert Path("s.toml").read_text() == SCENE


def test_leftovers_go_where_a_link_leads_and_no_other_file_does(scene):
    Path("disk").mkdir()
    link_to("disk/a.exr")
    dead = Path("disk/.mbinterval-0123456789abcdef.part")
    dead.write_bytes(b"half")
    kept = [link_to("../s.toml", "disk/.mbinterval-1.part"), Path("disk/.mbinterval-2.part")]
    os.mkfifo(kept[1])
    prepare_output("link.exr")
    assert sorted(Path("disk").iterdir()) == kept
    assert remove_leftovers(Path("disk")) == []
    assert (scene / "s.toml").read_text() == SCENE


def test_a_pipe_gets_the_bytes_and_stays(tmp_path):
    pipe, got = tmp_path / "a.png", []
    os.mkfifo(pipe)
    reader = threading.Thread(target=lambda: got.append(pipe.read_bytes()))
    reader.start()
    film = make_film(300, 400)  # more than the pipe holds
    assert film.write(pipe) == pipe
    reader.join()
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    film.write(tmp_path / "b.png")
    assert got == [(tmp_path / "b.png").read_bytes()]
    assert {path.name for path in tmp_path.iterdir()} == {"a.png", "b.png"}


def test_a_pipe_whose_reader_goes_is_an_error(tmp_path):
    pipe = tmp_path / "a.exr"
    os.mkfifo(pipe)

    def read():
        with pipe.open("rb") as file:
            file.read(1)

    reader = threading.Thread(target=read)
    reader.start()
    with pytest.raises(OutputError, match=r"a\.exr: cannot be written \(Broken pipe\)"):
        make_film(300, 400).write(pipe)
    reader.join()


def test_sockets_are_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # their names are short
    with socket.socket(socket.AF_UNIX) as server:
        server.bind("a.exr")
        for write in (make_film().write, prepare_output):
            with pytest.raises(OutputError, match=r"a\.exr: is a socket"):
                write(Path("a.exr"))
    assert stat.S_ISSOCK(Path("a.exr").stat().st_mode)


def test_descriptors_get_what_is_written_where_they_stand(tmp_path):
    """A file that a shell redirects to is not replaced under the shell's hand."""
    path = tmp_path / "out"
    link = tmp_path / "link"
    with path.open("wb", buffering=0) as file:
        number = file.fileno()
        file.write(b"first ")
        for name in (f"/dev/fd/{number}", f"/proc/self/fd/{number}", link):
            if name == link:
                link.symlink_to(f"/dev/fd/{number}")
            assert output_place(name) is None
            prepare_output(name)
            write_file(name, b"more ")
        file.write(b"last")
        inode = os.fstat(number).st_ino
    assert path.read_bytes() == b"first more more more last"
    assert path.stat().st_ino == inode
    with path.open("rb") as file, pytest.raises(OutputError, match="open for reading only"):
        prepare_output(f"/dev/fd/{file.fileno()}")
    with pytest.raises(OutputError, match="Bad file descriptor"):
        write_file(f"/dev/fd/{number}", b"")


def test_a_short_write_is_gone_on_with_and_a_wrong_size_is_an_error(tmp_path, monkeypatch):
    path, real = tmp_path / "a", os.write
    path.write_bytes(b"before")
    monkeypatch.setattr(os, "write", lambda to, data: real(to, data[:7]))
    write_file(path, bytes(range(256)))
    assert path.read_bytes() == bytes(range(256))
    monkeypatch.setattr(os, "write", lambda _, data: len(data))
    with pytest.raises(OutputError, match="0 of 6 bytes are there"):
        write_file(path, b"no more than a promise"[:6])
    assert path.read_bytes() == bytes(range(256))
    assert [p.name for p in tmp_path.iterdir()] == ["a"]


# Patterns


def test_names_of_folders_and_scenes_are_no_patterns(scene, said):
    for name in ("shot#3", "100%done", "{camera}", "{frame}", "c{x}"):
        assert render("-o", f"{name}/out.exr") == 0
        assert [p.name for p in (scene / name).iterdir()] == ["out.exr"]
        said()
        assert render("--frames", "1-2", "-o", f"{name}/out.exr") == 2
        assert "put #### where the frame's number belongs in the file's name" in said()
        Path(f"{name}.toml").write_text(SCENE)
        assert render("--frames", "1-2", scene=f"{name}.toml") == 0
        assert Path(f"{name}.0002.exr").exists()
    assert not list(scene.glob("*camera.0*"))


def test_a_camera_in_a_folders_name_parts_no_cameras(scene, said):
    camera = SCENE.split("[[lights]]")[0].replace("[camera]", '[[cameras]]\nname = "{}"')
    text = camera.replace("{}", "one") + camera.replace("{}", "two")
    Path("s.toml").write_text(text + "[[lights]]" + SCENE.split("[[lights]]")[1])
    assert render("--cameras", "all", "-o", "{camera}/a.exr") == 2
    assert "put {camera} where the camera's name belongs in the file's name" in said()
    assert render("--cameras", "all", "-o", "{camera}/{camera}.exr") == 0
    assert {path.name for path in (scene / "{camera}").iterdir()} == {"one.exr", "two.exr"}


def test_templates_for_farms_name_the_same_files(scene, said, capsys):
    Path("x{frame}, y").mkdir()
    for text in ("a,b.toml", "c{x}.toml"):
        Path(text).write_text(SCENE)
        assert cli.main(["openjd", text]) == 2
        assert "give another" in said()
    assert cli.main(["openjd", "c{x}.toml", "-o", "shot#1/a.####.exr"]) == 0
    assert f"--output={scene}/shot#1/a.####.exr" in capsys.readouterr().out
