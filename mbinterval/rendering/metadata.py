"""What a film says about itself in the files that it is written to.

Nothing here depends on the day, the machine, or a setting that cannot change the image, so that
equal renders are equal files.
"""

from __future__ import annotations

import numpy as np

from mbinterval.exposure.exposure import Exposure
from mbinterval.exposure.poses import CameraPoses
from mbinterval.files.exr import AttributeValue
from mbinterval.files.ownership import SOFTWARE
from mbinterval.plan.sampling import pattern_of
from mbinterval.scene.model import Scene
from mbinterval.scene.tracks import Track
from mbinterval.settings.settings import Settings


def frame_metadata(
    scene: Scene, exposure: Exposure, settings: Settings
) -> dict[str, AttributeValue]:
    """Metadata of one frame, under the standard EXR attribute names where there are some.

    ``frame``; ``fps``; ``shutterOpen`` and ``shutterClose`` in frames relative to the frame;
    ``expTime`` in seconds; ``worldToCamera`` at the shutter's opening (and
    ``worldToCameraClose`` where the camera moves), for row vectors as EXR has them;
    ``fieldOfView``, vertical, in degrees; ``shutterCurve``, ``shutterRolling`` and ``lineOffset``
    where they are asked for, of a rolling shutter ``expTime`` is a line's; ``aperture``, the
    f-number, and ``focus`` of a lens; ``settings.*``; ``software``.
    """
    shutter, (poses, closing) = scene.shutter, exposure.path.ends
    metadata: dict[str, AttributeValue] = {
        "software": SOFTWARE,
        "frame": float(exposure.frame),
        "fps": float(scene.fps),
        "shutterOpen": float(shutter.open),
        "shutterClose": float(shutter.close),
        "expTime": (shutter.close - shutter.open) / scene.fps,
        "fieldOfView": float(np.degrees(2.0 * np.arctan(0.5 / poses.focal[0]))),
        "worldToCamera": _world_to_camera(poses),
    }
    if shutter.curve != "box":
        metadata["shutterCurve"] = (
            shutter.curve if isinstance(shutter.curve, str) else tuple(shutter.curve)
        )
    if shutter.rolling is not None:
        metadata["shutterRolling"] = shutter.rolling
        metadata["lineOffset"] = float(shutter.line_offset or 0.0)
        metadata["expTime"] = float(shutter.line_exposure or 0.0)
    f_stop = exposure.camera.f_stop
    if f_stop is not None:
        keyed = f_stop.at(exposure.frame) if isinstance(f_stop, Track) else f_stop
        metadata["aperture"] = float(keyed)
        metadata["focus"] = float(poses.focus[0])
    if exposure.path.moves:
        metadata["worldToCameraClose"] = _world_to_camera(closing)
    if scene.name:
        metadata["scene"] = scene.name
    if scene.camera is not None and scene.camera.name:
        metadata["camera"] = scene.camera.name
    for name, value in (settings.given | {"pattern": pattern_of(settings)}).items():
        if value is not None:
            metadata[f"settings.{name}"] = int(value) if isinstance(value, bool) else value
    return metadata


def _world_to_camera(poses: CameraPoses) -> tuple[float, ...]:
    """4x4 matrix M, row by row, such that ``[x y z 1] @ M`` is a point in camera space."""
    rotation = poses.rotation[0]
    matrix = np.eye(4)
    matrix[:3, :3] = rotation.T
    matrix[3, :3] = -poses.eye[0] @ rotation.T
    return tuple(matrix.ravel().tolist())
