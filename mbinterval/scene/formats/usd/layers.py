"""A USD stage of layers that are in memory as a whole, and of one scene alone.

usd-core keeps every open layer in a registry of the process and gives it to all who open a file of
that path, however the file has changed; and of binary layers it maps the file itself into memory,
so that one that is cut while it renders ends the process. So the stage is opened through a link
of its own to the root of the file system: no layer is known by such a path yet, those of the
caller's own stages neither, and layers whose paths go through such a link are read as a whole.
"""

from __future__ import annotations

import hashlib
import os
import re
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

from mbinterval.errors import SceneError
from mbinterval.files.contents import read_file, record, recording

T = TypeVar("T")

_TAG, _ROOT = "mbinterval-usd-", "root"
_DAY = 86400.0
_STAGE = re.compile(r" *\(instantiating stage on stage [^)]*\)\.?")
_TRIES = 5
_GRAIN = 2 * 10**9
"""Nanoseconds by which some file systems round times, and clocks of machines differ."""


def without_link(text: str) -> str:
    """``text`` with the paths that the user knows."""
    start = os.path.join(tempfile.gettempdir(), _TAG)
    return re.sub(f"{re.escape(start)}[^/]*/{_ROOT}(?=/)", "", text)


class Layers:
    """Layers of a stage, through the link at ``prefix``, as long as that is there."""

    def __init__(self, path: Path, prefix: str) -> None:
        from pxr import Usd, UsdUtils

        self._prefix, self._path = prefix, path
        self._said = UsdUtils.CoalescingDiagnosticDelegate()  # instead of the standard error
        self.stage = Usd.Stage.Open(prefix + os.path.abspath(path))
        self._enclose()
        self._open_clips()

    def data(self, resolved: str) -> bytes | None:
        """Bytes of what an asset path resolved to, in a package too; None if it is not there."""
        from pxr import Ar

        if Ar.IsPackageRelativePath(resolved):
            asset = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(resolved))
            return bytes(asset.GetBuffer()) if asset else None
        path = self._file(resolved)
        return read_file(path) if path.is_file() else None

    def warnings(self) -> list[str]:
        """What USD warned of so far, such as files that are not there."""
        said = [item.commentary for item in self._said.TakeUncoalescedDiagnostics()]
        return [without_link(" ".join(_STAGE.sub("", text).split())) for text in said]

    def record(self) -> int:
        """Record the files of all layers, the stage's own first; return when one changed last."""
        used = (layer.realPath for layer in self.stage.GetUsedLayers(True))
        others = sorted({self._file(path) for path in used if path} - {self._path})
        latest = 0
        for path in (self._path, *(path for path in others if path.is_file())):
            with path.open("rb") as file:
                record(path, hashlib.file_digest(file, "sha256").hexdigest())
            state = path.stat()
            latest = max(latest, state.st_mtime_ns, state.st_ctime_ns)
        return latest

    def _file(self, resolved: str) -> Path:
        """File behind a path that USD resolved: of what is in a package, the package."""
        from pxr import Ar

        outer = Ar.SplitPackageRelativePathOuter(resolved)[0].removeprefix(self._prefix)
        return self._path if outer == os.path.abspath(self._path) else Path(outer)

    def _enclose(self) -> None:
        """Lead through the link what layers name by absolute paths, or what a search finds."""
        from pxr import UsdUtils

        done: set[str] = set()
        while any(self._is_outside(layer.realPath) for layer in self.stage.GetUsedLayers(True)):
            names = {layer.identifier for layer in self.stage.GetUsedLayers() if layer.realPath}
            if not names - done:
                return
            for layer in list(self.stage.GetUsedLayers()):
                if layer and layer.identifier in names - done and layer.realPath:
                    done.add(layer.identifier)
                    UsdUtils.ModifyAssetPaths(layer, self._enclosed(layer))

    def _enclosed(self, layer: Any) -> Callable[[str], str]:
        from pxr import Ar

        def enclosed(path: str) -> str:
            if not path or path.startswith("`"):  # an expression of variables
                return path
            full = Ar.GetResolver().Resolve(layer.ComputeAbsolutePath(path)).GetPathString()
            return self._prefix + full if self._is_outside(full) else path

        return enclosed

    def _is_outside(self, path: str) -> bool:
        return path.startswith("/") and not path.startswith(self._prefix)

    def _open_clips(self) -> None:
        """Open the layers of value clips, which USD does when a value of theirs is asked for."""
        from pxr import Usd

        instances = Usd.TraverseInstanceProxies(Usd.PrimAllPrimsPredicate)
        prims = iter(Usd.PrimRange.Stage(self.stage, instances))
        for prim in prims:
            if prim.HasAuthoredMetadata("clips"):
                for part in Usd.PrimRange(prim, instances):
                    for attribute in part.GetAttributes():
                        attribute.GetTimeSamples()
                prims.PruneChildren()


@contextmanager
def _opened(path: Path) -> Iterator[Layers]:
    from pxr import Sdf

    rules = Sdf.Layer.GetDetachedLayerRules()
    if _TAG not in rules.GetIncluded():
        Sdf.Layer.SetDetachedLayerRules(rules.Include([_TAG]))
    try:
        folder = tempfile.mkdtemp(prefix=_TAG)
        os.symlink("/", os.path.join(folder, _ROOT))
    except OSError as error:
        raise SceneError(
            f"USD files are read through a link among temporary files, which cannot be made "
            f"({error}); set TMPDIR to a folder that can be written to"
        ) from error
    try:
        yield Layers(path, os.path.join(folder, _ROOT))
    finally:
        _remove(folder)
        _clear_up()


def _remove(folder: str) -> None:
    os.unlink(os.path.join(folder, _ROOT))
    os.rmdir(folder)


def _clear_up() -> None:
    """Remove links of processes that were killed a day ago or earlier."""
    for folder in Path(tempfile.gettempdir()).glob(f"{_TAG}*"):
        with suppress(OSError):
            old = time.time() - folder.lstat().st_mtime > _DAY
            if old and (folder / _ROOT).is_symlink():
                _remove(str(folder))


def read_layers(path: Path, read: Callable[[Layers], T]) -> T:
    """Return what ``read`` makes of the layers of a USD file; files are recorded as they were read.

    Whether a file was changed between its reading and its digest is told by its times; where these
    leave a doubt, all is read again until digests stay.
    """
    before: dict[Path, str] = {}
    for _ in range(_TRIES):
        started = time.time_ns()
        with recording() as files, _opened(path) as layers:
            found = read(layers)
            changed = layers.record()
        if changed < started - _GRAIN or files == before:
            for name in sorted(files, key=lambda name: name != path):
                record(name, files[name])
            return found
        before = files
    raise SceneError(f"{path}: changes while it is read; load it when it is written")
