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
    VERSION,
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
from ....core.files.atomic_write import create_folder, write_json, write_text
from ...commands.change import labels_steps
from ...commands.reconstruct import source_of
from ...flags.arguments import with_flags
from ..case import CHANGING_FOLDERS, NO_MEMORY, Ask, announced_budget
from ..files import (
    ABSENT,
    DONE,
    batch_is_over,
    failed_record,
    identity,
    input_key,
    options_of,
    put_output,
    record_path,
    require_batch,
    settings_of,
    size_of,
    without_folders,
)

TABLE = "change.csv"


def do_pair(task: Mapping[str, Any], unfinished: Path, ask: Ask | None = None) -> None:
    """Compare both volumes of a task; it gets a JSON with its rows or its error."""
    start = time.perf_counter()
    [output] = task["outputs"]
    try:
        if task["version"] != VERSION:
            raise CtmcError(f"ctmc here is {VERSION} and the batch's is {task['version']}; install the same")
        _compare(task, output, unfinished, ask, start)
    except (CtmcError, MemoryError) as error:
        sentence = NO_MEMORY if isinstance(error, MemoryError) else with_flags(str(error))
        status = (ABSENT,) if isinstance(error, AbsentLabelError) else ()
        record = failed_record(task, output, sentence, _since(start), *status)
        if status:
            record |= pair_key(task)
        with CHANGING_FOLDERS:
            if not batch_is_over(task):
                write_json(record_path(Path(task["folder"]), output["name"]), record)


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
        "seconds": _since(start),
        "memory_bytes": peak_bytes(),
        "files": [name],
        "file_bytes": {name: size_of(file)},
    }
    with CHANGING_FOLDERS:
        if not batch_is_over(task):
            put_output(Path(task["folder"]), output["name"], unfinished, [file], None, record)


def _since(start: float) -> float:
    return round(time.perf_counter() - start, 3)
