"""How mbinterval hangs together: ``python tests/reports/packages.py``.

Prints the numbers of packages and modules, of imports between packages, of imports against the
order, of circles, and of imports of the package's face; then what each package imports.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from support.import_graph import (
    FACE,
    ORDER,
    against_order,
    circles,
    module_imports,
    package_imports,
)


def main() -> None:
    modules = module_imports()
    packages = package_imports(modules)
    faced = [name for name, others in modules.items() if FACE in others]
    figures = {
        "packages": len(packages),
        "modules": len(modules),
        "imports between packages": sum(map(len, packages.values())),
        "imports against the order": len(against_order(packages)),
        "circles of packages": len(circles(packages)),
        "circles of modules": len(circles(modules)),
        "imports of the face": len(faced),
    }
    for what, count in figures.items():
        print(f"{count:5} {what}")
    for name in ORDER:
        print(f"\n{name}: {', '.join(sorted(packages[name], key=ORDER.index)) or 'nothing'}")
    for name, other in against_order(packages):
        print(f"\nagainst the order: {name} imports {other}")
    for circle in [*circles(packages), *circles(modules)]:
        print(f"\na circle: {', '.join(circle)}")


if __name__ == "__main__":
    main()
