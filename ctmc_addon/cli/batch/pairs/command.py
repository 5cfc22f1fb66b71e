# SPDX-License-Identifier: GPL-3.0-or-later
"""Run `ctmc batch --pairs PAIRS.csv -o DIR`: compare many pairs, several at once, with a table of them all."""

from __future__ import annotations

import argparse
import uuid
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

from ....core import (
    CHANGE_HEADS,
    VERSION,
    Budget,
    CtmcError,
    Step,
    Steps,
    case_bytes,
    cases_at_once,
    cases_bytes,
    processors,
)
from ....core.files.atomic_write import create_folder, require_writable, write_csv
from ....core.files.input_files import add_inputs, plan_output
from ...commands.change import limits_of
from ...commands.reconstruct import source_of
from ...flags.arguments import UsageError, given_settings, reading_of
from ...flags.solid import given_solid
from ...terminal import Progress, listing, require_empty, table
from ..cases import values_of
from ..files import (
    ABSENT,
    DONE,
    FAILED,
    is_refused_now,
    is_same_input,
    read_record,
    record_path,
    remove_unfinished,
    stands_for,
    unfinished_folder,
)
from ..process import ENDED, run_here
from .case import TABLE, pair_key, sources_of
from .cases import PairCase, collect_pairs

COMBINED = "changes.csv"
HEADS = ("case", *CHANGE_HEADS, "error")
Record = Mapping[str, Any]


def run_pairs(args: argparse.Namespace) -> None:
    """Collect the pairs, compare those that are left, and write and print the table; an error if any failed."""
    if args.html or args.hu or args.scheduler:
        raise UsageError("--pairs writes tables on this machine; leave out --html, --hu and --scheduler")
    if args.maps or args.map_limit or args.map_table:
        raise UsageError("--pairs measures the distance to the earlier surface; leave out flags for other maps")
    if given_solid(args):
        raise UsageError("--pairs compares surfaces of labels; leave out flags of solids")
    folder = Path(args.output)
    limits = limits_of(args)
    reading = reading_of(args)
    pairs = collect_pairs(args.inputs, given_settings(args), reading)
    if not (args.resume or args.overwrite):
        require_empty(folder, "go on with --resume, start again with --overwrite, or choose another")
    create_folder(folder)
    require_writable(folder / COMBINED)
    add_inputs(path for pair in pairs for path in (pair.before, pair.after) if path.is_file())
    for path in [folder / COMBINED, *(path for pair in pairs for path in _files_of(folder, pair))]:
        plan_output(path)
    remove_unfinished(folder)
    run = uuid.uuid4().hex[:12]
    with unfinished_folder(folder) as unfinished, Progress() as progress:
        tasks = [_task_of(pair, folder, args, limits.to_dict(), run) | {"unfinished": unfinished} for pair in pairs]
        progress.finish(_pairs_steps(pairs, tasks, args))
    records = {pair.name: read_record(folder, pair.name) or {"error": "it left no record"} for pair in pairs}
    write_csv(folder / COMBINED, _rows_of(records), HEADS)
    print(f"{_table_of(records)}\n\n{listing(_facts_of(records))}", flush=True)
    absent = (DONE,) if reading.strict else (DONE, ABSENT)
    failed = [name for name, record in records.items() if record.get("status") not in absent]
    if failed:
        raise CtmcError(f"{len(failed)} of {len(pairs)} pairs failed: {', '.join(failed)}")


def _files_of(folder: Path, pair: PairCase) -> list[Path]:
    return [record_path(folder, pair.name), folder / pair.name / TABLE]


def _task_of(
    pair: PairCase, folder: Path, args: argparse.Namespace, limits: Mapping[str, Any], run: str
) -> dict[str, Any]:
    """Return the task of a pair as plain data, for the process that makes it."""
    settings = pair.settings.to_dict()
    settings.pop("label", None)
    return {
        "run": run,
        "case": pair.name,
        "input": str(pair.before.absolute()),
        "after": str(pair.after.absolute()),
        "pair": {"days": pair.days, "limits": dict(limits)},
        "reading": pair.reading.to_dict(),
        "outputs": [{"name": pair.name, "settings": settings, "labels": list(pair.labels), "beside": []}],
        "folder": str(folder.absolute()),
        "format": ".csv",
        "space": "ras",
        "verify": args.verify,
        "threads": args.threads,
        "asks": True,
        "version": VERSION,
    }


def _pairs_steps(pairs: Sequence[PairCase], tasks: Sequence[dict[str, Any]], args: argparse.Namespace) -> Steps[None]:
    """Compare the pairs that are left, several at once."""
    left, needs = [], []
    for at, (pair, task) in enumerate(zip(pairs, tasks, strict=True)):
        yield Step(0.1 * at / len(tasks), f"Checking {pair.name}")
        if not (args.resume and _is_done(task)):
            left.append(task)
            needs.append(_need_of(pair))
    facts = [("pairs", f"{len(pairs)}" + (f", {len(pairs) - len(left)} done before" if len(left) < len(pairs) else ""))]
    jobs = 1
    if left:
        jobs, reason = cases_at_once(args.jobs, needs, Budget())
        facts.append(("at once", f"{jobs}, {reason}"))
    print(listing(facts), flush=True)
    for task in left:
        task["threads"] = task["threads"] or max(1, processors() // jobs)
    over = 0
    with closing(run_here(left, jobs, needs, cases_bytes(Budget()))) as events:
        for event in events:
            if event is not None and event.status == ENDED:
                over += 1
            yield Step(0.1 + 0.9 * over / len(left), f"{over} of {len(left)} pairs compared")


def _is_done(task: Mapping[str, Any]) -> bool:
    """Return whether a pair was compared before, with the same settings, version and inputs."""
    [output] = task["outputs"]
    record = read_record(Path(task["folder"]), output["name"])
    if record is None or not stands_for(record, task, output):
        return False
    try:
        key = pair_key(task)
    except (CtmcError, OSError):
        return False
    return is_same_input(record, key) and not any(
        is_refused_now(record, task, source) for source in sources_of(task, output)
    )


def _need_of(pair: PairCase) -> int:
    """Return the bytes of memory that a pair starts with; it asks for more when it knows what it needs."""
    sources = (source_of(path, pair.settings.label) for path in (pair.before, pair.after))
    return case_bytes(sum(values_of(source, pair.reading.allow_outside)[0] for source in sources), None, False)


def _rows_of(records: Mapping[str, Record]) -> list[dict[str, Any]]:
    """Return the rows of all pairs; one that failed has a row with its error."""
    rows: list[dict[str, Any]] = []
    for name, record in records.items():
        rows += [{"case": name, **row} for row in record.get("rows", [])]
        if record.get("error"):
            rows.append({"case": name, "status": record.get("status", FAILED), "error": record["error"]})
    return rows


def _table_of(records: Mapping[str, Record]) -> str:
    """Return for each pair how many components have which status."""
    lines = [("case", "status", "changes", "seconds")]
    for name, record in records.items():
        counts = Counter(row["status"] for row in record.get("rows", []))
        changes = ", ".join(f"{count} {status}" for status, count in counts.items())
        seconds = record.get("seconds")
        status = record.get("status", FAILED)
        lines.append((name, status, changes, "" if seconds is None else f"{seconds:.1f}"))
    return table(lines)


def _facts_of(records: Mapping[str, Record]) -> list[tuple[str, str]]:
    errors = [(name, str(record["error"])) for name, record in records.items() if record.get("error")]
    return [*errors, ("written", COMBINED)]
