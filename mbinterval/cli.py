"""The command line: arguments in, one clear line and an exit code out; all work is the API's."""

from __future__ import annotations

import argparse
import difflib
import logging
import os
import re
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields
from types import FrameType
from typing import Any, NoReturn

from mbinterval import __version__, commands
from mbinterval.checks import nearest, number
from mbinterval.errors import CapacityError, MbintervalError, SceneError, UsageError
from mbinterval.frames import parse_frames, parse_outputs
from mbinterval.settings import SETTINGS, Settings, check_setting

_log = logging.getLogger("mbinterval")

INTERRUPTED = 130
"""Exit code after Ctrl-C or SIGTERM, as shells have it."""

_EXIT_CODES = """\
exit codes:
  0    done
  1    failure not listed here
  2    bad usage: an option or a setting is unknown or out of range
  3    bad scene: the scene file, or a file that it names, is wrong or missing
  4    no usable OpenCL device, or a kernel did not build
  5    out of capacity: the render needs more memory than there is
  6    an output file cannot be written
  130  interrupted by Ctrl-C or SIGTERM; the frame in work leaves no file

Messages go to standard error; -q leaves only warnings and errors, -v adds details and, after an
error, the traceback.
"""

_SETTING_HELP = {
    "method": "how visibility is solved",
    "paths": "how motion paths become time intervals",
    "pairing": "pair a path's fragments by time, or by depth as published",
    "occlusion": "exact, or the bits of an occlusion mask: 32, 64, ... 1024",
    "partial_bits": "with a mask, let what is seen begin and end inside a bit",
    "max_intervals": "keep only this many intervals per sample; 'none' keeps all",
    "samples": "spatial samples per pixel; 1 is the pixel's centre",
    "pattern": "where a pixel's samples lie",
    "filter": "pixel filter",
    "filter_radius": "radius of the pixel filter in pixels",
    "texture_samples": "shading evaluations along each visible span",
    "motion_segments": "linear motion segments per shutter, for meshes that state none; "
    "'none' chooses them by --motion-error",
    "motion_error": "greatest path error of chosen motion segments, in pixels",
    "seed": "seed of every pseudo-random choice",
    "transparent": "leave the background out; PNG gets an alpha channel",
    "cull": "which point samples a path is tested at",
    "cull_tile": "pixels along the edge of the tiles that culling bounds",
    "test": "how a point sample is tested: vertices or edges",
    "shading_rate": "shade every point sample, or once per pixel and triangle",
    "hybrid": "shade what does not move once per pixel",
    "frameless": "every n-th pixel sees its own part of the shutter",
    "slices": "pictures that accumulation averages",
    "slice_times": "uniform, jittered or stochastic",
    "statistics": "count samples that were tested and hit",
    "tile_size": "edge of a tile in pixels; it changes speed, never the image",
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code; argparse itself exits for --help and usage."""
    arguments = _arguments(list(sys.argv[1:] if argv is None else argv))
    with _messages(arguments.verbose - arguments.quiet), _interrupt_on_sigterm():
        try:
            arguments.run(arguments)
            sys.stdout.flush()
        except BrokenPipeError:
            # The reader of a pipe has gone; nothing is left to be said, at exit neither.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
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
        _log.error("mbinterval: interrupted")
        return INTERRUPTED
    if isinstance(error, MbintervalError):
        _log.error("mbinterval: error: %s", error)
        return error.exit_code
    if isinstance(error, MemoryError):
        _log.error(
            "mbinterval: error: out of memory; try a smaller image, --crop, or fewer samples"
        )
        return CapacityError.exit_code
    kind = type(error).__name__
    _log.error("mbinterval: internal error: %s: %s (-v shows where)", kind, error)
    return MbintervalError.exit_code


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
        if name in ("render", "info"):
            _add_scene_options(command)
        if name == "render":
            _add_output_options(command)
        if name == "bench":
            _add_bench_options(command)
        if name == "compare":
            _add_compare_options(command)
        if name == "study":
            _add_study_options(command)
        if name == "recommend":
            _add_recommend_options(command)
        command.usage = f"mbinterval {name}{takes and ' '}{takes} [options]"
    return parser


COMMANDS = {
    "render": (commands.render, "render frames of a scene to EXR and PNG", "SCENE"),
    "info": (commands.info, "print what a render would do, and why", "SCENE"),
    "compare": (commands.compare, "measure how far images are from the first", "SOURCE ..."),
    "study": (commands.study, "measure what accuracy costs in time, and write a report", "SCENE"),
    "recommend": (commands.recommend, "find settings that reach an error or a time", "SCENE"),
    "bench": (commands.bench, "measure seconds, work and error of the methods", "[SCENE ...]"),
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
    model.add_argument("--clip", type=_clip, metavar="NAME", help="clip by name or index [first]")
    model.add_argument(
        "--fps", type=float, metavar="NUMBER", help="a key at s seconds is at frame s * fps [24]"
    )
    frame = command.add_argument_group("frame (the scene file gives defaults)")
    frame.add_argument(
        "--frames",
        type=_argument(parse_frames),
        metavar="RANGE",
        help="7, 1-24, 1-24x2 or 1,5,9-12; write --frames=-5--1 for negative ones",
    )
    frame.add_argument("--width", type=_argument(_pixels), metavar="PIXELS")
    frame.add_argument(
        "--height",
        type=_argument(_pixels),
        metavar="PIXELS",
        help="with only one of --width and --height the shape is kept",
    )
    shutter = frame.add_mutually_exclusive_group()
    shutter.add_argument(
        "--shutter",
        type=_argument(_shutter),
        metavar="OPEN,CLOSE",
        help="in frames relative to the frame; write --shutter=-0.25,0.25 for negative ones",
    )
    shutter.add_argument(
        "--shutter-angle",
        type=_argument(_shutter_angle),
        dest="shutter",
        metavar="DEGREES[,PLACE]",
        help="open for DEGREES/360 of a frame; PLACE, centre, start or end, is on the frame",
    )
    frame.add_argument(
        "--crop",
        type=_argument(_crop),
        metavar="X,Y,W,H",
        help="render only this part of the frame, in pixels from the upper left corner",
    )
    _add_device_option(frame)
    settings = command.add_argument_group("settings (the scene file gives defaults)")
    for setting in fields(Settings):
        option = f"--{setting.name.replace('_', '-')}"
        text = _SETTING_HELP[setting.name]
        if isinstance(setting.default, bool):
            details: dict[str, Any] = {"action": argparse.BooleanOptionalAction}
        else:
            details = {"type": _value, "metavar": "VALUE"}
            text += f" [{str(setting.default).lower()}]"
        settings.add_argument(option, default=argparse.SUPPRESS, help=text, **details)


def _add_output_options(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "-o",
        "--output",
        action="append",
        type=_argument(parse_outputs),
        metavar="FILE",
        help="where to write, .exr or .png; #### or %%04d is the frame's number. May be given "
        "several times, or as a list with commas [SCENE.####.exr]",
    )
    command.add_argument(
        "--stats",
        metavar="FILE",
        help="write seconds by stage and counts of every frame to this JSON file",
    )


def _add_device_option(group: Any) -> None:
    group.add_argument(
        "--device",
        metavar="NAME",
        help="index or part of the name of an OpenCL device; see 'mbinterval devices'",
    )


def _add_compare_options(command: argparse.ArgumentParser) -> None:
    add = command.add_argument
    add(
        "sources",
        nargs="+",
        metavar="SOURCE",
        help="EXR file, quoted pattern of EXR files that are repeats with other seeds, or scene to "
        "render; the first image is the reference",
    )
    add(
        "--with",
        action="append",
        dest="variants",
        type=_argument(_variant),
        metavar="SETTINGS",
        help="render scenes with these settings, as in samples=16,pattern=sobol; may be given "
        "several times",
    )
    add(
        "--repeats",
        type=_argument(_rounds),
        default=1,
        metavar="COUNT",
        help="render with as many seeds, for the verdict whether noise explains a difference [1]",
    )
    add(
        "--level",
        type=_argument(_level),
        default=0.01,
        metavar="PROBABILITY",
        help="with which the verdict may say no to equal images [0.01]",
    )
    add(
        "--assume-samples",
        type=_argument(_rounds),
        metavar="COUNT",
        help="samples per pixel of EXR files that do not say, for the verdict [1]",
    )
    add("--maps", metavar="FOLDER", help="write error maps as PNG, a folder for each image")
    add("--json", metavar="FILE", help="write the result")
    _add_render_options(command)


def _add_study_options(command: argparse.ArgumentParser) -> None:
    add = command.add_argument
    _add_case_options(command)
    add(
        "-o",
        "--output",
        metavar="FOLDER",
        help="where report, figures and films go, and where a study that was stopped goes on "
        "[study-SCENE]",
    )
    add(
        "--sweeps",
        type=_names,
        metavar="NAMES",
        help="with commas between them; a wrong name lists all [all]",
    )
    add(
        "--costs",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="measure how time depends on cubes, speed, triangles and effects",
    )
    add("--rounds", type=_argument(_rounds), default=3, metavar="COUNT", help="renders of each "
        "row that takes less than half a second [3]")  # fmt: skip
    add(
        "--row-seconds",
        type=_argument(_above_zero),
        default=12.0,
        metavar="SECONDS",
        help="leave out rows that would take longer [12]",
    )
    add(
        "--reference-error",
        type=_argument(_above_zero),
        default=1e-4,
        metavar="RMSE",
        help="of the references, where some ten renders reach it [1e-4]",
    )
    add(
        "--references",
        metavar="FOLDER",
        help="where references are kept, which take a while to make [in the output folder]",
    )


def _add_recommend_options(command: argparse.ArgumentParser) -> None:
    _add_case_options(command)
    wanted = command.add_mutually_exclusive_group(required=True)
    wanted.add_argument(
        "--error",
        type=_argument(_above_zero),
        metavar="RMSE",
        help="to reach in the least time, over linear RGB",
    )
    wanted.add_argument(
        "--time",
        type=_argument(_above_zero),
        metavar="SECONDS",
        help="in which to reach the least error, kernels built",
    )


def _add_case_options(command: argparse.ArgumentParser) -> None:
    """Options of commands that make a reference of one frame."""
    add = command.add_argument
    add(
        "scene",
        metavar="SCENE",
        help="scene file, model, or a generated scene with its count, such as fast_cubes:2000",
    )
    add("--frame", type=_argument(_frame), metavar="NUMBER", help="which frame [the file's first]")
    add("--width", type=_argument(_pixels), metavar="PIXELS")
    add("--height", type=_argument(_pixels), metavar="PIXELS")
    _add_device_option(command)


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
    add("--rounds", type=_argument(_rounds), metavar="COUNT", help="renders of each row [7]")
    add("--width", type=_argument(_pixels), metavar="PIXELS")
    add("--height", type=_argument(_pixels), metavar="PIXELS")
    add(
        "--single-sided",
        action="store_true",
        help="cull the back faces of closed meshes, which are never seen from outside",
    )
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
        type=_argument(_tolerance),
        metavar="PART",
        help="with --baseline, fail where a row's median is slower by more than this part [0.1]",
    )
    _add_device_option(command)


def _argument(parse: Any) -> Any:
    """Turn a parser's UsageError into argparse's own error, which names the option."""

    def parsed(text: str) -> Any:
        try:
            return parse(text)
        except UsageError as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    return parsed


def _pixels(text: str) -> int:
    if not text.isdecimal() or not 1 <= int(text) <= 65536:
        raise UsageError(f"{text!r} is not a whole number from 1 to 65536")
    return int(text)


def _shutter(text: str) -> tuple[float, float]:
    try:
        low, high = map(float, text.split(","))
    except ValueError:
        raise UsageError(f"{text!r} is not OPEN,CLOSE, two numbers") from None
    if not low < high:
        raise UsageError(f"{text!r}: the shutter must open before it closes")
    return low, high


def _shutter_angle(text: str) -> tuple[float, float]:
    from mbinterval.scene.camera import Shutter

    angle, _, place = text.partition(",")
    try:
        shutter = Shutter.from_angle(float(angle), place or "centre")
    except (ValueError, SceneError):
        raise UsageError(
            f"{text!r} is not degrees above 0, or these and centre, start or end, as in 180,start"
        ) from None
    return shutter.open, shutter.close


def _rounds(text: str) -> int:
    if not text.isdecimal() or not 1 <= int(text) <= 10_000:
        raise UsageError(f"{text!r} is not a whole number from 1 to 10000")
    return int(text)


def _above_zero(text: str) -> float:
    return number(_value(text), "value", above=0.0)


def _frame(text: str) -> float:
    return number(_value(text), "frame")


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",")]


def _level(text: str) -> float:
    return number(_value(text), "level", above=0.0, below=1.0)


def _variant(text: str) -> tuple[str, dict[str, Any]]:
    """Settings in one text, as in ``samples=16,pattern=sobol``."""
    values = {}
    for part in text.split(","):
        name, given, value = part.partition("=")
        name = name.strip().replace("-", "_")
        if not given:
            raise UsageError(f"{part!r} is not NAME=VALUE, as in samples=16,pattern=sobol")
        if name not in SETTINGS:
            raise UsageError(f"unknown setting {name!r}, {nearest(name, SETTINGS)}")
        values[name] = check_setting(name, _switch(value.strip()))
    return text, values


def _switch(text: str) -> str | int | float | bool | None:
    return {"true": True, "false": False}.get(text.lower(), _value(text))


def _tolerance(text: str) -> float:
    return number(_value(text), "tolerance", low=0.0)


def _crop(text: str) -> tuple[int, int, int, int]:
    parts = [part.strip() for part in text.split(",")]
    if len(parts) != 4 or not all(part.isdecimal() for part in parts):
        raise UsageError(f"{text!r} is not X,Y,W,H in whole pixels")
    x, y, width, height = map(int, parts)
    if not (width and height):
        raise UsageError(f"{text!r}: width and height must be 1 or more")
    return x, y, width, height


def _clip(text: str) -> str | int:
    return int(text) if text.isdecimal() else text


def _value(text: str) -> str | int | float | None:
    """Value of a setting as a scene file would hold it; `Settings` checks it."""
    if text.lower() == "none":
        return None
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


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
        raise KeyboardInterrupt

    try:
        before = signal.signal(signal.SIGTERM, interrupt)
    except ValueError:  # not the main thread, where signals cannot be set
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
