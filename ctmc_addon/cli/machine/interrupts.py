# SPDX-License-Identifier: GPL-3.0-or-later
"""Handle Ctrl-C and SIGTERM: both raise `KeyboardInterrupt`, but never inside a block that it would break."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def sigterm_raised() -> Iterator[None]:
    """Clean up after SIGTERM, which SLURM, Docker and Snakemake send, as after Ctrl-C."""
    # Only the main thread gets signals, and whoever handles this one already goes on doing so.
    if not _in_main_thread() or signal.getsignal(signal.SIGTERM) != signal.SIG_DFL:
        yield
        return
    signal.signal(signal.SIGTERM, _raise_terminated)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _raise_terminated(_number: int, _frame: Any) -> None:
    raise KeyboardInterrupt("terminated")


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Raise `KeyboardInterrupt` after the block instead of inside it.

    Inside, Blender would crash while it is loaded, and swallow it while it renders, leaving half a picture.
    """
    if not _in_main_thread():
        yield
        return
    received: list[int] = []
    handlers = {number: signal.signal(number, lambda number, _: received.append(number)) for number in SIGNALS}
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
    if received:
        signal.raise_signal(received[0])


def _in_main_thread() -> bool:
    """Return whether this is the thread that Python handles signals in."""
    return threading.current_thread() is threading.main_thread()
