"""``render``: a scene, a frame and settings in; a film out."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Any

from mbinterval.errors import MbintervalError, SceneError, UsageError
from mbinterval.film.film import Film
from mbinterval.scene.model import Scene
from mbinterval.settings.settings import Settings
from mbinterval.values import number, shown, whole_number

if TYPE_CHECKING:
    from mbinterval.device.runtime import Runtime
    from mbinterval.plan.prepare import Prepared
    from mbinterval.rendering.finite import Wrong
    from mbinterval.rendering.shared_steps import Pixels


_REACH = 2
"""Pixels around one from which a filter may have its light."""


def render(
    scene: Scene,
    *,
    frame: float = 1.0,
    width: int = 1024,
    height: int = 768,
    settings: Settings | None = None,
    device: Any = None,
    crop: tuple[int, int, int, int] | None = None,
    progress: Callable[[float], None] | None = None,
    memory: int | None = None,
) -> Film:
    """Render one frame.

    Parameters
    ----------
    scene
        What to render; ``mbinterval.load`` reads one from a file.
    frame
        Frame whose shutter interval is exposed; scenes of arrays are the same in every frame.
    width, height
        Size of the whole frame in pixels, 1 to 65536.
    settings
        How to render; None is the default ``Settings()``.
    device
        A ``pyopencl.Device``, an index, a part of a name, or None (see ``choose_device``).
    crop
        Column, row, width and height in pixels of the part to render; its pixels are those of
        the whole frame.
    progress
        Called some times a second, with the fraction of the frame that is done.
    memory
        Most bytes that the frame may take: the process's memory, or with a GPU that of the
        device. None is what the device has. It changes speed, never the image.

    Raises
    ------
    UsageError, SceneError, DeviceError, KernelBuildError, CapacityError
        A ``SceneError`` also for a film that would have a NaN or an infinity: it names the pixel.
    """
    from mbinterval.rendering.finite import first_wrong

    settings = Settings() if settings is None else settings
    _check_arguments(scene, settings, progress)
    frame = number(frame, "frame")
    width = whole_number(width, "width", 1, 65536)
    height = whole_number(height, "height", 1, 65536)
    memory = None if memory is None else whole_number(memory, "memory", 1)
    film = _render(scene, frame, width, height, settings, device, crop, progress, memory)
    wrong = first_wrong(film)
    if wrong is not None:
        raise _spoilt(wrong, scene, frame, width, height, device)
    return film


def _spoilt(
    wrong: Wrong, scene: Scene, frame: float, width: int, height: int, device: Any
) -> SceneError:
    """Make the error for a film with a value that is no number."""
    from mbinterval.rendering.finite import blamed
    from mbinterval.scene.field_values import LARGEST

    what, column, row, value = wrong
    left, top = max(column - _REACH, 0), max(row - _REACH, 0)
    right, bottom = min(column + _REACH + 1, width), min(row + _REACH + 1, height)
    around = left, top, right - left, bottom - top
    seen: list[int] = []
    with suppress(MbintervalError):
        settings = Settings(samples=64, aovs=("events",))
        found = _render(scene, frame, width, height, settings, device, around).events
        seen = [] if found is None else sorted({int(place) - 1 for place in found["object"]})
    return SceneError(
        f"pixel ({column}, {row}): its {what} is {value}, since numbers there, or their products, "
        f"are beyond what float32 holds, {LARGEST:.2g}: {blamed(scene, seen)}; lower them"
    )


def _render(
    scene: Scene,
    frame: float,
    width: int,
    height: int,
    settings: Settings,
    device: Any,
    crop: Any,
    progress: Callable[[float], None] | None = None,
    memory: int | None = None,
) -> Film:
    """Render one frame, whatever comes of it."""
    from mbinterval.device.runtime import runtime
    from mbinterval.layout import ids
    from mbinterval.plan.memory import check_memory, memory_left
    from mbinterval.plan.plan import check_crop
    from mbinterval.plan.prepare import prepare
    from mbinterval.rendering.analytic import render_analytic
    from mbinterval.rendering.metadata import frame_metadata
    from mbinterval.rendering.stochastic import render_stochastic

    region = check_crop(crop, width, height)
    on = runtime(device)
    room = memory_left(memory, on)
    started = time.perf_counter()
    ready = prepare(scene, frame, width, height, settings, region, room=room)
    check_memory(ready.motion, ready.plan, memory)
    exposed = time.perf_counter() - started
    run = render_analytic if settings.method == "analytic" else render_stochastic
    try:
        ready, mapped = _add_surroundings(on, scene, ready, run)
        check_memory(ready.motion, ready.plan, memory)
        pixels = run(on, ready, progress)
    except BaseException:
        with suppress(MbintervalError):  # of a device that is gone, the first error says so
            on.finish()  # kernels in flight use buffers that go with the interrupted frames
        raise
    return Film(
        deep=pixels.deep,
        events=pixels.events,
        rgba=pixels.rgba,
        depth=pixels.depth,
        intervals=pixels.intervals,
        timings={"expose": exposed, **mapped, **pixels.timings},
        stats=pixels.stats,
        resolution=(width, height),
        origin=region[:2],
        metadata=frame_metadata(scene, ready.exposure, settings) | ids.names(scene, settings.aovs),
        transparent=settings.transparent,
        layers=ids.identified(scene, settings.aovs, pixels.layers),
        notes=ready.notes,
        device=on.device.name.strip(),
    )


def _add_surroundings(
    on: Runtime, scene: Scene, ready: Prepared, run: Callable[..., Pixels]
) -> tuple[Prepared, dict[str, float]]:
    """The environment that is seen, and stage "cube_map", what objects mirror; its seconds."""
    from mbinterval.rendering.cube_maps import gather
    from mbinterval.rendering.panorama import add_environment
    from mbinterval.rendering.reflections import add_cube_maps, surroundings

    ready = add_environment(ready, ready.exposure.environment)
    if "cube_map" not in ready.plan.stages:
        return ready, {}
    started = time.perf_counter()
    pictures = []
    if "REFLECTIONS" in ready.plan.active:
        pictures = surroundings(on, scene, ready, partial(run, on))
    ready = add_cube_maps(ready, gather(on, ready.exposure.environment, pictures))
    return ready, {"cube_map": time.perf_counter() - started}


def _check_arguments(scene: Any, settings: Any, progress: Any) -> None:
    if not isinstance(scene, Scene):
        raise UsageError(
            f"scene is {type(scene).__name__}: expected a Scene; mbinterval.load reads files"
        )
    if not isinstance(settings, Settings):
        raise UsageError(f"settings is {type(settings).__name__}: expected mbinterval.Settings")
    if progress is not None and not callable(progress):
        raise UsageError(f"progress={shown(progress)}: expected a function of one number")
