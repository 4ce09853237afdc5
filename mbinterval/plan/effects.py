"""The effects that a scene calls for, each with the reason why or why not.

An effect that is not called for leaves no code in the kernels: each is a macro.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mbinterval.exposure.exposure import reflecting
from mbinterval.film.aovs import MACROS, MOMENTARY, RECORDED
from mbinterval.layout.alpha import has_vertex_alpha, is_translucent, varies
from mbinterval.layout.appearance import casting
from mbinterval.layout.motion import has_large_uv
from mbinterval.plan.sampling import filter_of, pattern_of
from mbinterval.settings.rules import ANALYTIC
from mbinterval.settings.settings import Settings

if TYPE_CHECKING:
    from mbinterval.exposure.exposure import Exposure
    from mbinterval.layout.motion import Motion


METHODS = ("analytic", "stochastic")
"""Ways to render; accumulation is stochastic in this."""


@dataclass(frozen=True)
class Effect:
    """Something that a scene may call for, and why it does or does not.

    ``macro`` is what the kernels are compiled with where it is active, ``methods`` are those that
    know it.
    """

    name: str
    active: bool
    reason: str
    macro: str = ""
    methods: tuple[str, ...] = METHODS


def active_macros(effects: Sequence[Effect]) -> frozenset[str]:
    """Return the macros of the effects that are called for."""
    return frozenset(effect.macro for effect in effects if effect.active and effect.macro)


def effects_of(exposure: Exposure, motion: Motion, settings: Settings) -> tuple[Effect, ...]:
    """Find all effects, in the order of the pipeline, active or not."""
    moving = len(motion.paths) > motion.static_paths
    return (
        *_motion(exposure, motion, settings, moving),
        *_samples(exposure, settings),
        *_shutter(exposure, moving),
        *_geometry(motion),
        *_transparency(exposure),
        *_mirrors(exposure),
        *_shading(exposure, motion, settings),
        *_around(exposure, motion, settings),
        _over_time(motion, settings, moving),
        _footprint(motion, settings),
        *_film(exposure, settings),
        *_published(settings, moving),
        *_layers(settings),
    )


def _motion(
    exposure: Exposure, motion: Motion, settings: Settings, moving: bool
) -> tuple[Effect, ...]:
    resting = int(np.sum(motion.paths["step"][motion.static_paths :] == 0))
    paths = len(motion.paths) - motion.static_paths - resting
    segments = sorted({mesh.segments for mesh in exposure.meshes if mesh.segments})
    plural = "" if segments == [1] else "s"
    many = f", {' and '.join(map(str, segments))} motion segment{plural}" if segments else ""
    kinds = "translucent or mirrored" if exposure.mirrors else "translucent"
    lists = f"{resting} {kinds} triangles do not move"
    lists += ", but go through the same lists" if resting else ""
    kind = f"paths={settings.paths!r}" if moving else "nothing moves"
    camera = "the camera moves: every mesh has motion paths" if exposure.camera_moves else (
        "the camera stays"
    )  # fmt: skip
    return (
        Effect("motion", paths > 0, f"{paths} motion paths{many}", "MOVING"),
        Effect("transparency at rest", resting > 0, lists, "MOVING"),
        Effect("exact in time", settings.paths == "exact" or not moving, kind, "EXACT", ANALYTIC),
        Effect("camera motion", exposure.camera_moves, camera),
    )


def _samples(exposure: Exposure, settings: Settings) -> tuple[Effect, ...]:
    lens = any(np.any(poses.aperture > 0.0) for poses in exposure.cameras.values())
    stop = "the camera has an f_stop" if lens else "the camera is a pinhole"
    pattern = pattern_of(settings)
    scattered = pattern == "sobol"
    shape = filter_of(settings)
    weighted = shape is not None and shape.mass != 1.0
    lobes = f"the {settings.filter} filter has {'' if weighted else 'no '}negative lobes"
    glossy = any(mirror.shear > 0.0 for mirror in exposure.mirrors)
    placed = lens or glossy or scattered or weighted
    shared = settings.filter == "five_point"
    where = "each pixel has its own" if placed else "all pixels have the same"
    return (
        Effect("lens", lens, stop, "LENS"),
        Effect("scattered samples", scattered, f"pattern={pattern!r}", "SCATTERED", ANALYTIC),
        Effect("weighted samples", weighted, lobes, "WEIGHTED"),
        Effect("samples placed by pixel", placed, where, "PLACED", ANALYTIC),
        Effect(
            "samples shared by pixels",
            shared,
            f"filter={settings.filter!r}",
            "FIVE_POINT",
            ANALYTIC,
        ),
    )


def _shutter(exposure: Exposure, moving: bool) -> tuple[Effect, ...]:
    curve = exposure.shutter.curve
    name = f"curve={curve!r}" if isinstance(curve, str) else f"a table of {len(curve)} values"
    rolls = exposure.roll is not None and moving
    columns = exposure.roll is not None and exposure.roll.columns and moving
    rolling = f"rolling={exposure.shutter.rolling!r}"
    if not moving:
        name = rolling = "nothing moves"
    return (
        Effect("shutter curve", curve != "box" and moving, name),
        Effect("rolling shutter", rolls, rolling, "ROLLING"),
        Effect("rolling columns", columns, rolling, "ROLLING_COLUMNS"),
    )


def _geometry(motion: Motion) -> tuple[Effect, ...]:
    static = motion.static_paths
    single = [m.name for m in motion.materials if not m.double_sided]
    return (
        Effect(
            "static geometry", static > 0, f"{static} triangles do not move", "STATIC", ANALYTIC
        ),
        Effect("single-sided", bool(single), _named("material", single), "SINGLE_SIDED"),
    )


def _transparency(exposure: Exposure) -> tuple[Effect, ...]:
    meshes = [mesh for mesh in exposure.meshes if is_translucent(mesh)]
    used = {id(m): m for m in (mesh.mesh.material for mesh in meshes) if m is not None}
    named = {
        word: _named("material", [m.name for m in used.values() if m.alpha == mode])
        for word, mode in (("blended", "blend"), ("tested", "mask"))
        if any(m.alpha == mode for m in used.values())
    }
    called = "; ".join(f"{word}: {names}" for word, names in named.items())
    varying = [mesh.mesh.name for mesh in meshes if varies(mesh)]
    vertices = [mesh.mesh.name for mesh in meshes if has_vertex_alpha(mesh)]
    return (
        Effect("transparency", bool(meshes), called or _named("material", ()), "TRANSLUCENT"),
        Effect("alpha that varies", bool(varying), _named("mesh", varying), "ALPHA_VARIES"),
        Effect("vertex alpha", bool(vertices), _named("mesh", vertices), "VERTEX_ALPHA"),
    )


def _mirrors(exposure: Exposure) -> tuple[Effect, ...]:
    named = _named("mesh", [mirror.name for mirror in exposure.mirrors])
    faces = sum(len(mesh.mesh.faces) for mesh in exposure.meshes if mesh.world)
    seen = f"{named}; {faces} triangles are seen in them" if exposure.mirrors else named
    glossy = [mirror.name for mirror in exposure.mirrors if mirror.shear > 0.0]
    return (
        Effect("mirrors", bool(exposure.mirrors), seen, "MIRRORS"),
        Effect("glossy mirrors", bool(glossy), _named("mesh", glossy), "GLOSSY"),
    )


def _shading(exposure: Exposure, motion: Motion, settings: Settings) -> tuple[Effect, ...]:
    phong = [m.name for m in motion.materials if m.shading == "phong"]
    metallic = [m.name for m in motion.materials if m.shading == "metallic_roughness"]
    glowing = [m.name for m in motion.materials if m.shading != "unlit" and any(m.emission)]
    lit = bool(phong or metallic)
    textured = [m.name for m in motion.materials if m.textures]
    far = [mesh.mesh.name for mesh in exposure.meshes if not mesh.world and has_large_uv(mesh)]
    colored = [m.mesh.name for m in exposure.meshes if m.color is not None and not m.world]
    kinds = [light.kind for light in exposure.lights]
    spots = kinds.count("spot")
    points = kinds.count("point") + spots
    unlit = "nothing reflects them"
    lamps = f"{points} point lights" if lit or not points else unlit
    cones = f"{spots} spot lights" if lit or not spots else unlit
    casters = len(casting(exposure, settings))
    darkness = f"{casters} of {len(kinds)} lights cast them, shadows={settings.shadows!r}"
    if casters and not lit:
        darkness = unlit
    return (
        Effect("phong shading", bool(phong), _named("material", phong), "PHONG"),
        Effect("metallic-roughness shading", bool(metallic), _named("material", metallic),
               "METALLIC"),
        Effect("emission", bool(glowing), _named("material", glowing), "EMISSION"),
        Effect("point lights", lit and points > 0, lamps, "POINT_LIGHTS"),
        Effect("spot lights", lit and spots > 0, cones, "SPOT_LIGHTS"),
        Effect("shadows", lit and casters > 0, darkness, "SHADOWS"),
        Effect("texture", bool(textured), _named("material", textured), "TEXTURED"),
        Effect("texture over many repeats", bool(far), _named("mesh", far), "LARGE_UV"),
        Effect("vertex colour", bool(colored), _named("mesh", colored), "VERTEX_COLOR"),
    )  # fmt: skip


def _around(exposure: Exposure, motion: Motion, settings: Settings) -> tuple[Effect, ...]:
    around, lit = exposure.environment, any(m.shading != "unlit" for m in motion.materials)
    light = "the scene has none"
    behind = light
    if around is not None:
        light = f"an image of {around.image.shape[1]} x {around.image.shape[0]} pixels"
        behind = light if around.background else "background=False"
        light = light if lit else "nothing reflects it"
        if settings.transparent:
            behind = "the film is transparent"
    seen = around is not None and around.background and not settings.transparent
    asked = reflecting(exposure)
    names = _named("mesh", [mesh.mesh.name for meshes in asked.values() for mesh in meshes])
    pictures = sum(6 * reflections.times for reflections in asked)
    return (
        Effect("light of the environment", around is not None and lit, light, "ENVIRONMENT"),
        Effect("environment as background", seen, behind, "SKY"),
        Effect("reflections of surroundings", bool(asked),
               f"{names}, up to {pictures} pictures" if asked else names, "REFLECTIONS"),
    )  # fmt: skip


def _over_time(motion: Motion, settings: Settings, moving: bool) -> Effect:
    varying = any(m.shading != "unlit" or m.textures for m in motion.materials) or motion.color.size
    fixed = settings.shading_times
    times = f"shading_error={settings.shading_error:g}" if fixed is None else f"{fixed} times"
    why = f"{times} along each span" if varying else "colours are constant"
    return Effect("shading over time", bool(varying and moving), why if moving else "nothing moves")


def _footprint(motion: Motion, settings: Settings) -> Effect:
    textured = any(m.textures for m in motion.materials)
    asked = textured and settings.anisotropy > 0
    reason = f"anisotropy={settings.anisotropy}" if textured else "no texture"
    return Effect("texture footprint", asked, reason)


def _film(exposure: Exposure, settings: Settings) -> tuple[Effect, ...]:
    image = not isinstance(exposure.background, tuple)
    behind = "the scene has one" if image else "a constant colour"
    if image and exposure.sky:
        image, behind = False, "the environment is seen"
    if image and settings.transparent:
        behind = "the film is transparent"
    asked = "asked for" if settings.transparent else "not asked for"
    seen = image and (not settings.transparent or bool(exposure.mirrors))
    if seen and settings.transparent:
        behind = "the film is transparent, but mirrors show it"
    return (
        Effect("background image", seen, behind, "BACKGROUND_IMAGE"),
        Effect("transparent film", settings.transparent, asked, "TRANSPARENT"),
    )


def _published(settings: Settings, moving: bool) -> tuple[Effect, ...]:
    """Choices within the method of Hong & Oh (2017)."""
    by_depth = settings.pairing == "depth" and settings.paths == "triangulated" and moving
    partial = settings.partial_bits and settings.occlusion != "exact" and moving
    pairs = f"pairing={settings.pairing!r}"
    bits = f"partial_bits={settings.partial_bits}"
    if settings.paths == "exact":
        pairs = "exact paths have no fragments to pair"
    if not moving:
        pairs = bits = "nothing moves"
    return (
        Effect("pairing by depth", by_depth, pairs, "PAIR_BY_DEPTH", ANALYTIC),
        Effect("partial bits", partial, bits, "PARTIAL_BITS", ANALYTIC),
    )


def _layers(settings: Settings) -> tuple[Effect, ...]:
    asked = ", ".join(name for name in settings.aovs if name in MOMENTARY)
    spans = ", ".join(name for name in settings.aovs if name in RECORDED)
    layers = (
        Effect(f"layer {name}", True, "asked for", MACROS[name], ANALYTIC) for name in settings.aovs
    )
    none = "not asked for"
    return (
        Effect("values at one moment", bool(asked), asked or none, "MOMENTARY", ANALYTIC),
        Effect("visible spans kept", bool(spans), spans or none, "RECORDED", ANALYTIC),
        *layers,
    )


def _named(kind: str, names: Sequence[str]) -> str:
    """Say which items call for an effect: 'material 'tyre' and 2 more', or 'no material'."""
    if not names:
        return f"no {kind} calls for it"
    more = f" and {len(names) - 1} more" if len(names) > 1 else ""
    first = next((repr(name) for name in names if name), "without a name")
    return f"{kind} {first}{more}"
