"""Blender from a command: loaded when it is needed, silent, and not interrupted half-way."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, redirect_stderr, redirect_stdout
from typing import Any, TypeVar

from ..core import CtmcError, Steps

T = TypeVar("T")


def load_scene() -> Any:
    """The package that talks to Blender, or a sentence if there is no Blender here."""
    with interrupts_held():
        try:
            import bpy  # noqa: F401

            from .. import blender as scene
        except ImportError as error:
            raise CtmcError(
                f"writing a surface needs Blender ({error}); install the Python package bpy, "
                "or run the command as: blender -b --command ctmc reconstruct ..."
            ) from error
    return scene


@contextmanager
def blender_at_work() -> Iterator[None]:
    """Keep what Blender prints from both streams, and an interrupt waiting until it is done.

    What goes wrong arrives as an exception. Nothing of ours may be printed inside, and no step yielded.
    """
    with interrupts_held(), silence():
        yield


def quiet(steps: Steps[T]) -> Steps[T]:
    """The same steps, Blender at work in each."""
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
def interrupts_held() -> Iterator[None]:
    """Raise `KeyboardInterrupt` after the block instead of inside it.

    Inside, Blender would crash while it is loaded, and swallow it while it renders, leaving half a picture.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread gets interrupts
        return
    came: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before if before is not None else signal.SIG_DFL)
    if came and before is not signal.SIG_IGN:
        raise KeyboardInterrupt


@contextmanager
def silence() -> Iterator[None]:
    """Lead standard output and standard error nowhere, for Python and for C."""
    sys.stdout.flush()
    sys.stderr.flush()
    flush_c_streams()
    with ExitStack() as undo:
        nowhere = undo.enter_context(open(os.devnull, "w", encoding="utf-8"))
        undo.enter_context(redirect_stdout(nowhere))
        undo.enter_context(redirect_stderr(nowhere))
        for stream in (1, 2):
            try:
                kept = os.dup(stream)
            except OSError:  # a process without one, such as a windowed program
                continue
            undo.callback(os.close, kept)
            undo.callback(os.dup2, kept, stream)
            os.dup2(nowhere.fileno(), stream)
        undo.callback(flush_c_streams)
        yield


def flush_c_streams() -> None:
    """Write out what C code has printed so far, to where its streams lead now."""
    ctypes.CDLL("ucrtbase" if sys.platform == "win32" else None).fflush(None)
