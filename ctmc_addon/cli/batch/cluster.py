# SPDX-License-Identifier: GPL-3.0-or-later
"""Send the cases to a dask.distributed cluster, whose workers see the same files.

A worker starts a process for each case, as `ctmc batch` does on one machine. The scheduler gives the cases of a
worker that was lost to another one.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any

from ..machine.scheduler import PATIENCE, Scheduler
from .files import RUNNING
from .process import ENDED, Event, Events, Task, run_task, settle

# Seconds between two looks at the futures, and between two questions to the scheduler about the tasks at work.
TICK, LOOK = 0.2, 1.0


class Cluster(Scheduler):
    """A dask.distributed cluster that makes the cases of a batch."""

    def run(self, tasks: Sequence[Task]) -> Events:
        """Do the tasks on the cluster."""
        module = run_task.__module__

        def done_by_worker(task: Task) -> None:
            # Travels as code, for the scheduler unpacks it too and has perhaps no ctmc.
            import importlib

            importlib.import_module(module).run_task(task)

        futures = {index: self.client.submit(done_by_worker, task, pure=False) for index, task in enumerate(tasks)}
        running: set[int] = set()
        looked = time.monotonic()
        try:
            while futures:
                if time.monotonic() - looked > LOOK:
                    begun = [index for index in self.begun(futures) if index not in running]
                    running.update(begun)
                    yield from (Event(tasks[index], RUNNING) for index in begun)
                    looked = time.monotonic()
                over = [index for index, future in futures.items() if future.status != "pending"]
                for index in over:
                    future = futures.pop(index)
                    if future.status != "finished":
                        settle(tasks[index], self.problem(future))
                    yield Event(tasks[index], ENDED)
                if not over:
                    yield None
                    time.sleep(TICK)
        finally:
            if futures:
                self.client.cancel(list(futures.values()), force=True)

    def begun(self, futures: Mapping[int, Any]) -> list[int]:
        """Return the tasks that a worker has taken."""
        try:
            taken = {key for keys in self.client.processing().values() for key in keys}
        except (OSError, TimeoutError):
            return []  # The connection to the scheduler is lost; the futures will report it.
        return [index for index, future in futures.items() if future.key in taken]

    def problem(self, future: Any) -> str:
        """Return a sentence about why a task did not end."""
        if future.status != "error":
            return f"the scheduler {self.address} lost this case; run the batch again with --resume"
        error = future.exception(timeout=PATIENCE)
        if isinstance(error, self.distributed.KilledWorker):
            return "several workers were lost while they made this case; see their logs for the reason"
        return f"the worker could not do this case ({type(error).__name__}: {error}); it needs ctmc and the same files"
