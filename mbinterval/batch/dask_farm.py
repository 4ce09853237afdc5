"""Many machines, through Dask: frames, or bands of large ones, are tasks of its workers.

A worker reads the scene once, from the same path as here, and keeps its OpenCL context and its
kernels as long as it lives. Films come back to the process that asked, which writes the files.
A worker that is lost costs the frame in its work: Dask gives that to another one.
"""

from __future__ import annotations

import logging
import math
import queue
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mbinterval.batch.batch import Job, Task, identified, plan_tasks
from mbinterval.batch.dask_worker import Done, Order, render_part
from mbinterval.batch.local_engines import Engine, Outcome, Outcomes, Tell
from mbinterval.errors import DeviceError, UsageError
from mbinterval.film.bands import Crop, join, split
from mbinterval.film.film import Film
from mbinterval.film.frame_ranges import parse_frames, resolution
from mbinterval.settings.settings import Settings
from mbinterval.values import whole_number

_log = logging.getLogger(__name__)

_LARGE = 2**23
"""Pixels of a task, if a frame has more: one of 3840 x 2160 stays whole."""

_PATIENCE = 5.0
"""Seconds between looks at whether any worker is left."""


def farm(
    source: str | Path,
    frames: str | Iterable[int],
    *,
    dask: Any,
    width: int | None = None,
    height: int | None = None,
    settings: Settings | None = None,
    camera: str | int | None = None,
    device: Any = None,
    parts: int | None = None,
) -> Iterator[tuple[int, Film]]:
    """Render frames of a scene file or model on the workers of a Dask cluster.

    Parameters
    ----------
    source
        The file. Every worker reads it, and what it names, at the same path; contents are compared.
    frames
        Frame numbers, or a range such as ``"1-24x2"``.
    dask
        Address of a scheduler, such as ``"tcp://10.0.0.1:8786"``, or a ``distributed.Client``.
    width, height
        In pixels; None is what the file proposes, or 1024 x 768.
    settings
        How to render; None takes those of the file.
    camera
        Name or index of one of the scene's cameras; None is the first.
    device
        Device of every worker, an index or a part of a name, as for `render`.
    parts
        Bands that a frame is cut into; None cuts where there are more workers than frames, and
        frames of more than 8 million pixels. It changes speed, never the image.

    Yields
    ------
    Frame and film, in the order in which they are done, equal to those of `render` there.

    Raises
    ------
    UsageError
        Where no scheduler answers, and where a worker has another version of this program.
    SceneError
        Where a worker has no such files, or others.
    """
    from mbinterval.batch.identity import named_digests
    from mbinterval.scene.formats.load import load_file

    loaded = load_file(source)
    stored = loaded.render
    job = Job(
        scene=loaded.scene,
        source=str(source),
        frames=tuple(parse_frames(frames) if isinstance(frames, str) else frames),
        resolution=resolution(width, height, stored.width, stored.height),
        settings=Settings.from_mapping(loaded.settings) if settings is None else settings,
        outputs=(),
        device=device,
        cameras=() if camera is None else (loaded.scene.camera_index(str(camera)),),
        files=named_digests(loaded.files),
    )
    engine = on_dask(dask, parts)
    for outcome in engine(job, plan_tasks(job), lambda _number, _label: None):
        yield outcome.task.frame, outcome.rendered()


def on_dask(dask: Any, parts: int | None = None) -> Engine:
    """Make an engine that renders on a Dask cluster: see `farm` for the parameters.

    At any time a few tasks for each thread of the workers are on their way, so that films wait here
    and not in the workers' memory.
    """
    if parts is not None:
        whole_number(parts, "parts", 1)

    def render(job: Job, tasks: Sequence[Task], tell: Tell) -> Outcomes:
        with _client(dask) as client:
            yield from _Farm(client, job, tasks, parts).outcomes(tell)

    return render


@contextmanager
def _client(dask: Any) -> Iterator[Any]:
    """Client of the scheduler at an address, or the client itself."""
    try:
        from distributed import Client
    except ImportError:
        raise UsageError("many machines need Dask: pip install 'mbinterval[dask]'") from None
    if isinstance(dask, Client):
        yield dask
        return
    if not isinstance(dask, str):
        raise UsageError(f"dask={dask!r}: expected the address of a scheduler, or a Client")
    try:
        client = Client(dask, timeout=10, set_as_default=False)
    except (OSError, ValueError) as error:
        raise UsageError(
            f"no Dask scheduler answers at {dask} ({error}); start one with: dask scheduler"
        ) from None
    try:
        yield client
    finally:
        with _unheard():
            client.close(timeout=10)


