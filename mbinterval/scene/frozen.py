"""What the scene's records have in common: they never change, and so they are copied as they are.

They pickle with all that they hold. What moves a mesh may be anything, though, and a USD stage
stays in the process that opened it, so `check_portable` says which part can't go along.
"""

from __future__ import annotations

import pickle
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from mbinterval.errors import MbintervalError, SceneError
from mbinterval.values import shown


class Frozen:
    """A frozen dataclass whose arrays are read-only, after unpickling as before."""

    def __setstate__(self, state: dict[str, Any]) -> None:
        for name, value in state.items():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False
            object.__setattr__(self, name, value)

    def __copy__(self) -> Any:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> Any:
        return self


class OfStage:
    """What reads values of a USD stage when they are asked for."""


def check_portable(value: Any, what: str) -> None:
    """Raise ``SceneError`` for what can't be pickled; ``what`` names the object and its field."""
    if isinstance(value, OfStage):
        raise SceneError(
            f"{what} reads a USD stage of this process as it renders and cannot be pickled; pickle "
            "the file's path, and load it where the scene is needed"
        )
    if is_dataclass(value) and type(value).__module__.startswith("mbinterval."):
        # Transforms hold nothing but their own kind, and a chain of them may be long.
        for field in fields(value) if type(value).__name__ != "Transform" else ():
            check_portable(getattr(value, field.name), f"{what}.{field.name}")
    elif isinstance(value, tuple | list):
        for item in value:
            check_portable(item, what)
    elif not isinstance(value, np.ndarray | str | int | float | None):
        try:
            pickle.dumps(value)
        except MbintervalError:
            raise
        except Exception as error:
            raise SceneError(
                f"{what}={shown(value)} cannot be pickled ({error}); let it be an instance of a "
                "class at the top of a module, that holds no function made on the spot"
            ) from error
