"""Packages have an order, that of the data: none imports what comes after it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from support.import_graph import (
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


def test_what_is_imported_is_there():
    assert set().union(*MODULES.values()) <= set(module_names())


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


@pytest.mark.parametrize(
    "source", ["from . import film", "def late():\n    from ..film import aovs"]
)
def test_relative_imports_are_refused(source):
    with pytest.raises(ValueError, match="a relative import"):
        imports_of(source, module_names())


def imports_tests(source: str) -> bool:
    """Whether a test's source, or a program in it, takes something from another test."""
    return re.search(r"^\W*(from|import) test_", source, re.MULTILINE) is not None


def test_what_tests_share_is_in_support_and_not_in_other_tests():
    tests = [*Path(__file__).parents[1].rglob("*.py")]
    assert len(tests) > 100
    assert [path.name for path in tests if imports_tests(path.read_text(encoding="utf-8"))] == []
    assert imports_tests("import numpy\nfrom test_plan import mesh\n")
    assert imports_tests('CODE = """\n    import test_plan\n"""')


def test_circles_and_imports_against_the_order_are_found():
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"a", "d"}, "d": set()}) == [("a", "b", "c")]
    assert circles({"a": {"b"}, "b": {"c"}, "c": set()}) == []
    assert against_order({"film": {"errors", "plan"}, "errors": set()}) == [("film", "plan")]
