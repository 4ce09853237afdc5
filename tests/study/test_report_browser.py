"""The report in a real browser: pictures, slider, zoom, keyboard, plots, tables; no network."""

from __future__ import annotations

import io
import json
import re
import shutil

import numpy as np
import pytest
from PIL import Image
from support.films import make_film
from support.studies import small_study

from mbinterval.study.report import write_report

pytestmark = pytest.mark.browser

WIDTH, HEIGHT = 48, 36


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """A study of a small scene, in which two pictures are made to tell places apart."""
    folder = tmp_path_factory.mktemp("report")
    result = small_study(folder)
    text = write_report(folder).read_text(encoding="utf-8")
    pictures = json.loads(re.search(r'id="data">(.*?)</script>', text, re.S)[1])
    names = [picture["name"] for picture in pictures[2:4]]
    rows = {row["name"]: row for sweep in result["sweeps"].values() for row in sweep["rows"]}
    for name, colour in zip(names, [(1, 0, 0), (0, 0, 1)], strict=True):
        rgba = np.ones((HEIGHT, WIDTH, 4), np.float32)
        rgba[..., :3] = colour
        rgba[: HEIGHT // 2, : WIDTH // 2, 1] = 1.0  # green in the upper left quarter
        shape = {"depth": np.ones((HEIGHT, WIDTH)), "intervals": np.zeros((HEIGHT, WIDTH))}
        film = make_film(rgba=rgba, resolution=(WIDTH, HEIGHT), **shape)
        film.write(folder / rows[name]["film"])
    return write_report(folder), names


@pytest.fixture
def page(report):
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    driver = shutil.which("chromedriver")
    assert chromium, "these tests need chromium and its driver: apt-get install chromium-driver"
    assert driver, "these tests need chromium's driver: apt-get install chromium-driver"
    options.binary_location = chromium
    for argument in ("--headless=new", "--no-sandbox", "--disable-gpu", "--window-size=1300,1000"):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    browser = webdriver.Chrome(options, webdriver.ChromeService(driver))
    try:
        browser.get(report[0].as_uri())
        yield browser
        assert browser.get_log("browser") == []
    finally:
        browser.quit()


def script(page, text, *arguments):
    return page.execute_script(text, *arguments)


def find(page, selector):
    return page.find_element("css selector", selector)


def press(page, selector, keys):
    find(page, selector).send_keys(keys)


def choose(page, side, name):
    text = """const select = document.getElementById(arguments[0]);
        select.selectedIndex = [...select.options].findIndex((o) => o.text === arguments[1]);
        select.dispatchEvent(new Event("change"));"""
    script(page, text, side, name)


def seen(page, selector="#slider"):
    """Pixels of an element, ``(h, w, 3)``, as the screen has them."""
    png = find(page, selector).screenshot_as_png
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"), int)


def at(pixels, x, y):
    return tuple(pixels[int(y * len(pixels)), int(x * pixels.shape[1])] > 127)


RED, BLUE, YELLOW, CYAN = (True, False, False), (False, False, True), (True, True, False), (
    False, True, True)  # fmt: skip


def test_it_needs_no_network_and_every_picture_is_there(page):
    requested = [
        message["params"]["request"]["url"]
        for entry in page.get_log("performance")
        if (message := json.loads(entry["message"])["message"])["method"]
        == "Network.requestWillBeSent"
    ]
    assert requested
    assert all(url.startswith(("file:", "data:")) for url in requested)
    images = "return [...document.images].filter((i) => i.src).map((i) => i.naturalWidth)"
    widths = script(page, images)
    assert len(widths) > 10
    assert all(widths)


def test_the_slider_divides_any_two_pictures(page, report):
    red, blue = report[1]
    choose(page, "left", red)
    choose(page, "right", blue)
    pixels = seen(page)
    assert (at(pixels, 0.4, 0.8), at(pixels, 0.6, 0.8)) == (RED, BLUE)
    assert (at(pixels, 0.3, 0.2), at(pixels, 0.1, 0.2)) == (YELLOW, YELLOW)
    press(page, "#split", "\ue012" * 25)  # arrow left: the slider is at 25
    pixels = seen(page)
    assert (at(pixels, 0.2, 0.8), at(pixels, 0.3, 0.8)) == (RED, BLUE)
    assert (at(pixels, 0.2, 0.2), at(pixels, 0.3, 0.2)) == (YELLOW, CYAN)
    assert red in find(page, "#told").text
    assert blue in find(page, "#told").text
    choose(page, "right", red)
    assert at(seen(page), 0.9, 0.8) == RED


def test_zoom_is_linked_and_keeps_what_is_under_the_middle(page, report):
    red, blue = report[1]
    choose(page, "left", red)
    choose(page, "right", blue)
    press(page, "figure:nth-child(2) .view", "+")
    assert find(page, "#zoom").text == "2x"
    transforms = "return [...document.querySelectorAll('.view img')].map((i) => i.style.transform)"
    assert len(set(script(page, transforms))) == 1
    assert "scale(2)" in script(page, transforms)[0]
    pixels = seen(page)  # the middle half of the picture: its quarter is as large as before
    assert (at(pixels, 0.4, 0.4), at(pixels, 0.4, 0.6)) == (YELLOW, RED)
    assert (at(pixels, 0.6, 0.4), at(pixels, 0.6, 0.6)) == (BLUE, BLUE)
    press(page, "#slider", "\ue012" * 10 + "\ue013" * 10)  # left and up, to the corner
    pixels = seen(page)
    assert (at(pixels, 0.4, 0.9), at(pixels, 0.6, 0.9)) == (YELLOW, CYAN)
    press(page, "#slider", "0")
    assert find(page, "#zoom").text == "1x"


def test_the_keyboard_is_enough(page, report):
    red, blue = report[1]
    choose(page, "left", red)
    choose(page, "right", blue)
    press(page, "#slider", "]" * 8)
    assert find(page, "#split").get_attribute("value") == "90"
    press(page, "#slider", "<")
    assert script(page, "return document.getElementById('right').selectedOptions[0].text") != blue
    press(page, "#slider", ">")
    assert at(seen(page), 0.95, 0.8) == BLUE
    page.refresh()
    reached = set()
    find(page, "body").send_keys("\ue004")
    for _ in range(120):
        element = page.switch_to.active_element
        reached.add(element.get_attribute("id") or element.get_attribute("class"))
        element.send_keys("\ue004")
    assert {"left", "right", "split", "in", "out", "reset", "slider", "view", "sort"} <= reached


def test_names_in_a_legend_hide_their_lines(page):
    entry = "#plots .plot .legend"
    name = find(page, entry).get_attribute("data-series")
    shown = """return [...document.querySelectorAll('#plots .plot:first-of-type .series')].filter(
        (s) => s.dataset.series === arguments[0] && s.getBoundingClientRect().width).length"""
    assert script(page, shown, name) > 0
    press(page, entry, "\ue007")
    assert script(page, shown, name) == 0
    find(page, entry).click()
    assert script(page, shown, name) > 0


def test_tables_sort_by_value(page):
    cells = (
        "return [...document.querySelectorAll('#rows tbody tr')].map((r) => r.cells[2].innerText)"
    )
    find(page, "#rows th:nth-child(3) button").click()
    rising = [float(text) for text in script(page, cells) if text]
    assert rising == sorted(rising)
    assert len(set(rising)) > 3
    find(page, "#rows th:nth-child(3) button").click()
    assert [float(text) for text in script(page, cells) if text] == rising[::-1]
    assert find(page, "#rows th:nth-child(3)").get_attribute("aria-sort") == "descending"


def test_tables_are_copied_with_tabs(page):
    find(page, "#machine .copy").click()
    script(page, "document.body.prepend(document.createElement('textarea'))")
    from selenium.webdriver.support.wait import WebDriverWait

    WebDriverWait(page, 5).until(lambda page: find(page, "#said").text == "Copied")
    press(page, "textarea", "\ue009v")  # Ctrl+V
    pasted = find(page, "textarea").get_attribute("value")
    lines = [line.split("\t") for line in pasted.strip().splitlines()]
    assert ["machine", "cores"] in [line[:2] for line in lines]


def test_a_narrow_window_needs_no_sideways_scrolling(page):
    page.set_window_size(500, 800)
    sizes = "return [document.documentElement.scrollWidth, document.documentElement.clientWidth]"
    wide, window = script(page, sizes)
    assert wide <= window
