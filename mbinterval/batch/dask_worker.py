"""What a Dask worker does for `dask_farm`: bands of frames of a scene that it reads once."""

from __future__ import annotations

import hashlib
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from mbinterval.batch.batch import opened
from mbinterval.errors import CapacityError, MbintervalError, SceneError, UsageError
from mbinterval.film.bands import Crop
from mbinterval.film.film import Film
from mbinterval.rendering.renderer import render
from mbinterval.scene.model import Scene
from mbinterval.settings.settings import Settings
from mbinterval.version import __version__


@dataclass(frozen=True, eq=False)
class Order:
    """What a worker must know of a job. ``files`` are digests by path, beside ``source``."""

    source: str
    files: Mapping[str, str]
    program: str
    animation: tuple[str | int | None, float | None]
    shutter: tuple[float, float] | None
    resolution: tuple[int, int]
    settings: Settings
    device: Any
    memory: int | None


@dataclass(frozen=True, eq=False)
class Done:
    """What a worker sends back: a film or an error, seconds, and its address."""

    film: Film | None
    error: BaseException | None
    seconds: float
    worker: str


def render_part(order: Order, frame: int, camera: int | None, crop: Crop) -> Done:
    """Render a band of a frame; runs on a worker."""
    from distributed import get_worker

    worker = str(get_worker().address)
    started = time.perf_counter()
    try:
        scene = _scene_of(order, worker)
        film = render(
            scene if camera is None else scene.through(camera),
            frame=frame,
            width=order.resolution[0],
            height=order.resolution[1],
            settings=order.settings,
            device=order.device,
            crop=crop,
            memory=order.memory,
        )
    except (MbintervalError, MemoryError) as error:
        kind = CapacityError if isinstance(error, MemoryError) else type(error)
        told = kind(f"{Path(order.source).name}: frame {frame}: on {worker}: {error}")
        return Done(None, told, time.perf_counter() - started, worker)
    film = replace(film, device=f"{film.device} at {worker}")
    return Done(film, None, time.perf_counter() - started, worker)


_scenes: dict[tuple[Any, ...], Scene] = {}
_lock = threading.Lock()


def _scene_of(order: Order, worker: str) -> Scene:
    """Scene of an order, read once by a worker and kept until another one is asked for."""
    from mbinterval.batch.identity import program_digest

    if program_digest() != order.program:
        raise UsageError(
            f"the worker has another mbinterval (here {__version__}); install the same "
            "one everywhere"
        )
    key = order.source, tuple(sorted(order.files.items())), order.animation, order.shutter
    with _lock:
        if key not in _scenes:
            scene = _read(Path(order.source), order.files, order.animation)
            _scenes.clear()
            _scenes[key] = opened(scene, order.shutter)
        return _scenes[key]


def _read(
    source: Path, files: Mapping[str, str], animation: tuple[str | int | None, float | None]
) -> Scene:
    """Read a scene of the ``files`` of the process that asked, and of nothing else."""
    from mbinterval.batch.identity import named_digests
    from mbinterval.scene.formats.load import load_file

    _compare(source.parent, files, {name: _digest(source.parent / name) for name in files})
    clip, fps = animation
    loaded = load_file(source, clip=clip, fps=fps)
    _compare(source.parent, files, named_digests(loaded.files))
    return loaded.scene


def _digest(path: Path) -> str:
    if not path.is_file():
        raise SceneError(
            f"{path}: is not there; a scene's files must be at the same path on every worker"
        )
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise SceneError(f"{path}: cannot be read ({error.strerror or error})") from error


def _compare(folder: Path, wanted: Mapping[str, str], found: Mapping[str, str]) -> None:
    """Refuse digests that are not those that are ``wanted``."""
    for name in (*wanted, *found):
        if name not in wanted:
            raise SceneError(f"{folder / name}: is here, and not where the job was started")
        if found.get(name) != wanted[name]:
            raise SceneError(
                f"{folder / name}: is another file than where the job was started; copy it"
            )
