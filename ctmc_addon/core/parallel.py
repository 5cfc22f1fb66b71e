# SPDX-License-Identifier: GPL-3.0-or-later
"""Work spread over threads, as steps.

NumPy works without Python's lock, so threads help. They go on working between two steps: waiting for all of them
before each step would leave processors idle. They end with the steps: closing these waits for the items at work and
begins no other.
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
        for result in pool.map(work, items) if pool else map(work, items):
            done.append(result)
            if len(done) % batch == 0 or len(done) == len(items):
                yield Step(len(done) / len(items), message)
    finally:
        if pool:
            pool.shutdown(cancel_futures=True)
    return done
