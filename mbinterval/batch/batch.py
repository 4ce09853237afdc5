"""Many frames of a scene: what each is and where it goes, which are there, and the others.

    plan_tasks -> prepare -> survey -> render_task -> write_task

A frame is complete when all of its files are whole and say that they are what would be rendered
now (`identity`). Frames are rendered one after the other: writing beside the rendering of the
next frame was measured and gained nothing on a CPU device, and a kill would lose two frames.
"""

from __future__ import annotations

import logging
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from mbinterval.errors import SceneError, UsageError
from mbinterval.files.atomic import output_place, prepare_output
from mbinterval.files.ownership import check_replaceable
from mbinterval.film.aovs import EXPORTS
from mbinterval.film.file_names import (
    CAMERA_PLACE,
    FRAME_PLACE,
    frame_path,
    has_camera,
    is_numbered,
)
from mbinterval.film.film import Film
from mbinterval.film.formats import ending_for, format_of
from mbinterval.rendering.renderer import render
from mbinterval.scene.model import Scene
from mbinterval.settings.settings import Settings

_log = logging.getLogger(__name__)

Progress = Callable[[float], None]


@dataclass(frozen=True, eq=False)
class Job:
    """What is to be rendered, after the command line has overruled the scene file.

    Attributes
    ----------
    scene
        The scene; ``source`` names it in messages.
    frames, resolution, settings, outputs, device, memory
        Frames; width and height in pixels; how to render; patterns of files; as for `render`.
    crop
        Column, row, width and height in pixels, or None for the whole frame.
    cameras
        Places of the cameras to see it with among ``scene.cameras``; empty for the scene's own.
    files
        Digests of the scene's files by path. Without any, no frame is known to be complete.
    animation
        Clip and frames per second that were asked for.
    shutter
        Opening and closing that were asked for, as `opened` applies them; part of the scene.
    """

    scene: Scene
    source: str
    frames: tuple[int, ...]
    resolution: tuple[int, int]
    settings: Settings
    outputs: tuple[str, ...]
    crop: tuple[int, int, int, int] | None = None
    device: Any = None
    memory: int | None = None
    cameras: tuple[int, ...] = ()
    files: Mapping[str, str] = field(default_factory=dict)
    animation: tuple[str | int | None, float | None] = (None, None)
    shutter: tuple[float, float] | None = None


@dataclass(frozen=True)
class Task:
    """One frame through one camera: its files, and the identity of what they are to show.

    ``camera`` is the place of the camera among the scene's, None for the scene's own; ``name``
    is its name. Where the scene's files are not known ``identity`` is empty, and no file is
    complete.
    """

    frame: int
    camera: int | None
    name: str
    paths: tuple[Path, ...]
    identity: str

    @property
    def label(self) -> str:
        """What messages call it."""
        return f"frame {self.frame}" + ("" if self.camera is None else f", camera {self.name}")


@dataclass(frozen=True)
class Report:
    """What came of a frame: seconds, by stage too, counts, notes, bytes of its files, device."""

    device: str
    seconds: float
    timings: Mapping[str, float]
    stats: Mapping[str, int]
    notes: tuple[str, ...]
    sizes: tuple[int, ...]


def opened(scene: Scene, shutter: tuple[float, float] | None) -> Scene:
    """``scene`` with another shutter, if any: when it opens and closes, for all cameras."""
    if shutter is None:
        return scene
    changed = replace(scene.shutter, open=shutter[0], close=shutter[1])
    cameras = [replace(view, shutter=None) for view in scene.cameras]
    return replace(scene, shutter=changed, cameras=cameras)


def plan_tasks(job: Job) -> list[Task]:
    """Every frame through every camera, one camera after the other.

    Raises
    ------
    UsageError
        Where two of them, or two outputs, would go to one file, or onto a file of the scene.
    """
    from mbinterval.batch.identity import frame_identity

    tasks = []
    for camera in job.cameras or (None,):
        scene = job.scene if camera is None else job.scene.through(camera)
        name = _camera_name(scene, camera)
        first = 0 if job.scene.cameras else None
        for frame in job.frames:
            identity = job.files and frame_identity(
                job.files,
                animation=job.animation,
                frame=frame,
                camera=first if camera is None else camera,
                shutter=scene.shutter,
                resolution=job.resolution,
                crop=job.crop,
                settings=job.settings,
            )
            paths = tuple(frame_path(output, frame, name) for output in job.outputs)
            tasks.append(Task(frame, camera, name, paths, identity or ""))
    _check_clashes(job, tasks)
    return tasks


def _camera_name(scene: Scene, camera: int | None) -> str:
    if scene.camera is None:
        return "framing"
    return scene.camera.name or ("camera" if camera is None else str(camera))


def check_exports(job: Job) -> None:
    """Raise `UsageError` for what would go to no file, and for a file of a missing package's."""
    formats = [format_of(output) for output in job.outputs]
    parts = {format.part for format in formats}
    for name in EXPORTS:
        if name in job.settings.aovs and name not in parts:
            raise UsageError(
                f"aovs: {name} goes to files of its own; add an output such as name.{FRAME_PLACE}"
                f"{ending_for(name)}"
            )
    for format in formats:
        format.check()


