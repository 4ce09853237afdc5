"""One scene of each kind of effect, for the table, and to show that small errors are found."""

from __future__ import annotations

from dataclasses import replace

from .film import Asked
from .scenes import Case, Effects, Recipe, build

LIT = {"shading": "phong"}
METAL = {"shading": "metallic_roughness"}
KINDS: dict[str, Effects] = {
    "motion alone": Effects(),
    "textures": Effects(texture="color"),
    "textures repeated": Effects(texture="far", **LIT),
    "vertex colours": Effects(color="vertex"),
    "Phong, sun": Effects(**LIT, texture="all"),
    "Phong, lamp": Effects(**LIT, lights="lamps"),
    "Phong, spot": Effects(**LIT, lights="spots"),
    "metallic-roughness": Effects(**METAL, lights="lamps", texture="all"),
    "shadows of a sun": Effects(**LIT, shadows="shadows"),
    "shadows of a lamp": Effects(**LIT, lights="lamps", shadows="shadows", alpha="blend"),
    "shadows of a spot": Effects(**LIT, lights="spots", shadows="shadows", alpha="varying"),
    "one side": Effects(sides="single", texture="color"),
    "transparency": Effects(alpha="blend", texture="color"),
    "alpha of textures": Effects(alpha="varying", **LIT),
    "alpha tests": Effects(alpha="mask", texture="color"),
    "mirrors": Effects(mirror="flat", **LIT),
    "glossy mirrors": Effects(mirror="glossy", texture="color"),
    "camera": Effects(camera="moving", texture="color"),
    "round lens": Effects(lens="round", camera="moving"),
    "blades": Effects(lens="blades"),
    "focus pull": Effects(lens="pull"),
    "rolling down or up": Effects(rolling="rows", camera="moving"),
    "rolling left or right": Effects(rolling="columns", curve="curve"),
    "shutter curve": Effects(curve="curve", texture="color"),
    "background image": Effects(around="image", alpha="blend"),
    "light of an environment": Effects(around="light", **LIT),
    "mirrored environment": Effects(around="light", **METAL),
    "environment behind": Effects(around="sky", camera="moving"),
    "triangle filter": Effects(sampling="triangle"),
    "Gaussian filter": Effects(sampling="gaussian"),
    "Blackman-Harris filter": Effects(sampling="blackman_harris"),
    "Mitchell filter": Effects(sampling="mitchell"),
    "layers of a moment": Effects(layers="moment", texture="color", camera="moving"),
    "Cryptomatte": Effects(layers="cryptomatte", alpha="blend"),
    "deep images": Effects(layers="deep", alpha="blend"),
    "point samples": Effects(method="stochastic", **LIT, shadows="shadows", texture="color"),
    "point samples, lens": Effects(method="stochastic", lens="blades", mirror="glossy"),
    "slices": Effects(method="accumulation", **LIT, texture="color"),
    "slices, lens": Effects(method="accumulation", lens="round", camera="moving"),
}
"""What each scene has; of its motions, see `scenes`."""

SPATIAL = ("filter", "layers", "Cryptomatte", "deep")
"""Kinds, by a part of their name, that need samples all over the pixel."""


def kind_case(name: str, seed: int, strata: int = 64, repeats: int = 24) -> Case:
    """A scene of a kind, sampled more finely than random ones."""
    effects = KINDS[name]
    if effects.sampling == "box" and not any(part in name for part in SPATIAL):
        effects = replace(effects, sampling="centre").consistent()
    case = build(Recipe(effects, seed))
    settings = dict(case.settings)
    if case.repeats > 1 and settings.get("method") != "accumulation":
        settings["samples"] = strata
    if settings.get("method") == "accumulation":
        settings["slices"] = strata
    asked = Asked(**vars(case.asked) | {"strata": strata, "repeats": repeats})
    return replace(
        case, settings=settings, asked=asked, repeats=1 if case.repeats == 1 else repeats
    )
