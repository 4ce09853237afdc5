"""What the papers on point samples claim, redone: writes ``tests/reports/point-sampling.md``.

    python tests/reports/culling_tables.py [--quick] [--output FILE.md] [--picture FILE.png]

Measures at 960 x 540 (--quick: 240 x 135), some ten minutes on two cores, and sets the papers' own
figures beside what it finds: ``culling_laine.py``, ``culling_wu.py``, ``culling_akenine.py`` and
``culling_quality.py`` have a part each. The scenes are in ``culling_scenes.py``, the papers'
figures in ``culling_papers.py``.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import culling_akenine
import culling_laine
import culling_quality
import culling_wu
from culling_measure import SIZE
from culling_scenes import SCENES, variant

HEAD = """# Point samples: what the papers claim

Made by `python tests/reports/culling_tables.py`, {width} x {height}. The papers' scenes are not to
be had; in their place stand a *city* of boxes, {city:,} triangles of some tens of pixels, under a
moving camera, and a *crowd* of finely tessellated spheres, {crowd:,} triangles below a pixel, that
fly. "x2" doubles the way, or the lens. L11 is Laine et al. 2011, W15 Wu et al. 2015, AM07
Akenine-Möller et al. 2007.
"""


def document(picture: Path | None) -> Iterator[str]:
    counts = {name: sum(len(m.faces) for m in variant(name, "none").meshes) for name in SCENES}
    yield HEAD.format(width=SIZE[0], height=SIZE[1], **counts)
    yield from culling_laine.sections()
    yield from culling_wu.sections()
    yield from culling_akenine.sections()
    yield from culling_quality.sections(picture)
    yield "## The claims, one by one"
    yield ""
    for part in (culling_laine, culling_quality, culling_wu, culling_akenine):
        yield from part.claims()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="240 x 135 pixels")
    parser.add_argument("--output", type=Path)
    parser.add_argument("--picture", type=Path)
    arguments = parser.parse_args()
    if arguments.quick:
        SIZE[:] = 240, 135
    lines = []
    for line in document(arguments.picture):
        print(line, flush=True)
        lines.append(line)
    if arguments.output:
        arguments.output.write_text("\n".join(lines).rstrip() + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
