"""The command line: arguments in, one clear line and an exit code out; all work is the API's."""

from __future__ import annotations

import argparse
import difflib
import logging
import re
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields
from types import FrameType
from typing import Any, NoReturn

from mbinterval.cli import commands
from mbinterval.cli import evaluation_options as evaluation
from mbinterval.cli import option_values as values
from mbinterval.cli.streams import prepare_streams
from mbinterval.errors import MbintervalError, Terminated, exit_code
from mbinterval.film.file_names import parse_outputs
from mbinterval.film.frame_ranges import parse_frames
from mbinterval.settings.rules import rule_of
from mbinterval.settings.settings import Settings
from mbinterval.values import nearest
from mbinterval.version import __version__

_log = logging.getLogger("mbinterval")

_EXIT_CODES = """\
exit codes:
  0    done
  1    failure not listed here
  2    bad usage: an option or a setting is unknown or out of range
  3    bad scene: the scene file, or a file that it names, is wrong or missing
  4    no usable OpenCL device, or a kernel did not build
  5    out of capacity: the render needs more memory than there is
  6    an output file cannot be written
  130  interrupted by Ctrl-C; the frame in work leaves no file
  143  ended by SIGTERM; the frame in work leaves no file

Messages go to standard error; -q leaves only warnings and errors, -v adds details and, after an
error, the traceback.
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code; argparse itself exits for --help and usage."""
    prepare_streams()
    arguments = _arguments(list(sys.argv[1:] if argv is None else argv))
    with _messages(arguments.verbose - arguments.quiet), _interrupt_on_sigterm():
        try:
            arguments.run(arguments)
            sys.stdout.flush()
        except BrokenPipeError:
            return 0  # the reader of a pipe has gone; nothing is left to be said
        except (Exception, KeyboardInterrupt) as error:
            return _failed(error)
    return 0


def _arguments(argv: list[str]) -> argparse.Namespace:
    """Parse the arguments; what is unknown is an error with the nearest known name."""
    parser = _parser()
    command = next((text for text in argv if not text.startswith("-")), "")
    if argv and argv[0].startswith("-") and argv[0] not in ("-h", "--help", "--version"):
        parser.error(f"{argv[0]}: options come after the command, as in mbinterval render SCENE")
    if command and command not in COMMANDS:
        parser.error(f"unknown command {command!r}, {nearest(command, COMMANDS)}")
    arguments, rest = parser.parse_known_args(argv)
    arguments.given = argv[1:]
    for text in rest:
        command_parser = arguments.parser
        if not text.startswith("-"):
            command_parser.error(f"unexpected argument {text!r}")
        name = text.split("=")[0]
        options = re.findall(r"--[a-z-]+", command_parser.format_help())
        near = difflib.get_close_matches(name, options, n=1)
        hint = f"did you mean {near[0]}?" if near else "--help lists all"
        command_parser.error(f"unknown option {name}, {hint}")
    return arguments


def _failed(error: BaseException) -> int:
    """Say what went wrong, and return the exit code for it."""
    _log.debug("traceback:", exc_info=error)
    if isinstance(error, KeyboardInterrupt):
        how = "terminated" if isinstance(error, Terminated) else "interrupted"
        _log.error("mbinterval: %s", how)
    elif isinstance(error, MbintervalError):
        _log.error("mbinterval: error: %s", error)
    elif isinstance(error, MemoryError):
        _log.error(
            "mbinterval: error: out of memory; try a smaller image, --crop, or fewer samples"
        )
    else:
        kind = type(error).__name__
        _log.error("mbinterval: internal error: %s: %s (-v shows where)", kind, error)
    return exit_code(error)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="mbinterval",
        description="Render motion blur analytically in time, on OpenCL.",
        epilog=_EXIT_CODES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"mbinterval {__version__}")
    groups = parser.add_subparsers(required=True, metavar="COMMAND")
    for name, (run, summary, takes) in COMMANDS.items():
        command = _command(groups, name, run, summary)
        if name in ("render", "info", "openjd"):
            _add_scene_options(command)
        if name in ("render", "openjd"):
            _add_output_options(command)
        if name == "openjd":
            command.add_argument(
                "--per-task",
                type=values.argument(values.count),
                default=1,
                metavar="COUNT",
                help="frames of a task [1]",
            )
        if name == "bench":
            _add_bench_options(command)
        if name == "compare":
            evaluation.add_compare_options(command)
            _add_render_options(command)
        if name == "study":
            evaluation.add_study_options(command)
            _add_device_option(command)
        if name == "recommend":
            evaluation.add_recommend_options(command)
            _add_device_option(command)
        command.usage = f"mbinterval {name}{takes and ' '}{takes} [options]"
    return parser


