# SPDX-License-Identifier: GPL-3.0-or-later
"""Run `ctmc measure BEFORE AFTER --label tumor -o change.csv`: compare labels at two times."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ... import readers
from ...core import (
    Budget,
    ChangeLimits,
    LabelChanges,
    LabelError,
    ReconstructionSettings,
    Stages,
    Steps,
    Volume,
    change_cells,
    change_csv,
    compare_labels_steps,
    structures_of,
)
from ...core.files.atomic_write import require_writable, write_text
from ...core.files.map_table import write_map_table
from ..flags.arguments import UsageError, flags_checked, reading_of, settings_and_labels, with_flags
from ..flags.described import add_described, given
from ..flags.solid import given_solid
from ..terminal import Progress, listing, table, titled
from .reconstruct import head_of, needed_steps, source_of

STAGES = {"Reading earlier labels": 2, "Reading later labels": 2, "Comparing": 20}


def add_change(parser: Any) -> None:
    """Add AFTER, the days between two volumes and the limits of a change."""
    parser.add_argument(
        "after", nargs="?", metavar="AFTER", help="later labels, to compare each component with those of INPUT"
    )
    group = parser.add_argument_group("change (with AFTER)")
    group.add_argument("--days", type=days, metavar="N", help="days from INPUT to AFTER, for the doubling time")
    add_limits(group)


def add_limits(group: Any) -> None:
    """Add a flag for every limit of a change."""
    add_described(group, ChangeLimits)


def days(text: str) -> float:
    """Read a number of days above 0."""
    try:
        number = float(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError("write a number of days") from error
    if not 0 < number < math.inf:
        raise argparse.ArgumentTypeError(f"must be above 0, not {text}")
    return number


def limits_of(args: argparse.Namespace) -> ChangeLimits:
    """Return the limits that flags give."""
    with flags_checked():
        return ChangeLimits(**given(args, ChangeLimits))


def require_no_change(args: argparse.Namespace) -> None:
    """Refuse flags of a comparison where there is only one volume."""
    if args.days is not None or given(args, ChangeLimits):
        raise UsageError("--days and limits of a change need two volumes; give the later one behind INPUT")


def run_change(args: argparse.Namespace) -> None:
    """Read both volumes, compare, print and write."""
    settings, choices = settings_and_labels(args)
    output = require_writable(args.output, (".csv",)) if args.output else None
    map_table = require_writable(args.map_table, (".csv",)) if args.map_table else None
    require_comparison(settings, choices, args.ct)
    if args.maps or args.map_limit:
        raise UsageError("the map of two volumes is the distance to the earlier surface; leave other maps out")
    if given_solid(args):
        raise UsageError("two volumes are compared by their surfaces; leave out flags of solids, or leave AFTER out")
    limits = limits_of(args)
    stages = Stages(STAGES)
    first, last, comparing = STAGES
    with Progress() as progress:
        reading, budget = reading_of(args), Budget(args.threads)
        before, after = (
            progress.finish(stages.run(stage, labels_steps(Path(path), reading, settings, budget)))
            for stage, path in ((first, args.input), (last, args.after))
        )
        compared = compare_labels_steps(before, after, settings, choices, args.days, limits, budget)
        changes = progress.finish(stages.run(comparing, compared))
    if map_table is not None:
        named = {label.name: label.after for label in changes.labels if label.after is not None and label.after.maps}
        if not named:
            raise LabelError("no label has a surface in both volumes, so there is no distance; leave --map-table out")
        write_map_table(map_table, structures_of(list(named.values()), list(named)))
    if output is not None:
        write_text(output, change_csv(changes.rows))
    print(summary(changes, (before, after), [path for path in (output, map_table) if path is not None]))


def require_comparison(settings: ReconstructionSettings, choices: Sequence[int | str], ct: str | None = None) -> None:
    """Refuse flags that two label volumes do not take."""
    if not choices:
        raise UsageError("two volumes are compared by their labels; give --label, such as --label all")
    if ct:
        raise UsageError("--ct measures gray values inside the labels of one volume; leave it out, or leave AFTER out")
    if settings.simplifies and settings.simplifier == "decimate":
        raise UsageError("ctmc measure uses the built-in simplifier; leave out --simplifier decimate")


def labels_steps(
    path: Path, reading: readers.ReadingOptions, settings: ReconstructionSettings, budget: Budget
) -> Steps[Volume]:
    """Read a label volume; of a LiTS volume the labels beside it."""
    source = yield from readers.open_volume_steps(source_of(path, settings.label), reading.allow_outside)
    return (yield from needed_steps(source, path, reading, settings, several=True, budget=budget))


def summary(changes: LabelChanges, volumes: Sequence[Volume], files: Sequence[Path]) -> str:
    """Return both volumes, the rows and the notes, for a person."""
    heads = listing([(when, head_of(volume)) for when, volume in zip(("before", "after"), volumes, strict=True)])
    facts = titled("note", [with_flags(note) for note in changes.notes])
    if files:
        facts.append(("written", ", ".join(path.name for path in files)))
    return f"{heads}\n\n{table(change_cells(changes.rows))}\n\n{listing(facts)}"
