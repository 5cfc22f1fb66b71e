# SPDX-License-Identifier: GPL-3.0-or-later
"""Start one process for each case, look after it, and say what ended it.

A process that crashes, or is killed for its memory, takes nothing with it but its own case.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Generator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, Any, NamedTuple

from ...core import CtmcError, OutputError
from ...core.files.atomic_write import write_json
from .case import COMMAND
from .files import failed_record, read_record, record_path, without_folders

PACKAGE = Path(__file__).resolve().parents[2]
TICK = 0.05  # seconds between two looks at the processes
PATIENCE = 5.0  # seconds that a process gets to leave by itself

Task = Mapping[str, Any]


class Event(NamedTuple):
    """A change in the state of a task: 'running', or 'ended' with its records written."""

    task: Task
    status: str


Events = Generator[Event | None, None, None]  # yields events, and None while nothing happens


class CaseProcess:
    """The process of one case."""

    def __init__(self, task: Task) -> None:
        self.task = task
        self.start = time.perf_counter()
        self.errors: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115  (closed with the process)
        # Blender's own chatter goes nowhere; standard error is kept for a crash.
        try:
            self.process = subprocess.Popen(
                command(), stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=self.errors, env=environment()
            )
        except OSError as error:
            self.errors.close()
            raise CtmcError(
                f"no process could be started for {task['case']} ({error.strerror}); try fewer jobs, with --resume"
            ) from error
        assert self.process.stdin is not None
        try:
            self.process.stdin.write(json.dumps(task).encode("ascii") + b"\n")
            self.process.stdin.flush()
        except OSError:
            pass  # it has ended already, and its status will say why

    def ended(self) -> bool:
        """Return whether the process has ended; if so, every output has its record."""
        status = self.process.poll()
        if status is None:
            return False
        self.errors.seek(0)
        printed = self.errors.read().decode("utf-8", "replace")
        settle(self.task, death(status, printed), time.perf_counter() - self.start, printed)
        self.close()
        return True

    def wait(self) -> None:
        """Wait until the process has ended."""
        self.process.wait()
        self.ended()

    def stop(self) -> None:
        """End the process; what it had not finished goes with it."""
        self.close()
        try:
            self.process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()

    def close(self) -> None:
        """Close the pipe, at whose end the process leaves, and the file."""
        assert self.process.stdin is not None
        try:
            self.process.stdin.close()
        except OSError:
            pass
        self.errors.close()


def command() -> list[str]:
    """Return how a process for one case is started: Blender's own binary inside Blender, else this Python."""
    bpy = sys.modules.get("bpy")
    binary = bpy.app.binary_path if bpy is not None else ""
    if binary:
        # Blender's Python alone has no bpy, and the extension goes by another name there.
        return [binary, "--background", "--command", "ctmc", COMMAND]
    return [sys.executable, "-m", PACKAGE.name, COMMAND]


def environment() -> dict[str, str]:
    """Return the environment of this process, in which the package is found wherever it was started from."""
    paths = [str(PACKAGE.parent), os.environ.get("PYTHONPATH", "")]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))}


def death(status: int, printed: str) -> str:
    """Why a process ended without a record for each output, in one sentence."""
    if status < 0:
        try:
            name = signal.Signals(-status).name
        except ValueError:
            name = "unknown"
        killed = "; perhaps memory ran out: try fewer jobs" if name == "SIGKILL" else ""
        return f"the case's process was ended by signal {-status} ({name}){killed}"
    lines = [line.strip() for line in printed.splitlines() if line.strip()]
    last = lines[-1].removeprefix("ctmc: ") if lines else "it printed nothing"
    return f"the case's process ended with exit code {status}: {last}"


def settle(task: Task, error: str, seconds: float | None = None, printed: str = "") -> None:
    """Give every output that has no record of this run one with this error; a defect's traceback goes with it."""
    folder = Path(task["folder"])
    for output in task["outputs"]:
        record = read_record(folder, output["name"])
        if record is None or record.get("run") != task["run"]:
            record = failed_record(task, output, error, None if seconds is None else round(seconds, 3))
            if "Traceback " in printed:
                record["traceback"] = [without_folders(line, task) for line in printed.splitlines()]
            path = record_path(folder, output["name"])
            try:
                write_json(path, record)
            except OutputError:  # a full disk ends no batch; an older JSON would say that all is well
                with suppress(OSError):
                    path.unlink(missing_ok=True)


def run_task(task: Task) -> None:
    """Do one task from start to end, as a cluster's worker does."""
    process = CaseProcess(task)
    try:
        process.wait()
    finally:
        process.stop()


def run_here(tasks: Sequence[Task], jobs: int, needs: Sequence[int], limit: int | None) -> Events:
    """Do the tasks on this machine, some at once.

    Parameters
    ----------
    jobs : int
        Processes at once, at most.
    needs : sequence of int
        Memory that each task needs, bytes.
    limit : int or None
        Memory that they may need together; a task that needs more runs alone.
    """
    waiting = list(zip(tasks, needs, strict=True))
    running: list[tuple[CaseProcess, int]] = []
    try:
        while waiting or running:
            used = sum(need for _, need in running)
            while waiting and len(running) < jobs:
                task, need = waiting[0]
                if running and limit is not None and used + need > limit:
                    break
                del waiting[0]
                used += need
                running.append((CaseProcess(task), need))
                yield Event(task, "running")
            ended = [(process, need) for process, need in running if process.ended()]
            running = [pair for pair in running if pair not in ended]
            for process, _ in ended:
                yield Event(process.task, "ended")
            if not ended:
                yield None
                time.sleep(TICK)
    finally:
        for process, _ in running:
            process.close()
        for process, _ in running:
            process.stop()
