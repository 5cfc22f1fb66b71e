"""Work spread over threads, in batches between which nothing runs.

NumPy works without Python's lock, so threads help. A pool has ended before a step is yielded: whoever
stops at a step leaves no thread behind.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from .errors import SettingsError
from .progress import Step, Steps

Item = TypeVar("Item")
Result = TypeVar("Result")
MOST_THREADS = 8


def worker_count(threads: int | None) -> int:
    """How many threads to use: those asked for, or one for each processor, at most 8."""
    if threads is None:
        return min(MOST_THREADS, os.cpu_count() or 1)
    if threads < 1:
        raise SettingsError(f"threads must be 1 or more, not {threads}")
    return threads


def in_batches(
    work: Callable[[Item], Result],
    items: Sequence[Item],
    threads: int,
    message: str,
    batches: int = 16,
    at_once: int | None = None,
) -> Steps[list[Result]]:
    """Do `work` for every item; a step after each of about so many batches, the results in the items' order.

    `at_once` gives the items in a batch themselves. The error of the earliest item is raised, whichever
    thread met one first.
    """
    done: list[Result] = []
    at_once = at_once or max(4 * threads, -(-len(items) // batches))
    while len(done) < len(items):
        batch = items[len(done) : len(done) + at_once]
        if threads == 1 or len(batch) == 1:
            done += [work(item) for item in batch]
        else:
            with ThreadPoolExecutor(threads) as pool:
                done += pool.map(work, batch)
        yield Step(len(done) / len(items), message)
    return done
