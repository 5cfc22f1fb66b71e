# SPDX-License-Identifier: GPL-3.0-or-later
"""Run `ctmc batch INPUTS... -o DIR`: a surface for each of many cases, several at once, with a table of them all."""

from __future__ import annotations

import argparse
import math
import sys
import time
import uuid
from collections.abc import Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ... import readers
from ...core import (
    VERSION,
    Budget,
    CtmcError,
    Place,
    Step,
    Steps,
    asks_for_memory,
    case_bytes,
    cases_at_once,
    cases_bytes,
    files_of,
    measures_in,
    processors,
)
from ...core.files.atomic_write import create_folder, require_writable
from ...core.files.input_files import add_inputs, plan_output
from ...core.files.mesh_files import PAGE, SPACES, SURFACE_SUFFIXES
from ..commands.change import add_limits
from ..commands.reconstruct import source_of
from ..flags.arguments import add_quiet, add_reading, add_settings, at_least, given_settings, reading_of
from ..flags.maps import add_maps, asked_maps
from ..flags.solid import NOTHING, add_solid, given_solid
from ..machine.blender_host import has_blender, require_blender
from ..outputs import Outputs
from ..surfaces import open_words
from ..terminal import Progress, listing, require_empty, table
from .cases import Case, collect, values_of
from .files import (
    ABSENT,
    DONE,
    RUNNING,
    WAITING,
    is_otsu,
    is_refused_now,
    is_same_input,
    key_or_empty,
    options_of,
    read_record,
    record_path,
    remove_unfinished,
    settings_of,
    stands_for,
    thumbnail_path,
    unfinished_folder,
)
from .pairs.command import run_pairs
from .process import ENDED, Event, Events, run_here
from .summary import LABELS_FILE, SUMMARY_FILES, SummaryRow, amount, counts, write_summary, write_summary_if_possible

if TYPE_CHECKING:
    from .cluster import Cluster

FORMATS = tuple(suffix.lstrip(".") for suffix in SURFACE_SUFFIXES)
# While a batch runs, its summary is written no more often than this, and takes no more than this share of the time.
SUMMARY_SECONDS, SUMMARY_SHARE = 1.0, 0.1
MOST_ABSENT = 3  # The table names no more absent cases.
OTSU = "without --label or --threshold, Otsu's threshold makes one surface; use --label 1 2 or --label all for labels"


