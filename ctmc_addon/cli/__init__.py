# SPDX-License-Identifier: GPL-3.0-or-later
"""Run the command line: `ctmc ...`, `python -m ctmc_addon ...` and `blender -b --command ctmc ...`."""

from __future__ import annotations

import gc
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress

from ..version import VERSION


def main(argv: Sequence[str] | None = None) -> int:
    """Run `ctmc` with these arguments, by default the process's own, and return the exit code.

    0 is done, 1 a sentence about the input, 2 wrong usage, 130 Ctrl-C, 143 SIGTERM. Little is imported above, so
    that Ctrl-C is one line while NumPy is still being loaded, too.
    """
    if list(sys.argv[1:] if argv is None else argv) == ["--version"]:
        with suppress(OSError):  # A full disk or a closed pipe: the parser below reports it.
            print(f"ctmc {VERSION}", flush=True)
            return 0
    try:
        from .machine.address_space import reserve_memory
        from .machine.interrupts import interrupts_held, sigterm_raised

        reserve_memory()
        with sigterm_raised():
            with interrupts_held(), _nothing_collected():
                from .program import run
            return run(argv)
    except KeyboardInterrupt as stop:
        eval("0")  # where code in a string was stopped, as dataclasses run it, Python would end by a signal of its own
        terminated = bool(stop.args)
        print("ctmc: terminated" if terminated else "ctmc: interrupted", file=sys.stderr)
        return 143 if terminated else 130
    finally:
        if argv is None:  # the process ends; to look for garbage first would take a tenth of the whole start
            gc.freeze()


@contextmanager
def _nothing_collected() -> Iterator[None]:
    """Import without looking for garbage: all that is made stays."""
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()
