"""What lies around the scene at infinity, and reflections that an object asks for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbinterval.errors import SceneError
from mbinterval.scene import field_values
from mbinterval.scene.field_values import freeze
from mbinterval.scene.frozen import Frozen

Float32 = NDArray[np.float32]

_BRIGHTEST = 1e30
"""Light whose sums float32 still holds."""


@dataclass(frozen=True, eq=False)
class Environment(Frozen):
    """A picture of all directions, infinitely far away, that lights surfaces and is seen.

    Surfaces that reflect light scatter what comes from all sides, weighed by the cosine to their
    normal; those of glTF's metallic-roughness model mirror it too. Nothing stands in its way: it
    casts no shadows, and objects don't hide it from each other.

    Attributes
    ----------
    image
        ``(h, w, 3)``, scene-linear, from 0 up, twice as wide as high: latitude by row, straight up
        on top, and longitude by column. A camera that looks along -Z sees its middle, and turns
        to columns on the right when it turns to the right. Alpha is left out. `read_image` reads a
        file.
    intensity
        Multiplies the image.
    rotation
        Degrees about +Y by which it is turned, counter-clockwise seen from above.
    background
        Whether the camera sees it where nothing else is. If not, that is the scene's background.
    """

    image: Float32
    intensity: float = 1.0
    rotation: float = 0.0
    background: bool = True

    def __post_init__(self) -> None:
        image = field_values.image(self.image, "environment: image")[..., :3]
        height, width = image.shape[:2]
        if width != 2 * height:
            raise SceneError(
                f"environment: image has {width} x {height} pixels; expected twice as many columns "
                "as rows, which stand for all directions by longitude and latitude"
            )
        if image.min() < 0.0:
            row, column = np.argwhere(image.min(axis=2) < 0.0)[0]
            raise SceneError(
                f"environment: image has {image.min():g} as its least value, the first below 0 at "
                f"row {row}, column {column}; light can't be negative: clip the image at 0"
            )
        intensity = field_values.number(self.intensity, "environment: intensity", 0.0)
        most = float(image.max()) * intensity
        if most > _BRIGHTEST:
            raise SceneError(
                f"environment: image times intensity is up to {most:.3g}; at most {_BRIGHTEST:g} "
                "can be rendered: lower the intensity"
            )
        freeze(
            self,
            image=image,
            intensity=intensity,
            rotation=field_values.number(self.rotation, "environment: rotation"),
            background=field_values.flag(self.background, "environment: background"),
        )


@dataclass(frozen=True, eq=False)
class Reflections(Frozen):
    """Asks for a picture of an object's surroundings that its surface mirrors, as they move.

    A cube map (Akenine-Möller et al. 2007, 3.5): all directions as they are seen from the middle of
    the object, without it, averaged over each of ``times`` equal parts of the shutter. It replaces
    the environment in what metallic-roughness materials mirror. All meshes that share one
    record are one object.

    Attributes
    ----------
    size
        Texels along an edge of the cube, 16 to 1024.
    times
        Parts of the shutter, 1 to 64. Where nothing moves one is enough, and taken.
    """

    size: int = 128
    times: int = 4

    def __post_init__(self) -> None:
        freeze(
            self,
            size=field_values.whole_number(self.size, "reflections: size", 16, 1024),
            times=field_values.whole_number(self.times, "reflections: times", 1, 64),
        )
