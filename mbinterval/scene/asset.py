"""What one model file brings into a scene, and how its reader reports a file that is broken."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from mbinterval.errors import SceneError
from mbinterval.scene.model import Camera, Light, Mesh, Shutter, Viewpoint

GLTF_SUFFIXES = (".glb", ".gltf")
USD_SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")


@dataclass(frozen=True, eq=False)
class Asset:
    """Meshes of a file, its cameras and lights if it has any, and what had to be assumed.

    ``animation`` is the first and the last frame of the file's keys; None where nothing is keyed.
    ``fps`` is what the file gives, if it does.
    """

    meshes: tuple[Mesh, ...]
    cameras: tuple[Viewpoint, ...] = ()
    lights: tuple[Light, ...] = ()
    notes: tuple[str, ...] = ()
    animation: tuple[float, float] | None = None
    fps: float | None = None

    @property
    def camera(self) -> Camera | None:
        """The first camera, which is used where none is chosen."""
        return self.cameras[0].camera if self.cameras else None

    @property
    def shutter(self) -> Shutter | None:
        """The first camera's shutter."""
        return self.cameras[0].shutter if self.cameras else None


def several_cameras(names: Sequence[str]) -> str:
    """Note on a file with more cameras than one."""
    return f"has cameras {', '.join(names)}; the first is used unless another is asked for"


@contextmanager
def reading(path: Path, what: str) -> Iterator[None]:
    """Turn whatever a file library raises or warns about a broken file into a ``SceneError``.

    Parsers of other projects raise anything at all on broken input, hence the wide net.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except SceneError as error:
        if str(error).startswith(str(path)):
            raise
        raise SceneError(f"{path}: {error}") from None
    except MemoryError:
        raise SceneError(f"{path}: does not fit into memory, or claims a size that can't") from None
    except FileNotFoundError as error:
        raise SceneError(f"{path}: file not found: tried {error.filename}; put it there") from None
    except ImportError:
        # trimesh asks for a package that guesses encodings where it takes binary data for text.
        raise SceneError(f"{path}: not a readable {what} file; export it again") from None
    except OSError as error:
        raise SceneError(f"{path}: cannot be read ({error.strerror or error})") from None
    except Exception as error:
        raise SceneError(
            f"{path}: not a readable {what} file ({type(error).__name__}: {error}); export it again"
        ) from error
