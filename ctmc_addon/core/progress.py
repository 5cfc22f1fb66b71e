# SPDX-License-Identifier: GPL-3.0-or-later
"""Progress of long work: a generator yields `Step`s and returns its result.

Whoever drives the generator decides what a step means: a panel redraws, a command line prints,
`finish` drains. Closing the generator cancels the work. Every function that must be drained is called `*_steps`.

A window draws and answers between two steps, so on millions of triangles they are about 0.1 s apart at most.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterator, Mapping
from typing import Generic, NamedTuple, TypeVar

T = TypeVar("T")
Item = TypeVar("Item")


class Step(NamedTuple):
    """One sign of life of long work: `fraction` in 0..1, and what is being done if the stage's name does not say it."""

    fraction: float = 0.0
    message: str = ""


Steps = Generator[Step, None, T]
PAUSE = Step()  # The step of work that does not know how far it is.


def finish(steps: Steps[T], report: Callable[[Step], None] | None = None) -> T:
    """Drive `steps` to the end, hand each to `report`, and return the result.

    Examples
    --------
    >>> def work_steps():
    ...     yield Step(0.5, "Half")
    ...     return 42
    >>> finish(work_steps())
    42
    """
    while True:
        try:
            step = next(steps)
        except StopIteration as end:
            result: T = end.value
            return result
        if report is not None:
            report(step)


class WithResult(Generic[Item, T]):
    """A generator to loop over once, and its return value in `result`; leaving the loop closes it.

    Examples
    --------
    >>> def letters():
    ...     yield "a"
    ...     return 42
    >>> source = WithResult(letters())
    >>> [letter for letter in source], source.result
    (['a'], 42)
    """

    result: T

    def __init__(self, generator: Generator[Item, None, T]) -> None:
        self._generator = generator

    def __iter__(self) -> Iterator[Item]:
        try:
            self.result = yield from self._generator
        finally:
            self._generator.close()


class Stages:
    """The stages of a larger work, in their order: each has a name and a weight, and its seconds are kept.

    Parameters
    ----------
    weights : mapping of str to float
        Name that a user reads while a stage runs, and its usual share of the time; the sum does not matter.

    Examples
    --------
    >>> def half_steps():
    ...     yield Step(0.5)
    ...     return 42
    >>> stages = Stages({"Reading": 1, "Extracting": 3})
    >>> list(stages.run("Extracting", half_steps()))
    [Step(fraction=0.625, message='Extracting')]
    >>> list(stages.seconds)
    ['Extracting']
    """

    def __init__(self, weights: Mapping[str, float]) -> None:
        total = sum(weights.values())
        self.shares: dict[str, tuple[float, float]] = {}
        self.seconds: dict[str, float] = {}
        done = 0.0
        for name, weight in weights.items():
            self.shares[name] = (done / total, (done + weight) / total)
            done += weight

    def run(self, name: str, steps: Steps[T]) -> Steps[T]:
        """The same steps as the stage `name` of the whole; a stage that is run again adds to its seconds."""
        low, high = self.shares[name]
        result, seconds = yield from timed_steps(steps, low, high, name)
        self.seconds[name] = self.seconds.get(name, 0.0) + seconds
        return result


def equal_part(steps: Steps[T], number: int, count: int) -> Steps[T]:
    """The same steps as part `number` of `count` equal ones, counted from 0.

    Examples
    --------
    >>> def half_steps():
    ...     yield Step(0.5, "Half")
    >>> list(equal_part(half_steps(), 1, 2))
    [Step(fraction=0.75, message='Half')]
    """
    result, _ = yield from timed_steps(steps, number / count, (number + 1) / count)
    return result


def timed_steps(steps: Steps[T], low: float = 0.0, high: float = 1.0, name: str = "") -> Steps[tuple[T, float]]:
    """The same steps, from `low` to `high` of a larger work; returns their result and the seconds they worked.

    Time that their driver takes is not counted. `name` is the message of steps that have none.

    Examples
    --------
    >>> def half_steps():
    ...     yield Step(0.5)
    ...     return 42
    >>> result, seconds = finish(timed_steps(half_steps()))
    >>> result
    42
    """
    done = seconds = 0.0
    try:
        while True:
            start = time.perf_counter()
            try:
                fraction, message = next(steps)
            except StopIteration as end:
                return end.value, seconds + time.perf_counter() - start
            seconds += time.perf_counter() - start
            done = max(done, fraction)  # A pause does not know how far it is, and nothing goes back.
            yield Step(low + (high - low) * done, message or name)
    finally:
        steps.close()
