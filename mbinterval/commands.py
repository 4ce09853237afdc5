"""What the commands of the command line do, through the public API."""

from __future__ import annotations

import argparse
import logging
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mbinterval
from mbinterval.atomic import prepare_output
from mbinterval.errors import MbintervalError, SceneError, UsageError
from mbinterval.frames import (
    frame_path,
    is_numbered,
    parse_frames,
    parse_outputs,
    resolution,
)
from mbinterval.settings import SETTINGS, Settings, check_setting, conflicts

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Job:
    """What is to be rendered, after the command line has overruled the scene file.

    ``crop`` is column, row, width and height in pixels, or None for the whole frame.
    """

    scene: Any
    frames: tuple[int, ...]
    resolution: tuple[int, int]
    crop: tuple[int, int, int, int] | None
    settings: Settings
    outputs: tuple[str, ...]
    device: str | None


def render(arguments: argparse.Namespace) -> None:
    """``mbinterval render``: every frame to every output; each note about the scene once."""
    from mbinterval.atomic import prepare_output
    from mbinterval.film import check_output
    from mbinterval.stats_file import stats_row, write_stats

    job = make_job(arguments)
    if arguments.stats:
        prepare_output(arguments.stats)
    paths = output_paths(job.outputs, job.frames)
    for path in (path for group in paths.values() for path in group):
        check_output(path)
    width, height = job.resolution
    said: set[str] = set()
    rows: list[dict[str, Any]] = []
    with _progress(job.frames) as progress:
        for number, frame in enumerate(job.frames, start=1):
            started = time.perf_counter()
            with _told_of(arguments.scene, frame):
                film = mbinterval.render(
                    job.scene,
                    frame=frame,
                    width=width,
                    height=height,
                    settings=job.settings,
                    device=job.device,
                    crop=job.crop,
                    progress=progress(number, frame),
                )
            for note in film.notes:
                if note not in said:
                    _log.warning("mbinterval: note: %s", note)
            said.update(film.notes)
            if arguments.stats:
                rows.append(stats_row(frame, film, job.settings))
                write_stats(arguments.stats, rows)
            written = ", ".join(str(film.write(path)) for path in paths[frame])
            seconds = time.perf_counter() - started
            place = f"{number}/{len(job.frames)}"
            _log.info("frame %d (%s): %.2f s -> %s", frame, place, seconds, written)
            _log.debug("%s", _timing_lines(film.timings))


def info(arguments: argparse.Namespace) -> None:
    """``mbinterval info``: the plan of the first frame, with the reason for each effect."""
    from mbinterval.describe import describe

    job = make_job(arguments)
    frame, size, count = job.frames[0], job.resolution, len(job.frames)
    with _told_of(arguments.scene, frame):
        text = describe(job.scene, frame, *size, job.settings, job.crop, job.device)
    if count > 1:
        print(f"of {count} frames, from {frame} to {job.frames[-1]}, the first is described")
    print(text)


@contextmanager
def _told_of(scene: str, frame: int) -> Iterator[None]:
    """Name file and frame where a scene turns out to be wrong only in a frame of it."""
    try:
        yield
    except SceneError as error:
        raise SceneError(f"{scene}: frame {frame}: {error}") from error


def bench(arguments: argparse.Namespace) -> None:
    """``mbinterval bench``: measure, print, and compare with a baseline."""
    from mbinterval import bench as benchmark
    from mbinterval.bench_cases import make_case
    from mbinterval.bench_report import changes, comparison, read_result, table, write_result

    if arguments.tolerance is not None and arguments.baseline is None:
        raise UsageError("tolerance is for comparing with a baseline; give --baseline FILE")
    before = read_result(arguments.baseline) if arguments.baseline else None
    if arguments.json:
        prepare_output(arguments.json)
    scenes = arguments.scenes or benchmark.SCENES
    references = arguments.reference or ["-"] * len(scenes)
    if len(references) != len(scenes):
        raise UsageError(
            f"{len(references)} references for {len(scenes)} scenes; give one for each, - for none"
        )
    size = arguments.width, arguments.height
    cases = [
        make_case(
            name,
            None if file == "-" else file,
            *size,
            single_sided=arguments.single_sided,
            at_rest=arguments.at_rest,
        )
        for name, file in zip(scenes, references, strict=True)
    ]
    rows: Iterable[str] = benchmark.ROWS
    if arguments.rows is not None or arguments.settings:
        names = [row.strip() for row in (arguments.rows or "").split(",")]
        rows = [*filter(None, names), *(arguments.settings or ())]
    result = benchmark.measure(cases, rows, arguments.rounds or benchmark.ROUNDS, arguments.device)
    print(table(result))
    if arguments.json:
        write_result(arguments.json, result)
    if before is None:
        return
    found = changes(result, before)
    print(f"\n{comparison(found, result, before)}")
    tolerance = 0.1 if arguments.tolerance is None else arguments.tolerance
    slower = [f"{c.scene}, {c.row}: {c.ratio:.2f}" for c in found if c.ratio > 1.0 + tolerance]
    if slower:
        raise MbintervalError(
            f"slower than {arguments.baseline} by more than {tolerance:.0%}: {'; '.join(slower)}"
        )


