"""What the commands of the command line do, through the public API."""

from __future__ import annotations

import argparse
import logging
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mbinterval.cli.option_values import several_devices
from mbinterval.errors import MbintervalError, SceneError, UsageError
from mbinterval.files.ownership import SOFTWARE
from mbinterval.film.file_names import CAMERA_PLACE, FRAME_PLACE, literal, parse_outputs
from mbinterval.film.formats import format_of
from mbinterval.film.frame_ranges import parse_frames, resolution
from mbinterval.settings.settings import SETTINGS, Settings, check_setting, conflicts

if TYPE_CHECKING:
    from mbinterval.batch.batch import Job, Task
    from mbinterval.batch.joblog import JobLog
    from mbinterval.batch.local_engines import Engine, Outcomes
    from mbinterval.batch.stats_file import StatsFile
    from mbinterval.scene.model import Scene

_log = logging.getLogger(__name__)


def render(arguments: argparse.Namespace) -> None:
    """``mbinterval render``: the frames that are not complete; each note about the scene once."""
    from mbinterval.batch.batch import check_apart, check_exports, plan_tasks, prepare, survey
    from mbinterval.batch.joblog import JobLog
    from mbinterval.batch.stats_file import StatsFile
    from mbinterval.device.opencl import THREADS

    if arguments.threads is not None:
        os.environ[THREADS] = str(arguments.threads)
    job = make_job(arguments)
    check_exports(job)
    tasks = plan_tasks(job)
    engine = _engine(arguments)
    check_apart(job, tasks, arguments.stats, arguments.log)
    prepare(tasks)
    figures = StatsFile(arguments.stats, arguments.overwrite)
    with JobLog(arguments.log) as log:
        log.start(job, len(tasks), arguments.threads)
        reasons = dict.fromkeys(tasks, "--overwrite") if arguments.overwrite else survey(tasks)
        if arguments.stats:
            reasons = {task: reason or "--stats counts it" for task, reason in reasons.items()}
        waiting = [task for task in tasks if reasons[task]]
        for task in tasks:
            if not reasons[task]:
                log.frame(task, "complete")
        if len(waiting) < len(tasks):
            _log.info("%s", _complete(len(tasks) - len(waiting), len(tasks)))
        for task in waiting:
            _log.debug("%s: %s", task.label, reasons[task])
        with _progress(len(waiting)) as tell:
            outcomes = engine(job, waiting, tell)
            with closing(outcomes), figures:
                _write_outcomes(job, outcomes, reasons, log, figures, arguments.overwrite)


def _complete(complete: int, count: int) -> str:
    if count == 1:
        return "the frame is complete and stays; --overwrite renders it again"
    which = "all" if complete == count else f"{complete} of"
    return f"{which} {count} frames are complete and stay; --overwrite renders them again"


def _engine(arguments: argparse.Namespace) -> Engine:
    """Who renders: Dask's workers, several devices, or one."""
    from mbinterval.batch.local_engines import on_devices, on_one_device
    from mbinterval.device.choose import choose_devices

    if arguments.parts is not None and not arguments.dask:
        raise UsageError("--parts goes with --dask: one machine renders whole frames")
    if arguments.dask:
        if arguments.threads is not None:
            raise UsageError("--threads is for this machine; of a worker say MBINTERVAL_THREADS")
        if several_devices(arguments.device):
            raise UsageError("--device names several; with --dask start a worker for each")
        from mbinterval.batch.dask_farm import on_dask

        return on_dask(arguments.dask, arguments.parts)
    if not several_devices(arguments.device):
        return on_one_device
    if arguments.memory is not None:
        raise UsageError("--memory is for one device; --device names several")
    return on_devices(choose_devices(arguments.device))


def _write_outcomes(
    job: Job,
    outcomes: Outcomes,
    reasons: Mapping[Task, str],
    log: JobLog,
    figures: StatsFile,
    overwrite: bool,
) -> None:
    """Write each frame as it is done; the first that failed ends the job."""
    from mbinterval.batch.batch import uninterrupted, write_task
    from mbinterval.batch.stats_file import stats_row

    said: set[str] = set()
    count = sum(map(bool, reasons.values()))
    for number, outcome in enumerate(outcomes, start=1):
        task, report = outcome.task, None
        try:
            film = outcome.rendered()
            with uninterrupted():
                report = write_task(task, film, outcome.seconds, overwrite)
                log.frame(task, "rendered", reason=reasons[task], report=report)
        except BaseException as error:
            if report is None:
                log.frame(task, "failed", reason=reasons[task], error=error)
            raise
        for note in film.notes:
            if note not in said:
                _log.warning("mbinterval: note: %s", note)
        said.update(film.notes)
        figures.add(stats_row(task.frame, film, job.settings))
        place, written = f"{number}/{count}", ", ".join(map(str, task.paths))
        _log.info("%s (%s): %.2f s -> %s", task.label, place, report.seconds, written)
        _log.debug("%s", _timing_lines(report.timings))


