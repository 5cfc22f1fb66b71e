# SPDX-License-Identifier: GPL-3.0-or-later
"""Import the readers' libraries when they are first needed, and silence their messages."""

from __future__ import annotations

import importlib
import logging
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent import futures
from contextlib import contextmanager
from typing import Any, TypeVar

from ..core import NO_THREAD, ReadError, Step, Steps

Item = TypeVar("Item")
Result = TypeVar("Result")
STEP_SECONDS = 0.03  # Seconds between two steps while a library is imported.

# Where no application listens, `logging` prints a library's complaints; a handler of its own keeps it from that.
for _name in ("PIL", "imageio", "pydicom", "tifffile"):
    logging.getLogger(_name).addHandler(logging.NullHandler())


def needed(module: str, package: str, what: str, remedy: str = "install it") -> Any:
    """Import `module`, or say that `package` is missing, `what` it reads and how it comes here.

    Imported late: a Blender whose platform lacks one wheel still reads the other formats.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise ReadError(f"reading {what} needs the Python package {package}, which is missing; {remedy}") from error


def imported_steps(module: str, package: str, what: str, remedy: str = "install it") -> Steps[Any]:
    """Import a library as `needed` does, with steps: the first import of pydicom or nibabel takes up to half a second.

    It runs in a thread, the only one that lives across steps; closing the generator waits for its end.
    """
    if module not in sys.modules:
        with futures.ThreadPoolExecutor(1) as pool:
            loading = pool.submit(needed, module, package, what, remedy)
            while not futures.wait([loading], STEP_SECONDS).done:
                yield Step(0.0, f"Loading {package}")
            loading.result()
    return needed(module, package, what, remedy)


@contextmanager
def quiet() -> Iterator[None]:
    """Silence the libraries' warnings; notes report what matters.

    The filters belong to the whole interpreter: entered in the main thread alone, and never held across a step.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def quiet_batches_steps(
    work: Callable[[Item], Result], items: Sequence[Item], message: str, at_once: int, threads: int = 1
) -> Steps[list[Result]]:
    """Return `[work(item) for item in items]`, the libraries kept quiet while they work.

    Parameters
    ----------
    work : callable
    items : sequence
    message : str
        Of each step.
    at_once : int
        Items between two steps; no thread lives across a step.
    threads : int

    Raises
    ------
    Exception
        That of the earliest item.
    """
    results: list[Result] = []
    for start in range(0, len(items), at_once):
        batch = items[start : start + at_once]
        with quiet():
            results += _mapped(work, batch, min(threads, len(batch)))
        yield Step(len(results) / len(items), message)
    return results


def _mapped(work: Callable[[Item], Result], batch: Sequence[Item], threads: int) -> list[Result]:
    """Return the results of a batch, from several threads, or from this one if memory allows no other."""
    if threads > 1:
        try:
            with futures.ThreadPoolExecutor(threads) as pool:
                return list(pool.map(work, batch))
        except RuntimeError as error:
            if str(error) != NO_THREAD:
                raise
    return list(map(work, batch))


def reason(error: BaseException) -> str:
    """Return the first line of a library's complaint, short enough for one sentence."""
    lines = str(error).strip().splitlines()
    text = lines[0].strip().rstrip(".") if lines else type(error).__name__
    return text if len(text) <= 160 else text[:157] + "..."
