"""The report of a study: what it says is what was measured, whole or in part."""

import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest
from support.studies import SWEEPS, small_study

import mbinterval as mb
from mbinterval.comparison.comparison import false_colour
from mbinterval.files.images import decode_image, linear_to_srgb
from mbinterval.study import run as module
from mbinterval.study.pictures import CROP, data_uri, worst_crop
from mbinterval.study.plots import Axis, Point, Series, bars, plot
from mbinterval.study.report import read_study, write_report
from mbinterval.study.summary import equal_errors, seconds_for
from mbinterval.study.tables import table


class Parser(HTMLParser):
    """Elements that are open, ids, tables as lists of rows, and every address in the page."""

    VOID = ("meta", "link", "img", "input", "br")

    def __init__(self, text):
        super().__init__()
        self.open, self.ids, self.tables, self.addresses = [], [], [], []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attributes):
        found = dict(attributes)
        self.ids += [found["id"]] if "id" in found else []
        self.addresses += [found[name] for name in ("src", "href") if name in found]
        if tag not in self.VOID:
            self.open.append(tag)
        if tag == "table":
            self.tables.append([])
        if tag == "tr":
            self.tables[-1].append([])
        if tag in ("td", "th"):
            self.tables[-1][-1].append("")

    def handle_startendtag(self, tag, attributes):
        self.ids += [dict(attributes)["id"]] if "id" in dict(attributes) else []

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and {"td", "th"} & set(self.open):
            self.tables[-1][-1][-1] += data


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("report")


@pytest.fixture(scope="module")
def result(folder):
    return small_study(folder)


@pytest.fixture(scope="module")
def page(folder, result):
    return write_report(folder).read_text(encoding="utf-8")


def table_of(page, first):
    return next(rows for rows in Parser(page).tables if rows[0][0] == first)


def test_it_is_one_well_formed_file_that_names_nothing_outside(page):
    parsed = Parser(page)
    assert parsed.open == []
    assert len(parsed.ids) == len(set(parsed.ids))
    assert all(one.startswith(("data:", "#")) for one in parsed.addresses)
    assert {one[1:] for one in parsed.addresses if one.startswith("#")} <= set(parsed.ids)
    assert "http" not in re.sub(r"data:[^\"]*", "", page).replace("http://www.w3.org", "")
    assert "$" not in re.sub(r"\$\{|\$/", "", page.split("<script>")[0])


def test_its_figures_are_the_studys(page, result):
    rows = {row[0]: row for row in table_of(page, "row")}
    measured = [row for sweep in result["sweeps"].values() for row in sweep["rows"]]
    assert len(rows) == len(measured) + 1
    for row in measured:
        assert rows[row["name"]][8] == f"{row['rmse']:.2e}"
        assert rows[row["name"]][2] == f"{row['median']:.3f}"
    effects = {row[0]: row for row in table_of(page, "effect")}
    assert set(effects) == {"effect", "none", "motion", "single-sided"}


def test_its_equal_error_table_is_that_of_the_series(page, result):
    series = {
        sweep["series"]: sweep["rows"] for sweep in result["sweeps"].values() if sweep["counts"]
    }
    errors = equal_errors(series)
    rows = {row[0]: row[1:] for row in table_of(page, "series")}
    assert rows.pop("series") == [f"RMSE {error:g}" for error in errors]
    assert set(rows) == set(series)
    for name, cells in rows.items():
        for error, cell in zip(errors, cells, strict=True):
            seconds = seconds_for(series[name], error)
            assert cell.rstrip("*") == ("not reached" if seconds is None else f"{seconds:.3f}")
    for column in range(len(errors)):
        assert sum(cells[column].endswith("*") for cells in rows.values()) >= 1


def test_its_pictures_are_the_films_with_the_srgb_curve(page, folder, result):
    pictures = json.loads(re.search(r'id="data">(.*?)</script>', page, re.S)[1])
    names = [picture["name"] for picture in pictures]
    assert names[:2] == ["reference by stochastic", "reference by analytic"]
    assert len(names) > 4
    films = {row["name"]: row["film"] for s in result["sweeps"].values() for row in s["rows"]
             if "film" in row}  # fmt: skip
    for picture in pictures[2:]:
        film = mb.Film.read(folder / films[picture["name"]])
        shown = decode(picture["image"])
        expected = linear_to_srgb(film.rgba[..., :3])
        assert np.abs(linear_to_srgb(shown) - expected).max() < 0.51 / 255
        judge = "stochastic" if film.metadata["settings.method"] == "analytic" else "analytic"
        reference = mb.Film.read(folder / module.reference_name(judge))
        difference = film.rgba[..., :3].astype(float) - reference.rgba[..., :3]
        heat = false_colour(np.sqrt(np.mean(difference**2, axis=2)))
        assert np.abs(linear_to_srgb(decode(picture["map"])) - linear_to_srgb(heat)).max() < 0.01


