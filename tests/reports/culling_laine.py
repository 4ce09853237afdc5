"""Sample test efficiency and operations: Laine et al. 2011, section 4."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from culling_measure import changes, measured, operations_of, said, table, verdict
from culling_papers import L11, L11_TILES, L11_UVT
from culling_scenes import ROWS, SCENES

SAMPLE_TEST = {False: 25, True: 34}
OTHERS = {"city": ("CONAN", "ASSASSIN"), "crowd": ("CARS",)}


def sections() -> Iterator[str]:
    yield from efficiency()
    yield from operation_counts()


def beside(found: float, theirs: Sequence[float]) -> str:
    return f"{found:.2f} ({', '.join(f'{value:g}' for value in theirs)})"


def efficiency() -> Iterator[str]:
    yield "## Sample test efficiency, as in table 1 of Laine et al. 2011"
    yield ""
    yield (
        "Hits over tests in percent; in brackets theirs, CONAN and ASSASSIN beside the city, CARS "
        "beside the crowd. No depth culling. `pixar` has the strata of their section 4 for 4, 16 "
        "and 64 samples; `bbox`, `dual_space` and `interleave_uvt` 16 samples. For "
        "`interleave_uvt` they give one figure for the games and one for CARS."
    )
    yield ""
    columns = [("bbox", 16), ("pixar", 4), ("pixar", 16), ("pixar", 64), ("dual_space", 16)]
    rows = []
    for name, others in OTHERS.items():
        for row in ROWS:
            cells = [
                beside(measured(name, row, cull, n).ste, [L11[o][row][i] for o in others])
                for i, (cull, n) in enumerate(columns)
            ]
            cells.append(beside(measured(name, row, "interleave_uvt").ste, [L11_UVT[name]]))
            rows.append([f"{name}, {row}", *cells])
    heads = ["bbox", "pixar 4", "pixar 16", "pixar 64", "dual_space", "interleave_uvt"]
    yield from table(["scene", *heads], rows)


def operations(name: str, row: str, cull: str, tile: int = 1) -> float:
    """Millions at 16 samples, as they count: each primitive is set up once for each stratum."""
    of, cost = measured(name, row, cull, 16, tile), operations_of(cull)
    lens = "defocus" in row or "both" in row
    interleaved = cull == "interleave_uvt"
    strata = 64 if interleaved else 16
    setup = cost.get("path", (0, 0))[lens] + strata * cost.get("stratum", (0, 0))[lens]
    tiles = of.stats["bounded"] / (4 if interleaved else tile**2) * (strata if interleaved else 1)
    work = of.triangles * setup + tiles * cost["tile"][lens]
    return (work + of.stats["tests"] * SAMPLE_TEST[lens]) / 1e6


def setups(samples: int) -> dict[str, tuple[int, int]]:
    """Operations to set up a triangle, without a lens and with one, by method."""
    of = {cull: operations_of(cull) for cull in ("dual_space", "pixar", "interleave_uvt")}
    times = {"dual_space": 1, "pixar": samples, "interleave_uvt": 4 * samples}
    each = {cull: cost.get("path") or cost["stratum"] for cull, cost in of.items()}
    return {cull: (times[cull] * a, times[cull] * b) for cull, (a, b) in each.items()}


def operation_counts() -> Iterator[str]:
    yield "## Operations, and tiles of 2 x 2 pixels (Laine et al. 2011, 4.1)"
    yield ""
    dual, pixar, uvt = (operations_of(cull) for cull in ("dual_space", "pixar", "interleave_uvt"))
    yield (
        "Counts of the statistics times what each culling file states for one execution, millions, "
        "16 samples: set-up of each triangle, for each stratum with `pixar` and `interleave_uvt`; "
        "bounds of each tile of pixels in the triangle's box; and "
        f"{SAMPLE_TEST[False]} operations for each sample test ({SAMPLE_TEST[True]} with a lens; "
        "they say about 25). Comparing samples with bounds is free, as they assume. Theirs for one "
        "triangle: set-up 500 (ours {}, with a lens {:,}), tile 40 ({}, {}), ".format(
            *dual["path"], *dual["tile"]
        )
        + "`pixar` 100 for each stratum ({}, {}), `interleave_uvt` 50 ({}, {}). ".format(
            *pixar["stratum"], *uvt["stratum"]
        )
        + "Ours have the slack that makes bounds hold in float32, and behind the eye. The renderer "
        "itself sets up anew in each 16 x 16 pixels, which is not counted. In brackets their range."
    )
    yield ""
    rows = []
    for name in SCENES:
        for row in ROWS[1:]:
            one, two = (operations(name, row, "dual_space", n) for n in (1, 2))
            before, after = (measured(name, row, "dual_space", 16, n).ste for n in (1, 2))
            cells = [operations(name, row, c) for c in ("bbox", "pixar", "interleave_uvt")]
            cells += [operations(name, row, "clip_space"), one, two]
            lower = {what: "-{} to -{}".format(*L11_TILES[name][what]) for what in L11_TILES[name]}
            rows.append(
                [
                    f"{name}, {row}",
                    *(f"{cell:,.0f}" for cell in cells),
                    f"{100 * (two / one - 1):+.0f} % ({lower['operations']})",
                    f"{100 * (after / before - 1):+.0f} % ({lower['ste']})",
                ]
            )
    heads = ["bbox", "pixar", "interleave_uvt", "clip_space", "dual_space", "dual_space 2 x 2"]
    yield from table(["scene", *heads, "2 x 2: operations", "2 x 2: STE"], rows)


def published(column: int, effect: str) -> str:
    """How their STE changes when an effect is doubled: CONAN, ASSASSIN and CARS."""
    found = [of[f"{effect} x2"][column] / of[effect][column] - 1.0 for of in L11.values()]
    return ", ".join(f"{100.0 * change:+.0f}" for change in found) + " %"


def claims() -> Iterator[str]:
    yield from efficiency_claims()
    yield from operation_claims()


def efficiency_claims() -> Iterator[str]:
    one = [*changes("dual_space", "motion"), *changes("dual_space", "defocus")]
    yield (
        "- *L11: STE is practically immune to motion or defocus alone.* "
        f"{verdict(max(map(abs, one)) < 5.0)}: doubling motion changes it by {said(one[:2])}, "
        f"doubling defocus by {said(one[2:])}; theirs by {published(4, 'motion')} (motion) and "
        f"{published(4, 'defocus')} (defocus)."
    )
    both = changes("dual_space", "both")
    yield (
        f"- *L11: with both effects it falls.* {verdict(max(both) < -5.0)}: by {said(both)} when "
        f"both double; theirs by {published(4, 'both')}."
    )
    for cull, column in (("bbox", 0), ("pixar", 2)):
        falls = {effect: changes(cull, effect) for effect in ("motion", "defocus")}
        other = {effect: published(column, effect) for effect in falls}
        yield (
            f"- *L11: that of `{cull}` falls significantly.* "
            f"{'Confirmed' if max(map(max, falls.values())) < -5.0 else 'In part'}: by "
            f"{said(falls['motion'])} when motion doubles, theirs by {other['motion']}; by "
            f"{said(falls['defocus'])} when defocus does, theirs by {other['defocus']}."
        )
    gain = [measured("crowd", "defocus x2", c).ste for c in ("dual_space", "bbox", "pixar")]
    rest = measured("crowd", "none", "bbox").ste / gain[1]
    theirs = L11["CARS"]["none"][0] / L11["CARS"]["defocus x2"][0]
    yield (
        "- *L11: in small triangles out of focus, 160 times `bbox` and 15 times `pixar` at 16 "
        f"samples.* In kind, not in size: {gain[0] / gain[1]:.0f} and {gain[0] / gain[2]:.1f} "
        f"times on the crowd, where `bbox` falls by a factor of {rest:.0f} from rest to double "
        f"defocus, in CARS of {theirs:.0f}."
    )
    uvt = [[measured(n, row, "interleave_uvt").ste for row in ROWS] for n in SCENES]
    spread = [100.0 * (max(v) / min(v) - 1.0) for v in uvt]
    yield (
        "- *L11: STE of InterleaveUVT does not depend on motion or defocus, and is lower for "
        f"small triangles.* {verdict(max(spread) < 15.0 and uvt[1][0] < uvt[0][0])}: greatest over "
        f"least {said(spread)}; {uvt[0][0]:.0f} % in the city (theirs 21 in games), "
        f"{uvt[1][0]:.1f} % in the crowd (3.8 in CARS)."
    )


def operation_claims() -> Iterator[str]:
    for samples, theirs, words in (
        (16, "500 against 1,600 and 3,200", "far less than those of all strata"),
        (4, "500, 400 and 800", "about as much"),
    ):
        for lens, with_lens in ((False, "without a lens"), (True, "with one")):
            own, *rest = (cost[lens] for cost in setups(samples).values())
            far = samples == 16
            holds = own < 0.5 * min(rest) if far else max(own, *rest) <= 2.0 * min(own, *rest)
            yield (
                f"- *L11: at {samples} samples the one set-up of a triangle costs {words} "
                f"({theirs}), {with_lens}.* {verdict(holds)}: {own:,} against {rest[0]:,} of "
                f"`pixar` and {rest[1]:,} of `interleave_uvt`."
            )
    sizes = [(n, row) for n in SCENES for row in ROWS[1:]]
    saved = [
        100.0 * (operations(n, r, "dual_space", 2) / operations(n, r, "dual_space", 1) - 1.0)
        for n, r in sizes
    ]
    yield (
        "- *L11: tiles of 2 x 2 pixels cost STE and save operations in every scene.* "
        f"{verdict(max(saved) < 0.0)}: they change the count by {min(saved):+.0f} to "
        f"{max(saved):+.0f} %; theirs by -54 to -5 % in the games, -57 to -26 % in CARS."
    )
