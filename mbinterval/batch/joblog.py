"""The log of a job: one JSON object a line, appended, so that a kill costs no earlier line.

A pipe or a device gets the lines as they come.

Events are ``start``, ``frame`` and ``end``. A job without ``end`` was killed.
"""

from __future__ import annotations

import json
import logging
import os
import socket
from collections.abc import Mapping
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any

from mbinterval.batch.batch import Job, Report, Task
from mbinterval.errors import OutputError, exit_code
from mbinterval.files.atomic import open_stream, output_place, prepare_output, write_all
from mbinterval.version import __version__

_log = logging.getLogger(__name__)


class JobLog:
    """Writes the lines of one job to ``path``; None writes nothing."""

    def __init__(self, path: str | Path | None) -> None:
        self._path = None if path is None else _checked(prepare_output(path))
        self._stream: int | None = None
        self._counts = {"rendered": 0, "complete": 0}

    def __enter__(self) -> JobLog:
        return self

    def __exit__(
        self,
        _kind: type[BaseException] | None,
        error: BaseException | None,
        _: TracebackType | None,
    ) -> None:
        """Write ``end``, with the exit code, and the error if there is one."""
        code = 0 if error is None else exit_code(error)
        said = {} if error is None else {"error": str(error) or type(error).__name__}
        try:
            self._write("end", exit=code, **self._counts, **said)
        except OutputError as unwritten:
            if error is None:
                raise
            _log.warning("mbinterval: %s", unwritten)
        finally:
            if self._stream is not None:
                os.close(self._stream)

    def start(self, job: Job, tasks: int, threads: int | None) -> None:
        """Write what the job is."""
        self._write(
            "start",
            version=__version__,
            host=socket.gethostname(),
            process=os.getpid(),
            scene=job.source,
            files=dict(job.files),
            frames=tasks,
            resolution=job.resolution,
            crop=job.crop,
            settings=asdict(job.settings),
            threads=threads,
            memory=job.memory,
        )

    def frame(
        self,
        task: Task,
        status: str,
        *,
        reason: str = "",
        report: Report | None = None,
        error: BaseException | None = None,
    ) -> None:
        """Write what came of a frame: ``rendered``, ``complete`` or ``failed``."""
        if status in self._counts:
            self._counts[status] += 1
        record: dict[str, Any] = {
            "frame": task.frame,
            "camera": task.name,
            "status": status,
            "identity": task.identity,
            "outputs": [str(path) for path in task.paths],
        }
        if reason:
            record["reason"] = reason
        if report is not None:
            record |= _plain(report)
        if error is not None:
            record |= {"exit": exit_code(error), "error": str(error) or type(error).__name__}
        self._write(**{"event": "frame", **record})

    def _write(self, event: str, **values: Any) -> None:
        if self._path is None:
            return
        now = datetime.now(UTC).isoformat(timespec="milliseconds")
        line = json.dumps({"event": event, "time": now, **values}) + "\n"
        try:
            if output_place(self._path) is None:
                self._send(self._path, event, line)
            else:
                _append(self._path, line)
        except OSError as error:
            raise OutputError(
                f"{self._path}: cannot be written ({error.strerror or error})"
            ) from error

    def _send(self, path: Path, event: str, line: str) -> None:
        """Send a line to a pipe, which stays open: its reader takes the end for that of all."""
        if self._stream is None and event == "end":
            return  # it was stopped while it waited for a reader
        if self._stream is None:
            self._stream = open_stream(path)
        write_all(self._stream, line.encode())


def _append(path: Path, line: str) -> None:
    with path.open("ab+", buffering=0) as file:
        file.seek(max(file.seek(0, os.SEEK_END) - 1, 0))
        if file.read(1) not in (b"", b"\n"):  # a line that a full disk cut off
            line = "\n" + line
        write_all(file.fileno(), line.encode())


def _checked(path: Path) -> Path:
    """Refuse to append to a file that is no log."""
    if output_place(path) is None:
        return path
    try:
        with path.open("rb") as file:
            first = file.read(1 << 16).lstrip()
    except FileNotFoundError:
        return path
    except OSError as error:
        raise OutputError(f"{path}: cannot be read ({error.strerror or error})") from error
    if first and not first.startswith(b'{"event"'):
        raise OutputError(f"{path}: is there, and no log of mbinterval; give another name")
    return path


def _plain(report: Report) -> Mapping[str, Any]:
    return {
        "device": report.device,
        "seconds": round(report.seconds, 6),
        "timings": {name: round(value, 6) for name, value in report.timings.items()},
        "stats": dict(report.stats),
        "bytes": list(report.sizes),
        "notes": list(report.notes),
    }
