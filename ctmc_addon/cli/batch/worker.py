# SPDX-License-Identifier: GPL-3.0-or-later
"""Run a process that makes cases of a batch one after the other: `ctmc batch` starts it and hands it tasks.

A task is a line of JSON on standard input; when its case is over, a line on standard output says so. Standard input
stays open while the batch lives. Its end means that there is nothing more to do, or that the batch is gone, killed
perhaps: then this process removes what it has not finished and goes too.
"""

from __future__ import annotations

import argparse
import gc
import os
import queue
import shutil
import signal
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ...core import (
    CtmcError,
    case_process_is_large,
    give_back,
    own_output,
    requests,
    reset_peak_bytes,
    resident_bytes,
    send,
)
from ...core.files.input_files import own_input_files
from .case import CHANGING_FOLDERS, do_case
from .files import own_unfinished_folder, remove_own_unfinished
from .pairs.case import do_pair

COMMAND = "batch-case"
MARK = "ctmc-batch-case "  # Every line for the batch begins with this, because Blender prints on standard output too.
OVER, LEAVING, NEEDS = "over", "leaving", "needs"
GO = "go"


def add_parser(commands: Any) -> None:
    """Add the command to `ctmc`; it is not for people, and has no help."""
    commands.add_parser(COMMAND).set_defaults(run=run)


def run(_args: argparse.Namespace) -> None:
    """Take tasks from standard input, and do them, until it ends or this process has grown."""
    asked = requests()
    first = next(asked, None)
    if first is None:
        raise CtmcError(f"{COMMAND} is for `ctmc batch` to start; use that")
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # The batch gets Ctrl-C too, and ends this process.
    batch = _BatchPipe(asked, own_output(), Path(first["temporary"]))
    try:
        batch.take(first)
        threading.Thread(target=batch.listen, daemon=True).start()
        _do_cases(batch)
    finally:
        shutil.rmtree(batch.temporary, ignore_errors=True)


def _do_cases(batch: _BatchPipe) -> None:
    """Do one task after the other, until there is none or this process has grown."""
    while (task := batch.tasks.get()) is not None:
        unfinished = own_unfinished_folder(task)
        reset_peak_bytes()
        try:
            with own_input_files():
                make = do_pair if "pair" in task else do_case
                make(task, unfinished, batch.ask if task.get("asks") else None)
        finally:
            shutil.rmtree(unfinished, ignore_errors=True)
        gc.collect()  # what refers to itself holds volumes, too
        give_back()
        # A batch of another installation may wait for the end of this process.
        leaving = case_process_is_large(resident_bytes()) or not task.get("more")
        batch.end_task(LEAVING if leaving else f"{OVER} {_written_errors()}")
        if leaving:
            return


class _BatchPipe:
    """The batch at the other end of standard input and output.

    Parameters
    ----------
    asked : iterator
        The tasks and words that it sends.
    output : int
        The file that it reads.
    temporary : Path
        The folder for this process's temporary files.
    """

    def __init__(self, asked: Iterator[Any], output: int, temporary: Path) -> None:
        self.asked = asked
        self.output = output
        self.temporary = temporary
        self.tasks: queue.SimpleQueue[dict[str, Any] | None] = queue.SimpleQueue()
        self.unfinished: Path | None = None  # of the task that is under way
        self.granted = threading.Event()

    def take(self, task: dict[str, Any]) -> None:
        """Let a task be the next."""
        self.unfinished = own_unfinished_folder(task)
        self.tasks.put(task)

    def listen(self) -> None:
        """Take what comes on standard input; at its end leave, as soon as no output is being put in its place."""
        for word in self.asked:
            if word == GO:
                self.granted.set()
            else:
                self.take(word)
        unfinished = self.unfinished
        if unfinished is None:
            self.tasks.put(None)
            return
        with CHANGING_FOLDERS:  # never released: no folder comes again
            remove_own_unfinished(unfinished)
            shutil.rmtree(self.temporary, ignore_errors=True)
            os._exit(1)

    def end_task(self, word: str) -> None:
        """Report that the case has ended, and whether this process takes another."""
        self.unfinished = None
        self.send(word)

    def ask(self, needed_bytes: int) -> None:
        """Tell the batch the bytes that this process will need in all, and wait until there is room for them."""
        self.granted.clear()
        self.send(f"{NEEDS} {needed_bytes}")
        self.granted.wait()

    def send(self, words: str) -> None:
        """Write a line for the batch."""
        send(self.output, f"{MARK}{words}\n".encode("ascii"))


def _written_errors() -> int:
    """Return the bytes in the file that standard error goes to: the next case's errors begin behind them.

    The batch cannot look itself: the process may have died, and written why, by then.
    """
    sys.stderr.flush()
    return os.fstat(2).st_size
