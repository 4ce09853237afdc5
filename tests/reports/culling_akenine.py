"""Depth culling and texture bandwidth: Akenine-Möller et al. 2007, 3.4 and 4.4."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np
from culling_measure import SIZE, render, table, verdict
from culling_papers import AM07
from culling_scenes import SCENES, disc, floor, slices_of, variant

from mbinterval.scene.generators import fast_cubes

LINE_BYTES = 64
WAYS = (1.0, 0.5, 0.25, 0.125)
DISC_TEXTURES = (512, 1024, 2048)
TILE = 8


def sections() -> Iterator[str]:
    yield from depth_culling()
    yield from texels()


def depth_culling() -> Iterator[str]:
    yield "## Zmin and Zmax, as in Akenine-Möller et al. 2007, 3.4"
    yield ""
    yield (
        "Tests that Zmax leaves out, and comparisons of depth that Zmin does, in percent of those "
        "without; 16 samples, tiles of 16 x 16 pixels, paths from near to far (Zmin has the more "
        "to do the less they are sorted). The paper has no figures."
    )
    yield ""
    scenes = {name: variant(name, "motion") for name in SCENES} | {"1,000 fast cubes": fast_cubes()}
    shown = (("zmax", "tests"), ("zmax_strata", "tests"),
             ("zmin", "depth_tests"), ("zmin_strata", "depth_tests"))  # fmt: skip
    rows = []
    for name, of in scenes.items():
        counts = {
            cull: render(of, cull=cull, samples=16, statistics=True).stats
            for cull in ("bbox", *(cull for cull, _ in shown))
        }
        saved = [100.0 * (1.0 - counts[cull][what] / counts["bbox"][what]) for cull, what in shown]
        rows.append([name, *(f"{percent:.1f}" for percent in saved)])
    heads = ["zmax: tests", "zmax_strata: tests", "zmin: depths", "zmin_strata: depths"]
    yield from table(["scene", *heads], rows)


@cache
def megabytes(name: str, size: int, way: float = 1.0) -> tuple[float, float]:
    """Fetched by four samples per pixel, and by four pictures at rest."""
    moves = name == "disc"
    of, pattern = (disc(size, way), "rgss") if moves else (floor(size), "sobol")
    sampled = render(of, samples=4, pattern=pattern, statistics=True).stats["texel_lines"]
    alone = {"method": "accumulation", "slices": 1, "samples": 1, "pattern": "fixed"}
    at_rest = [
        render(each, statistics=True, **alone).stats["texel_lines"]
        for each in slices_of(name, size, way)
    ]
    return sampled * LINE_BYTES / 1e6, sum(at_rest) * LINE_BYTES / 1e6


def fetched(found: tuple[float, float], form: str = ".1f") -> str:
    return f"{found[0] / found[1]:.2f} ({found[0]:{form}} / {found[1]:{form}})"


def pixels(way: float) -> float:
    """How far the disc's middle moves."""
    return 0.3 * SIZE[1] * way


def texels() -> Iterator[str]:
    yield "## Texture bandwidth, as in Akenine-Möller et al. 2007, 4.4"
    yield ""
    yield (
        "Four samples per pixel over an accumulation buffer of four passes: what a cache of 6 kB "
        "fetches for them (lines of 4 x 4 texels of 4 bytes; six lines in each of 16 sets; emptied "
        "before each tile of 16 x 16 pixels), and in brackets both in megabytes. A disc with a "
        "texture moves and turns, by the paper's pattern of samples (theirs: a wheel); a floor and "
        "a wall with textures are out of focus (theirs: Sponza). The paper says neither how large "
        "its pictures and textures are, nor how far its wheel moves, nor how its cache is "
        "organized."
    )
    yield ""
    rows = []
    for way in WAYS:
        cells = [fetched(megabytes("disc", size, way)) for size in DISC_TEXTURES]
        rows.append([f"disc, {pixels(way):.0f} pixels", *cells, fetched(AM07["disc"], ".0f")])
    cells = [fetched(megabytes("floor", size)) for size in DISC_TEXTURES]
    rows.append(["floor", *cells, fetched(AM07["floor"], ".0f")])
    heads = [f"texture of {size} x {size}" for size in DISC_TEXTURES]
    yield from table(["scene", *heads, "theirs"], rows)


