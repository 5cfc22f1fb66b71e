"""How far long work is: a generator yields `Step`s and returns its result.

Whoever drives the generator decides what a step means: a panel redraws, a command line prints,
`finish` drains. Closing the generator cancels the work.

A window shall draw and answer between two steps, so on millions of triangles they are about 0.1 s apart at most.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import NamedTuple, TypeVar

T = TypeVar("T")


class Step(NamedTuple):
    """One sign of life of long work: `fraction` in 0..1 and what is being done."""

    fraction: float
    message: str


Steps = Generator[Step, None, T]
Pauses = Generator[None, None, T]
"""Work that can be left now and then, and does not know how far it is: `said` makes steps of it."""


def finish(steps: Steps[T] | Pauses[T], report: Callable[[Step], None] | None = None) -> T:
    """Drive `steps` to the end, hand each to `report`, and return the result.

    Examples
    --------
    >>> def work():
    ...     yield Step(0.5, "Half")
    ...     return 42
    >>> finish(work())
    42
    """
    while True:
        try:
            step = next(steps)
        except StopIteration as end:
            result: T = end.value
            return result
        if report is not None and step is not None:
            report(step)


def said(pauses: Pauses[T], fraction: float, message: str) -> Steps[T]:
    """The same step at every pause.

    Examples
    --------
    >>> def work():
    ...     yield
    ...     return 42
    >>> [step.message for step in said(work(), 0.5, "Half")]
    ['Half']
    """
    while True:
        try:
            next(pauses)
        except StopIteration as end:
            result: T = end.value
            return result
        yield Step(fraction, message)


def within(steps: Steps[T], low: float, high: float) -> Steps[T]:
    """The same steps, their fractions moved from 0..1 into `low`..`high` of a larger work.

    Examples
    --------
    >>> def work():
    ...     yield Step(0.5, "Half")
    ...     return 42
    >>> next(within(work(), 0.2, 0.4)).fraction
    0.30000000000000004
    """
    try:
        while True:
            try:
                fraction, message = next(steps)
            except StopIteration as end:
                result: T = end.value
                return result
            yield Step(low + (high - low) * fraction, message)
    finally:
        steps.close()
