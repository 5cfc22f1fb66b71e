# SPDX-License-Identifier: GPL-3.0-or-later
"""The threads, bytes and workers that a work may use, as one frozen object; None means those of the machine.

Threads, memory and workers change no result: the same input gives the same bytes, or a refusal. The number of triangles
that decides how a surface is simplified stands here too (`whole_faces`), so that tests can hand in a small one.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from typing import Any, Protocol

from .memory import available_bytes, refusal, require
from .parallel import worker_count


class SlabWorkers(Protocol):
    """Processes, perhaps on other machines, that extract slabs of a volume which all of them can read."""

    @property
    def count(self) -> int:
        """Return the present number of workers."""

    def results(self, tasks: Sequence[Any]) -> Generator[Any | None, None, None]:
        """Return the results in the order of the tasks, and None while nothing happens."""


@dataclass(frozen=True)
class Budget:
    """The threads, memory and workers that a computation may use.

    Parameters
    ----------
    threads : int, optional
        Number of threads; by default one for each processor, at most 8.
    bytes : int, optional
        Memory that it may take; by default what the machine has available at the time.
    workers : SlabWorkers, optional
        Processes that extract slabs instead of this one.
    slab_bytes : int
        Bytes of values that are fetched from a file at once; a volume in memory is one slab.
    work_bytes : int
        Bytes of working memory, at most, besides the values and the surface.
    whole_faces : int
        Triangles up to which a surface is simplified as a whole; batches of larger ones have about a quarter as many.
    counted_slabs : int
        Slabs in which triangles are counted, at most, to tell whether a surface fits before it is made. In 24 of 512
        slabs of a foam of 2 GiB, 1.7 % fewer were counted than there are, in 1.7 s of processor time with what is
        advised.
    spool_share : float
        Share of the memory for pieces that are read several times; the rest wait in a file.
    small_label : int
        Voxels of work that each of several labels has besides those of its box.

    Examples
    --------
    >>> half = Budget(threads=4, bytes=1 << 30).shared_by(2)
    >>> half.threads, half.bytes
    (2, 536870912)
    """

    threads: int | None = None
    bytes: int | None = None
    workers: SlabWorkers | None = None
    slab_bytes: int = 1 << 22
    work_bytes: int = 128 << 20
    whole_faces: int = 1 << 20
    counted_slabs: int = 24
    spool_share: float = 0.125
    small_label: int = 1 << 15

    @property
    def thread_count(self) -> int:
        """Return the number of threads to use."""
        return worker_count(self.threads)

    @property
    def available(self) -> int | None:
        """Bytes that may be used now; None if the system does not report them."""
        return available_bytes() if self.bytes is None else self.bytes

    @property
    def spool_bytes(self) -> int:
        """Return the bytes of pieces that may stay in memory for another pass."""
        there = self.available
        return self.work_bytes if there is None else int(self.spool_share * there)

    def require(self, needed_bytes: int, what: str, remedy: str | Callable[[int], str]) -> None:
        """Raise `MemoryLimitError` if `what` needs more memory than is available.

        Parameters
        ----------
        needed_bytes : int
            Memory that the work needs.
        what : str
            The work, for the message.
        remedy : str or callable
            Advice for the message; a callable gets the available bytes.

        Raises
        ------
        MemoryLimitError
            If `needed_bytes` is more than is available.
        """
        require(needed_bytes, what, remedy, self.bytes)

    def refusal(self, what: str, remedy: str) -> AbstractContextManager[None]:
        """Raise `MemoryLimitError` if the system refuses memory to `what`, whose need is not known beforehand."""
        return refusal(what, remedy, self.bytes)

    def threads_for(self, bytes_each: int, other_bytes: int = 0) -> int:
        """Return how many threads may work side by side if each takes `bytes_each` bytes; at least one.

        Examples
        --------
        >>> Budget(threads=4, bytes=100).threads_for(30), Budget(threads=4, bytes=100).threads_for(30, other_bytes=20)
        (3, 2)
        """
        there = self.available
        if there is None:
            return self.thread_count
        fitting = min(self.thread_count, (there - other_bytes) // max(1, bytes_each))
        return max(1, fitting)

    def shared_by(self, count: int) -> Budget:
        """Return the budget of each of `count` computations that run side by side."""
        there = self.available
        return replace(
            self, threads=max(1, self.thread_count // count), bytes=None if there is None else there // count
        )
