"""Converged references: made once, by a method that is not under study, with an error of their own.

A reference is the mean of renders that differ in their seed. Every other one belongs to one of two
halves, which are independent, so that their difference tells the error of the mean: half of the
root mean square. It is kept in a file whose name is a hash of all that it depends on.
"""

from __future__ import annotations

import hashlib
import io
import json
import logging
import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbinterval.bench.bench import settings_text
from mbinterval.bench.cases import Case
from mbinterval.device.choose import choose_device
from mbinterval.device.sources import kernel_root
from mbinterval.errors import UsageError
from mbinterval.files.arrays import read_arrays
from mbinterval.files.atomic import prepare_output, write_file
from mbinterval.rendering.renderer import render
from mbinterval.settings.settings import Settings
from mbinterval.values import number, shown, whole_number
from mbinterval.version import __version__

_log = logging.getLogger(__name__)

Float32 = NDArray[np.float32]

FEWEST_PAIRS = 2


@dataclass(frozen=True, eq=False)
class Reference:
    """A converged image.

    Attributes
    ----------
    halves
        ``(2, H, W, 3)`` float32, scene-linear: means over independent renders; ``(1, H, W, 3)``
        where it was made elsewhere and nothing is known of its noise.
    made
        By which settings, for people and for the rule that no method is its own judge.
    method
        The method of these settings, empty where it is not known.
    renders
        How many there are in both halves together.
    seconds
        That they took, wall clock.
    """

    halves: Float32
    made: str
    method: str = ""
    renders: int = 0
    seconds: float = 0.0

    @classmethod
    def of_image(cls, image: NDArray[Any], made: str, method: str = "") -> Reference:
        """Take ``image`` ``(H, W, 3 or 4)`` as the truth, whatever its error."""
        return cls(np.asarray(image, np.float32)[None, ..., :3], made, method)

    @property
    def image(self) -> Float32:
        """``(H, W, 3)``: the mean of the halves."""
        return np.asarray(self.halves.mean(axis=0), np.float32)

    @property
    def error(self) -> float | None:
        """RMSE of `image`, estimated from its halves; None where there is one only."""
        return _error(*self.halves) if len(self.halves) == 2 else None

    def rmse_of(self, image: NDArray[Any]) -> float:
        """RMSE of ``image`` ``(H, W, 3 or 4)`` without the reference's own share; 0 at the least.

        The product of the differences from both halves has the square of the image's error as its
        mean, whatever the halves' noise, where the square of the difference from their mean has
        the reference's own error on top.
        """
        return math.sqrt(max(0.0, float(np.mean(self._products(image)))))

    def resolves(self, image: NDArray[Any]) -> bool:
        """Whether `rmse_of` is more than noise: its square is three standard errors above 0.

        That is far below the reference's own error, since noise averages out over the pixels.
        """
        by_pixel = self._products(image).mean(axis=2)
        return bool(by_pixel.mean() > 3.0 * by_pixel.std() / math.sqrt(by_pixel.size))

    def _products(self, image: NDArray[Any]) -> NDArray[np.float64]:
        values = np.asarray(image, np.float64)[..., :3]
        return np.asarray((values - self.halves[0]) * (values - self.halves[-1]))


def converged(
    case: Case,
    settings: Settings,
    error: float,
    *,
    most: int = 1024,
    folder: str | Path | None = None,
    device: Any = None,
    progress: Callable[[int, float], None] | None = None,
) -> Reference:
    """Make the reference of ``case``, or read it from ``folder`` where it was made before.

    Parameters
    ----------
    case
        Scene, frame and size; its own settings and reference are not looked at.
    settings
        Of a method that has a seed; renders count it up from ``settings.seed``.
    error
        Stop when the estimated RMSE of the mean is at most this, above 0.
    most
        Stop after as many renders, with a warning; at least four.
    folder
        Where references are kept; None keeps none. A file that cannot be read is made again.
    progress
        Told after each pair of renders how many there are, and the error so far.

    Raises
    ------
    UsageError
        Where the seed changes nothing; and what ``mbinterval.render`` raises.
    """
    number(error, "error", above=0.0)
    whole_number(most, "most", 2 * FEWEST_PAIRS)
    path = None
    if folder is not None:
        key = fingerprint(case, settings, device)
        path = prepare_output(Path(folder) / f"{case.name.replace(':', '-')}-{key}.npz")
        kept = _read(path, settings, case)
        if kept is not None and (_fine(kept, error) or kept.renders >= most):
            return kept
    reference = _made(case, settings, error, most, device, progress)
    if not _fine(reference, error):
        _log.warning(
            "reference of %s: error %.1e after %d renders, %.1e was asked for",
            *(case.name, reference.error, reference.renders, error),
        )
    if path is not None:
        _write(path, reference)
    return reference


