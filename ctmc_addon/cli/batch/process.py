# SPDX-License-Identifier: GPL-3.0-or-later
"""Start and watch the processes that make the cases of a batch, each several cases one after the other.

A process that crashes, or is killed for its memory, takes nothing with it but the case that it was making.
"""

from __future__ import annotations

import json
import os
import queue
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Generator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, Any, NamedTuple

from ...core import CtmcError, OutputError, ending, temporary_files_in
from ...core.files.atomic_write import write_json
from .files import RUNNING, WAITING, failed_record, read_record, record_path, require_batch, without_folders
from .worker import COMMAND, GO, MARK, NEEDS, OVER

PACKAGE = Path(__file__).resolve().parents[2]
# Times in seconds.
TICK = 0.05  # A batch waits no longer for a message of its processes.
PATIENCE = 5.0  # A process that does not leave by itself within this time is killed.
LOOK = 0.5  # A cluster's worker looks this often whether the batch still lives.
KEPT_SECONDS = 10.0  # A cluster's worker keeps a process without a case this long.

ENDED = "ended"
Task = Mapping[str, Any]


class Event(NamedTuple):
    """A change in the state of a task: `RUNNING`, `WAITING` again, or `ENDED` with its records written."""

    task: Task
    status: str


Events = Generator[Event | None, None, None]  # It yields None while nothing happens.
Messages = queue.Queue[tuple["CaseProcess", "str | None"]]  # A process and what it says; None where it has ended.


class CaseProcess:
    """A process that makes cases, one at a time.

    Parameters
    ----------
    messages : queue
        Gets this process and what it says.
    """

    def __init__(self, messages: Messages) -> None:
        self.task: Task = {}
        self.start = 0.0
        self.reserved_bytes = 0
        self.asked_bytes = 0  # The memory that the case asks for and waits to get.
        self.errors: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115  (closed with the process)
        self.errors_before = 0  # bytes that earlier cases wrote, as the process says at the end of each
        # For temporary files. The process removes it at its end, `stop` if it was killed.
        self.folder = tempfile.mkdtemp(prefix="ctmc-")
        # Blender's own chatter is passed over; standard error is kept for a crash.
        try:
            self.process = subprocess.Popen(
                command(),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self.errors,
                env=environment(self.folder),
            )
        except OSError as error:
            self.errors.close()
            shutil.rmtree(self.folder, ignore_errors=True)
            raise CtmcError(
                f"no process could be started for a case ({error.strerror}); try fewer jobs, with --resume"
            ) from error
        self.messages = messages
        threading.Thread(target=self.listen, daemon=True).start()

    def listen(self) -> None:
        """Queue the process's messages until it ends."""
        assert self.process.stdout is not None
        try:
            with self.process.stdout as stream:
                for line in stream:
                    # Blender may print without an end of line before it.
                    _, mark, words = line.decode("utf-8", "replace").rpartition(MARK)
                    words = words.strip()
                    if mark and words.startswith(OVER):
                        self.errors_before = int(words.removeprefix(OVER))
                        words = OVER
                    if mark:
                        self.messages.put((self, words))
        finally:
            self.messages.put((self, None))

    def begin(self, task: Task, reserved_bytes: int = 0) -> None:
        """Let the process make a case with `reserved_bytes` of memory."""
        self.task, self.reserved_bytes, self.asked_bytes = task, reserved_bytes, 0
        self.start = time.perf_counter()
        self.send({**task, "more": True, "temporary": self.folder, "reserved": reserved_bytes})

    def grant(self) -> None:
        """Let the case go on with the memory that it asks for."""
        self.reserved_bytes, self.asked_bytes = self.asked_bytes, 0
        self.send(GO)

    def send(self, content: Any) -> None:
        """Send a line of JSON."""
        assert self.process.stdin is not None
        with suppress(OSError):  # it has ended already, and its status will say why
            self.process.stdin.write(json.dumps(content).encode("ascii") + b"\n")
            self.process.stdin.flush()

    def settle(self, ended: bool) -> None:
        """Give every output of the case its record, now that the case is over or the process has ended."""
        error, printed = "the case left no record", ""
        if ended:
            error = f"the case's process {ending(self.process, self.errors, self.errors_before, 'try fewer jobs')}"
            self.errors.seek(self.errors_before)
            printed = self.errors.read().decode("utf-8", "replace")
        settle(self.task, error, time.perf_counter() - self.start, printed)

    def stop(self) -> None:
        """End the process; what it had not finished goes with it."""
        self.close()
        try:
            self.process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.errors.close()
        shutil.rmtree(self.folder, ignore_errors=True)

    def close(self) -> None:
        """Close the pipe, at whose end the process leaves."""
        assert self.process.stdin is not None
        with suppress(OSError):
            self.process.stdin.close()


