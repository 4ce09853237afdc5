"""What a render can find in the same pass as its image: arbitrary output variables, by layer.

What a film always has is not among them: coverage over pixel and shutter is its alpha, and the
number of time intervals its ``intervals``.

Values at one moment, ``Settings.aov_time``, are those of the surface that the centre of the pixel
sees then, through the middle of the lens. They are points, never averages, so that nothing is
mixed across an edge; in space as in time they don't depend on samples, filter or occlusion. What is
translucent is that surface where its alpha is 0.5 or more, as Blender's Cycles has it by default.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from mbinterval.values import nearest, refuse

if TYPE_CHECKING:  # settings are checked before anything heavy is imported
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True)
class Aov:
    """A layer: its channels in EXR files, and whether they are whole numbers (uint32).

    ``moment`` ones are found at the centres of pixels, at one moment; ``ranked`` ones have more
    channels of the same kind, numbered on.
    """

    channels: tuple[str, ...]
    whole: bool = False
    moment: bool = False
    ranked: bool = False

    @property
    def dtype(self) -> str:
        """Type of its pixels."""
        return "uint32" if self.whole else "float32"


AOVS: Mapping[str, Aov] = {
    "sharp": Aov(("sharp.R", "sharp.G", "sharp.B", "sharp.A")),
    "depth": Aov(("sharp.Z",), moment=True),
    "normal": Aov(("normal.X", "normal.Y", "normal.Z"), moment=True),
    "uv": Aov(("uv.u", "uv.v"), moment=True),
    "forward": Aov(("forward.u", "forward.v"), moment=True),
    "backward": Aov(("backward.u", "backward.v"), moment=True),
    "object": Aov(("object.id",), whole=True, moment=True),
    "material": Aov(("material.id",), whole=True, moment=True),
    "operations": Aov(("operations.count",), whole=True),
    **{
        name: Aov(tuple(f"{name}00.{channel}" for channel in "RGBA"), ranked=True)
        for name in ("crypto_object", "crypto_material")
    },
}
"""Every layer by its name.

``sharp``
    ``(H, W, 4)`` float32: the image at the moment, scene-linear and premultiplied, over the
    background as the film is, layers of what is translucent blended; the mean over the pixel's
    samples with their weights. Alpha is the share of the pixel that is covered then.
``depth``
    ``(H, W)`` float32: distance along the view axis; infinity where nothing is. Its channel is not
    ``depth.Z`` because compositing programs take that and ``Z``, the film's own, for one.
``normal``
    ``(H, W, 3)`` float32: unit normal in the world, as shading has it: interpolated where the mesh
    has normals, else of the flat triangle. Of a two-sided surface seen from behind it is turned
    to the viewer. 0 where nothing is.
``uv``
    ``(H, W, 2)`` float32: texture coordinates as the mesh has them, v up; 0 where there are none.
``forward``, ``backward``
    ``(H, W, 2)`` float32: optical flow in pixels, x right and y down: from the pixel's centre to
    where the point of the surface that it sees is in the next frame, or was in the one before,
    at the same time of the shutter. Motion of the camera counts. Whether something hides the point
    there is not asked. 0 where nothing is, NaN where the point is behind the eye.
``object``, ``material``
    ``(H, W)`` uint32: 1 and the place of the mesh in ``Scene.meshes``, or of its material among
    those that they use; 0 where nothing is. The same in every frame. The film's metadata give the
    names, as JSON lists from 0 on, under ``objects`` and ``materials``.
``operations``
    ``(H, W)`` uint32: how many triangles and motion paths the pixel's samples were tested against.
    As a measure of work it depends on ``tile_size``; exact paths only.
``crypto_object``, ``crypto_material``
    ``(H, W, 2 * cryptomatte_levels)`` float32: Cryptomatte (`cryptomatte`): pairs of an
    ID and its coverage over pixel and shutter, the largest first; 0 where there are no more.
