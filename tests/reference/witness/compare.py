"""A case rendered, seen by the witness, and judged: what of both agrees."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from . import film as films
from . import moment as moments
from .ids import name_id
from .judge import Verdict, judge
from .product import PATH_ERROR, Film, colors
from .product import films as rendered
from .scenes import DEPTHS, SIZE, Case

LEVEL = 1e-7
"""Probability of equal expectations below which films are told apart: some hundred thousand
judgements are made in a night."""
ROUNDING = 1e-4
SPAN_DEPTH = 0.03
"""Of film.depth, which takes each span's in its middle (``test_witness_cases.py`` has it)."""


@dataclass(frozen=True, eq=False)
class Result:
    """Verdicts by name, and what of the layers of one moment is wrong, in words."""

    verdicts: dict[str, Verdict]
    wrong: tuple[str, ...] = ()

    @property
    def agrees(self) -> bool:
        return not self.wrong and all(v.p > LEVEL for v in self.verdicts.values())

    def __str__(self) -> str:
        lines = [f"{name}: {verdict}" for name, verdict in self.verdicts.items()]
        return "\n".join([*lines, *self.wrong])


def compare(case: Case, size: tuple[int, int] = SIZE, given: list[Film] | None = None) -> Result:
    """Render ``case`` (or take the films that are given) and compare it with the witness."""
    if given is None:
        given = rendered(case.scene, case.frame, size, case.repeats, **case.settings)
    seen = films.film(case.scene, case.frame, size, case.asked)
    alpha = np.stack([film.rgba[..., 3:] for film in given]).astype(float)
    depth = np.stack([film.depth for film in given]).astype(float)[..., None]
    depth = alpha * np.where(np.isfinite(depth), depth, 0.0)
    rare = 2.0 / (case.asked.strata * case.asked.repeats)
    allowed = case.allowed

    def verdicts_of(slack: np.ndarray | float) -> dict[str, Verdict]:
        color, cover, deep = np.split(slack * np.ones(5), [3, 4], axis=-1)
        return {
            "color": judge(colors(given)[..., :3], seen.rgba[..., :3], allowed + color, rare),
            "alpha": judge(alpha, seen.rgba[..., 3:], ROUNDING + cover, rare),
            "depth": judge(depth, seen.depth[..., None], SPAN_DEPTH + deep, 8.0 * rare),
        }

    verdicts = verdicts_of(0.0)
    if case.asked.centre and any(v.p <= LEVEL for v in verdicts.values()):
        verdicts = verdicts_of(_slack(case, size, seen))
    aovs = case.settings.get("aovs", ())
    wrong: list[str] = []
    if "sharp" in aovs:
        frozen = films.film(case.scene, case.frame, size, replace(case.asked, moment=0.5))
        sharp = np.stack([film.layers["sharp"] for film in given])
        verdicts["sharp"] = judge(sharp, frozen.rgba, allowed, rare)
    if "depth" in aovs:
        wrong += _moment(case, size, given[0])
    for name in ("crypto_object", "crypto_material"):
        if name in aovs:
            names = _names(case.scene, name)
            each = np.stack([_coverage(film.layers[name], names) for film in given])
            cover = np.stack(
                [seen.cover[..., [i for i, n in enumerate(names) if n == one]].sum(axis=-1)
                 for one in dict.fromkeys(names)], axis=-1)  # fmt: skip
            verdicts[name] = judge(each, cover, ROUNDING, rare)
    if "deep" in aovs:
        flat = np.stack([film.deep.flatten() for film in given])
        own = np.stack([film.rgba for film in given])
        if case.scene.environment is None and np.ndim(case.scene.background) == 1:
            own[..., :3] -= (1.0 - own[..., 3:]) * np.asarray(case.scene.background)
            if np.abs(flat - own).max() > 1e-5:
                wrong.append(f"deep: flattened it is off by {np.abs(flat - own).max():.1e}")
        below = np.stack([_below(film, DEPTHS) for film in given])
        # A sample is a hundredth of its depth thick, and tells nothing of within.
        near, far = seen.below[..., 0::2], seen.below[..., 1::2]
        slack = 0.01 + 0.5 * (far - near).mean(axis=0)
        verdicts["deep"] = judge(below, 0.5 * (near + far), slack, rare)
    return Result(verdicts, tuple(wrong))


