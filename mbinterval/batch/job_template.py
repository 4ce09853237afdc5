"""A batch as an Open Job Description template, for render farms that schedule by it.

The format is that of specification 2023-09 (https://github.com/OpenJobDescription). Every task is a
`mbinterval render` of some frames, with the options that were given; a frame that is complete is
not rendered again, so a task may be lost and repeated.
"""

from __future__ import annotations

import argparse
import itertools
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mbinterval.batch.batch import Job
from mbinterval.errors import UsageError

_MOST_TASKS = 1024  # that a list of values may have
_MOST_NAME = 64


def job_template(job: Job, options: Sequence[str], per_task: int) -> str:
    """Return the template as JSON, which is YAML too.

    Parameters
    ----------
    job
        What is to be rendered.
    options
        Options of ``mbinterval render``, but for scene, frames and outputs.
    per_task
        Frames of a task.
    """
    # The format wants default paths to be relative to the template, so the scene is no parameter.
    scene = str(Path(job.source).absolute())
    outputs = [str(Path(output).absolute()) for output in job.outputs]
    for output in outputs:
        if "," in output or output != output.strip():
            raise UsageError(f"output {output!r}: commas and spaces part outputs; give another")
    given = [scene, *(f"--output={output}" for output in outputs), *options]
    for text in given:
        if "{{" in text:
            raise UsageError(
                f"{text!r}: Open Job Description takes '{{{{' for its own; give another name"
            )
    run = {
        "command": "{{Param.Command}}",
        "args": ["render", "--frames={{Task.Param.Frames}}", *given],
        "cancelation": {"mode": "NOTIFY_THEN_TERMINATE"},
    }
    template = {
        "specificationVersion": "jobtemplate-2023-09",
        "name": f"mbinterval {Path(job.source).stem}"[:_MOST_NAME],
        "parameterDefinitions": [
            {
                "name": "Command",
                "type": "STRING",
                "default": "mbinterval",
                "description": "The program on the machines of the farm.",
            },
        ],
        "steps": [
            {
                "name": "Render",
                "parameterSpace": {"taskParameterDefinitions": [_frames(job.frames, per_task)]},
                "script": {"actions": {"onRun": run}},
            }
        ],
    }
    return json.dumps(template, indent=2)


def _frames(frames: Sequence[int], per_task: int) -> dict[str, Any]:
    """Task parameter "Frames": a number for each task, or a range of ``per_task`` of them."""
    if per_task == 1:
        return {"name": "Frames", "type": "INT", "range": frame_ranges(frames)}
    groups = [frames[first : first + per_task] for first in range(0, len(frames), per_task)]
    if len(groups) > _MOST_TASKS:
        least = -(-len(frames) // _MOST_TASKS)
        raise UsageError(f"{len(groups)} tasks are too many; --per-task {least} or more makes less")
    return {"name": "Frames", "type": "STRING", "range": [frame_ranges(group) for group in groups]}


def frame_ranges(frames: Sequence[int]) -> str:
    """Range of ``frames``, as short as steps of one allow: ``1-3,7``.

    >>> frame_ranges([1, 2, 3, 7])
    '1-3,7'
    """
    runs = itertools.groupby(enumerate(sorted(frames)), key=lambda item: item[1] - item[0])
    ends = [[number for _, number in run] for _, run in runs]
    return ",".join(f"{run[0]}-{run[-1]}" if run[1:] else str(run[0]) for run in ends)


def render_options(given: Sequence[str], scene: str) -> list[str]:
    """Options of a command line, after the command, that a task passes on as they are."""
    own = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    for names in (("--frames",), ("-o", "--output"), ("--per-task",), ("--log",)):
        own.add_argument(*names, action="append")
    known, rest = own.parse_known_args(list(given))
    rest.remove(scene)
    return rest + [f"--log={Path(log).absolute()}" for log in (known.log or ())[-1:]]
