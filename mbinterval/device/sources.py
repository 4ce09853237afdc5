"""Where the kernels are, in a checkout, an editable install, and an installed wheel."""

from __future__ import annotations

from pathlib import Path

from mbinterval.errors import DeviceError

_PACKAGE = Path(__file__).resolve().parent.parent


def kernel_root(package: Path = _PACKAGE) -> Path:
    """Folder ``cl`` with the kernels: the root for ``-I`` and of kernel names.

    A wheel holds it inside the package; a checkout and an editable install have it beside the
    package.

    Raises
    ------
    DeviceError
        Where neither is there, with both places.
    """
    places = (package / "cl", package.parent / "cl")
    for place in places:
        if next(place.glob("**/*.cl"), None) is not None:
            return place
    tried = " and ".join(map(str, places))
    raise DeviceError(f"no kernels (.cl files) in {tried}; install mbinterval again")
