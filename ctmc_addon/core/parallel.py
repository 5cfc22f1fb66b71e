# SPDX-License-Identifier: GPL-3.0-or-later
"""Work spread over threads, as steps.

NumPy works without Python's lock, so threads help. They go on working between two steps: waiting for all of them
before each step would leave processors idle. They end with the steps: closing these waits for the items at work and
begins no other.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from typing import TypeVar

from .errors import SettingsError
from .memory import NO_THREAD
from .progress import Step, Steps

Item = TypeVar("Item")
Result = TypeVar("Result")
MOST_THREADS = 8
LOOK = 0.05  # seconds between two looks at works in threads


def worker_count(threads: int | None) -> int:
    """Return how many threads to use: `threads`, or by default one for each processor, at most 8."""
    if threads is None:
        return min(MOST_THREADS, os.cpu_count() or 1)
    if threads < 1:
        raise SettingsError(f"threads must be 1 or more, not {threads}")
    return threads


def map_steps(
    work: Callable[[Item], Result], items: Sequence[Item], threads: int, message: str = "", batches: int = 16
) -> Steps[list[Result]]:
    """Return `work` of every item, in the items' order, in about `batches` steps.

    The error of the earliest item is raised, whichever thread met one first.
    """
    done: list[Result] = []
    batch = -(-len(items) // batches)
    pool = ThreadPoolExecutor(min(threads, len(items))) if min(threads, len(items)) > 1 else None
    try:
        for result in _pooled(pool, work, items) if pool else map(work, items):
            done.append(result)
            if len(done) % batch == 0 or len(done) == len(items):
                yield Step(len(done) / len(items), message)
    finally:
        if pool:
            pool.shutdown(cancel_futures=True)
    return done


def _pooled(pool: ThreadPoolExecutor, work: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[Result]:
    """What `pool.map` returns, or this thread's results where there is no memory for the stack of another."""
    try:
        return pool.map(work, items)
    except RuntimeError as error:
        if str(error) != NO_THREAD:
            raise
    pool.shutdown(cancel_futures=True)
    return map(work, items)


def side_by_side_steps(
    works: Sequence[Callable[[], Steps[Result]]], weights: Sequence[float], threads: int, message: str = ""
) -> Steps[list[Result]]:
    """Return the results of works that are steps themselves, in their order; so many are at work at a time.

    They are begun in their order. Closing these steps closes those at work at their next step.

    Parameters
    ----------
    works : sequence of functions
        Each begins its steps, in the thread that drives them.
    weights : sequence of float
        Usual share of the time of each.

    Examples
    --------
    >>> from ctmc_addon.core.progress import finish
    >>> def half_steps(number):
    ...     yield Step(0.5)
    ...     return 2 * number
    >>> finish(side_by_side_steps([lambda n=n: half_steps(n) for n in range(3)], [1, 1, 1], 2))
    [0, 2, 4]
    """
    total = sum(weights) or 1.0
    done = [0.0] * len(works)
    stopped = threading.Event()

    def driven_steps(number: int) -> Steps[Result]:
        steps = works[number]()
        try:
            while True:
                try:
                    step = next(steps)
                except StopIteration as end:
                    done[number] = weights[number]
                    result: Result = end.value
                    return result
                done[number] = weights[number] * step.fraction
                yield Step(min(1.0, sum(done) / total), message)
        finally:
            steps.close()

    def driven(number: int) -> Result | None:
        steps = driven_steps(number)
        try:
            while not stopped.is_set():
                next(steps)
        except StopIteration as end:
            result: Result = end.value
            return result
        finally:
            steps.close()
        return None

    if min(threads, len(works)) < 2:
        results = []
        for number in range(len(works)):
            results.append((yield from driven_steps(number)))
        return results
    pool = ThreadPoolExecutor(min(threads, len(works)))
    try:
        futures = [pool.submit(driven, number) for number in range(len(works))]
        waiting = set(futures)
        while waiting:
            finished, waiting = wait(waiting, LOOK, FIRST_COMPLETED)
            for future in finished:
                future.result()  # raises what the work raised
            yield Step(min(1.0, sum(done) / total), message)
        # None is a result only of steps that were closed, and then nobody is here.
        return [future.result() for future in futures]  # type: ignore[misc]
    finally:
        stopped.set()
        pool.shutdown(cancel_futures=True)