def _check_clashes(job: Job, tasks: Sequence[Task]) -> None:
    frames = len(job.frames)
    for output in job.outputs:
        if frames > 1 and not is_numbered(output):
            raise UsageError(
                f"output {output!r}: {frames} frames would overwrite each other; put {FRAME_PLACE} "
                f"where the frame's number belongs in the file's name, as in name.{FRAME_PLACE}"
                f"{Path(output).suffix}"
            )
        if len(job.cameras) > 1 and not has_camera(output):
            raise UsageError(
                f"output {output!r}: {len(job.cameras)} cameras would overwrite each other; put "
                f"{CAMERA_PLACE} where the camera's name belongs in the file's name"
            )
    taken: dict[str, str] = {}
    read = _read_files(job)
    for task in tasks:
        for path in task.paths:
            place = _real(path)
            if place is None:  # a pipe may be given twice
                continue
            if place in read:
                raise UsageError(f"output {str(path)!r} is a file that the scene is read from")
            other = taken.get(place)
            if other == task.label:
                raise UsageError(f"output {str(path)!r} is given twice")
            if other is not None:
                raise UsageError(f"output {str(path)!r} of {task.label} is that of {other} too")
            taken[place] = task.label


def _real(path: str | Path) -> str | None:
    place = output_place(path)
    return None if place is None else os.path.realpath(place)


def _read_files(job: Job) -> set[str]:
    folder = Path(job.source).parent
    return {os.path.realpath(folder / name) for name in job.files}


def check_apart(job: Job, tasks: Sequence[Task], stats: str | None, log: str | None) -> None:
    """Raise `UsageError` where statistics or a log would go onto another file of the job."""
    frames = {_real(path) for task in tasks for path in task.paths} - {None}
    places = [path and _real(path) for path in (stats, log)]
    if places[0] in frames | _read_files(job):
        raise UsageError(f"{stats}: is another file of the job; give another name")
    if places[1] and places[1] in frames | {places[0]}:
        raise UsageError(f"{log}: is another file of the job; give another name")


def prepare(tasks: Sequence[Task]) -> None:
    """Make the folders, check that they can be written to, and clear up after killed processes."""
    folders = set()
    for path in (path for task in tasks for path in task.paths):
        place = output_place(path)
        if place is None or place.parent not in folders:
            prepare_output(path)
            folders.add(path if place is None else place.parent)


def survey(tasks: Sequence[Task]) -> dict[Task, str]:
    """Say of every task why it is to be rendered; of a complete one, the empty text.

    Raises
    ------
    OutputError
        Where a file is not provably of mbinterval, which is not replaced unasked.
    """
    from mbinterval.batch.identity import why_not

    reasons: dict[Task, str] = {}
    for task in tasks:
        found = [(path, why_not(path, task.identity)) for path in task.paths]
        for path, reason in found:
            if reason:
                _check_replaceable(path)
        reasons[task] = "; ".join(f"{path} {reason}" for path, reason in found if reason)
    return reasons


def _check_replaceable(path: Path) -> None:
    check_replaceable(path, path.suffix.lower(), "--overwrite replaces it")


def render_task(job: Job, task: Task, progress: Progress | None = None) -> Film:
    """Render one frame; the film says what it is."""
    scene = job.scene if task.camera is None else job.scene.through(task.camera)
    with told_of(job.source, task.frame):
        film = render(
            scene,
            frame=task.frame,
            width=job.resolution[0],
            height=job.resolution[1],
            settings=job.settings,
            device=job.device,
            crop=job.crop,
            memory=job.memory,
            progress=progress,
        )
    return identified(task, film)


def identified(task: Task, film: Film) -> Film:
    """``film`` with the identity of the task that it was rendered for, if that has one."""
    from mbinterval.batch.identity import IDENTITY

    if not task.identity:
        return film
    return replace(film, metadata={**film.metadata, IDENTITY: task.identity})


def write_task(task: Task, film: Film, seconds: float, overwrite: bool) -> Report:
    """Write the files of a frame that took ``seconds`` to render.

    Raises
    ------
    OutputError
        Where a file can't be written; where it is not provably of mbinterval and not to be
        overwritten, also if it came while the frame was rendered.
    """
    started = time.perf_counter()
    if not overwrite:
        for path in task.paths:
            _check_replaceable(path)
    for path in task.paths:
        film.write(path)
    took = time.perf_counter() - started
    return Report(
        device=film.device,
        seconds=seconds + took,
        timings={**film.timings, "write": took},
        stats=film.stats,
        notes=film.notes,
        sizes=tuple(path.stat().st_size for path in task.paths),  # 0 of what keeps nothing
    )


@contextmanager
def told_of(source: str, frame: int) -> Iterator[None]:
    """Name file and frame where a scene turns out to be wrong only in a frame of it."""
    try:
        yield
    except SceneError as error:
        raise SceneError(f"{source}: frame {frame}: {error}") from error


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Hold back the first Ctrl-C or SIGTERM until the block is done; the second one counts."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    held: list[int] = []
    before: dict[int, Any] = {}

    def hold(number: int, frame: Any) -> None:
        held.append(number)
        if len(held) > 1:
            before[number](number, frame)

    wanted: tuple[int, ...] = (signal.SIGINT, signal.SIGTERM)
    for number in wanted:
        if callable(signal.getsignal(number)):
            before[number] = signal.signal(number, hold)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if held:
        signal.raise_signal(held[0])