def _slack(case: Case, size: tuple[int, int], seen: films.Repeats) -> np.ndarray:
    """What the film changes by, ``(H, W, 5)``, where all is `PATH_ERROR` pixels elsewhere.

    At the middles of pixels an edge that hardly moves passes much sooner or later then.
    """
    largest = np.zeros((*seen.depth.shape[1:], 5))
    for shift in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        moved = replace(case.asked, shift=tuple(PATH_ERROR * part for part in shift))
        other = films.film(case.scene, case.frame, size, moved)
        change = np.concatenate([other.rgba - seen.rgba, (other.depth - seen.depth)[..., None]], -1)
        largest = np.maximum(largest, np.abs(change.mean(axis=0)))
    return 2.0 * largest


def _names(scene: Any, layer: str) -> list[str]:
    if layer == "crypto_object":
        return [mesh.name for mesh in scene.meshes]
    return [mesh.material.name for mesh in scene.meshes]


def _coverage(layer: np.ndarray, names: list[str]) -> np.ndarray:
    """``(H, W, n)`` of the names, each once, from ranked pairs of ID and coverage."""
    ids, cover = layer[..., 0::2].astype(np.float64), layer[..., 1::2].astype(np.float64)
    return np.stack(
        [np.where(ids == name_id(name), cover, 0.0).sum(axis=-1) for name in dict.fromkeys(names)],
        axis=-1,
    )


def _below(film: Film, depths: Any) -> np.ndarray:
    """Alpha before each depth: samples laid over each other as far as they end before it."""
    deep = film.deep
    counts = deep.counts.ravel().astype(int)
    found = np.zeros((len(counts), len(depths)))
    first = np.cumsum(counts) - counts
    for pixel, count in enumerate(counts):
        part = slice(first[pixel], first[pixel] + count)
        alpha = deep.rgba[part, 3].astype(float)
        middle = 0.5 * (deep.z[part] + deep.z_back[part])
        added = alpha * np.cumprod(np.append(1.0, 1.0 - alpha))[:-1]
        found[pixel] = [added[middle < depth].sum() for depth in depths]
    return found.reshape(*deep.counts.shape, -1)


def _moment(case: Case, size: tuple[int, int], film: Film) -> list[str]:
    """What is wrong in the layers of one moment, but for pixels whose centres are on an edge."""
    truth, wrong = moments.layers(case.scene, case.frame, size, 0.5), []
    sure = truth["edge"] > 1e-3
    for name, within in (("object", 0), ("material", 0), ("depth", 5e-3), ("normal", 2e-2),
                         ("uv", 1e-3), ("forward", 2e-2), ("backward", 2e-2)):  # fmt: skip
        if name not in film.layers:
            continue
        got, right = film.layers[name].astype(float), truth[name]
        if name == "normal":  # its side has a case of its own
            side = np.sum(got * right, axis=-1, keepdims=True)
            right = np.where(side < 0.0, -right, right)
        with np.errstate(invalid="ignore"):
            off = np.abs(got - right)
        off = np.where((got == right) | (np.isnan(got) & np.isnan(right)), 0.0, off)
        off = off.reshape(*off.shape[:2], -1).max(axis=-1)
        if name == "uv":  # of which a layer has float32
            within += 1e-7 * np.abs(right).max()
        bad = sure & ~(off <= within)
        if bad.any():
            y, x = np.argwhere(bad)[0]
            wrong.append(
                f"{name}: {bad.sum()} of {sure.sum()} pixels, first ({x}, {y}): "
                f"{got[y, x]} for {right[y, x]}"
            )
    return wrong
