# SPDX-License-Identifier: GPL-3.0-or-later
"""Run `ctmc info PATH`: describe a CT or label volume, and the assumptions made while reading it."""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ... import readers
from ...core import ReconstructionSettings, Stages, Steps, Volume, sizes_text
from ...core.files.atomic_write import json_text
from ...core.volume import ValueFacts, ValueKind, label_extents_steps, region_limits, value_facts_steps
from ...reporting.formatting import SIDES
from ..flags.arguments import add_input, reading_of, with_flags
from ..terminal import Progress, dimensions, listing, titled
from .reconstruct import needed_steps

MOST_LABELS = 150
STAGES = {"Reading headers": 1, "Reading values": 4, "Checking values": 2, "Counting the labels": 2}


def add_parser(commands: Any) -> None:
    """Add the command to `ctmc`."""
    parser = commands.add_parser(
        "info",
        help="describe a volume",
        description=(
            "Print the shape, spacing, orientation, position in RAS mm, values, series, labels and notes of a volume."
        ),
    )
    add_input(parser)
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Read the volume and print what it is."""
    options, stages = reading_of(args), Stages(STAGES)
    with Progress() as progress:
        opening = readers.open_volume_steps(args.input, options.allow_outside)
        source = progress.finish(stages.run("Reading headers", opening))
        reading = needed_steps(source, Path(args.input), options, ReconstructionSettings(), several=True)
        volume = progress.finish(stages.run("Reading values", reading))
        values = progress.finish(stages.run("Checking values", value_facts_steps(volume)))
        labels = progress.finish(stages.run("Counting the labels", _labels_steps(volume)))
    facts = facts_of(volume, source, values, labels)
    print(json_text(facts) if args.json else text_of(facts, source.series), end="" if args.json else "\n")


def facts_of(
    volume: Volume, source: readers.VolumeSource, values: ValueFacts, labels: list[dict[str, Any]]
) -> dict[str, Any]:
    """Return the facts of a volume as plain data; lowest and highest value are None if they are not numbers."""
    finite = values.low <= values.high
    sibling = readers.segmentation_sibling(source.path)
    return {
        "name": volume.name,
        "format": source.format,
        "size": list(volume.size),
        "spacing_mm": list(volume.spacing),
        "orientation": volume.orientation,
        "affine": volume.affine.tolist(),
        "place_ras_mm": [end + 0.0 for end in region_limits(volume, "mm")],  # 0, not -0
        "dtype": str(volume.dtype),
        "kind": volume.kind,
        "low": values.low if finite else None,
        "high": max([values.high, *(label["value"] for label in labels)]) if finite else None,
        "not_finite": values.not_finite,
        # Without the operator's words, which may hold a name: this may become a file.
        "series": [
            {"text": series.text, "spacing_mm": series.spacing_mm, "uid": series.uid, "times": series.times}
            for series in source.series
        ],
        "labels": labels,
        "levels": [list(size) for size in source.levels],
        "label_groups": list(source.label_groups),
        "label_file": None if sibling is None else sibling.name,
        "labels_found": _labels_found(source) if volume.kind != ValueKind.LABEL and sibling is None else [],
        "volumes_found": _volumes_found(source) if volume.kind in (ValueKind.HU, ValueKind.GRAY) else [],
        "notes": list(volume.notes),
    }


def _labels_found(source: readers.VolumeSource) -> list[str]:
    """Return the files and folders of labels near a CT, as paths from its own."""
    return _from_its_own(source, readers.labels_beside)


def _volumes_found(source: readers.VolumeSource) -> list[str]:
    """Return the doses and PET near a CT, as paths from its own."""
    return _from_its_own(source, readers.volumes_beside)


def _from_its_own(source: readers.VolumeSource, nearby: Callable[[Path], Sequence[Path]]) -> list[str]:
    place = readers.volume_place(source.path).absolute()
    return [Path(os.path.relpath(path, place)).as_posix() for path in nearby(place)]


def _labels_steps(volume: Volume) -> Steps[list[dict[str, Any]]]:
    """Return every label with its value, its name and sRGB color if it has them, and its voxels."""
    if volume.kind != ValueKind.LABEL:
        return []
    extents = yield from label_extents_steps(volume)
    counts = {value: extent.voxels for value, extent in extents.items()}
    counts[0] = math.prod(volume.size) - sum(counts.values())
    if volume.layers:  # A voxel of overlapping labels is counted more than once.
        counts[0] = 0
        for number in range(volume.size[2]):
            planes = [layer.slab(number, number + 1) == 0 for layer in volume.each_layer]
            counts[0] += int(np.logical_and.reduce(planes).sum())
    return [
        {
            "value": value,
            "name": volume.label_names.get(value, ""),
            "color": "#{:02x}{:02x}{:02x}".format(*color) if (color := volume.label_colors.get(value)) else None,
            "voxels": count,
        }
        for value, count in sorted(counts.items())
        if count
    ]


def text_of(facts: dict[str, Any], series: Sequence[readers.Series]) -> str:
    """Return the facts for a person, and the series as the scanner's operator called them."""
    ends = facts["place_ras_mm"]
    sides = zip("xyz", ends[:3], ends[3:], strict=True)
    place = ", ".join(f"{axis} {low:.6g} to {high:.6g}" for axis, low, high in sides)
    axes = zip(("columns", "rows", "slices"), facts["orientation"], strict=True)
    values = "no finite value" if facts["low"] is None else f"{facts['low']:.10g} to {facts['high']:.10g}"
    values += f", {facts['kind'].plural}"
    if facts["not_finite"]:
        values += f"; {facts['not_finite']} are NaN or infinite: replace them with --nan-as"
    labels = [
        f"{label['value']:g}{' ' + label['name'] if label['name'] else ''}: {label['voxels']} voxels"
        for label in facts["labels"][:MOST_LABELS]
    ]
    if len(facts["labels"]) > MOST_LABELS:
        labels.append(f"and {len(facts['labels']) - MOST_LABELS} more")
    lines = [
        ("name", facts["name"]),
        ("format", facts["format"]),
        ("shape", f"{dimensions(facts['size'])} (columns x rows x slices)"),
        ("spacing", sizes_text(facts["spacing_mm"], digits=6)),
        ("orientation", f"{facts['orientation']} ({', '.join(f'{axis} to the {SIDES[side]}' for axis, side in axes)})"),
        ("place", f"{place} (RAS+ mm, centers of the outermost samples)"),
        ("dtype", facts["dtype"]),
        ("values", values),
    ]
    if len(series) > 1 or any(item.uid or item.times > 1 for item in series):
        texts = [f"{item.screen_text}{', UID ' + item.uid if item.uid else ''}" for item in series]
        lines += titled("series", texts)
    if len(facts["levels"]) > 1:
        lines += titled("levels", [f"{number}: {dimensions(size)}" for number, size in enumerate(facts["levels"])])
    lines += titled("labels", labels)
    lines += titled("label groups", facts["label_groups"])
    if facts["label_file"]:
        lines.append(("label file", f"{facts['label_file']} beside it"))
    lines += titled("labels found", facts["labels_found"])
    lines += titled("dose, PET found", facts["volumes_found"])
    return listing([*lines, *titled("notes", [with_flags(note) for note in facts["notes"]])])