COMMANDS = {
    "render": (commands.render, "render frames of a scene to EXR and PNG", "SCENE"),
    "info": (commands.info, "print what a render would do, and why", "SCENE"),
    "compare": (commands.compare, "measure how far images are from the first", "SOURCE ..."),
    "study": (commands.study, "measure what accuracy costs in time, and write a report", "SCENE"),
    "recommend": (commands.recommend, "find settings that reach an error or a time", "SCENE"),
    "bench": (commands.bench, "measure seconds, work and error of the methods", "[SCENE ...]"),
    "openjd": (commands.openjd, "print the batch as a template for render farms", "SCENE"),
    "devices": (commands.devices, "list the OpenCL devices", ""),
}
"""What each command runs, its summary, and what it takes."""


def _command(groups: Any, name: str, run: Any, summary: str) -> argparse.ArgumentParser:
    command: argparse.ArgumentParser = groups.add_parser(
        name,
        help=summary,
        description=f"{summary[0].upper()}{summary[1:]}.",
        epilog=_EXIT_CODES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    command.set_defaults(run=run, parser=command)
    command.add_argument("-v", "--verbose", action="count", default=0, help="say more")
    command.add_argument("-q", "--quiet", action="count", default=0, help="say less")
    return command


def _add_scene_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("scene", metavar="SCENE", help="scene file, or a model such as a .glb")
    _add_render_options(command)


def _add_render_options(command: argparse.ArgumentParser) -> None:
    model = command.add_argument_group("animation of a model (a scene file has these per object)")
    model.add_argument(
        "--clip", type=values.clip, metavar="NAME", help="clip by name or index [first]"
    )
    model.add_argument(
        "--fps", type=float, metavar="NUMBER", help="a key at s seconds is at frame s * fps [24]"
    )
    frame = command.add_argument_group("frame (the scene file gives defaults)")
    frame.add_argument(
        "--frames",
        type=values.argument(parse_frames),
        metavar="RANGE",
        help="7, 1-24, 1-24x2 (or 1-24:2) or 1,5,9-12; write --frames=-5--1 for negative ones",
    )
    frame.add_argument(
        *("--camera", "--cameras"),
        action="append",
        metavar="NAME",
        help="a camera of the scene by name or index, from 0 on; may be given several times; "
        "'all' takes every one [the first]",
    )
    frame.add_argument("--width", type=values.argument(values.pixels), metavar="PIXELS")
    frame.add_argument(
        "--height",
        type=values.argument(values.pixels),
        metavar="PIXELS",
        help="with only one of --width and --height the shape is kept",
    )
    shutter = frame.add_mutually_exclusive_group()
    shutter.add_argument(
        "--shutter",
        type=values.argument(values.shutter),
        metavar="OPEN,CLOSE",
        help="in frames relative to the frame; write --shutter=-0.25,0.25 for negative ones",
    )
    shutter.add_argument(
        "--shutter-angle",
        type=values.argument(values.shutter_angle),
        dest="shutter",
        metavar="DEGREES[,PLACE]",
        help="open for DEGREES/360 of a frame; PLACE, centre, start or end, is on the frame",
    )
    frame.add_argument(
        "--crop",
        type=values.argument(values.crop),
        metavar="X,Y,W,H",
        help="render only this part of the frame, in pixels from the upper left corner",
    )
    _add_device_option(frame)
    settings = command.add_argument_group("settings (the scene file gives defaults)")
    for setting in fields(Settings):
        option = f"--{setting.name.replace('_', '-')}"
        text = rule_of(setting).help
        if isinstance(setting.default, bool):
            details: dict[str, Any] = {"action": argparse.BooleanOptionalAction}
        else:
            details = {"type": values.value, "metavar": "VALUE"}
            text += f" [{_shown(setting.default)}]"
        settings.add_argument(option, default=argparse.SUPPRESS, help=text, **details)


def _shown(default: Any) -> str:
    return str(default).lower() if default != () else "none"


def _add_output_options(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "-o",
        "--output",
        action="append",
        type=values.argument(parse_outputs),
        metavar="FILE",
        help="where to write: .exr or .png, .deep.exr for the deep image, .npz or .parquet for the "
        "events; ####, %%04d or {frame:04} is the frame's number, "
        "{camera} the camera's name. May be given several times, or as a list with commas "
        "[SCENE.####.exr]",
    )
    batch = command.add_argument_group("batch")
    batch.add_argument(
        "--overwrite",
        action="store_true",
        help="render every frame, and replace what is there. Without it frames stay whose files "
        "are whole and are just what would be rendered; other files that say they are by "
        "mbinterval are replaced, and any other file in the way is an error",
    )
    batch.add_argument(
        "--log", metavar="FILE", help="append a line of JSON for the job and for every frame"
    )
    batch.add_argument(
        "--threads",
        type=values.argument(values.count),
        metavar="COUNT",
        help="threads of the CPU device [as many as there are cores]",
    )
    batch.add_argument(
        "--memory",
        type=values.argument(values.size),
        metavar="SIZE",
        help="most memory that a frame may take, such as 800M or 2G [what there is]",
    )
    batch.add_argument(
        "--dask",
        metavar="ADDRESS",
        help="render on the workers of the Dask scheduler there, such as tcp://10.0.0.1:8786; the "
        "scene's files must be at the same path on all of them",
    )
    batch.add_argument(
        "--parts",
        type=values.argument(values.count),
        metavar="COUNT",
        help="with --dask, cut every frame into so many bands [as many as workers need]",
    )
    command.add_argument(
        "--stats",
        metavar="FILE",
        help="write seconds by stage and counts of every frame to this JSON file; frames that "
        "are complete are rendered as well",
    )


def _add_device_option(group: Any) -> None:
    group.add_argument(
        "--device",
        metavar="NAME",
        help="index or part of the name of an OpenCL device; see 'mbinterval devices'. render "
        "shares frames out among several, with commas between them, or 'all'",
    )


def _add_bench_options(command: argparse.ArgumentParser) -> None:
    add = command.add_argument
    add(
        "scenes",
        nargs="*",
        metavar="SCENE",
        help="scene file, benchmark (.npz), or a generated scene with its count, such as "
        "fast_cubes:2000 [five generated ones]",
    )
    add("--rows", metavar="NAMES", help="with commas between them; a wrong name lists all")
    add(
        "--settings",
        action="append",
        metavar="TEXT",
        help="a row of these settings, such as 'method=\"stochastic\", samples=64', after those of "
        "--rows; may be given again",
    )
    add(
        "--rounds",
        type=values.argument(values.rounds),
        metavar="COUNT",
        help="renders of each row [7]",
    )
    add("--width", type=values.argument(values.pixels), metavar="PIXELS")
    add("--height", type=values.argument(values.pixels), metavar="PIXELS")
    add(
        "--single-sided",
        action="store_true",
        help="cull the back faces of closed meshes, which are never seen from outside",
    )
    add("--at-rest", action="store_true", help="show everything as it is at the frame, unmoved")
    add(
        "--reference",
        action="append",
        metavar="FILE",
        help="what a scene should look like, for the RMSE: an EXR, or an npz with rgb; one for "
        "each scene, in their order, - for none",
    )
    add("--json", metavar="FILE", help="write the result, which --baseline reads")
    add("--baseline", metavar="FILE", help="compare with an earlier --json")
    add(
        "--tolerance",
        type=values.argument(values.tolerance),
        metavar="PART",
        help="with --baseline, fail where a row's median is slower by more than this part [0.1]",
    )
    _add_device_option(command)


@contextmanager
def _messages(verbosity: int) -> Iterator[None]:
    """Send the package's log to standard error, by default from level INFO on."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(logging.Formatter("%(message)s"))
    level = logging.INFO - 10 * max(-2, min(verbosity, 1))
    before = _log.level
    _log.addHandler(handler)
    _log.setLevel(level)
    try:
        yield
    finally:
        _log.setLevel(before)
        _log.removeHandler(handler)


@contextmanager
def _interrupt_on_sigterm() -> Iterator[None]:
    """Let SIGTERM unwind as Ctrl-C does, so that temporary files are removed."""

    def interrupt(_signal: int, _frame: FrameType | None) -> NoReturn:
        raise Terminated

    try:
        before = signal.signal(signal.SIGTERM, interrupt)
    except ValueError:  # not the main thread, where signals cannot be set
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
