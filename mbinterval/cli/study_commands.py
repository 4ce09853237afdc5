"""What ``mbinterval study`` and ``mbinterval recommend`` do."""

from __future__ import annotations

import argparse
import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from mbinterval.bench.cases import Case, make_case
from mbinterval.errors import MbintervalError
from mbinterval.files.atomic import prepare_output
from mbinterval.files.results import aligned
from mbinterval.study.judge import Truth, make_truth
from mbinterval.study.recommend import options, recommend
from mbinterval.study.report import write_report
from mbinterval.study.run import Progress, check_folder, study
from mbinterval.study.sweeps import chosen

_log = logging.getLogger(__name__)


def run_study(arguments: argparse.Namespace) -> None:
    """Make references, measure, and write the report, of a part too after Ctrl-C."""
    chosen(arguments.sweeps)
    case = _case(arguments)
    folder = Path(arguments.output or f"study-{case.name.replace(':', '-')}")
    check_folder(folder)
    prepare_output(folder / "study.json")
    truth = _truth(case, arguments, arguments.references or folder / "references")
    try:
        with _told() as progress:
            study(
                case,
                truth,
                sweeps=arguments.sweeps,
                costs=arguments.costs,
                rounds=arguments.rounds,
                row_seconds=arguments.row_seconds,
                device=arguments.device,
                folder=folder,
                progress=progress,
            )
    except KeyboardInterrupt:
        _log.warning("%s: stopped; the same command goes on from here", folder)
        if (folder / "study.json").is_file():
            _log.info("%s: the part that is done", write_report(folder))
        raise
    _log.info("%s", write_report(folder))


def _case(arguments: argparse.Namespace) -> Case:
    case = make_case(arguments.scene, None, arguments.width, arguments.height)
    return case if arguments.frame is None else replace(case, frame=arguments.frame)


def _truth(case: Case, arguments: argparse.Namespace, folder: str | Path) -> Truth:
    def told(what: str, count: int, error: float) -> None:
        _log.info("reference of %s: %d renders, error %.1e", what, count, error)

    device = arguments.device
    return make_truth(
        case, error=arguments.reference_error, folder=folder, device=device, told=told
    )


@contextmanager
def _told() -> Iterator[Progress]:
    """Show a bar on a terminal; elsewhere a line for each part."""
    if not sys.stderr.isatty() or not _log.isEnabledFor(logging.INFO):
        yield _line
        return
    from tqdm import tqdm
    from tqdm.contrib.logging import logging_redirect_tqdm

    shape = "{desc}{percentage:3.0f}% |{bar}| {elapsed}{postfix}"
    with (
        logging_redirect_tqdm([logging.getLogger("mbinterval")]),
        tqdm(file=sys.stderr, bar_format=shape, dynamic_ncols=True, leave=False) as bar,
    ):

        def tell(part: str, done: int, total: int, left: float | None) -> None:
            bar.total, bar.n = total, done
            bar.set_description_str(f"{part} ({done}/{total}) ", refresh=False)
            bar.set_postfix_str(_to_go(left))

        yield tell


def _line(part: str, done: int, total: int, left: float | None) -> None:
    if part:
        _log.info("%d of %d rows, %s; now %s", done, total, _to_go(left), part)


def _to_go(seconds: float | None) -> str:
    if seconds is None:
        return "time to go not known yet"
    return f"about {int(seconds) // 60}:{int(seconds) % 60:02d} to go"


def run_recommend(arguments: argparse.Namespace) -> None:
    """Print the settings that were found, as a command too, and what other methods would take."""
    case = _case(arguments)
    found = recommend(
        case,
        error=arguments.error,
        seconds=arguments.time,
        device=arguments.device,
        told=_log.info,
    )
    wanted = f"RMSE {arguments.error:g}" if arguments.error else f"{arguments.time:g} s"
    if not found:
        raise MbintervalError(f"{case.name}: no method is predicted to reach {wanted}")
    best = found[0]
    rows = [("method", "settings", "predicted s", "predicted RMSE", "measured s", "measured RMSE")]
    for choice in found:
        seconds = "" if choice.seconds is None else f"{choice.seconds:.3f}"
        error = "" if choice.error is None else f"{choice.error:.2e}"
        predicted = f"{choice.predicted_seconds:.3f}", f"{choice.predicted_error:.2e}"
        rows.append((choice.name, options(choice.settings), *predicted, seconds, error))
    print("\n".join(aligned(rows)))
    size = f"--width {case.width} --height {case.height}"
    if arguments.frame is not None:
        size = f"--frames {arguments.frame:g} {size}"
    print(f"\nmbinterval render {arguments.scene} {size} {options(best.settings)}")
    if not best.reached:
        raise MbintervalError(f"{case.name}: {wanted} is not reached by the best that was found")
