"""One case of a batch in a process of its own: `ctmc batch` starts it and hands it a task on standard input.

Standard input stays open while the batch lives. Its end means that the batch is gone, killed perhaps: then this process
takes away what it has not finished and goes too.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ... import readers
from ...core import VERSION, CtmcError, ReconstructionSettings, Volume, finish, reconstruct_steps
from ...reporting.atomic_write import made_folder, refused
from ..arguments import with_flags
from ..commands.reconstruct import Outputs, Work, require_label_volume, source_of, written_steps
from .files import (
    failed_record,
    fingerprint_of,
    identity,
    put_record,
    size_of,
    thumbnail_path,
    unfinished_folder,
    without_folders,
)

COMMAND = "batch-case"
THUMBNAIL = (160, 120)
NO_MEMORY = "there is not enough memory; choose a region, a larger stride or fewer jobs"


def add_parser(commands: Any) -> None:
    """Add the command to `ctmc`; it is not for people, and has no help."""
    commands.add_parser(COMMAND, allow_abbrev=False).set_defaults(run=run)


def run(chosen: argparse.Namespace) -> None:
    """Take the task from standard input, and do it."""
    line = first_line()
    if not line:
        raise CtmcError(f"{COMMAND} is for `ctmc batch` to start; use that")
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the batch gets it too, and ends this process
    task = json.loads(line)
    unfinished = unfinished_folder(Path(task["folder"]))
    threading.Thread(target=leave_with_the_batch, args=(unfinished,), daemon=True).start()
    try:
        do_case(task, unfinished)
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)


def first_line() -> bytes:
    """One line of standard input, read without a buffer that would hold a lock at exit."""
    line = b""
    while not line.endswith(b"\n"):
        piece = os.read(0, 1 << 16)
        if not piece:
            return b""
        line += piece
    return line


def leave_with_the_batch(unfinished: Path) -> None:
    """Wait for the end of standard input, then go at once."""
    while os.read(0, 1 << 16):
        pass
    shutil.rmtree(unfinished, ignore_errors=True)
    os._exit(1)


def do_case(task: Mapping[str, Any], unfinished: Path) -> None:
    """Make every output of a case; a JSON says of each what came of it."""
    folder = Path(task["folder"])
    made = CaseWork(task, unfinished)
    for output in task["outputs"]:
        start = time.perf_counter()
        try:
            if task["version"] != VERSION:
                raise CtmcError(f"ctmc here is {VERSION} and the batch's is {task['version']}; install the same")
            record = made.surface(output)
        except MemoryError:
            record = failed_record(task, output, NO_MEMORY, since(start), made.fingerprint)
        except CtmcError as error:
            record = failed_record(task, output, with_flags(str(error)), since(start), made.fingerprint)
        else:
            record["seconds"] = since(start)
        put_record(folder, output["name"], record)


def since(start: float) -> float:
    """Seconds since `start`, to a millisecond."""
    return round(time.perf_counter() - start, 3)


class CaseWork:
    """One case on its way: its volume is read once for all outputs of the same file."""

    def __init__(self, task: Mapping[str, Any], unfinished: Path) -> None:
        self.task = task
        self.unfinished = unfinished
        self.path = Path(task["input"])
        self.source: Path | None = None
        self.volume: Volume | None = None
        self.fingerprint: str | None = None

    def surface(self, output: Mapping[str, Any]) -> dict[str, Any]:
        """Make one output and put it in its place; returns its record."""
        task, name = self.task, output["name"]
        settings = ReconstructionSettings.from_dict(output["settings"])
        source, notes = source_of(self.path, settings.label)
        work = Work(notes=list(notes))
        with work.timed("Reading"):
            volume = self.read(source)
        require_label_volume(volume, self.path, settings.label)
        result = finish(reconstruct_steps(volume, settings, task["threads"]))
        thumbnail = self.unfinished / f"{name}.png" if task["thumbnails"] and can_render() else None
        surface = self.unfinished / f"{name}{task['format']}"
        result = finish(written_steps(result, Outputs((surface,), None, thumbnail, task["space"], THUMBNAIL), work))
        folder = Path(task["folder"])
        placed(surface, folder / surface.name)
        if thumbnail is not None:
            made_folder(thumbnail_path(folder, name).parent)
            placed(thumbnail, thumbnail_path(folder, name))
        report = result.report()
        report["notes"] = [without_folders(note, task) for note in report["notes"]]
        return {
            "case": name,
            "status": "done",
            "error": None,
            **report,
            **identity(task, output),
            "fingerprint": self.fingerprint,
            "files": [surface.name],
            "file_bytes": {surface.name: size_of(folder / surface.name)},
        }

    def read(self, source: Path) -> Volume:
        """The volume in a file, kept for the outputs to come."""
        if self.volume is None or self.source != source:
            self.volume, self.source, self.fingerprint = None, source, None
            self.fingerprint = fingerprint_of(source)
            reading = dict(self.task["reading"])
            self.volume = finish(readers.read_volume_steps(source, **reading, threads=self.task["threads"]))
        return self.volume


def can_render() -> bool:
    """Whether this Blender has the engine for thumbnails; without it there are none."""
    import bpy

    return hasattr(bpy.types.Scene, "cycles")


def placed(made: Path, path: Path) -> None:
    """Move a complete file to its place on the same disk, in one go."""
    try:
        made.replace(path)
    except OSError as error:
        raise refused(path, error) from error
