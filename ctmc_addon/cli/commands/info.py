# SPDX-License-Identifier: GPL-3.0-or-later
"""`ctmc info PATH`: what a CT or label volume is, and what had to be assumed to read it."""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import Any

import numpy as np

from ... import readers
from ...core import Stages, Volume, finish
from ...core.files.atomic_write import json_text
from ...core.volume import label_extents_steps, slabs_of, value_range
from ...reporting.formatting import SIDES, kind_text
from ..arguments import add_input, reading_of
from ..terminal import Progress, dimensions, listing, titled

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
    parser.add_argument("--json", action="store_true", help="as JSON, for programs")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Read the volume and print what it is."""
    stages = Stages(READING)
    with Progress() as progress:
        source = progress.finish(stages.run("Reading headers", readers.open_volume_steps(args.input)))
        volume = progress.finish(stages.run("Reading values", source.read_steps(**reading_of(args))))
    facts = facts_of(replace(volume, name=args.name or volume.name), source)
    print(json_text(facts) if args.json else text_of(facts), end="" if args.json else "\n")


def facts_of(volume: Volume, source: readers.VolumeSource) -> dict[str, Any]:
    """What is known of a volume, as plain data; lowest and highest value are None where they are not numbers."""
    finite = np.isfinite(extremes := value_range(volume.values)).all()
    broken = 0
    if volume.values.dtype.kind == "f":
        broken = sum(int(slab.size - np.isfinite(slab).sum()) for slab in slabs_of(volume.values))
    sibling = readers.segmentation_sibling(source.path)
    return {
        "name": volume.name,
        "format": source.format,
        "size": list(volume.size),
        "spacing_mm": list(volume.spacing),
        "orientation": volume.orientation,
        "affine": volume.affine.tolist(),
        "dtype": str(volume.values.dtype),
        "kind": volume.kind,
        "low": float(extremes[0]) if finite else None,
        "high": float(extremes[1]) if finite else None,
        "not_finite": broken,
        "series": [{"text": series.screen_text, "uid": series.uid, "times": series.times} for series in source.series],
        "labels": labels_of(volume),
        "label_file": None if sibling is None else sibling.name,
        "notes": list(volume.notes),
    }


def labels_of(volume: Volume) -> list[dict[str, Any]]:
    """Every label with its value, its name and sRGB color if it has them, and its voxels."""
    if volume.kind != "label":
        return []
    counts = {value: extent.voxels for value, extent in finish(label_extents_steps(volume)).items()}
    counts[0] = volume.values.size - sum(counts.values())
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


def text_of(facts: dict[str, Any]) -> str:
    """The facts for a person."""
    axes = zip(("columns", "rows", "slices"), facts["orientation"], strict=True)
    values = "no number" if facts["low"] is None else f"{facts['low']:.10g} to {facts['high']:.10g}"
    values += f", {kind_text(facts['kind'])}{'s' if facts['kind'] != 'HU' else ''}"
    if facts["not_finite"]:
        values += f"; {facts['not_finite']} are NaN or infinite, --nan-as gives them a value"
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
        ("spacing", f"{dimensions(facts['spacing_mm'])} mm"),
        (
            "orientation",
            f"{facts['orientation']} ({', '.join(f'{axis} to the {SIDES[side]}' for axis, side in axes)})",
        ),
        ("dtype", facts["dtype"]),
        ("values", values),
    ]
    if len(facts["series"]) > 1 or any(item["uid"] or item["times"] > 1 for item in facts["series"]):
        texts = [f"{item['text']}{', UID ' + item['uid'] if item['uid'] else ''}" for item in facts["series"]]
        lines += titled("series", texts)
    lines += titled("labels", labels)
    if facts["label_file"]:
        lines.append(("label file", f"{facts['label_file']} beside it"))
    return listing([*lines, *titled("notes", facts["notes"])])
