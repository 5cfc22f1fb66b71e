"""`ctmc info PATH`: what a CT or label volume is, and what had to be assumed to read it."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from ... import readers
from ...core import Stages, Volume
from ...core.volume import slabs, value_range
from ..arguments import add_input, reading_of
from ..terminal import Progress, dimensions, listing, titled

SIDES = {"L": "left", "R": "right", "P": "back", "A": "front", "S": "head", "I": "feet"}
MOST_LABELS = 150
READING = {"Reading headers": 1, "Reading values": 4}


def add_parser(commands: Any) -> None:
    """Add the command to `ctmc`."""
    parser = commands.add_parser(
        "info",
        help="say what a volume is",
        description="Shape, spacing, orientation, values, series, labels and notes of a volume.",
    )
    add_input(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Read the volume and print what it is."""
    stages = Stages(READING)
    with Progress() as progress:
        source = progress.finish(stages.run("Reading headers", readers.open_volume_steps(args.input)))
        volume = progress.finish(stages.run("Reading values", source.read_steps(**reading_of(args))))
    series = source.series
    columns, rows, slices = volume.size
    axes = zip(("columns", "rows", "slices"), volume.orientation, strict=True)
    facts = [
        ("name", volume.name),
        ("shape", f"{columns} x {rows} x {slices} (columns x rows x slices)"),
        ("spacing", f"{dimensions(volume.spacing)} mm"),
        ("orientation", f"{volume.orientation} ({', '.join(f'{axis} to the {SIDES[side]}' for axis, side in axes)})"),
        ("dtype", str(volume.values.dtype)),
        ("values", values_text(volume)),
    ]
    if len(series) > 1 or any(item.uid for item in series):
        facts += titled("series", [f"{item.text}{', UID ' + item.uid if item.uid else ''}" for item in series])
    facts += titled("labels", labels_text(volume))
    sibling = readers.segmentation_sibling(args.input)
    if sibling is not None:
        facts.append(("label file", f"{sibling.name} beside it"))
    facts += titled("notes", list(volume.notes))
    print(listing(facts))


def values_text(volume: Volume) -> str:
    """The range and meaning of the values, and how many are not finite."""
    low, high = value_range(volume.values)
    span = f"{low:.10g} to {high:.10g}" if np.isfinite([low, high]).all() else "no number"
    text = f"{span}, {volume.kind}{'s' if volume.kind != 'HU' else ''}"
    if volume.values.dtype.kind == "f":
        broken = sum(int(slab.size - np.isfinite(slab).sum()) for slab in slabs(volume.values))
        if broken:
            text += f"; {broken} are NaN or infinite, --nan-as gives them a value"
    return text


def labels_text(volume: Volume) -> list[str]:
    """A line for every label: its value, its name if it has one, and its voxels."""
    if volume.kind != "label":
        return []
    counts: dict[float, int] = {}
    for slab in slabs(volume.values):
        for value, count in zip(*(found.tolist() for found in np.unique(slab, return_counts=True)), strict=True):
            counts[value] = counts.get(value, 0) + count
    lines = []
    for value, count in sorted(counts.items()):
        name = volume.label_names.get(int(value), "")
        lines.append(f"{value:g}{' ' + name if name else ''}: {count} voxels")
    more = len(lines) - MOST_LABELS
    return lines if more <= 0 else [*lines[:MOST_LABELS], f"and {more} more"]
