# SPDX-License-Identifier: GPL-3.0-or-later
"""Run Blender from a command: load it on demand, silence it, and never interrupt it half-way."""

from __future__ import annotations

import ctypes
import importlib.util
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, redirect_stderr, redirect_stdout
from dataclasses import replace
from typing import Any, TypeVar

from ...core import CtmcError, MemoryLimitError, Reconstruction, Steps, address_space_available, amount
from .interrupts import interrupts_held

T = TypeVar("T")
BLENDER_BYTES = 1250 << 20  # Address space that Blender 4.2 to 5.2 needs.


def has_blender() -> bool:
    """Return whether Blender can be imported, without doing so."""
    try:
        return importlib.util.find_spec("bpy") is not None
    except ValueError:  # `sys.modules["bpy"]` is None: it is blocked
        return False


def require_blender(purpose: str) -> None:
    """Load Blender, or raise a `CtmcError` that says what to install for this purpose."""
    available_bytes = None if "bpy" in sys.modules else address_space_available()
    if available_bytes is not None and available_bytes < BLENDER_BYTES:  # it would crash
        raise MemoryLimitError(
            f"{purpose} needs Blender, which alone takes about {amount(BLENDER_BYTES)} of address space, and "
            f"{amount(available_bytes)} are available; raise the limit (STL and PLY files need no Blender)"
        )
    with interrupts_held():
        try:
            import bpy  # noqa: F401
        except ImportError as error:
            raise CtmcError(
                f"{purpose} needs Blender ({error}); pip install 'ctmc-addon[blender]' on Python 3.11 or 3.13, "
                "or run the command as: blender -b --command ctmc ..."
            ) from error


@contextmanager
def blender_at_work() -> Iterator[None]:
    """Keep what Blender prints from both streams, and an interrupt waiting until it is done.

    Failures arrive as exceptions. Print nothing and yield no step inside.
    """
    with interrupts_held(), silence():
        yield


def quiet_steps(steps: Steps[T]) -> Steps[T]:
    """Return the same steps, Blender at work in each."""
    try:
        while True:
            with blender_at_work():
                try:
                    step = next(steps)
                except StopIteration as end:
                    result: T = end.value
                    return result
            yield step
    finally:
        with blender_at_work():
            steps.close()


@contextmanager
def objects_of(
    results: Sequence[Reconstruction],
    scene_name: str = "CTMC",
    names: Sequence[str] = (),
    opacities: Sequence[float | None] = (),
) -> Iterator[tuple[Any, list[Any], list[Reconstruction]]]:
    """Make a scene with an object for every surface, with names and opacities if any; yield surfaces as shown."""
    from ...blender.surface import evaluated_triangles, temporary_surfaces

    with ExitStack() as stack:
        with blender_at_work():
            scene, objects = stack.enter_context(temporary_surfaces(results, scene_name, names, opacities))
            # Files and reports are of the surface that a live Decimate modifier leaves.
            shown = [
                replace(result, mesh=evaluated_triangles(obj, scene))
                if result.settings.simplifies and result.settings.simplifier == "decimate"
                else result
                for result, obj in zip(results, objects, strict=True)
            ]
        yield scene, objects, shown


@contextmanager
def silence() -> Iterator[None]:
    """Discard standard output and standard error, for Python and for C."""
    sys.stdout.flush()
    sys.stderr.flush()
    _flush_c_streams()
    with ExitStack() as undo:
        nowhere = undo.enter_context(open(os.devnull, "w", encoding="utf-8"))
        undo.enter_context(redirect_stdout(nowhere))
        undo.enter_context(redirect_stderr(nowhere))
        for stream in (1, 2):
            try:
                duplicate = os.dup(stream)
            except OSError:  # a process without one, such as a windowed program
                continue
            undo.callback(os.close, duplicate)
            undo.callback(os.dup2, duplicate, stream)
            os.dup2(nowhere.fileno(), stream)
        undo.callback(_flush_c_streams)
        yield


def _flush_c_streams() -> None:
    """Write out what C code has printed so far, to where its streams lead now."""
    ctypes.CDLL("ucrtbase" if sys.platform == "win32" else None).fflush(None)
