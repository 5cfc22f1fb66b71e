# SPDX-License-Identifier: GPL-3.0-or-later
"""Send the cases to a dask.distributed cluster, whose workers see the same files.

A worker starts a process for each case, as `ctmc batch` does on one machine. The scheduler gives the cases of a
worker that was lost to another one.
"""

from __future__ import annotations

import asyncio
import importlib
import logging
import re
import time
from collections.abc import Mapping, Sequence
from typing import Any

from ...core import CtmcError
from .process import PACKAGE, Event, Events, Task, run_task, settle

PATIENCE = 10.0  # seconds in which a scheduler has to answer
TICK = 0.2  # seconds between two looks at the futures
LOOK = 1.0  # seconds between two questions to the scheduler about who does what


class Cluster:
    """A connection to a scheduler; raises `CtmcError` if there is none to be had."""

    def __init__(self, address: str) -> None:
        self.address = address
        if __name__.partition(".")[0] != PACKAGE.name:
            raise CtmcError("--scheduler works from the Python package ctmc-addon, which the workers need too")
        if not re.fullmatch(r"((tcp|tls|ucx|ws|wss)://)?\S+:\d+/?", address):
            raise CtmcError(f"'{address}' is not a scheduler's address; it is like tcp://host:8786")
        try:
            self.distributed: Any = importlib.import_module("distributed")
        except ImportError as error:
            raise CtmcError(
                f"--scheduler needs dask.distributed ({error}); pip install 'ctmc-addon[cluster]'"
            ) from error
        for name in [name for name in logging.root.manager.loggerDict if name.startswith("distributed")]:
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)  # what matters is said in a sentence
        start = time.perf_counter()
        try:
            asyncio.run(asyncio.wait_for(self.greet(), PATIENCE))
            self.client: Any = self.distributed.Client(address, timeout=PATIENCE, set_as_default=False)
        except MemoryError as error:  # letters of another protocol, taken for a length
            raise CtmcError(
                f"what answers at {address} is not a scheduler; check the port, 8786 if it was started without one "
                "(8787 is its web page)"
            ) from error
        except (OSError, ValueError) as error:
            raise CtmcError(
                f"the scheduler {address} did not answer, tried for {time.perf_counter() - start:.0f} s; "
                "check its address, and that it runs"
            ) from error

    async def greet(self) -> None:
        """Exchange greetings once: a client would wait without end for one that takes calls and says nothing."""
        line = await self.distributed.comm.connect(self.address, timeout=PATIENCE)
        await line.close()

    def close(self) -> None:
        """End the connection; the cluster goes on."""
        self.client.close(timeout=PATIENCE)

    @property
    def workers(self) -> int:
        """Workers that the scheduler knows now."""
        return len(self.client.nthreads())

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
                    yield from (Event(tasks[index], "running") for index in begun)
                    looked = time.monotonic()
                over = [index for index, future in futures.items() if future.status != "pending"]
                for index in over:
                    future = futures.pop(index)
                    if future.status != "finished":
                        settle(tasks[index], self.problem(future))
                    yield Event(tasks[index], "ended")
                if not over:
                    yield None
                    time.sleep(TICK)
        finally:
            if futures:
                self.client.cancel(list(futures.values()), force=True)

    def begun(self, futures: Mapping[int, Any]) -> list[int]:
        """The tasks that a worker has taken."""
        try:
            taken = {key for keys in self.client.processing().values() for key in keys}
        except (OSError, TimeoutError):
            return []  # the scheduler is away; its futures will say so
        return [index for index, future in futures.items() if future.key in taken]

    def problem(self, future: Any) -> str:
        """Why a task did not come to its end, in one sentence."""
        if future.status != "error":
            return f"the scheduler {self.address} lost this case; run the batch again with --resume"
        error = future.exception(timeout=PATIENCE)
        if isinstance(error, self.distributed.KilledWorker):
            return "the workers that took this case were lost, again and again; see their logs for the reason"
        return f"the worker could not do this case ({type(error).__name__}: {error}); it needs ctmc and the same files"
