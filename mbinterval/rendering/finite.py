"""No film has a NaN or an infinity that the scene did not ask for: which pixel has one, and why.

Numbers of a scene are such as float32 holds, but their products may be beyond that: light on a
colour, a texture on both, a sum of lights. What comes of it is infinite, or, as infinity times
nothing, no number.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.layout.appearance import DEFAULT_MATERIAL
from mbinterval.scene.field_values import LARGEST

if TYPE_CHECKING:
    from mbinterval.film.film import Film
    from mbinterval.scene.model import Mesh, Scene

Wrong = tuple[str, int, int, float]
"""What of a film is no number, column and row of the pixel in the frame, and what it is instead."""

_SHOWN = 4
_NOTHING: Mapping[str, Any] = {"depth": np.isposinf, "forward": np.isnan, "backward": np.isnan}
"""Layers with values that say that there is nothing, or that a point is behind the eye."""


def first_wrong(film: Film) -> Wrong | None:
    """Return the first NaN or infinity that means nothing; None where all is as it should be."""
    return next(_all_wrong(film), None)


def _all_wrong(film: Film) -> Iterator[Wrong]:
    yield from _in_pixels(film, "colour", film.rgba)
    if not film.depth.min() >= -LARGEST:
        yield from _in_pixels(film, "depth", np.where(np.isposinf(film.depth), 0.0, film.depth))
    for name, pixels in film.layers.items():
        if name in _NOTHING:
            pixels = np.where(_NOTHING[name](pixels), 0.0, pixels)
        if pixels.dtype.kind == "f":
            yield from _in_pixels(film, name, pixels)
    if film.deep is not None:
        counts = film.deep.counts.ravel()
        pixel = np.repeat(np.arange(len(counts)), counts)
        for values in (*film.deep.rgba.T, film.deep.z, film.deep.z_back):
            yield from _in_list(film, "deep image", values, pixel)
    if film.events is not None:
        for name, values in film.events.columns.items():
            if values.dtype.kind == "f" and not np.isfinite(values).all():
                yield from _in_list(film, f"events' {name}", values, film.events.pixel)


def _in_pixels(film: Film, name: str, pixels: NDArray[Any]) -> Iterator[Wrong]:
    """Wrong values among ``pixels`` ``(H, W, ...)``."""
    flat = pixels.reshape(-1)
    # A product of all with themselves goes through memory once, in parts of a millisecond.
    with np.errstate(over="ignore", invalid="ignore"):
        if np.isfinite(np.dot(flat, flat)):
            return
    for place in np.argwhere(~np.isfinite(pixels))[:1]:
        column, row = film.origin[0] + int(place[1]), film.origin[1] + int(place[0])
        yield name, column, row, float(pixels[tuple(place)])


def _in_list(film: Film, name: str, values: NDArray[Any], pixel: NDArray[Any]) -> Iterator[Wrong]:
    """Wrong ones among ``values`` ``(N,)``, each of one ``pixel`` of the film."""
    for place in np.flatnonzero(~np.isfinite(values))[:1]:
        row, column = divmod(int(pixel[place]), film.rgba.shape[1])
        yield name, film.origin[0] + column, film.origin[1] + row, float(values[place])


def blamed(scene: Scene, seen: Sequence[int]) -> str:
    """Say which numbers of the meshes ``seen``, by their places, and of lights are largest."""
    found = {}
    named = [repr(mesh.name) if mesh.name else str(n) for n, mesh in enumerate(scene.meshes)]
    for place in seen or range(len(scene.meshes)):
        for what, value in _numbers(scene.meshes[place]).items():
            found[f"{what} of mesh {named[place]}"] = value
    for number, light in enumerate(scene.lights):
        found[f"light {number} ({light.kind})"] = _most(light.color) * light.intensity
    if scene.environment is not None:
        found["the environment"] = _most(scene.environment.image) * scene.environment.intensity
    found["the background"] = _most(scene.background)
    largest = sorted(found, key=lambda what: -found[what])[:_SHOWN]
    numbers = ", ".join(f"{what} is up to {found[what]:.3g}" for what in largest if found[what])
    names = ", ".join(named[place] for place in seen[:_SHOWN])
    more = ", ..." if len(seen) > _SHOWN else ""
    there = f"mesh {names}{more} is seen there; " if seen else ""
    return f"{there}{numbers or 'every colour is 0'}"


def _numbers(mesh: Mesh) -> Mapping[str, float]:
    """Largest numbers of what a mesh shows, by their fields."""
    material = mesh.material or DEFAULT_MATERIAL
    fields = ("base_color", "specular", "emission")
    images = ("texture", "emission_texture")
    given = {name: getattr(material, name) for name in fields}
    given |= {name: image.image for name in images if (image := getattr(material, name))}
    if mesh.color is not None:
        given["color"] = mesh.color
    return {name: _most(values) for name, values in given.items()}


def _most(values: Any) -> float:
    return float(np.abs(np.asarray(values, np.float64)).max(initial=0.0))