def add_parser(commands: Any) -> None:
    """Add the command to `ctmc`."""
    parser = commands.add_parser(
        "batch",
        help="make surfaces from many volumes",
        description="Make a surface for each of many cases, several side by side, and a summary of them all. "
        "In LiTS, volume-N is a case and segmentation-N beside it has its labels. A case without the label is absent, "
        "which is a failure only with --strict.",
    )
    parser.add_argument(
        "inputs",
        nargs="+",
        metavar="INPUT",
        help="folder of volumes or slices, file, glob, or a .csv with the columns input, case and any setting",
    )
    parser.add_argument("-o", "--output", required=True, metavar="DIR", help="output folder, created if needed")
    add_reading(parser, names=False)
    add_settings(parser, many=("label",))
    group = parser.add_argument_group("output")
    group.add_argument(
        "--output-format", choices=FORMATS, default="stl", help="file format of the surfaces (default stl)"
    )
    group.add_argument(
        "--space", choices=SPACES, default="ras", help="axes of .stl, .ply, .obj and .3mf, mm (default ras)"
    )
    group.add_argument("--no-thumbnails", action="store_true", help="leave thumbnails out of summary.html")
    group.add_argument("--html", action="store_true", help="also make a page of each case, linked from summary.html")
    group.add_argument(
        "--hu",
        action="store_true",
        help="measure mean HU inside each label; also reads the CT beside the labels (LiTS)",
    )
    group.add_argument(
        "--map-table", action="store_true", help="also write CASE-maps.csv: every vertex, mm, and the values there"
    )
    again = group.add_mutually_exclusive_group()
    again.add_argument(
        "--resume", action="store_true", help="make only outputs that are missing, failed or out of date"
    )
    again.add_argument("--overwrite", action="store_true", help="make everything again in a folder that is not empty")
    group.add_argument(
        "--verify", action="store_true", help="detect changed inputs by content hash instead of size and date"
    )
    add_solid(parser)
    add_maps(parser)
    group = parser.add_argument_group("pairs")
    group.add_argument(
        "--pairs",
        action="store_true",
        help="compare labels at two times: INPUT is a .csv with the columns case, before, after, label, days and any "
        "setting; writes CASE/change.csv and changes.csv",
    )
    add_limits(group)
    group = parser.add_argument_group("work")
    group.add_argument(
        "--jobs", type=at_least(1), metavar="N", help="cases at once (default: as processors and memory allow)"
    )
    group.add_argument(
        "--threads",
        type=at_least(1),
        metavar="N",
        help="threads of each case (default: processors divided by cases at once)",
    )
    group.add_argument(
        "--scheduler", metavar="ADDRESS", help="send the cases to a dask.distributed cluster, such as tcp://host:8786"
    )
    add_quiet(group)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Collect the cases, make what is left to make, and print the table; an error if any case failed."""
    if args.pairs:
        run_pairs(args)
        return
    folder = Path(args.output)
    maps = asked_maps(args, manifest=any(word.lower().endswith(".csv") for word in args.inputs)).in_folder(Path.cwd())
    cases = collect(args.inputs, given_settings(args), reading_of(args), folder, maps, given_solid(args))
    if not args.scheduler:  # on a cluster the workers need it, not this machine
        _require_blender_for(cases, args.output_format)
    if not (args.resume or args.overwrite):
        require_empty(folder, "go on with --resume, start again with --overwrite, or choose another")
    cluster = _connected(args.scheduler) if args.scheduler else None
    try:
        create_folder(folder)
        require_writable(folder / "summary.json")
        _plan_outputs(cases, folder, [f".{args.output_format}", *([PAGE] if args.html else [])])
        remove_unfinished(folder)
        with unfinished_folder(folder) as unfinished, Progress() as progress:
            rows = progress.finish(_batch_steps(cases, folder, unfinished, args, cluster))
    finally:
        if cluster is not None:
            cluster.close()
    print(f"\n{_table_of(rows, _labels_not_used(cases))}\n\n{counts(rows)}; see summary.html", flush=True)
    failed = [row.case for row in rows if row.status not in (DONE, ABSENT)]
    absent = [row.case for row in rows if row.status == ABSENT and reading_of(args).strict]
    what = [f"{len(failed)} of {amount(rows)} failed: {', '.join(failed)}"] if failed else []
    if absent:
        verb = "lacks" if len(absent) == 1 else "lack"
        what.append(f"{len(absent)} of {amount(rows)} {verb} the label, which --strict refuses: {', '.join(absent)}")
    if what:
        raise CtmcError("; ".join(what))


def _require_blender_for(cases: Sequence[Case], output_format: str) -> None:
    """Raise an error before the start if Blender is needed and missing."""
    outputs = Outputs((Path(f"a.{output_format}"),))
    for case in cases:
        for output in case.outputs:
            purpose = outputs.blender_needed_for(output.settings.simplifier)
            if purpose and not has_blender():
                require_blender(purpose)


def _plan_outputs(cases: Sequence[Case], folder: Path, suffixes: Sequence[str]) -> None:
    """Raise an `OutputError` before the start if a file of an input would be replaced."""
    add_inputs(case.path for case in cases if case.path.is_file())
    has_labels = any(output.labels for case in cases for output in case.outputs)
    for name in (*SUMMARY_FILES, *([LABELS_FILE] if has_labels else [])):
        plan_output(folder / name)
    for case in cases:
        for output in case.outputs:
            plan_output(record_path(folder, output.name))
            plan_output(thumbnail_path(folder, output.name))
            for suffix in suffixes:
                for file in files_of(folder / f"{output.name}{suffix}"):
                    plan_output(file)


def _connected(address: str) -> Cluster:
    """Return a connection to a dask.distributed scheduler."""
    from .cluster import Cluster

    return Cluster(address)


def _batch_steps(
    cases: Sequence[Case], folder: Path, unfinished: str, args: argparse.Namespace, cluster: Cluster | None
) -> Steps[list[SummaryRow]]:
    """Run the tasks that are left; returns a row for every output, in the order of the cases."""
    rows = {output.name: SummaryRow(output.name, of_case=case.name) for case in cases for output in case.outputs}
    run = uuid.uuid4().hex[:12]
    tasks = [_task_of(case, folder, args, run) | {"unfinished": unfinished} for case in cases]
    if args.resume:
        tasks = yield from _remaining_steps(tasks, folder, rows)
    events = _started(tasks, cases, args, cluster)
    total, over = max(len(tasks), 1), 0
    next_write, is_written = _write_now(folder, rows, not tasks), True
    try:
        with closing(events):
            for event in events:
                if event is not None:
                    over += event.status == ENDED
                    _update_rows(event, rows, folder)
                    _print_ended(event, rows)
                    is_written = False
                if not is_written and (over == len(tasks) or time.monotonic() >= next_write):
                    next_write, is_written = _write_now(folder, rows, over == len(tasks)), True
                yield Step(over / total, counts(list(rows.values())))
    finally:
        # Interrupted cases wait to be made again.
        stopped = [row for row in rows.values() if row.status == RUNNING]
        for row in stopped:
            row.status = WAITING
        if stopped or not is_written:
            write_summary_if_possible(folder, list(rows.values()))
    return list(rows.values())


def _write_now(folder: Path, rows: Mapping[str, SummaryRow], over: bool) -> float:
    """Write the summary, and return the time of the next write: thousands of rows take a while."""
    start = time.monotonic()
    write_summary(folder, list(rows.values()), over)
    return start + max(SUMMARY_SECONDS, (time.monotonic() - start) / SUMMARY_SHARE)


def _task_of(case: Case, folder: Path, args: argparse.Namespace, run: str) -> dict[str, Any]:
    """Return the task of a case as plain data, for the process that makes it."""
    return {
        "run": run,
        "case": case.name,
        "input": str(case.path.absolute()),
        "reading": case.reading.to_dict(),
        "outputs": [output.plain() for output in case.outputs],
        "folder": str(folder.absolute()),
        "format": f".{args.output_format}",
        "space": args.space,
        "html": args.html,
        "hu": args.hu,
        "maps": case.maps.plain() if case.maps else None,
        "solid": case.solid.to_dict() if case.solid != NOTHING else None,
        "map_table": args.map_table,
        "thumbnails": not args.no_thumbnails,
        "verify": args.verify,
        "threads": args.threads,
        "version": VERSION,
    }


def _remaining_steps(
    tasks: Sequence[dict[str, Any]], folder: Path, rows: Mapping[str, SummaryRow]
) -> Steps[list[dict[str, Any]]]:
    """Return the tasks with missing outputs; fill the rows of complete ones."""
    left = []
    for at, task in enumerate(tasks):
        yield Step(at / len(tasks), f"Checking {task['case']}")
        remaining = []
        keys: dict[Path, dict[str, str]] = {}
        for output in task["outputs"]:
            record = read_record(folder, output["name"])
            if record is not None and stands_for(record, task, output):
                source = source_of(Path(task["input"]), settings_of(output).label)
                if source not in keys:
                    keys[source] = key_or_empty(source, task["verify"], options_of(task).allow_outside)
                if is_same_input(record, keys[source]) and not is_refused_now(record, task, source):
                    rows[output["name"]].fill(record, folder)
                    continue
            remaining.append(output)
        if remaining:
            left.append(task | {"outputs": remaining})
    return left


def _started(
    tasks: list[dict[str, Any]], cases: Sequence[Case], args: argparse.Namespace, cluster: Cluster | None
) -> Events:
    """Print the number of cases and how many run at once, and begin them."""
    done_before = len(cases) - len(tasks)
    facts = [("cases", f"{len(cases)}" + (f", {done_before} done before" if done_before else ""))]
    if cluster is not None:
        workers = cluster.workers
        facts.append(("workers", f"{workers} at {cluster.address}" + ("" if workers else "; waiting for the first")))
        for task in tasks:
            task["threads"] = task["threads"] or 1
        events = cluster.run(tasks)
    elif not tasks:
        events = run_here([], 1, [], None)
    else:
        by_name = {case.name: case for case in cases}
        thumbnails = not args.no_thumbnails and has_blender()
        needs = [need_of(task, by_name[task["case"]], thumbnails) for task in tasks]
        limit = cases_bytes(Budget())
        jobs, reason = cases_at_once(args.jobs, needs, Budget())
        for task in tasks:
            task["threads"] = task["threads"] or max(1, processors() // jobs)
        facts.append(("at once", f"{jobs}, {reason}"))
        events = run_here(tasks, jobs, needs, limit)
    print(listing([*facts, *_labels_not_used(cases)]), flush=True)
    return events


def _labels_not_used(cases: Sequence[Case]) -> list[tuple[str, str]]:
    """Return facts about cases whose settings use neither the labels beside them nor a threshold."""
    without = [case for case in cases if not case.outputs[0].labels and is_otsu(case.outputs[0].settings)]
    unused = [labels for case in without if (labels := readers.segmentation_sibling(case.path)) is not None]
    if not unused:
        return []
    which = f"{len(unused)} of {len(cases)} case{'s' * (len(cases) != 1)}, such as {unused[0].name}"
    return [("labels", f"found beside {which}, but not used: {OTSU}")]


def need_of(task: dict[str, Any], case: Case, thumbnails: bool) -> int:
    """Return the bytes of memory that a case starts with; a case that knows its needs asks for more."""
    first = case.outputs[0]
    several = bool(first.labels or first.shared_labels)
    asks_early = asks_for_memory(first.settings, several)
    task["asks"] = asks_early or bool(case.solid)  # A solid asks once its surfaces are known.
    source = source_of(case.path, first.settings.label)
    voxels, value_bytes = values_of(source, case.reading.allow_outside)
    need = case_bytes(voxels, value_bytes if asks_early else None, thumbnails or task["format"] == ".blend")
    if task["hu"] and source != case.path and not asks_early:  # who asks does so for the CT too
        need += math.prod(values_of(case.path, case.reading.allow_outside))
    return need


def _print_ended(event: Event, rows: Mapping[str, SummaryRow]) -> None:
    """Print a line for each output of a case that has ended, where output goes to a file and no bar is drawn."""
    if event.status == ENDED and not sys.stdout.isatty():
        for output in event.task["outputs"]:
            row = rows[output["name"]]
            facts = [fact for fact in _numbers_of(row) if fact]
            facts += ["all labels as one"] * row.labels_as_one
            print("  ".join([row.status, row.case, *(facts if row.status == DONE else [row.error or ""])]), flush=True)


def _update_rows(event: Event, rows: Mapping[str, SummaryRow], folder: Path) -> None:
    for output in event.task["outputs"]:
        name = output["name"]
        if event.status != ENDED:
            rows[name].status = event.status
        else:
            rows[name].fill(read_record(folder, name), folder)


def _numbers_of(row: SummaryRow) -> list[str]:
    """Return measures and seconds of an output for a person."""
    seconds = "" if row.seconds is None else f"{row.seconds:.1f}"
    return [*map(row.text, measures_in(Place.LINE)), seconds]


def _table_of(rows: Sequence[SummaryRow], facts: Sequence[tuple[str, str]] = ()) -> str:
    """Return the summary for a terminal, errors and other facts below."""
    lines = [["case", "status", *(each.head for each in measures_in(Place.LINE)), "seconds"]]
    lines += [[row.case, row.status, *_numbers_of(row)] for row in rows]
    absent = [row.case for row in rows if row.status == ABSENT]
    errors = [(row.case, row.error) for row in rows if row.error and row.status != ABSENT]
    errors += facts
    merged = [row.case for row in rows if row.labels_as_one]
    if merged:
        which = f"in {len(merged)} of {amount(rows)} became one surface, such as that of {merged[0]}"
        errors.append(("labels", f"{which}: {OTSU}"))
    opened = sum(row.values.get("closed") is False for row in rows)
    if opened:
        done = sum(row.status == DONE for row in rows)
        errors.append(("surfaces", open_words(done, opened)))
    if absent:
        errors.append((ABSENT, f"{len(absent)} without the label, such as {', '.join(absent[:MOST_ABSENT])}"))
    return table(lines) + (f"\n\n{listing(errors)}" if errors else "")
