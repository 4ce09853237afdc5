"""Options of the commands that measure accuracy: compare, study and recommend."""

from __future__ import annotations

import argparse

from mbinterval.cli import option_values as values


def add_compare_options(command: argparse.ArgumentParser) -> None:
    """Options of ``compare``, beside those of a render."""
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
        type=values.argument(values.variant),
        metavar="SETTINGS",
        help="render scenes with these settings, as in samples=16,pattern=sobol; may be given "
        "several times",
    )
    add(
        "--repeats",
        type=values.argument(values.rounds),
        default=1,
        metavar="COUNT",
        help="render with as many seeds, for the verdict whether noise explains a difference [1]",
    )
    add(
        "--level",
        type=values.argument(values.level),
        default=0.01,
        metavar="PROBABILITY",
        help="with which the verdict may say no to equal images [0.01]",
    )
    add(
        "--assume-samples",
        type=values.argument(values.rounds),
        metavar="COUNT",
        help="samples per pixel of EXR files that do not say, for the verdict [1]",
    )
    add("--maps", metavar="FOLDER", help="write error maps as PNG, a folder for each image")
    add("--json", metavar="FILE", help="write the result")


def add_study_options(command: argparse.ArgumentParser) -> None:
    """Options of ``study``."""
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
        type=values.names,
        metavar="NAMES",
        help="with commas between them; a wrong name lists all [all]",
    )
    add(
        "--costs",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="measure how time depends on cubes, speed, triangles and effects",
    )
    add(
        "--rounds",
        type=values.argument(values.rounds),
        default=3,
        metavar="COUNT",
        help="renders of each row that takes less than half a second [3]",
    )
    add(
        "--row-seconds",
        type=values.argument(values.above_zero),
        default=12.0,
        metavar="SECONDS",
        help="leave out rows that would take longer [12]",
    )
    add(
        "--reference-error",
        type=values.argument(values.above_zero),
        default=1e-4,
        metavar="RMSE",
        help="of the references, where some ten renders reach it [1e-4]",
    )
    add(
        "--references",
        metavar="FOLDER",
        help="where references are kept, which take a while to make [in the output folder]",
    )


def add_recommend_options(command: argparse.ArgumentParser) -> None:
    """Options of ``recommend``."""
    _add_case_options(command)
    wanted = command.add_mutually_exclusive_group(required=True)
    wanted.add_argument(
        "--error",
        type=values.argument(values.above_zero),
        metavar="RMSE",
        help="to reach in the least time, over linear RGB",
    )
    wanted.add_argument(
        "--time",
        type=values.argument(values.above_zero),
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
    add(
        "--frame",
        type=values.argument(values.frame),
        metavar="NUMBER",
        help="which frame [the file's first]",
    )
    add("--width", type=values.argument(values.pixels), metavar="PIXELS")
    add("--height", type=values.argument(values.pixels), metavar="PIXELS")