def _fine(reference: Reference, error: float) -> bool:
    return reference.error is not None and reference.error <= error


def _made(
    case: Case,
    settings: Settings,
    error: float,
    most: int,
    device: Any,
    progress: Callable[[int, float], None] | None,
) -> Reference:
    started = time.perf_counter()
    totals = np.zeros((2, case.height, case.width, 3))
    for pairs in range(1, most // 2 + 1):
        for half in (0, 1):
            seed = (settings.seed + 2 * (pairs - 1) + half) % 2**32
            film = render(
                case.scene,
                frame=case.frame,
                width=case.width,
                height=case.height,
                settings=replace(settings, seed=seed),
                device=device,
            )
            totals[half] += film.rgba[..., :3]
        if pairs == 1 and np.array_equal(*totals):
            raise UsageError(
                f"reference: with {settings_text(settings)} the seed changes nothing, so that its "
                "error cannot be estimated; use a random pattern"
            )
        found = _error(*totals / pairs)
        if progress is not None:
            progress(2 * pairs, found)
        if pairs >= FEWEST_PAIRS and found <= error:
            break
    halves = (totals / pairs).astype(np.float32)
    made, seconds = settings_text(settings), time.perf_counter() - started
    return Reference(halves, made, settings.method, 2 * pairs, seconds)


def _error(first: NDArray[Any], second: NDArray[Any]) -> float:
    return 0.5 * math.sqrt(float(np.mean((first.astype(np.float64) - second) ** 2)))


def fingerprint(case: Case, settings: Settings, device: Any = None) -> str:
    """Hash of all that renders of ``case`` depend on, 24 hexadecimal digits.

    Scene, frame and size; settings; mbinterval's version and its kernels; the OpenCL device and
    its driver.
    """
    chosen = choose_device(device)
    root = kernel_root()
    kernels = {str(p.relative_to(root)): p.read_bytes() for p in sorted(root.rglob("*.*"))}
    where = (chosen.name, chosen.platform.version, chosen.driver_version)
    parts = (case.scene, case.frame, case.width, case.height, settings, kernels, where)
    digest = hashlib.sha256(__version__.encode())
    for piece in _bytes_of(parts):
        digest.update(piece)
    return digest.hexdigest()[:24]


def _bytes_of(value: Any) -> Iterator[bytes]:
    """Bytes that are equal for equal values only: each with its type and its length."""
    yield type(value).__name__.encode() + b"\0"
    if isinstance(value, np.ndarray):
        yield f"{value.dtype.str}{value.shape}".encode()
        yield np.ascontiguousarray(value).tobytes()
    elif isinstance(value, bytes):
        yield f"{len(value)}:".encode() + value
    elif value is None or isinstance(value, str | int | float | np.generic | Path):
        text = repr(value).encode()
        yield f"{len(text)}:".encode() + text
    elif isinstance(value, Mapping):
        yield from _bytes_of(list(value.items()))
    elif isinstance(value, list | tuple):
        yield f"{len(value)}:".encode()
        for item in value:
            yield from _bytes_of(item)
    elif hasattr(value, "fingerprint"):
        yield from _bytes_of(value.fingerprint)
    elif type(value).__module__.startswith("pxr."):  # what it is follows from the stage
        named = value.GetPrim() if hasattr(value, "GetPrim") else value
        yield from _bytes_of(str(named.GetPath()) if hasattr(named, "GetPath") else "")
    elif is_dataclass(value):
        yield from _bytes_of([(item.name, getattr(value, item.name)) for item in fields(value)])
    else:
        raise UsageError(
            f"{shown(value)}: a scene with a part that is not of mbinterval is not known by its "
            "contents, so that references of it cannot be kept: make it of transforms, tracks or "
            "positions per time"
        )


def _write(path: Path, reference: Reference) -> None:
    facts = {"renders": reference.renders, "seconds": reference.seconds}
    written = io.BytesIO()
    np.savez(written, halves=reference.halves, facts=json.dumps(facts))
    write_file(path, written.getvalue())


def _read(path: Path, settings: Settings, case: Case) -> Reference | None:
    if not path.exists():
        return None
    try:
        stored = read_arrays(path, ["halves", "facts"])
        halves, facts = stored["halves"], json.loads(str(stored["facts"]))
        if halves.dtype != np.float32 or halves.shape != (2, case.height, case.width, 3):
            raise ValueError("no halves of the image")
        renders, seconds = int(facts["renders"]), float(facts["seconds"])
        return Reference(halves, settings_text(settings), settings.method, renders, seconds)
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        _log.warning("reference %s: cannot be read (%s); it is made again", path, error)
        return None
