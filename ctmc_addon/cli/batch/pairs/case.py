# SPDX-License-Identifier: GPL-3.0-or-later
"""Compare one pair of a batch: read both label volumes and write change.csv, with a JSON, also for errors."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from .... import readers
from ....core import (
    AbsentLabelError,
    Budget,
    ChangeLimits,
    CtmcError,
    change_csv,
    compare_labels_steps,
    finish,
    peak_bytes,
    written_columns,
)
from ....core.files.atomic_write import create_folder, write_text
from ...commands.change import labels_steps
from ...commands.reconstruct import source_of
from ...flags.arguments import with_flags
from ..case import CHANGING_FOLDERS, Ask, announced_budget, require_version, write_error
from ..files import (
    ABSENT,
    DONE,
    batch_is_over,
    identity,
    input_key,
    options_of,
    put_output,
    require_batch,
    settings_of,
    since,
    size_of,
    without_folders,
)

TABLE = "change.csv"


def do_pair(task: Mapping[str, Any], unfinished: Path, ask: Ask | None = None) -> None:
    """Compare both volumes of a task; it gets a JSON with its rows or its error."""
    start = time.perf_counter()
    [output] = task["outputs"]
    try:
        require_version(task)
        _compare(task, output, unfinished, ask, start)
    except AbsentLabelError as error:
        write_error(task, output, error, start, ABSENT, pair_key(task))
    except (CtmcError, MemoryError) as error:
        write_error(task, output, error, start)


def sources_of(task: Mapping[str, Any], output: Mapping[str, Any]) -> list[Path]:
    """Return both files that are read."""
    label = settings_of(output).label
    return [source_of(Path(task[name]), label) for name in ("input", "after")]


def pair_key(task: Mapping[str, Any]) -> dict[str, str]:
    """Return a key that changes with either input, as `input_key` has it for one."""
    keys: Sequence[dict[str, str]] = [
        input_key(readers.open_volume(path, options_of(task).allow_outside), task["verify"])
        for path in sources_of(task, task["outputs"][0])
    ]
    return {
        name: hashlib.blake2b("".join(key[name] for key in keys).encode("ascii"), digest_size=16).hexdigest()
        for name in keys[0]
    }


def _compare(
    task: Mapping[str, Any], output: Mapping[str, Any], unfinished: Path, ask: Ask | None, start: float
) -> None:
    settings, reading = settings_of(output), options_of(task)
    budget = Budget(task["threads"]) if ask is None else announced_budget(task, ask)
    key = pair_key(task)
    before, after = (finish(labels_steps(Path(task[name]), reading, settings, budget)) for name in ("input", "after"))
    days, limits = task["pair"]["days"], ChangeLimits.from_dict(task["pair"]["limits"])
    changes = finish(compare_labels_steps(before, after, settings, output["labels"], days, limits, budget))
    with CHANGING_FOLDERS:
        require_batch(task)  # or its hidden folder would come again
        file = create_folder(unfinished / output["name"]) / TABLE
    write_text(file, change_csv(changes.rows))
    name = file.relative_to(unfinished).as_posix()
    record = {
        "case": output["name"],
        "status": DONE,
        "error": None,
        "rows": [written_columns(row) for row in changes.rows],
        "notes": [with_flags(without_folders(note, task)) for note in changes.notes],
        **identity(task, output),
        **key,
        "run": task["run"],
        "seconds": since(start),
        "memory_bytes": peak_bytes(),
        "files": [name],
        "file_bytes": {name: size_of(file)},
    }
    with CHANGING_FOLDERS:
        if not batch_is_over(task):
            put_output(Path(task["folder"]), output["name"], unfinished, [file], None, record)
