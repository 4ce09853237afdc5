"""Pictures of a study's report: PNG data for the page, error maps, and crops at equal times."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.comparison import metrics
from mbinterval.comparison.comparison import false_colour
from mbinterval.files.images import linear_to_srgb
from mbinterval.film.film import Film
from mbinterval.study.judge import independent

CROP = (112, 84)
"""Width and height of crops in pixels."""

Float32 = NDArray[np.float32]


def data_uri(colour: NDArray[Any]) -> str:
    """``(H, W, 3)`` scene-linear colour as a PNG in a data URI: 8 bits, with the sRGB curve."""
    from PIL import Image

    stream = io.BytesIO()
    encoded = np.round(255.0 * linear_to_srgb(colour)).astype(np.uint8)
    Image.fromarray(encoded).save(stream, "PNG", optimize=True)
    return "data:image/png;base64," + base64.b64encode(stream.getvalue()).decode("ascii")


@dataclass(frozen=True, eq=False)
class Gallery:
    """The films of a study.

    Attributes
    ----------
    folder
        Of the study.
    references
        Colours ``(H, W, 3)`` by method; a row's map is against the first that is
        independent of its method.
    """

    folder: Path
    references: Mapping[str, Float32]

    def colour(self, film: str) -> Float32 | None:
        """Colour of a film by its name in the folder; None where it is not there."""
        path = self.folder / film
        return Film.read(path).rgba[..., :3] if path.is_file() else None

    def error_map(self, colour: Float32, method: str) -> Float32 | None:
        """``(H, W)`` RMS difference at each pixel from what a row of ``method`` is judged by."""
        for name, reference in self.references.items():
            if independent(name, method):
                return metrics.rms_map(colour, reference)
        return None


def map_uri(errors: Float32) -> str:
    """`mbinterval.comparison.comparison.false_colour` of errors, as `data_uri` has it."""
    return data_uri(false_colour(errors))


def worst_crop(maps: Sequence[Float32]) -> tuple[slice, slice]:
    """Rows and columns of the crop in which the mean of error maps is largest.

    Blocks of `CROP` that overlap by half; the first of equal ones.
    """
    mean = np.mean(np.stack(maps), axis=0)
    height, width = mean.shape
    across, down = min(CROP[0], width), min(CROP[1], height)
    total = np.pad(mean.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    best = max(

            (total[y + down, x + across] - total[y, x + across] - total[y + down, x] + total[y, x],
             -y, -x)
            for y in range(0, height - down + 1, max(down // 2, 1))
            for x in range(0, width - across + 1, max(across // 2, 1))

    )  # fmt: skip
    y, x = -best[1], -best[2]
    return slice(y, y + down), slice(x, x + across)