def planes_fail() -> tuple[int, int, float]:
    """How often the bound from planes decides, how often it fails, and by how much at most.

    Random triangles before the eye, of one orientation all the time, moving linearly in homogeneous
    pixel space across a tile of 8 x 8 pixels; their least depth there is that of 33 times at 17 x
    17 places, in double precision, so that failures may be missed and none is made up.
    """
    rng, times = np.random.default_rng(1), np.linspace(0, 1, 33)
    corners = np.array([[0, 0], [TILE, 0], [0, TILE], [TILE, TILE]], float)
    grid = np.linspace(0, TILE, 17)
    places = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)
    matter, fail, most = 0, 0, 0.0
    for _ in range(3000):
        w = rng.uniform(0.5, 4.0, (2, 3))
        xy = rng.uniform(-20, 28, (2, 3, 2))
        ends = np.concatenate([xy * w[..., None], w[..., None]], axis=-1)
        planes = [np.linalg.solve(end, np.ones(3)) for end in ends]  # 1/w = plane . (x, y, 1)
        turned = np.linalg.det(ends[0] + times[:, None, None] * (ends[1] - ends[0]))
        inverse = [corners @ plane[:2] + plane[2] for plane in planes]
        if turned.min() * turned.max() <= 0.0 or np.min(inverse) <= 0.0:
            continue
        bound = 1.0 / np.max(inverse)
        if bound <= w.min():
            continue
        least = min(least_depth_at(ends, t, places) for t in times)
        if np.isfinite(least):
            matter += 1
            fail += least < bound * (1.0 - 1e-9)
            most = max(most, 1.0 - least / bound)
    return matter, fail, 100.0 * most


def least_depth_at(ends: np.ndarray, t: float, places: np.ndarray) -> float:
    """Least depth of the triangle at places that it covers at one time; infinity if none."""
    p = ends[0] + t * (ends[1] - ends[0])
    moved = p[:, None, :2] - places[None] * p[:, None, 2:]
    x, y = moved[..., 0], moved[..., 1]
    edges = np.stack(
        [x[i] * y[j] - x[j] * y[i] for i, j in ((1, 2), (2, 0), (0, 1))]
    )  # opposite to vertices 0, 1, 2
    inside = (edges > 0).all(axis=0) | (edges < 0).all(axis=0)
    if not inside.any():
        return float("inf")
    depth = (edges[:, inside] * p[:, 2:]).sum(axis=0) / edges[:, inside].sum(axis=0)
    return float(depth.min())


def claims() -> Iterator[str]:
    ratios = {way: np.divide(*megabytes("disc", DISC_TEXTURES[0], way)) for way in WAYS}
    below = [way for way in WAYS if ratios[way] < 1.0]
    theirs = AM07["disc"][0] / AM07["disc"][1]
    said = ", ".join(f"{ratios[way]:.2f} at {pixels(way):.0f} pixels" for way in WAYS)
    yield (
        "- *AM07: texture bandwidth is below that of an accumulation buffer, in motion.* "
        + (f"Confirmed up to {pixels(max(below)):.0f} pixels of motion; " if below else "")
        + ("not reproduced beyond: " if len(below) < len(WAYS) else "")
        + f"{said}, theirs {theirs:.2f}. The four samples of a pixel are spread over four parts of "
        "the way, so that the places of the texture that a tile of pixels asks for grow with the "
        "motion, until a cache of 96 lines holds them no longer; a pass at rest asks for one such "
        "part only. How far the paper's wheel moves is not said."
    )
    found = megabytes("floor", DISC_TEXTURES[0])
    others = [np.divide(*megabytes("floor", size)) for size in DISC_TEXTURES[1:]]
    yield (
        "- *AM07: texture bandwidth is below that of an accumulation buffer, out of focus.* "
        f"{verdict(found[0] < found[1])} where a pixel is about as large as a texel: "
        f"{found[0] / found[1]:.2f} of it, theirs {AM07['floor'][0] / AM07['floor'][1]:.2f}. With "
        f"finer textures it is {' and '.join(f'{ratio:.2f}' for ratio in others)}; there are no "
        "coarser levels of a texture here, where the paper may have had them."
    )
    matter, fail, most = planes_fail()
    yield (
        "- *AM07, 3.4: as long as a triangle keeps its orientation, the planes of its start and "
        f"its end bound its depth at a tile's corners.* {verdict(fail == 0)}: of {matter} random "
        f"moving triangles for which that bound is the greater of the two {fail} came nearer than "
        f"it, by up to {most:.0f} %. `zmax` has the vertices' bound."
    )
