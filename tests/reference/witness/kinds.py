"""One scene of each kind of effect, for the table, and to show that small errors are found."""

from __future__ import annotations

from dataclasses import dataclass, replace

from .film import Asked
from .scenes import Case, Effects, Recipe, build

LIT = {"shading": "phong"}
METAL = {"shading": "metallic_roughness"}


@dataclass(frozen=True)
class Kind:
    """What scenes of a kind have, and what is looked at in them.

    ``seed`` is of one that moves enough for small errors to show at ``strata`` samples of 24 films.
    With ``spread`` these lie all over the pixel, where they could be in its middle too.
    """

    effects: Effects
    about: str
    seed: int = 1
    strata: int = 64
    spread: bool = False


KINDS: dict[str, Kind] = {
    "motion alone": Kind(Effects(), "keys, splines, arrays, joints, morph targets, parents"),
    "textures": Kind(Effects(texture="color"), "colours that slide by while they are seen"),
    "vertex colours": Kind(Effects(color="vertex"), "blended over faces"),
    "Phong, sun": Kind(
        Effects(**LIT, texture="all"), "diffuse, highlights, glow, of a light far away"
    ),
    "Phong, lamp": Kind(Effects(**LIT, lights="lamps"), "the same of a point light"),
    "Phong, spot": Kind(Effects(**LIT, lights="spots"), "the same in a cone"),
    "metallic-roughness": Kind(
        Effects(**METAL, lights="lamps", texture="all"), "glTF's model, its textures"
    ),
    "shadows of a sun": Kind(Effects(**LIT, shadows="shadows"), "when light comes and goes"),
    "shadows of a lamp": Kind(
        Effects(**LIT, lights="lamps", shadows="shadows", alpha="blend"),
        "what is translucent lets light through",
    ),
    "shadows of a spot": Kind(
        Effects(**LIT, lights="spots", shadows="shadows", alpha="varying"),
        "as much as the texture's alpha says",
    ),
    "one side": Kind(Effects(sides="single", texture="color"), "which side is the front"),
    "transparency": Kind(Effects(alpha="blend", texture="color"), "layers in order at any time"),
    "alpha of textures": Kind(Effects(alpha="varying", **LIT), "layers whose alpha varies"),
    "alpha tests": Kind(Effects(alpha="mask", texture="color"), "holes with sudden edges"),
    "mirrors": Kind(Effects(mirror="flat", **LIT), "what moves in a flat mirror, and its light"),
    "glossy mirrors": Kind(Effects(mirror="glossy", texture="color"), "spread over a disc"),
    "camera": Kind(Effects(camera="moving", texture="color"), "a camera that moves and zooms"),
    "round lens": Kind(
        Effects(lens="round", camera="moving"), "circles of confusion of a camera that moves"
    ),
    "blades": Kind(Effects(lens="blades"), "polygons, and which way they turn"),
    "focus pull": Kind(Effects(lens="pull"), "a focus that changes while the shutter is open"),
    "rolling down or up": Kind(
        Effects(rolling="rows", camera="moving"), "each row at its own time"
    ),
    "rolling left or right": Kind(
        Effects(rolling="columns", curve="curve"), "each column, with a shutter curve"
    ),
    "shutter curve": Kind(Effects(curve="curve", texture="color"), "how far it is open over time"),
    "background image": Kind(Effects(around="image", alpha="blend"), "behind what is translucent"),
    "light of an environment": Kind(Effects(around="light", **LIT), "what surfaces scatter of it"),
    "mirrored environment": Kind(Effects(around="light", **METAL), "what facets mirror of it"),
    "environment behind": Kind(Effects(around="sky", camera="moving"), "as the camera turns"),
    "triangle filter": Kind(
        Effects(sampling="triangle"), "light of a pixel's surroundings", 12, 256, spread=True
    ),
    "Gaussian filter": Kind(Effects(sampling="gaussian"), "the same, wider", 12, 256, spread=True),
    "Blackman-Harris filter": Kind(
        Effects(sampling="blackman_harris"), "the same, narrower", 12, 256, spread=True
    ),
    "Mitchell filter": Kind(
        Effects(sampling="mitchell"), "with weights below 0", 29, 256, spread=True
    ),
    "five-point rule": Kind(
        Effects(sampling="five_point", texture="color", camera="moving"),
        "centres and those beside them",
    ),
    "layers of a moment": Kind(
        Effects(layers="moment", texture="color", camera="moving"),
        "sharp, depth, normal, uv, flow and IDs too", spread=True,
    ),
    "Cryptomatte": Kind(
        Effects(layers="cryptomatte", alpha="blend"),
        "coverage by name too", 15, 256, spread=True,
    ),
    "deep images": Kind(
        Effects(layers="deep", alpha="blend"), "alpha before four depths too", 15, 256, spread=True
    ),
    "events": Kind(
        Effects(layers="events", alpha="blend", curve="curve"),
        "parts of the exposure, and what is seen when, too", 5,
    ),
    "point samples": Kind(
        Effects(method="stochastic", **LIT, shadows="shadows", texture="color"),
        "the stochastic method",
    ),
    "point samples, lens": Kind(
        Effects(method="stochastic", lens="blades", mirror="glossy"),
        "with a lens and a glossy mirror", strata=256,
    ),
    "slices": Kind(
        Effects(method="accumulation", **LIT, texture="color"), "the mean of pictures at rest"
    ),
    "slices, lens": Kind(
        Effects(method="accumulation", lens="round", camera="moving"),
        "each through a point of the lens",
    ),
}  # fmt: skip
"""What each scene has; of its motions, see `scenes`."""


def kind_case(name: str, seed: int, strata: int = 64, repeats: int = 24) -> Case:
    """A scene of a kind, sampled more finely than random ones."""
    effects = KINDS[name].effects
    if effects.sampling == "box" and not KINDS[name].spread:
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
