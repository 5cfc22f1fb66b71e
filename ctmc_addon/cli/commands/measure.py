# SPDX-License-Identifier: GPL-3.0-or-later
"""Run `ctmc measure INPUT --label all -o table.csv`: measure surfaces without writing them."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ... import readers
from ...core import (
    Budget,
    LabelError,
    ReconstructionSettings,
    Stages,
    Steps,
    Volume,
    measure_structures_steps,
    structures_of,
    table_cells,
    table_csv,
)
from ...core.files.atomic_write import require_writable, write_text
from ...core.files.map_table import write_map_table
from ...core.volume import ValueKind, samples_on_grid
from ..flags.arguments import UsageError, add_input, add_settings, add_work, reading_of, with_flags
from ..flags.maps import add_maps, asked_maps
from ..flags.solid import add_solid, settings_labels_and_solid
from ..surfaces import may_be_several, open_words, surfaces_steps
from ..terminal import Progress, listing, table, titled
from .change import add_change, require_no_change, run_change
from .reconstruct import fetched_steps, head_of, needed_steps, source_of

STAGES = {"Reading": 3, "Reading the CT": 1, "Reconstructing": 6, "Measuring": 2}


def add_parser(commands: Any) -> None:
    """Add the command to `ctmc`."""
    parser = commands.add_parser(
        "measure",
        help="measure structures: volume, area, diameter, HU, dose, SUV",
        description="Measure structures: volume, area, components, largest diameter, mean and standard deviation "
        "of the gray values inside; of a dose also the maximum and D95, of a PET SUVmax and SUVpeak. Makes surfaces as "
        "`ctmc reconstruct` does, with the same settings, but writes none. With AFTER, another label volume of the "
        "same patient, compare components.",
    )
    add_input(parser)
    add_change(parser)
    parser.add_argument("-o", "--output", metavar="FILE.csv", help="one row per structure, with units in the header")
    parser.add_argument(
        "--ct",
        metavar="PATH",
        help="CT for the gray values inside labels, with samples at the same positions; axes may have "
        "another order or direction (default: INPUT, if it is a CT with a label file beside it); or a dose (RTDOSE) or "
        "a PET on any grid, which is sampled at the centers of the labels' voxels",
    )
    parser.add_argument(
        "--v-dose",
        metavar="GY",
        type=float,
        action="append",
        default=[],
        help="percent of the volume that receives at least this dose (Gy); may be repeated",
    )
    add_settings(parser, many=("label",))
    add_solid(parser)
    add_maps(parser, shown=False)
    parser.add_argument(
        "--map-table", metavar="FILE.csv", help="position of every vertex, mm, and the values of every map there"
    )
    add_work(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Read, reconstruct, measure, print and write."""
    if args.after:
        run_change(args)
        return
    require_no_change(args)
    settings, choices, solid = settings_labels_and_solid(args)
    maps = asked_maps(args)
    output = require_writable(args.output, (".csv",)) if args.output else None
    map_table = require_writable(args.map_table, (".csv",)) if args.map_table else None
    if output is not None and output == map_table:
        raise UsageError(f"-o and --map-table both name {output.name}; give two files")
    if settings.simplifies and settings.simplifier == "decimate":
        raise UsageError("ctmc measure uses the built-in simplifier; leave out --simplifier decimate")
    if args.ct and not choices:
        raise UsageError("--ct needs labels; give --label, or give the CT as INPUT with --threshold")
    if solid and (args.ct or args.v_dose):
        raise UsageError(
            "gray values and doses are those of labels, which a solid changes; leave out --ct and --v-dose, or measure "
            "the labels in a run without flags of the solid"
        )
    doses = _checked_doses(args.v_dose)
    stages = Stages(STAGES)
    reading, reading_ct, making, measuring = STAGES
    with Progress() as progress:
        volume = progress.finish(stages.run(reading, fetched_steps(args, settings, may_be_several(choices))))
        ct = progress.finish(stages.run(reading_ct, _no_ct_steps() if solid else _ct_steps(args, volume, settings)))
        if doses and (ct is None or ct.kind != ValueKind.DOSE):
            raise UsageError("--v-dose needs a dose in Gy; give an RTDOSE with --ct, or as INPUT with --threshold")
        budget = Budget(args.threads)
        steps = surfaces_steps(volume, settings, choices, budget, maps=maps, solid=solid)
        surfaces = progress.finish(stages.run(making, steps))
        measure = measure_structures_steps(surfaces.results, ct, volume, surfaces.titles, doses)
        rows = progress.finish(stages.run(measuring, measure))
    kind = ValueKind.HU if ct is None else ct.kind
    if output is not None:
        write_text(output, table_csv(rows, kind))
    if map_table is not None:
        write_map_table(map_table, structures_of(surfaces.results, surfaces.titles))
    opened = sum(not result.measures.closed for result in surfaces.results)
    notes = [*surfaces.notes, *(note for row in rows for note in row.notes)]
    facts = titled("note", [with_flags(note) for note in notes])
    if opened:
        facts.insert(0, ("surfaces", open_words(len(rows), opened)))
    if output is not None or map_table is not None:
        facts.append(("written", ", ".join(path.name for path in (output, map_table) if path is not None)))
    print(f"{head_of(volume)}\n\n{table(table_cells(rows, kind))}" + (f"\n\n{listing(facts)}" if facts else ""))


def _ct_steps(args: argparse.Namespace, volume: Volume, settings: ReconstructionSettings) -> Steps[Volume | None]:
    """Open the CT, dose or PET whose values are measured; None for labels without one.

    Raises
    ------
    LabelError
        If --ct holds labels.
    VolumeError
        If the labels' samples are not samples of the CT.
    """
    if settings.label is None:
        return volume
    path = Path(args.ct or args.input)
    if not args.ct and source_of(path, settings.label) == path:
        return None
    source = yield from readers.open_volume_steps(path, reading_of(args).allow_outside)
    options = readers.ReadingOptions() if args.ct else reading_of(args)
    ct = yield from needed_steps(source, path, options, ReconstructionSettings(), several=True)
    if ct.kind == ValueKind.LABEL:
        raise LabelError(f"{path.name} holds labels; give the CT with --ct and the labels as INPUT")
    if not ct.kind.is_sampled:
        samples_on_grid(volume, ct)  # raises before the surfaces are made
    return ct


def _no_ct_steps() -> Steps[Volume | None]:
    """Return no CT, as the samples inside a solid are not those of its label."""
    return None
    yield


def _checked_doses(doses: Sequence[float]) -> tuple[float, ...]:
    """Return each dose once, in the order in which they were given."""
    for dose in doses:
        if not (math.isfinite(dose) and dose > 0):
            raise UsageError(f"--v-dose takes a dose above 0 Gy, not {dose:g}")
    return tuple(dict.fromkeys(doses))
