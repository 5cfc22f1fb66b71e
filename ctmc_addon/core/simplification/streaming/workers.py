# SPDX-License-Identifier: GPL-3.0-or-later
"""Steps that run in other threads while this one goes on; whoever began them asks for their results in order."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from typing import Generic, TypeVar

from ...progress import PAUSE, Step, Steps, finish

Result = TypeVar("Result")

WAIT = 0.05  # seconds between two steps


class _Stopped(Exception):
    """Ends work whose result nobody wants any more."""


class Task(Generic[Result]):
    """Work that was begun; without a pool it is done when it is waited for."""

    def __init__(
        self, steps: Steps[Result], pool: ThreadPoolExecutor | None = None, stopped: threading.Event | None = None
    ) -> None:
        self.steps, self.stopped = steps, stopped or threading.Event()
        self.future: Future[Result] | None = pool.submit(self._run) if pool else None

    def _run(self) -> Result:
        return finish(self.steps, self._check)

    def _check(self, _step: Step) -> None:
        if self.stopped.is_set():
            raise _Stopped

    def result_steps(self) -> Steps[Result]:
        """Wait for the result."""
        if self.future is None:
            return (yield from self.steps)
        while not self.future.done():
            wait([self.future], WAIT)
            yield PAUSE
        return self.future.result()


class Workers:
    """Threads that work at tasks."""

    def __init__(self, threads: int) -> None:
        self.threads = threads
        self.pool = ThreadPoolExecutor(threads) if threads > 1 else None
        self.stopped = threading.Event()

    def begin(self, steps: Steps[Result]) -> Task[Result]:
        """Begin this work when a thread is free."""
        return Task(steps, self.pool, self.stopped)


@contextmanager
def working(threads: int) -> Iterator[Workers]:
    """So many threads; work that is not done at the end of the block is given up."""
    workers = Workers(threads)
    try:
        yield workers
    finally:
        workers.stopped.set()
        if workers.pool:
            workers.pool.shutdown(cancel_futures=True)