def devices(_arguments: argparse.Namespace) -> None:
    """``mbinterval devices``: one line for each device."""
    from mbinterval.device.choose import choose_device

    listed = mbinterval.devices()
    if not listed:
        choose_device()  # raises, and explains why there is none
    for device in listed:
        memory = device.memory_bytes / 2**30
        remark = "" if device.usable else "; not usable: no double precision"
        print(
            f"{device.index}: {device.name} ({device.platform}, {device.kind}, "
            f"{device.compute_units} compute units, {memory:.1f} GiB{remark})"
        )


def make_job(arguments: argparse.Namespace) -> Job:
    """Join command line and scene file; the command line wins."""
    from mbinterval.scene.load import load_file

    given = vars(arguments)
    overruled = {
        name: check_setting(name, value) for name, value in given.items() if name in SETTINGS
    }
    if given.get("stats"):
        overruled["statistics"] = True
    loaded = load_file(arguments.scene, overruled=overruled, clip=arguments.clip, fps=arguments.fps)
    stored = loaded.render
    job = Job(
        scene=_scene(loaded.scene, arguments.shutter),
        frames=tuple(arguments.frames or parse_frames(stored.frames or "1")),
        resolution=resolution(arguments.width, arguments.height, stored.width, stored.height),
        crop=arguments.crop,
        settings=_settings(arguments.scene, loaded.settings, overruled),
        outputs=_outputs(given.get("output"), stored.output, arguments.scene),
        device=arguments.device,
    )
    if not arguments.frames and not given.get("output") and stored.frames and stored.output:
        try:
            output_paths(job.outputs, job.frames)
        except UsageError as error:
            raise SceneError(f"{arguments.scene}: render: {error}") from error
    return job


def _scene(scene: Any, shutter: tuple[float, float] | None) -> Any:
    """``scene`` with the shutter of the command line, if any: open and close."""
    if shutter is None:
        return scene
    opened = replace(scene.shutter, open=shutter[0], close=shutter[1])
    return replace(scene, shutter=opened)


def output_paths(outputs: Sequence[str], frames: Sequence[int]) -> dict[int, list[Path]]:
    """Files of each frame.

    Raises
    ------
    UsageError
        Where two frames or two outputs would go to the same file.
    """
    paths = {frame: [frame_path(output, frame) for output in outputs] for frame in frames}
    for output in outputs:
        if len(frames) > 1 and not is_numbered(output):
            ending = Path(output).suffix
            raise UsageError(
                f"output {output!r}: {len(frames)} frames would overwrite each other; "
                f"put #### where the frame's number belongs, as in name.####{ending}"
            )
    doubled = [path for group in paths.values() for path in group if group.count(path) > 1]
    if doubled:
        raise UsageError(f"output {str(doubled[0])!r} is given twice")
    return paths


def _settings(scene: str, stored: Mapping[str, Any], overruled: Mapping[str, Any]) -> Settings:
    """Settings of the scene file under those of the command line."""
    joined = {**stored, **overruled}
    for conflict in conflicts(joined):
        theirs = [name for name in conflict.names if name in stored and name not in overruled]
        options = " or ".join(f"--{name.replace('_', '-')}" for name in theirs)
        where = f" ({theirs[0]} is from {scene}; {options} overrules it)" if theirs else ""
        raise UsageError(f"{conflict.text}{where}")
    return Settings.from_mapping(joined)


def _outputs(given: Sequence[list[str]] | None, stored: str | None, scene: str) -> tuple[str, ...]:
    if given:
        return tuple(output for outputs in given for output in outputs)
    return tuple(parse_outputs(stored)) if stored else (f"{Path(scene).stem}.####.exr",)


Progress = Callable[[float], None]


@contextmanager
def _progress(frames: Sequence[int]) -> Iterator[Callable[[int, int], Progress | None]]:
    """Show a bar on a terminal; log lines go above it. Elsewhere the lines say it all.

    What it gives takes a frame's place in the row and its number, and returns what is to be
    told the fraction of it that is done.
    """
    if not sys.stderr.isatty() or not _log.isEnabledFor(logging.INFO):
        yield lambda _place, _frame: None
        return
    from tqdm import tqdm
    from tqdm.contrib.logging import logging_redirect_tqdm

    total = len(frames)
    bar = tqdm(
        total=total,
        file=sys.stderr,
        bar_format="{desc}{percentage:3.0f}% |{bar}| {elapsed}, {remaining} to go",
        dynamic_ncols=True,
        miniters=0,  # otherwise it would wait for steps as large as whole frames
        leave=False,
    )

    def progress(place: int, frame: int) -> Progress:
        def tell(part: float) -> None:
            # Tiles that are done again with more room take nothing back.
            bar.update(max(place - 1 + part - bar.n, 0.0))

        bar.set_description_str(f"frame {frame} ({place}/{total}) ", refresh=False)
        tell(0.0)
        bar.refresh()
        return tell

    with logging_redirect_tqdm([logging.getLogger("mbinterval")]), bar:
        yield progress


def _timing_lines(timings: Mapping[str, float]) -> str:
    return "\n".join(f"    {stage:<12} {seconds:9.4f} s" for stage, seconds in timings.items())
