# SPDX-License-Identifier: GPL-3.0-or-later
"""Work spread over threads, as steps.

NumPy works without Python's lock, so threads help. They go on working between two steps: waiting for all of them
before each step would leave processors idle. They end with the steps: closing these waits for the items at work and
begins no other.
"""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from typing import TypeVar

from ..errors import SettingsError
from ..progress import PAUSE, Step, Steps, finish
from .memory import NO_THREAD

Item = TypeVar("Item")
Result = TypeVar("Result")
MOST_THREADS = 8
LOOK = 0.05  # Look at works in threads every this many seconds.


def processors() -> int:
    """Return the processors that this process may use, which a job of SLURM or a container limits."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def worker_count(threads: int | None) -> int:
    """Return how many threads to use: `threads`, or by default one for each of `processors`, at most 8."""
    if threads is None:
        return min(MOST_THREADS, processors())
    if threads < 1:
        raise SettingsError(f"threads must be 1 or more, not {threads}")
    return threads


def map_steps(
    work: Callable[[Item], Result], items: Sequence[Item], threads: int, message: str = "", batches: int = 16
) -> Steps[list[Result]]:
    """Apply `work` to every item; return the results in the items' order, in about `batches` steps.

    The error of the earliest item is raised, whichever thread met one first.
    """
    done: list[Result] = []
    batch = -(-len(items) // batches)
    with threads_of(min(threads, len(items))) as pool:
        for result in pool.mapped(work, items) if pool else map(work, items):
            done.append(result)
            if len(done) % batch == 0 or len(done) == len(items):
                yield Step(len(done) / len(items), message)
    return done


class Threads(ThreadPoolExecutor):
    """A thread pool that falls back to the calling thread when no thread can be started.

    Attributes
    ----------
    count : int
    """

    def __init__(self, count: int) -> None:
        super().__init__(count)
        self.count = count
        self._ended = False

    def mapped(self, work: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[Result]:
        """Return the result of `map`; without memory for another thread this one does the rest, now and later."""
        if self._ended:
            return map(work, items)
        done: dict[int, Result] = {}

        def keep(number: int) -> Result:
            done[number] = work(items[number])
            return done[number]

        try:
            return self.map(keep, range(len(items)))
        except RuntimeError as error:
            if str(error) != NO_THREAD:
                raise
        self._ended = True
        self.shutdown(cancel_futures=True)  # waits for what threads have begun, which is not done again
        return (done[number] if number in done else work(item) for number, item in enumerate(items))


@contextmanager
def threads_of(count: int) -> Iterator[Threads | None]:
    """Open a pool of `count` threads, or give None for one. Leaving cancels queued work."""
    if count < 2:
        yield None
        return
    pool = Threads(count)
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


def parts_of(count: int, at_once: int) -> list[slice]:
    """Return slices of at most this many rows each; the cuts do not depend on the threads."""
    return [slice(start, min(start + at_once, count)) for start in range(0, count, at_once)]


def spread(pool: Threads | None, work: Callable[[slice], None], parts: Sequence[slice]) -> None:
    """Call `work` for all parts, on threads where there are some, and wait until all are done.

    Each thread gets two stretches of parts: a part takes 0.2 ms, and handing it over alone more than half of that.
    """
    if pool is None or len(parts) < 2:
        for part in parts:
            work(part)
        return
    count = -(-len(parts) // (2 * pool.count))

    def stretch(first: int) -> None:
        for part in parts[first : first + count]:
            work(part)

    for _ in pool.mapped(stretch, range(0, len(parts), count)):
        pass


def side_by_side_steps(
    works: Sequence[Callable[[], Steps[Result]]], weights: Sequence[float], threads: int, message: str = ""
) -> Steps[list[Result]]:
    """Return the results of works that are steps themselves, in their order; some are at work at a time.

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

    def here_steps() -> Steps[list[Result]]:
        results = []
        for number in range(len(works)):
            results.append((yield from driven_steps(number)))
        return results

    waiting = deque(range(len(works)))
    results: dict[int, Result] = {}

    def drive() -> None:
        """Drive one work after the other until none is waiting."""
        while not stopped.is_set():
            try:
                number = waiting.popleft()
            except IndexError:
                return
            steps = driven_steps(number)
            try:
                while not stopped.is_set():
                    next(steps)
            except StopIteration as end:
                results[number] = end.value
            finally:
                steps.close()

    count = min(threads, len(works))
    with threads_of(count) as pool:
        try:
            drivers = set() if pool is None else _drivers(pool, drive, count)
            if not drivers:
                return (yield from here_steps())
            while drivers:
                finished, drivers = wait(drivers, LOOK, FIRST_COMPLETED)
                for driver in finished:
                    driver.result()  # raises what a work raised
                yield Step(min(1.0, sum(done) / total), message)
            return [results[number] for number in range(len(works))]
        finally:
            stopped.set()


def _drivers(pool: Threads, drive: Callable[[], None], count: int) -> set[Future[None]]:
    """Start up to `count` threads that drive works, fewer if memory runs out, perhaps none."""
    drivers = set()
    for _ in range(count):
        try:
            drivers.add(pool.submit(drive))
        except RuntimeError as error:
            if str(error) != NO_THREAD:
                raise
            break
    return drivers


def in_order_steps(
    works: Iterable[Step | Callable[[], Steps[Result]]], threads: int
) -> Generator[Step | Result, None, None]:
    """Yield the results of works in their order, and steps; up to `threads` are at work at a time.

    Each work is steps too, and has a thread of its own as long as it lasts; where the system gives none, it is driven
    here. Closing these steps closes those at work at their next step.

    Parameters
    ----------
    works : iterable of Step and functions
        Each function begins its steps. Steps are handed on.
    """
    stopped = threading.Event()
    at_work: deque[tuple[Threads, Future[Result]]] = deque()  # and done, but for one before

    def until_steps(most: int) -> Generator[Step | Result, None, None]:
        """Yield the results that are next in order, until no more than `most` works are not done."""
        while True:
            running = [future for _, future in at_work if not future.done()]
            while at_work and at_work[0][1].done():
                pool, future = at_work.popleft()
                pool.shutdown()
                yield future.result()
            if len(running) <= most:
                return
            wait(running, LOOK, FIRST_COMPLETED)
            yield PAUSE

    try:
        for work in works:
            if isinstance(work, Step):
                yield work
                continue
            yield from until_steps(threads - 1)
            steps = work()
            del work  # it keeps what it was given, which the steps may let go of
            begun = _begun(steps, stopped) if threads > 1 else None
            if begun is not None:
                at_work.append(begun)
                continue
            yield from until_steps(0)
            yield (yield from _without_fractions_steps(steps))
        yield from until_steps(0)
    finally:
        stopped.set()
        for pool, _ in at_work:
            pool.shutdown(cancel_futures=True)


class _Stopped(Exception):
    """Ends a thread whose result is no longer needed."""


def _begun(steps: Steps[Result], stopped: threading.Event) -> tuple[Threads, Future[Result]] | None:
    """Drive steps in a thread; None where there is no memory for one."""

    def check(_step: Step) -> None:
        if stopped.is_set():
            raise _Stopped

    pool = Threads(1)
    try:
        return pool, pool.submit(finish, steps, check)
    except RuntimeError as error:
        if str(error) != NO_THREAD:
            raise
    return None


def _without_fractions_steps(steps: Steps[Result]) -> Steps[Result]:
    """Yield the same steps without fractions, because their share of the whole is not known."""
    try:
        while True:
            try:
                next(steps)
            except StopIteration as end:
                result: Result = end.value
                return result
            yield PAUSE
    finally:
        steps.close()
