# SPDX-License-Identifier: GPL-3.0-or-later
"""How the benchmark measures: calls in turn, medians, rows with a target, and what the memory can do.

Everything that is compared runs in one process, one call after the other and round again, so that a
slow minute of the machine falls on all alike. A result is let go only when the clock has stopped.

On a machine that others use (`Session.shared`) the clock is processor time, and the least of the calls counts: waiting
for one's turn is not in it, and what others do to the caches can only add. What two threads gain cannot be told there.
"""

from __future__ import annotations

import gc
import os
import statistics
import time
import tracemalloc
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

Call = Callable[[], Any]
Clock = Callable[[], float]


@dataclass(frozen=True)
class Row:
    """One comparison. `ours` and `theirs` are in `unit`; less is better throughout.

    Parameters
    ----------
    part : str
        The part of the benchmark it belongs to.
    work, peer : str
        What was done, and what it is compared with.
    ours, theirs : float
        Medians, or the least; `theirs` may be a limit such as one frame at 60 Hz.
    target : float or None
        The ratio ours / theirs is to stay at or below this; None where no promise is made.
    unit : str
        Of `ours` and `theirs`.
    note : str
        What a reader should know to understand the number.
    """

    part: str
    work: str
    peer: str
    ours: float
    theirs: float
    target: float | None = None
    unit: str = "s"
    note: str = ""
    runs: dict[str, list[float]] = field(default_factory=dict)

    @property
    def ratio(self) -> float:
        """Return our value over theirs."""
        return self.ours / self.theirs

    @property
    def verdict(self) -> str:
        """Return whether the target is met; empty without one."""
        if self.target is None:
            return ""
        return "met" if self.ratio <= self.target else "not met"

    def as_dict(self) -> dict[str, Any]:
        """Return the row for bench.json: seconds under the names of the printed table, with the unit."""
        fields = asdict(self)
        return {
            "part": self.part,
            "work": self.work,
            "peer": self.peer,
            "ours_s": self.ours,
            "peer_s": self.theirs,
            "unit": self.unit,
            "ratio": self.ratio,
            "target": self.target,
            "met": None if self.target is None else self.ratio <= self.target,
            "note": self.note,
            "runs": fields["runs"],
        }


@dataclass
class Session:
    """A session in which one part of the benchmark measures and reports.

    Parameters
    ----------
    part : str
    repeats : int
        Calls of each competitor whose median counts.
    show : callable
        Called with every `Row` as soon as it is known.
    say : callable
        Called with a sentence about what goes on.
    scratch, data : Path
        A folder for the run's own files, and the folder of real CT.
    also : list of Path
        More CT to measure.
    shared : bool
        Whether others use the machine.
    row_seconds : float
        After so long no further round of calls begins.
    """

    part: str
    repeats: int
    show: Callable[[Row], None]
    say: Callable[[str], None]
    scratch: Path
    data: Path
    also: list[Path] = field(default_factory=list)
    shared: bool = False
    row_seconds: float = 60.0
    rows: list[Row] = field(default_factory=list)
    facts: dict[str, Any] = field(default_factory=dict)

    @property
    def threads(self) -> tuple[int, ...]:
        """Return the measured numbers of threads."""
        return (1,) if self.shared else (1, 2)

    @property
    def clock(self) -> Clock:
        """Return seconds since some moment."""
        return processor_seconds if self.shared else time.perf_counter

    def typical(self, seconds: list[float]) -> float:
        """Return the representative of the seconds of equal calls."""
        return min(seconds) if self.shared else statistics.median(seconds)

    def seconds(self, call: Call, repeats: int | None = None) -> float:
        """Return typical seconds of a call."""
        return self.typical(self.race({"call": call}, repeats)["call"])

    def timed(self, call: Call) -> tuple[float, Any]:
        """Return the seconds of one call, and its result."""
        return timed(call, self.clock)

    def add(self, row: Row) -> None:
        """Keep a row and show it."""
        self.rows.append(row)
        self.show(row)

    def race(self, calls: dict[str, Call], repeats: int | None = None, warm: bool = True) -> dict[str, list[float]]:
        """Return the seconds of every call, made in turn `repeats` times, or until `row_seconds` are over.

        With `warm` the first round does not count, unless it alone takes as long.
        """
        seconds: dict[str, list[float]] = {name: [] for name in calls}
        end = time.perf_counter() + self.row_seconds
        for turn in range(warm + (repeats or self.repeats)):
            if turn and time.perf_counter() > end:
                break
            if turn == 1 and warm:
                seconds = {name: [] for name in calls}
            for name, call in calls.items():
                seconds[name].append(self.timed(call)[0])
        return seconds

    def compare(
        self,
        work: str,
        ours: Call,
        peers: dict[str, tuple[Call, float | None]],
        note: str = "",
        repeats: int | None = None,
        warm: bool = True,
    ) -> dict[str, float]:
        """Race `ours` against every peer (a call and a target), add a row for each, and return typical seconds."""
        seconds = self.race({"CTMC": ours, **{name: call for name, (call, _) in peers.items()}}, repeats, warm)
        typical = {name: self.typical(taken) for name, taken in seconds.items()}
        for name, (_, target) in peers.items():
            runs = {"CTMC": seconds["CTMC"], name: seconds[name]}
            self.add(Row(self.part, work, name, typical["CTMC"], typical[name], target, note=note, runs=runs))
        return typical


