"""Frame ranges and numbered file names."""

from pathlib import Path

import pytest

from mbinterval import errors
from mbinterval.film.file_names import frame_path, has_camera, is_numbered, literal, parse_outputs
from mbinterval.film.frame_ranges import parse_frames


@pytest.mark.parametrize(
    ("text", "frames"),
    [
        ("7", [7]),
        ("1-4", [1, 2, 3, 4]),
        ("1-8x3", [1, 4, 7]),
        ("1-8:3", [1, 4, 7]),
        ("1,5,10-20:5", [1, 5, 10, 15, 20]),
        ("1,5,9-12", [1, 5, 9, 10, 11, 12]),
        ("3,1-4, 2", [3, 1, 2, 4]),
        ("-5--3", [-5, -4, -3]),
        ("-2-1", [-2, -1, 0, 1]),
        ("5-5x100", [5]),
    ],
)
def test_frame_ranges(text, frames):
    assert parse_frames(text) == frames


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "'' is no frame"),
        ("1,,2", "'' is no frame"),
        ("1-", "'1-' is no frame"),
        ("1x2", "'1x2' is no frame"),
        ("1.5", "'1.5' is no frame"),
        ("1 - 3", "'1 - 3' is no frame"),
        ("1,9-3", "'9-3' ends before it starts"),
        ("1-9x0", "the step of '1-9x0' must be 1 or more"),
        ("1-9999999999", "more than 1,000,000 frames"),
    ],
)
def test_bad_frame_ranges_say_which_part_is_bad(text, reason):
    with pytest.raises(errors.UsageError, match=reason.replace("(", r"\(")) as caught:
        parse_frames(text)
    assert str(caught.value).startswith(f"frames {text!r}: ")


@pytest.mark.parametrize(
    ("pattern", "frame", "path"),
    [
        ("shot.####.exr", 7, "shot.0007.exr"),
        ("shot.#.exr", 7, "shot.7.exr"),
        ("shot.##.exr", 12345, "shot.12345.exr"),
        ("v#1/shot.####.exr", 7, "v#1/shot.0007.exr"),
        ("shot.%04d.exr", 7, "shot.0007.exr"),
        ("shot.%d.exr", 7, "shot.7.exr"),
        ("100%.####.exr", 7, "100%.0007.exr"),
        ("shot.####.exr", -7, "shot.-0007.exr"),
        ("shot.{frame:04}.exr", 7, "shot.0007.exr"),
        ("shot.{frame:04d}.exr", -7, "shot.-0007.exr"),
        ("{frame}.shot.{frame:03}.####.exr", 7, "7.shot.007.0007.exr"),
        ("shot.%4d.exr", 7, "shot.7.exr"),
        ("shot#3/100%done/{frame}/{x}/%03d.exr", 7, "shot#3/100%done/{frame}/{x}/007.exr"),
        ("/####/../%d/{{.####.exr", 7, "/####/../%d/{.0007.exr"),
        ("{{{frame}}}.{{frame:04}}.exr", 7, "{7}.{frame:04}.exr"),
        ("{####.exr", 7, "{0007.exr"),
        ("{frame:032}.exr", 7, f"{7:032d}.exr"),
    ],
)
def test_file_names_take_the_frame(pattern, frame, path):
    assert is_numbered(pattern)
    assert frame_path(pattern, frame) == Path(path)


@pytest.mark.parametrize(
    ("camera", "path"),
    [("side", "side.7.exr"), ("a/b: c", "a_b_ c.7.exr"), ("..", "_.7.exr"), ("Kö", "Kö.7.exr")],
)
def test_file_names_take_the_camera(camera, path):
    assert has_camera("{camera}.#.exr")
    assert frame_path("{camera}.#.exr", 7, camera) == Path(path)
    # A camera's name is no pattern, and patterns belong to the file's name.
    assert frame_path("{camera}/{camera}.exr", 7, "#{frame}") == Path("{camera}/_frame_.exr")


@pytest.mark.parametrize(
    "pattern", ["shot#3/a.exr", "100%done/a.exr", "{frame:04}/{camera}/a.exr", "a.{{frame}}.exr"]
)
def test_what_looks_like_a_pattern_elsewhere_is_a_name(pattern):
    assert parse_outputs(pattern) == [pattern]
    assert not is_numbered(pattern)
    assert not has_camera(pattern)
    assert frame_path(pattern, 7, "side") == Path(pattern.replace("{{", "{").replace("}}", "}"))


@pytest.mark.parametrize("name", ["c{x}", "{frame}", "{{camera}}", "a#b", "%d", "}{", "{", "###"])
def test_any_text_can_be_a_literal_part_of_a_name(name):
    assert frame_path(f"{literal(name)}.####.exr", 7, "side") == Path(f"{name}.0007.exr")


def test_unknown_places_in_names_are_refused():
    for output in ("a.{scene}.exr", "a.{frame:x}.exr", "a.{}.exr", "c{x}.####.exr", "{fr#ame}.exr"):
        with pytest.raises(errors.UsageError, match=r"is unknown; known are \{frame\}"):
            parse_outputs(output)
    assert parse_outputs("{camera}.{frame:04}.exr, b.exr") == ["{camera}.{frame:04}.exr", "b.exr"]


@pytest.mark.parametrize(
    "name",
    ["{frame:0999999999}", "{frame:033}", "%0999999d", f"%0{'9' * 5000}d", "#" * 33, "#" * 5000],
)
def test_numbers_are_padded_to_so_many_digits_at_most(name):
    with pytest.raises(errors.UsageError, match="is padded to 32 digits at most") as caught:
        parse_outputs(f"{name}.exr")
    assert len(str(caught.value)) < 200


def test_a_name_without_a_place_for_the_frame_is_kept():
    assert not is_numbered("shot.exr")
    assert frame_path("shot.exr", 7) == Path("shot.exr")
