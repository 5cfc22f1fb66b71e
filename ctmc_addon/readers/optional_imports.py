"""The readers' libraries, imported when first needed, and what they raise on broken files."""

from __future__ import annotations

import importlib
import logging
import struct
import sys
import warnings
import zlib
from collections.abc import Callable, Iterator, Sequence
from concurrent import futures
from contextlib import contextmanager
from typing import Any, TypeVar

from ..core import ReadError, Step, Steps, finish, map_steps

Item = TypeVar("Item")
Result = TypeVar("Result")
STEP_SECONDS = 0.03  # between two steps while a library is imported

# What a parser raises when bytes are not what it expects. Only calls into a library stand under it.
BROKEN = (
    ArithmeticError,
    AssertionError,
    AttributeError,
    EOFError,
    LookupError,
    NotImplementedError,
    OSError,
    RuntimeError,
    SyntaxError,
    TypeError,
    ValueError,
    struct.error,
    zlib.error,
)
LOGGERS = (
    "tifffile",
    "tifffile.tifffile",
    "PIL",
    "PIL.PngImagePlugin",
    "PIL.TiffImagePlugin",
    "pydicom",
    "nibabel.global",
    "imageio",
)


def needed(module: str, package: str, what: str) -> Any:
    """Import `module`, or say that `package` is missing and `what` it reads.

    Imported late: a Blender whose platform lacks one wheel still reads the other formats.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise ReadError(f"reading {what} needs the Python package {package}, which is missing; install it") from error


def imported_steps(module: str, package: str, what: str) -> Steps[Any]:
    """`needed` with steps: the first import of pydicom or nibabel takes up to half a second.

    It runs in a thread, the only one that lives across steps; closing the generator waits for its end.
    """
    if module not in sys.modules:
        with futures.ThreadPoolExecutor(1) as pool:
            loading = pool.submit(needed, module, package, what)
            while not futures.wait([loading], STEP_SECONDS).done:
                yield Step(0.0, f"Loading {package}")
            loading.result()
    return needed(module, package, what)


@contextmanager
def quiet() -> Iterator[None]:
    """Keep the libraries' warnings and log lines from the user; what matters is said in the notes.

    Never held across a `yield` of steps, since the filters belong to the whole interpreter.
    """
    talking = [logger for logger in map(logging.getLogger, LOGGERS) if not logger.disabled]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for logger in talking:
            logger.disabled = True
        try:
            yield
        finally:
            for logger in talking:
                logger.disabled = False


def quiet_batches(
    work: Callable[[Item], Result], items: Sequence[Item], message: str, at_once: int, threads: int = 1
) -> Steps[list[Result]]:
    """`[work(item) for item in items]`, a step after every `at_once`, the libraries kept quiet while they work."""
    done: list[Result] = []
    while len(done) < len(items):
        some = items[len(done) : len(done) + at_once]
        with quiet():
            done += finish(map_steps(work, some, threads, message))
        yield Step(len(done) / len(items), message)
    return done


def reason(error: BaseException) -> str:
    """The first line of a library's complaint, short enough for one sentence."""
    lines = str(error).strip().splitlines()
    text = lines[0].strip().rstrip(".") if lines else type(error).__name__
    return text if len(text) <= 160 else text[:157] + "..."