def test_each_effect_is_shown_with_and_without(page, folder, result):
    whole, *switched = result["effects"]
    section = page.split('<section id="effects">')[1].split("</section>")[0]
    blocks = section.split("<h3>")[1:]
    assert [block.split("</h3>")[0] for block in blocks] == [one["effect"] for one in switched]
    for one, block in zip(switched, blocks, strict=True):
        assert one["reason"] in block
        assert one["off"] in block
        films = [mb.Film.read(folder / of["film"]).rgba[..., :3] for of in (whole, one)]
        uris = re.findall(r'src="([^"]+)"', block)
        for film, uri in zip(films, uris[:2], strict=True):
            assert np.abs(linear_to_srgb(decode(uri)) - linear_to_srgb(film)).max() < 0.51 / 255
        changed = np.sqrt(np.mean((films[1].astype(float) - films[0]) ** 2, axis=2))
        shown = decode(uris[2])
        assert np.abs(linear_to_srgb(shown) - linear_to_srgb(false_colour(changed))).max() < 0.01
        assert (changed > 0).any() == (one["effect"] == "motion")  # closed cubes hide their backs


def decode(uri):
    import base64

    return decode_image(base64.b64decode(uri.partition(",")[2]), "picture")[..., :3]


def test_a_study_that_was_stopped_has_a_report_that_says_so(tmp_path, monkeypatch):
    def stopped(self, part):
        if part == "samples-published":
            raise KeyboardInterrupt
        measure(self, part)

    measure = module._Run.measure
    monkeypatch.setattr(module._Run, "measure", stopped)
    with pytest.raises(KeyboardInterrupt):
        small_study(tmp_path)
    page = write_report(tmp_path).read_text(encoding="utf-8")
    assert "stopped before its end" in page
    assert Parser(page).open == []
    assert list(read_study(tmp_path)["sweeps"]) == list(SWEEPS[:2])


def test_a_report_without_any_row_can_be_written(tmp_path):
    camera = mb.Camera(position=(0, 0, 9), look_at=(0, 0, 0), f_stop=2.0, focus_distance=9.0)
    from dataclasses import replace

    from mbinterval.bench.cases import make_case
    from mbinterval.study.judge import Truth
    from mbinterval.study.run import study

    case = make_case("fast_cubes:5", width=16, height=12)
    lens = replace(case, scene=replace(case.scene, camera=camera))
    study(lens, Truth([]), sweeps=["limit"], costs=False, rounds=1, folder=tmp_path)
    page = write_report(tmp_path).read_text(encoding="utf-8")
    assert Parser(page).open == []
    assert "lens" in page


@pytest.mark.parametrize("text", [None, "", "{}", '{"format": 0}'])
def test_a_folder_without_a_study_is_an_error(tmp_path, text):
    if text is not None:
        (tmp_path / "study.json").write_text(text)
    with pytest.raises(mb.UsageError, match="not a study"):
        write_report(tmp_path)


def test_the_worst_crop_is_where_errors_are():
    errors = np.zeros((300, 400), np.float32)
    errors[200:210, 300:310] = 1.0
    rows, columns = worst_crop([errors, np.full_like(errors, 0.001)])
    assert (rows.stop - rows.start, columns.stop - columns.start) == CROP[::-1]
    assert rows.start <= 200 < 210 <= rows.stop
    assert columns.start <= 300 < 310 <= columns.stop
    small = worst_crop([np.ones((10, 20), np.float32)])
    assert small == (slice(0, 10), slice(0, 20))


def test_png_data_is_the_picture():
    colour = np.random.default_rng(0).random((5, 7, 3)).astype(np.float32)
    assert np.abs(linear_to_srgb(decode(data_uri(colour))) - linear_to_srgb(colour)).max() < 0.002


def places(svg):
    return [tuple(map(float, pair.split(","))) for line in re.findall(r'points="(.*?)"', svg)
            for pair in line.split()]  # fmt: skip


def test_plots_are_to_scale():
    points = [Point(1.0, 1e-3), Point(10.0, 1e-2), Point(100.0, 1e-1), Point(0.0, 1.0)]
    log = places(plot([Series("a <b>", points)], Axis("x"), Axis("y")))
    assert len(log) == 3  # zero has no place on a logarithmic axis
    steps = np.diff(log, axis=0)
    assert np.allclose(steps[0], steps[1], atol=0.02)
    assert steps[0][0] > 0 > steps[0][1]
    straight = plot([Series("a", points)], Axis("x", log=False), Axis("y", log=False))
    at = dict(zip([p.x for p in points], places(straight), strict=True))
    assert (at[100][0] - at[10][0]) / (at[10][0] - at[1][0]) == pytest.approx(10, rel=0.01)
    assert "a &lt;b&gt;" in plot([Series("a <b>", points)], Axis("x"), Axis("y"))
    assert "Nothing was measured" in plot([Series("a", points[3:])], Axis("x"), Axis("y"))


def test_bars_are_as_long_as_their_parts():
    svg = bars({"one": {"a": 1.0, "b": 3.0}, "two": {"b": 1.0}}, "s")
    widths = [float(w) for w in re.findall(r'width="([\d.]+)" height="17"', svg)]
    assert widths[1] == pytest.approx(3 * widths[0], rel=0.001)
    assert widths[2] == pytest.approx(widths[0], rel=0.001)


def test_tables_escape_what_they_say_and_tell_figures_apart():
    text = table(("a",), [("<b>",), ("1.5",), ("5%",), ("",)], "c & d")
    assert "&lt;b&gt;" in text
    assert "c &amp; d" in text
    assert text.count('class="number"') == 2
