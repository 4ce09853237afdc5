"""Packages have an order, that of the data: none imports what comes after it."""

from __future__ import annotations

import pytest
from import_graph import (
    FACE,
    ORDER,
    against_order,
    circles,
    imports_of,
    module_imports,
    module_names,
    package_imports,
)

MODULES = module_imports()
PACKAGES = package_imports(MODULES)


def test_every_package_has_its_place_in_the_order():
    assert set(PACKAGES) == set(ORDER)


def test_no_package_imports_what_comes_after_it():
    assert against_order(PACKAGES) == []


def test_packages_and_modules_import_each_other_in_no_circle():
    assert circles(PACKAGES) == []
    assert circles(MODULES) == []


def test_no_module_imports_the_face_of_the_package():
    assert [name for name, others in MODULES.items() if FACE in others] == []


def test_the_device_knows_nothing_of_films():
    assert PACKAGES["device"] <= {"errors", "values"}


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ("import mbinterval", {FACE}),
        ("from mbinterval import Film, errors", {FACE, "errors"}),
        ("import mbinterval.film.film as film", {"film.film"}),
        ("def late():\n    from mbinterval.film import aovs", {"film.aovs"}),
        ("if TYPE_CHECKING:\n    from mbinterval.film.film import Film", {"film.film"}),
        ("import numpy\nfrom mbintervals import film", set()),
    ],
)
def test_imports_are_found_wherever_they_are(source, found):
    assert imports_of(source, module_names()) == found


def test_circles_and_imports_against_the_order_are_found():
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"a", "d"}, "d": set()}) == [("a", "b", "c")]
    assert circles({"a": {"b"}, "b": {"c"}, "c": set()}) == []
    assert against_order({"film": {"errors", "plan"}, "errors": set()}) == [("film", "plan")]