def openjd(arguments: argparse.Namespace) -> None:
    """``mbinterval openjd``: the batch as an Open Job Description template."""
    from mbinterval.batch.batch import plan_tasks
    from mbinterval.batch.job_template import job_template, render_options

    for name in ("dask", "parts", "stats"):
        if getattr(arguments, name) is not None:
            raise UsageError(f"--{name} does not go with a render farm, which runs frames itself")
    job = make_job(arguments)
    plan_tasks(job)
    options = render_options(arguments.given, arguments.scene)
    print(job_template(job, options, arguments.per_task))


def info(arguments: argparse.Namespace) -> None:
    """``mbinterval info``: the plan of the first frame, with the reason for each effect."""
    from mbinterval.batch.batch import told_of
    from mbinterval.rendering.describe import describe

    job = make_job(arguments)
    frame, size, count = job.frames[0], job.resolution, len(job.frames)
    scene = job.scene.through(job.cameras[0]) if job.cameras else job.scene
    with told_of(arguments.scene, frame):
        text = describe(scene, frame, *size, job.settings, job.crop, job.device)
    if count > 1:
        print(f"of {count} frames, from {frame} to {job.frames[-1]}, the first is described")
    print(text)


def bench(arguments: argparse.Namespace) -> None:
    """``mbinterval bench``: measure, print, and compare with a baseline."""
    from mbinterval.bench import bench as benchmark
    from mbinterval.bench.cases import make_case
    from mbinterval.bench.report import changes, comparison, read_result, table
    from mbinterval.files.results import check_result, write_result

    if arguments.tolerance is not None and arguments.baseline is None:
        raise UsageError("tolerance is for comparing with a baseline; give --baseline FILE")
    before = read_result(arguments.baseline) if arguments.baseline else None
    if arguments.json:
        check_result(arguments.json)
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
    print(table(result), flush=True)
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


def compare(arguments: argparse.Namespace) -> None:
    """``mbinterval compare``: renders and files against the first of them."""
    from mbinterval.comparison.comparison import compare as compare_films
    from mbinterval.comparison.sources import read_sources, render_sources, table, write_maps
    from mbinterval.files.results import check_result, write_result

    if arguments.json:
        check_result(arguments.json)
    sources = []
    for name in arguments.sources:
        if Path(name).suffix.lower() == ".exr":
            sources.append(read_sources(name))
        else:
            given = argparse.Namespace(**{**vars(arguments), "scene": name})
            sources += render_sources(given, make_job)
    if len(sources) < 2:
        raise UsageError(
            "one image is nothing to compare; give another file, or a scene with --with twice"
        )
    reference, *others = sources
    results = {}
    for source in others:
        name = source.name
        while name in results:
            name += "'"
        results[name] = compare_films(
            source.films, reference.films, samples=arguments.assume_samples, level=arguments.level
        )
    print(table(reference, results), flush=True)
    if arguments.maps:
        write_maps(Path(arguments.maps), results)
    if arguments.json:
        found = {name: result.as_dict() for name, result in results.items()}
        facts = {"software": SOFTWARE, "reference": reference.name, "images": found}
        write_result(arguments.json, facts)


def study(arguments: argparse.Namespace) -> None:
    """``mbinterval study``: what accuracy costs in time, in a folder of its own."""
    from mbinterval.cli.study_commands import run_study

    run_study(arguments)


def recommend(arguments: argparse.Namespace) -> None:
    """``mbinterval recommend``: settings that reach an error, or make the best of a time."""
    from mbinterval.cli.study_commands import run_recommend

    run_recommend(arguments)


def devices(_arguments: argparse.Namespace) -> None:
    """``mbinterval devices``: one line for each device."""
    from mbinterval.device.choose import choose_device
    from mbinterval.device.choose import devices as listed_devices

    listed = listed_devices()
    if not listed:
        choose_device()  # raises, and explains why there is none
    for device in listed:
        memory = device.memory_bytes / 2**30
        remark = "; kernels are shaped for CPUs" if device.kind != "CPU" else ""
        if not device.usable:
            remark = "; not usable: no double precision"
        print(
            f"{device.index}: {device.name} ({device.platform}, {device.kind}, "
            f"{device.compute_units} compute units, {memory:.1f} GiB{remark})"
        )