def processor_seconds() -> float:
    """Return the processor time of this process and of ended child processes (to 10 ms; not on Windows)."""
    times = os.times()
    return time.process_time() + times.children_user + times.children_system


def timed(call: Call, clock: Clock = time.perf_counter) -> tuple[float, Any]:
    """Return the seconds of a call and its result, without garbage collection in between."""
    gc.collect()
    gc.disable()
    try:
        start = clock()
        result = call()
        return clock() - start, result
    finally:
        gc.enable()


def peak_bytes(call: Call, returned: Callable[[Any], int]) -> int:
    """Return the most memory that Python and NumPy held during a call, without its result."""
    call()  # tables and imports made on first use are not the call's
    gc.collect()
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        tracemalloc.reset_peak()
        result = call()
        return tracemalloc.get_traced_memory()[1] - before - returned(result)
    finally:
        tracemalloc.stop()


def stage_seconds(session: Session, make_steps: Callable[[], Any]) -> dict[str, float]:
    """Return typical seconds between the steps of long work, by the message of the step that ends them."""
    runs: list[dict[str, float]] = []
    for _ in range(session.repeats + 1):
        gc.collect()
        taken: dict[str, float] = {}
        before = session.clock()
        for step in make_steps():
            now = session.clock()
            taken[step.message] = taken.get(step.message, 0.0) + now - before
            before = now
        runs.append(taken)
    return {stage: session.typical([run.get(stage, 0.0) for run in runs[1:]]) for stage in runs[-1]}


def bandwidth(session: Session, threads: int, size: int = 1 << 28) -> dict[str, float]:
    """Return the bytes per second that this machine reads and writes with this many threads.

    Written into memory that is in use already: what fresh memory costs on top is the system's page faults.
    """
    block = np.ones(size, np.uint8)  # zeros would be one page of the system's, read again and again
    parts = [slice(size * part // threads, size * (part + 1) // threads) for part in range(threads)]
    with ThreadPoolExecutor(threads) as pool:

        def read() -> None:
            list(pool.map(lambda part: block[part].max(), parts))

        def write() -> None:
            list(pool.map(lambda part: block[part].fill(1), parts))

        return {"read": size / session.seconds(read), "write": size / session.seconds(write)}


def least_seconds(read: float, written: float, width: dict[str, float]) -> float:
    """Return the seconds to move these bytes at full bandwidth."""
    return read / width["read"] + written / width["write"]