@contextmanager
def _unheard() -> Iterator[None]:
    """What calls in flight say on Dask's event loop when a job ends early is of use to nobody."""
    loggers = [logging.getLogger(name) for name in ("tornado.application", "distributed")]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)


class _Farm:
    """A job on its way: tasks that wait, those that workers have, and bands that came back."""

    def __init__(self, client: Any, job: Job, tasks: Sequence[Task], parts: int | None) -> None:
        from mbinterval.batch.identity import program_digest
        from mbinterval.plan.plan import check_crop

        self.client, self.job, self.count = client, job, len(tasks)
        self.order = Order(
            source=str(Path(job.source).absolute()),
            files=dict(job.files),
            program=program_digest(),
            animation=job.animation,
            shutter=job.shutter,
            resolution=job.resolution,
            settings=job.settings,
            device=job.device,
            memory=job.memory,
        )
        region = check_crop(job.crop, *job.resolution)
        pixels = region[2] * region[3]
        least = math.ceil(self._threads() / max(self.count, 1))
        count = max(least, math.ceil(pixels / _LARGE)) if parts is None else parts
        self.bands = split(region, count)
        self.waiting = deque((task, band) for task in tasks for band in self.bands)
        self.running: dict[Any, tuple[Task, Crop]] = {}
        self.back: dict[Task, list[Done]] = {task: [] for task in tasks}
        self.done: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self.failed: set[str] = set()
        self.alone = False

    def outcomes(self, tell: Tell) -> Outcomes:
        """Yield each frame when all of its bands are there."""
        ready = 0
        try:
            while self.waiting or self.running:
                self._submit()
                found = self._next()
                if found is None:
                    continue
                task, done = found
                self.back[task].append(done)
                if done.error is None and len(self.back[task]) < len(self.bands):
                    continue
                ready += 1
                yield self._outcome(task, done)
                progress = tell(ready, task.label)
                if progress is not None:
                    progress(1.0)
        finally:
            with _unheard():
                self.client.cancel(list(self.running))

    def _outcome(self, task: Task, last: Done) -> Outcome:
        bands = self.back.pop(task)
        films = [done.film for done in bands if done.film is not None]
        film = identified(task, join(films)) if last.error is None else None
        return Outcome(task, film, last.error, sum(done.seconds for done in bands))

    def _threads(self) -> int:
        return max(sum(map(int, self.client.nthreads().values())), 1)

    def _submit(self) -> None:
        """Give the workers as much as keeps them busy, and none to those whose device failed."""
        most = 2 * self._threads()
        while self.waiting and len(self.running) < most:
            task, band = self.waiting.popleft()
            others = [name for name in self.client.nthreads() if name not in self.failed]
            future = self.client.submit(
                render_part,
                self.order,
                task.frame,
                task.camera,
                band,
                pure=False,
                workers=others if self.failed else None,
            )
            self.running[future] = task, band
            future.add_done_callback(self.done.put)

    def _next(self) -> tuple[Task, Done] | None:
        """Wait for a task that is done; None where the device failed and another worker has it."""
        while True:
            try:
                future = self.done.get(timeout=_PATIENCE)
                break
            except queue.Empty:
                if not self.alone and not set(self.client.nthreads()) - self.failed:
                    _log.warning("mbinterval: no Dask worker that works is there; waiting for one")
                    self.alone = True
        task, band = self.running.pop(future)
        done = self._result(future, task)
        if isinstance(done.error, DeviceError) and self._elsewhere(done, task):
            self.waiting.appendleft((task, band))
            return None
        return task, done

    def _elsewhere(self, done: Done, task: Task) -> bool:
        """Whether another worker is there to do what the device of this one did not."""
        known = done.worker in self.failed
        self.failed.add(done.worker)
        others = set(self.client.nthreads()) - self.failed
        if others and not known:
            _log.warning(
                "mbinterval: worker %s: %s: %s; it gets no more frames",
                done.worker,
                task.label,
                done.error,
            )
        return bool(others)

    def _result(self, future: Any, task: Task) -> Done:
        from distributed.client import FutureCancelledError
        from distributed.scheduler import KilledWorker

        try:
            done: Done = future.result()
        except KilledWorker as error:
            lost = DeviceError(
                f"{task.label}: every worker that rendered it was lost ({error}); they may need "
                "more memory"
            )
            return Done(None, lost, 0.0, "")
        except FutureCancelledError as error:
            lost = DeviceError(f"{task.label}: Dask's scheduler gave it up ({error})")
            return Done(None, lost, 0.0, "")
        return done
