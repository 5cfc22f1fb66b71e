"""Work on many slices by a small pool of threads that has joined before every step yields."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from ..core.progress import Step, Steps
from .libraries import quiet

T = TypeVar("T")
R = TypeVar("R")


def pool_size(threads: int | None) -> int:
    """`threads`, by default as many as there are processors, at most 4."""
    return max(1, threads if threads is not None else min(4, os.cpu_count() or 1))


def mapped(
    work: Callable[[T], R], items: Sequence[T], message: str, threads: int | None = None, batch: int = 16
) -> Steps[list[R]]:
    """`[work(item) for item in items]`, `batch` items between two steps, in order.

    An error of the earliest item is raised, whichever thread met one first.
    """
    size = pool_size(threads)
    results: list[R] = []
    for start in range(0, len(items), batch):
        yield Step(start / len(items), message)
        some = items[start : start + batch]
        with quiet():
            if size == 1 or len(some) == 1:
                results += [work(item) for item in some]
            else:
                with ThreadPoolExecutor(size) as pool:
                    results += pool.map(work, some)
    return results