"""

EXPORTS = ("deep", "events")
"""What else can be asked for under ``aovs``, and goes to files of its own: `deep` and
`events`."""

RECORDED = ("crypto_object", "crypto_material", *EXPORTS)
"""Those that are made from all visible spans (stage "record")."""

MACROS: Mapping[str, str] = {
    **{name: f"AOV_{name.upper()}" for name in AOVS},
    **dict.fromkeys(("object", "material"), "AOV_MESH"),
    **dict.fromkeys(RECORDED, "RECORDED"),
    **dict.fromkeys(EXPORTS, "RECORDED_COLOR"),
}
"""What the kernels call each; objects and materials follow from the mesh."""

MOMENTARY = tuple(name for name, aov in AOVS.items() if aov.moment)
"""Those that are found at the centres of pixels, at one moment."""

FLOWS = {"forward": 1, "backward": -1}
"""How many frames on each flow leads."""


def check_aovs(value: Any, what: str) -> tuple[str, ...]:
    """Return the names that ``value`` gives, each once, in the order of ``AOVS``."""
    names = value
    if isinstance(value, str):
        names = [name.strip() for name in value.split(",")] if value else []
    elif value is None:
        names = []
    if not isinstance(names, Sequence) or not all(isinstance(name, str) for name in names):
        raise refuse(value, what, f"names among {', '.join((*AOVS, *EXPORTS))}")
    for name in names:
        if name not in (*AOVS, *EXPORTS):
            near = nearest(name, (*AOVS, *EXPORTS))
            raise refuse(value, what, f"names of layers; {name!r} is unknown, {near}")
    return tuple(name for name in (*AOVS, *EXPORTS) if name in names)


def planar(names: Sequence[str]) -> list[str]:
    """Return those of ``names`` that the kernels write planes for."""
    return [name for name in names if name != "sharp" and name not in RECORDED]


def plane_sizes(names: Sequence[str]) -> dict[str, int]:
    """Return the kernels' sizes of the layers of these ``names``: nothing where none has planes.

    ``PLANE_NORMAL`` is the first plane of ``normal``, and so on; ``PLANES`` is how many there are.
    """
    sizes: dict[str, int] = {}
    count = 0
    for name in planar(names):
        if _plane(name) not in sizes:
            sizes[_plane(name)] = count
            count += len(AOVS[name].channels)
    return sizes | {"PLANES": count} if sizes else {}


def plane_count(names: Sequence[str]) -> int:
    """Return how many planes the kernels write for the layers of these ``names``."""
    return plane_sizes(names).get("PLANES", 0)


def split_planes(names: Sequence[str], planes: NDArray[np.uint32]) -> dict[str, NDArray[Any]]:
    """Layers of ``planes`` ``(P, H, W)``, which are where `plane_sizes` says.

    Under ``"object"`` is 1 and the index of the mesh record, 0 where nothing is.
    """
    import numpy as np

    found: dict[str, NDArray[Any]] = {}
    sizes = plane_sizes(names)
    for name, aov in AOVS.items():
        first = sizes.pop(_plane(name), None)
        if first is not None:
            part: NDArray[Any] = planes[first : first + len(aov.channels)].view(aov.dtype)
            found[name] = part[0] if len(part) == 1 else np.moveaxis(part, 0, 2)
    return found


def _plane(name: str) -> str:
    """Return what the kernels call the layer's first plane."""
    return MACROS[name].replace("AOV_", "PLANE_")


def channel_names(name: str, count: int) -> list[str]:
    """Return the names of a layer's ``count`` channels; of ranked ones RGBA, numbered on."""
    if not AOVS[name].ranked:
        return list(AOVS[name].channels)
    return [f"{name}{place // 4:02d}.{'RGBA'[place % 4]}" for place in range(count)]


def channels_of(layers: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Return the planes ``(H, W)`` of ``layers`` by channel."""
    found: dict[str, NDArray[Any]] = {}
    for name, pixels in layers.items():
        planes = pixels[..., None] if pixels.ndim == 2 else pixels
        channels = channel_names(name, planes.shape[2])
        found |= {channel: planes[..., index] for index, channel in enumerate(channels)}
    return found


def layers_of(channels: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Return the layers all of whose channels are there, of the right kind."""
    import numpy as np

    found: dict[str, NDArray[Any]] = {}
    for name, aov in AOVS.items():
        wanted = len(aov.channels)
        if aov.ranked:
            while all(channel in channels for channel in channel_names(name, wanted + 4)):
                wanted += 4
        planes = [channels[key] for key in channel_names(name, wanted) if key in channels]
        right = all((plane.dtype.kind == "u") == aov.whole for plane in planes)
        if len(planes) == wanted and right:
            found[name] = planes[0] if len(planes) == 1 else np.stack(planes, axis=2)
    return found
