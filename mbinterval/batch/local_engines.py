"""Who renders the frames of a batch: this process on one device, or on several at once.

An engine takes a job and its tasks, and yields what came of each as it is done; the command that
asked writes the files, one frame after the other. `dask_farm` has one for many machines.
"""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

from mbinterval.batch.batch import Job, Progress, Task, render_task
from mbinterval.errors import CapacityError, DeviceError
from mbinterval.film.film import Film

_log = logging.getLogger(__name__)

Tell = Callable[[int, str], Progress | None]
"""What is told of progress: a frame's number in the row and its name give a function of a part."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """What came of a task: a film, or the error that it failed with; seconds of the render."""

    task: Task
    film: Film | None
    error: BaseException | None
    seconds: float

    def rendered(self) -> Film:
        """Return the film, or raise the error."""
        if self.film is None:
            raise self.error or DeviceError(f"{self.task.label}: no film")
        return self.film


Outcomes = Generator[Outcome, None, None]
Engine = Callable[[Job, Sequence[Task], Tell], Outcomes]


def on_one_device(job: Job, tasks: Sequence[Task], tell: Tell) -> Outcomes:
    """Render one frame after the other in this thread."""
    for number, task in enumerate(tasks, start=1):
        yield attempt(job, task, tell(number, task.label))


def attempt(job: Job, task: Task, progress: Progress | None) -> Outcome:
    """Render a frame; whatever it fails with is part of the outcome."""
    started = time.perf_counter()
    try:
        film = render_task(job, task, progress)
    except BaseException as error:
        return Outcome(task, None, error, time.perf_counter() - started)
    return Outcome(task, film, None, time.perf_counter() - started)


def on_devices(devices: Sequence[Any]) -> Engine:
    """Make an engine that shares frames out among ``devices``, a thread for each.

    A device that fails is told of and gets no more frames; its frame is rendered by another one. A
    frame that has no room on a device is tried on every other one, and the device goes on.
    """

    def render(job: Job, tasks: Sequence[Task], tell: Tell) -> Outcomes:
        crew = _Crew(job, tasks, devices)
        try:
            for number in range(1, len(tasks) + 1):
                outcome = crew.next()
                yield outcome
                progress = tell(number, outcome.task.label)
                if progress is not None:
                    progress(1.0)
        finally:
            crew.dismiss()

    return render


class _StoppedError(Exception):
    """Ends the render of a thread whose film nobody waits for."""


class _Crew:
    """Threads that render, each on its device, and what they have to do.

    ``waiting`` are tasks with the devices that could not render them, by their place in the row.
    """

    def __init__(self, job: Job, tasks: Sequence[Task], devices: Sequence[Any]) -> None:
        self.job, self.devices = job, devices
        self.waiting = deque((task, frozenset[int]()) for task in tasks)
        self.outcomes: queue.SimpleQueue[Outcome] = queue.SimpleQueue()
        self.changed = threading.Condition()
        self.stopped = False
        self.working = set(range(len(devices)))
        self.left = len(tasks)
        self.threads = [
            threading.Thread(target=self._work, args=(place,), name=f"device {place}")
            for place in range(len(devices))
        ]
        for thread in self.threads:
            thread.start()

    def next(self) -> Outcome:
        """Wait for a frame that is done, or failed for good; hears an interrupt meanwhile."""
        while True:
            with suppress(queue.Empty):
                return self.outcomes.get(timeout=0.2)

    def dismiss(self) -> None:
        """End the threads, and what they render."""
        with self.changed:
            self.stopped = True
            self.changed.notify_all()
        for thread in self.threads:
            thread.join()

    def _work(self, place: int) -> None:
        job = replace(self.job, device=self.devices[place])
        while (found := self._task(place)) is not None:
            task, tried = found
            outcome = attempt(job, task, self._tell)
            if not isinstance(outcome.error, _StoppedError):
                self._done(place, outcome, tried | {place})

    def _task(self, place: int) -> tuple[Task, frozenset[int]] | None:
        """Next task that this device has not tried yet; None when there is nothing more to do."""
        with self.changed:
            while not self.stopped and self.left and place in self.working:
                for number, (task, tried) in enumerate(self.waiting):
                    if place not in tried:
                        del self.waiting[number]
                        return task, tried
                self.changed.wait()
            return None

    def _done(self, place: int, outcome: Outcome, tried: frozenset[int]) -> None:
        with self.changed:
            self._judge(place, outcome, tried)
            self.changed.notify_all()

    def _judge(self, place: int, outcome: Outcome, tried: frozenset[int]) -> None:
        """Give the outcome, or, where others are left that may do better, the task to them."""
        error, task = outcome.error, outcome.task
        if isinstance(error, DeviceError):
            self.working.discard(place)
        others = self.working - tried
        if isinstance(error, DeviceError | CapacityError) and others:
            _log.warning(
                "mbinterval: device %s: %s: %s; another one renders it%s",
                self.devices[place].name.strip(),
                task.label,
                error,
                "" if place in self.working else " and what was left to this one",
            )
            self.waiting.appendleft((task, tried))
            return
        self.left -= 1
        self.outcomes.put(outcome)
        # What nobody is left to try has failed as well.
        for waiting, before in list(self.waiting):
            if not self.working - before:
                self.waiting.remove((waiting, before))
                self.left -= 1
                self.outcomes.put(Outcome(waiting, None, error, 0.0))

    def _tell(self, _part: float) -> None:
        if self.stopped:
            raise _StoppedError