def make_job(arguments: argparse.Namespace) -> Job:
    """Join command line and scene file; the command line wins."""
    from mbinterval.batch.batch import Job, opened, plan_tasks
    from mbinterval.batch.identity import named_digests
    from mbinterval.scene.formats.load import load_file

    given = vars(arguments)
    overruled = {
        name: check_setting(name, value) for name, value in given.items() if name in SETTINGS
    }
    if given.get("stats"):
        overruled["statistics"] = True
    loaded = load_file(arguments.scene, overruled=overruled, clip=arguments.clip, fps=arguments.fps)
    stored = loaded.render
    scene = opened(loaded.scene, arguments.shutter)
    cameras = _cameras(scene, arguments.camera)
    outputs = _outputs(given.get("output"), stored.output, arguments.scene, len(cameras))
    job = Job(
        scene=scene,
        source=arguments.scene,
        frames=tuple(arguments.frames or parse_frames(stored.frames or "1")),
        resolution=resolution(arguments.width, arguments.height, stored.width, stored.height),
        settings=_settings(arguments.scene, loaded.settings, overruled, outputs),
        outputs=outputs,
        crop=arguments.crop,
        device=arguments.device,
        memory=given.get("memory"),
        cameras=cameras,
        files=named_digests(loaded.files),
        animation=(arguments.clip, arguments.fps),
        shutter=arguments.shutter,
    )
    if not (arguments.frames or given.get("output") or cameras) and stored.frames and stored.output:
        try:
            plan_tasks(job)
        except UsageError as error:
            raise SceneError(f"{arguments.scene}: render: {error}") from error
    return job


def _cameras(scene: Scene, names: Sequence[str] | None) -> tuple[int, ...]:
    """Places of the cameras that were asked for, each once; none for the scene's own."""
    if "all" in (names or ()):
        return tuple(range(len(scene.cameras)))
    return tuple(dict.fromkeys(scene.camera_index(name) for name in names or ()))


def _settings(
    scene: str, stored: Mapping[str, Any], overruled: Mapping[str, Any], outputs: Sequence[str]
) -> Settings:
    """Settings of the scene file under those of the command line, and what ``outputs`` need."""
    joined = {**stored, **overruled}
    needed = list(dict.fromkeys(filter(None, (format_of(output).part for output in outputs))))
    if needed:
        joined["aovs"] = check_setting("aovs", [*joined.get("aovs", ()), *needed])
    for conflict in conflicts(joined):
        theirs = [name for name in conflict.names if name in stored and name not in overruled]
        options = " or ".join(f"--{name.replace('_', '-')}" for name in theirs)
        where = f" ({theirs[0]} is from {scene}; {options} overrules it)" if theirs else ""
        raise UsageError(f"{conflict.text}{where}")
    return Settings.from_mapping(joined)


def _outputs(
    given: Sequence[list[str]] | None, stored: str | None, scene: str, cameras: int
) -> tuple[str, ...]:
    if given:
        return tuple(output for outputs in given for output in outputs)
    if stored:
        return tuple(parse_outputs(stored))
    camera = f".{CAMERA_PLACE}" if cameras > 1 else ""
    return (f"{literal(Path(scene).stem)}{camera}.{FRAME_PLACE}.exr",)


Progress = Callable[[float], None]


@contextmanager
def _progress(total: int) -> Iterator[Callable[[int, str], Progress | None]]:
    """Show a bar on a terminal; log lines go above it. Elsewhere the lines say it all.

    What it gives takes a frame's place in the row and what it is called, and returns what is to
    be told the fraction of it that is done.
    """
    if not sys.stderr.isatty() or not _log.isEnabledFor(logging.INFO):
        yield lambda _place, _label: None
        return
    from tqdm import tqdm
    from tqdm.contrib.logging import logging_redirect_tqdm

    bar = tqdm(
        total=total,
        file=sys.stderr,
        bar_format="{desc}{percentage:3.0f}% |{bar}| {elapsed}, {remaining} to go",
        dynamic_ncols=True,
        miniters=0,  # otherwise it would wait for steps as large as whole frames
        leave=False,
    )

    def progress(place: int, label: str) -> Progress:
        def tell(part: float) -> None:
            # Tiles that are done again with more room take nothing back.
            bar.update(max(place - 1 + part - bar.n, 0.0))

        bar.set_description_str(f"{label} ({place}/{total}) ", refresh=False)
        bar.n = max(bar.n, place - 1)
        bar.refresh()
        return tell

    with logging_redirect_tqdm([logging.getLogger("mbinterval")]), bar:
        yield progress


def _timing_lines(timings: Mapping[str, float]) -> str:
    return "\n".join(f"    {stage:<12} {seconds:9.4f} s" for stage, seconds in timings.items())
