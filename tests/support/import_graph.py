"""Which module of mbinterval imports which, and the order that its packages have.

Every import counts: those in functions, and those for types alone. What is imported from the
package's own face, ``mbinterval`` itself, is an import of it.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable, Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2] / "mbinterval"

ORDER = (
    *("errors", "version", "values", "device", "files", "film", "settings"),
    *("scene", "scene.formats.meshes", "scene.formats.gltf", "scene.formats.usd"),
    *("scene.formats.toml", "scene.formats", "exposure", "layout", "plan", "rendering"),
    *("comparison", "batch", "bench", "study", "cli", "__main__"),
)
"""Packages, and modules that are in none: each may import those before it."""

FACE = ""
"""The package itself, ``mbinterval/__init__.py``."""

Imports = Mapping[str, frozenset[str]]


def module_names(root: Path = ROOT) -> dict[str, Path]:
    """Files of all modules by name below the package; a package is the name of its ``__init__``."""
    found = {}
    for path in sorted(root.rglob("*.py")):
        parts = path.relative_to(root).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imports_of(source: str, known: Iterable[str]) -> frozenset[str]:
    """Names of the modules that a ``source`` imports; ``known`` are those that there are.

    A relative import is a ``ValueError``.
    """
    known, found = set(known), set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            if node.level:
                raise ValueError(f"line {node.lineno}: a relative import")
            below = [f"{node.module}.{alias.name}" for alias in node.names]
            names = [name if _below(name) in known else str(node.module) for name in below]
        else:
            continue
        found |= {_below(name) for name in names if (f"{name}.").startswith("mbinterval.")}
    return frozenset(found)


def _below(name: str) -> str:
    return name.removeprefix("mbinterval").removeprefix(".")


def module_imports(root: Path = ROOT) -> Imports:
    """Return what each module imports, but for the face, which is to import everything."""
    known = module_names(root)
    return {
        name: imports_of(path.read_text(encoding="utf-8"), known) - {name}
        for name, path in known.items()
        if name != FACE
    }


def package_of(name: str, root: Path = ROOT) -> str:
    """Return the package that a module is in; of one that is in none, and of a package, itself."""
    is_package = root.joinpath(*name.split("."), "__init__.py").exists()
    return name if is_package or "." not in name else name.rpartition(".")[0]


def package_imports(imports: Imports, root: Path = ROOT) -> Imports:
    """Return what each package imports of others."""
    found: dict[str, set[str]] = {}
    for name, others in imports.items():
        own = package_of(name, root)
        found.setdefault(own, set()).update(package_of(other, root) for other in others)
    return {name: frozenset(others - {name}) for name, others in found.items()}


def circles(imports: Imports) -> list[tuple[str, ...]]:
    """Return the sets of those that import each other, by way of others too (Tarjan 1972)."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[tuple[str, ...]] = []

    def visit(name: str) -> None:
        index[name] = low[name] = len(index)
        stack.append(name)
        for other in sorted(imports.get(name, ())):
            if other not in index:
                visit(other)
            if other in stack:
                low[name] = min(low[name], low[other])
        if low[name] == index[name]:
            place = stack.index(name)
            if len(stack) - place > 1:
                found.append(tuple(sorted(stack[place:])))
            del stack[place:]

    for name in sorted(imports):
        if name not in index:
            visit(name)
    return found


def against_order(packages: Imports) -> list[tuple[str, str]]:
    """Return the imports of packages that come later in `ORDER`, importer first."""
    place = {name: number for number, name in enumerate(ORDER)}
    return [
        (name, other)
        for name, others in packages.items()
        for other in sorted(others)
        if place.get(other, -1) > place[name]
    ]