def command() -> list[str]:
    """Return the command that starts a process for cases: Blender's own binary inside Blender, else this Python."""
    bpy = sys.modules.get("bpy")
    binary = bpy.app.binary_path if bpy is not None else ""
    if binary:
        # Blender's Python alone has no bpy, and the extension goes by another name there.
        return [binary, "--background", "--command", "ctmc", COMMAND]
    return [sys.executable, "-m", PACKAGE.name, COMMAND]


def environment(folder: str) -> dict[str, str]:
    """Return the environment of a process with temporary files in `folder`, in which the package is found.

    Workers of dask have the C library give every freed array back to the system, to fetch it again page by page: a
    liver takes 1.7 times the processor seconds. A case gives its memory back itself, once it is over.
    """
    paths = [str(PACKAGE.parent), os.environ.get("PYTHONPATH", "")]
    kept = {name: value for name, value in temporary_files_in(folder).items() if name != "MALLOC_TRIM_THRESHOLD_"}
    return {**kept, "PYTHONPATH": os.pathsep.join(filter(None, paths))}


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


# The processes that a cluster's worker keeps.
_idle: list[CaseProcess] = []
_lock = threading.Lock()


def run_task(task: Task) -> None:
    """Do one task from start to end, as a cluster's worker does, which keeps the process for a while for the next.

    Once the batch is over, the process is stopped and no record written.
    """
    require_batch(task)
    with _lock:
        process = _idle.pop() if _idle else None
    process = process or CaseProcess(queue.Queue())
    kept = False
    try:
        process.begin(task)
        words = _last_words(process, task)
        process.settle(ended=words is None)
        kept = words == OVER
    finally:
        if not kept:
            process.stop()
    if not kept:
        return
    with _lock:
        _idle.append(process)
    timer = threading.Timer(KEPT_SECONDS, _stop_if_idle, [process, process.start])
    timer.daemon = True
    timer.start()


def _last_words(process: CaseProcess, task: Task) -> str | None:
    """Return the words of a process at the end of its case, None if it has ended.

    Raises a `CtmcError` if the batch ends before.
    """
    while True:
        words, has_said = None, False
        with suppress(queue.Empty):
            words, has_said = process.messages.get(timeout=LOOK)[1], True
        require_batch(task)
        if has_said:
            return words


def _stop_if_idle(process: CaseProcess, start: float) -> None:
    """Stop a process that has had no other case since the one that began at `start`."""
    with _lock:
        if process not in _idle or process.start != start:
            return
        _idle.remove(process)
    process.stop()


def run_here(tasks: Sequence[Task], jobs: int, needs: Sequence[int], limit: int | None) -> Events:
    """Do the tasks on this machine, some at once.

    A process makes one case after the other. A case may ask for more memory when it knows what it needs, and waits
    until it is there; where all of them wait, the last one to begin is put back, to begin with what it asks for.

    Parameters
    ----------
    jobs : int
        Processes at once, at most.
    needs : sequence of int
        Memory that each task needs to begin, bytes.
    limit : int or None
        Memory that they may need together; a task that needs more runs alone.
    """
    waiting = deque(zip(tasks, needs, strict=True))
    messages: Messages = queue.Queue()
    running: list[CaseProcess] = []
    processes: list[CaseProcess] = []
    idle: list[CaseProcess] = []
    try:
        while waiting or running:
            while granted := first_to_grant(running, limit):
                granted.grant()
            if running and all(process.asked_bytes for process in running):
                last = running.pop()
                waiting.appendleft((last.task, last.asked_bytes))
                yield Event(last.task, WAITING)
                processes.remove(last)
                last.stop()
                continue
            while waiting and len(running) < jobs and fits(running, waiting[0][1], limit):
                task, need = waiting.popleft()
                if not idle:
                    idle.append(CaseProcess(messages))
                    processes.append(idle[-1])
                running.append(idle.pop())
                running[-1].begin(task, need)
                yield Event(task, RUNNING)
            for process in idle:  # Running cases need the memory that an idle process keeps.
                process.close()
            idle = []
            try:
                process, words = messages.get(timeout=TICK)
            except queue.Empty:
                yield None
                continue
            if words is not None and words.startswith(NEEDS):
                process.asked_bytes = int(words.removeprefix(NEEDS))
                continue
            if process in running:
                running.remove(process)
                process.settle(ended=words is None)
                if words == OVER:
                    idle.append(process)
                yield Event(process.task, ENDED)
            if words is None and process in processes:  # It is not if it was put back.
                processes.remove(process)
                process.stop()
    finally:
        for process in processes:
            process.close()
        for process in processes:
            process.stop()


def fits(running: Sequence[CaseProcess], need: int, limit: int | None) -> bool:
    """Return whether `need` bytes fit beside those that running cases reserve; True if none runs."""
    return not running or limit is None or sum(process.reserved_bytes for process in running) + need <= limit


def first_to_grant(running: Sequence[CaseProcess], limit: int | None) -> CaseProcess | None:
    """Return the first case whose memory there is room for now, of those that ask."""
    for process in running:
        other_processes = [each for each in running if each is not process]
        if process.asked_bytes and fits(other_processes, process.asked_bytes, limit):
            return process
    return None
