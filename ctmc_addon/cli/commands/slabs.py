# SPDX-License-Identifier: GPL-3.0-or-later
"""Extract one volume on many machines: the workers of a dask.distributed cluster extract slabs of a shared file.

Each task opens the file by its path and reads its slices alone. The scheduler gives the slabs of a worker that was
lost to another one, so a lost worker costs its slab and not the run.
"""

from __future__ import annotations

import pickle
import time
from collections.abc import Generator, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ... import readers
from ...core import CtmcError, ReadError, SlabResult, SlabTask, finish, slab_result_steps
from ..machine.scheduler import PATIENCE, Scheduler

TICK = 0.05  # Seconds between two checks of the futures.
AHEAD = 3  # Tasks per worker at the scheduler; their results wait in the workers' memory.
LOST = "the scheduler {} lost a slab; run this again once it is up"
LONGEST_WITHOUT_WORKERS = 60.0  # Seconds to wait for a worker.
RETRIES = 2  # Retries of a task that failed for another reason than the content of the file.


@dataclass(frozen=True)
class _ClusterWorkers:
    """The workers of a cluster, for one volume.

    Parameters
    ----------
    cluster : Scheduler
    path : Path
        Absolute path of the file or folder.
    reading : ReadingOptions
        Reading options of the file.
    """

    cluster: Scheduler
    path: Path
    reading: readers.ReadingOptions

    @property
    def count(self) -> int:
        """Return the current number of workers."""
        return self.cluster.workers

    def results(self, tasks: Sequence[SlabTask]) -> Generator[SlabResult | None, None, None]:
        """Yield the results in the order of the tasks, and None while nothing happens."""
        module, path, reading = __name__, str(self.path), self.reading.to_dict()

        def done_by_worker(task: bytes) -> Any:
            # Travels as code and bytes, for the scheduler unpacks it too and has perhaps no ctmc.
            import importlib

            return importlib.import_module(module).slab_result(path, reading, task)

        client = self.cluster.client
        futures: dict[int, Any] = {}
        begun = 0
        try:
            for number in range(len(tasks)):
                while begun < len(tasks) and begun < number + AHEAD * max(1, self.count):
                    futures[begun] = client.submit(
                        done_by_worker, pickle.dumps(tasks[begun]), pure=False, retries=RETRIES
                    )
                    begun += 1
                for _ in self._waiting(futures[number]):
                    yield None
                yield self._result(futures.pop(number))
        except (OSError, TimeoutError, CancelledError) as error:
            raise CtmcError(LOST.format(self.cluster.address)) from error
        finally:
            if futures:
                with suppress(OSError, TimeoutError):  # the scheduler may be gone
                    client.cancel(list(futures.values()), force=True)

    def _waiting(self, future: Any) -> Iterator[None]:
        """Wait for a result, as long as there is a worker."""
        looked = seen = time.monotonic()
        while future.status == "pending":
            yield None
            time.sleep(TICK)
            if time.monotonic() - looked > 1.0:
                looked = time.monotonic()
                seen = looked if self.count else seen
                if looked - seen > LONGEST_WITHOUT_WORKERS:
                    raise CtmcError(
                        f"the scheduler {self.cluster.address} has had no worker for "
                        f"{LONGEST_WITHOUT_WORKERS:.0f} s; check why the workers ended, start one with `dask "
                        f"worker {self.cluster.address}`, and run this again"
                    )

    def _result(self, future: Any) -> SlabResult:
        if future.status == "finished":
            result: SlabResult = future.result(timeout=None)
            return result
        if future.status != "error":
            raise CtmcError(LOST.format(self.cluster.address))
        error = future.exception(timeout=PATIENCE)
        if isinstance(error, CtmcError):
            raise error
        if isinstance(error, self.cluster.distributed.KilledWorker):
            raise CtmcError("workers were lost again and again while extracting a slab; see their logs for the reason")
        raise CtmcError(
            f"a worker could not extract a slab ({type(error).__name__}: {error}); workers need ctmc and the same files"
        ) from error


@contextmanager
def workers_of(address: str | None, path: Path, reading: readers.ReadingOptions) -> Iterator[_ClusterWorkers | None]:
    """Yield the workers of the scheduler at an address, if any, which read `path`."""
    if not address:
        yield None
        return
    cluster = Scheduler(address)
    try:
        if not cluster.workers:
            raise CtmcError(f"the scheduler {address} has no worker; start one with `dask worker {address}`")
        yield _ClusterWorkers(cluster, path.resolve(), reading)
    finally:
        cluster.close()


def slab_result(path: str, reading: Mapping[str, Any], packed: bytes) -> SlabResult:
    """Do a task on a worker; open the file again, because it cannot serve two threads at once."""
    task: SlabTask = pickle.loads(packed)
    try:
        options = readers.ReadingOptions.from_dict(reading)
        volume = finish(readers.open_volume(path, options.allow_outside).slabs_steps(options))
    except ReadError as error:
        raise ReadError(f"a worker reports: {error}; all workers must see INPUT under the same path") from error
    return finish(slab_result_steps(volume, task))
