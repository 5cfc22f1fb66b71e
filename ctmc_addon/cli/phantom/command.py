# SPDX-License-Identifier: GPL-3.0-or-later
"""Run `ctmc phantom DIR`: write a CT with known truth as files of the usual formats."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ...core import Stages, Step, Steps, descriptions, equal_part, sizes_text, volume_text
from ...core.files.atomic_write import create_folder, require_writable, write_json
from ...core.phantom import Phantom, phantom_steps
from ...readers import ReadingOptions
from ..flags.arguments import add_quiet, at_least
from ..flags.described import Numbers, value_reader
from ..terminal import Progress, dimensions, listing
from .files import WRITERS, require_own_slices

FORMATS = (*WRITERS, "all")


def add_parser(commands: Any) -> None:
    """Add the command to `ctmc`."""
    parser = commands.add_parser(
        "phantom",
        help="make a CT with known ground truth",
        description="Make an abdominal CT with a liver and tumors of known volume. Each slice averages over its "
        "thickness, as in a scanner; a voxel takes the label at its center.",
    )
    parser.add_argument("folder", metavar="DIR", help="output folder, created if needed")
    parser.add_argument(
        "--slices", type=at_least(3), default=29, metavar="N", help="Number of slices, 3 or more (default 29)"
    )
    parser.add_argument(
        "--size", type=at_least(16), default=512, metavar="N", help="rows and columns, 16 or more (default 512)"
    )
    parser.add_argument(
        "--spacing",
        action=Numbers,
        most=3,
        type=value_reader("spacing", descriptions(ReadingOptions)["spacing"]),
        metavar="X Y Z",
        help="Distance between samples (mm; default: a field of view of 379 mm, 145 mm of slices at most 5 mm apart)",
    )
    parser.add_argument("--format", choices=FORMATS, default="all", help="files to write (default all)")
    parser.add_argument("--seed", type=at_least(0), default=0, metavar="N", help="random seed, 0 or more (default 0)")
    add_quiet(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Make the phantom, write it and print its truth."""
    folder = create_folder(args.folder)
    require_writable(folder / "truth.json")
    formats = list(WRITERS) if args.format == "all" else [args.format]
    require_own_slices(folder, formats, args.slices)
    stages = Stages({"Making the phantom": 1, "Writing": 1})
    with Progress() as progress:
        steps = phantom_steps(args.slices, args.size, args.spacing, args.seed)
        phantom = progress.finish(stages.run("Making the phantom", steps))
        written = progress.finish(stages.run("Writing", write_phantom_steps(phantom, folder, formats)))
    volumes = ", ".join(map(volume_text, phantom.tumour_volumes_mm3))
    shape = f"{dimensions(phantom.volume.size)}, {sizes_text(phantom.volume.spacing, digits=6)}"
    print(
        listing(
            [
                ("phantom", f"{shape}, seed {phantom.seed}"),
                ("tumors", f"{volumes}, {volume_text(sum(phantom.tumour_volumes_mm3))} in total"),
                ("liver", f"{volume_text(phantom.liver_volume_mm3)} with its tumors"),
                ("written", ", ".join(written)),
            ]
        )
    )


def write_phantom_steps(phantom: Phantom, folder: Path, formats: list[str]) -> Steps[list[str]]:
    """Write the phantom in these formats, and its truth; returns the names, folders with a slash."""
    written = []
    for at, name in enumerate(formats):
        written += yield from equal_part(WRITERS[name](phantom, folder), at, len(formats))
    yield Step(1.0, "Writing the ground truth")
    write_json(folder / "truth.json", truth_of(phantom))
    return [*written, "truth.json"]


def truth_of(phantom: Phantom) -> dict[str, Any]:
    """Return the ground truth of the phantom as plain data."""
    return {
        "seed": phantom.seed,
        "slices": phantom.volume.size[2],
        "size": phantom.volume.size[0],
        "spacing_mm": list(phantom.volume.spacing),
        "tumours": len(phantom.tumour_volumes_mm3),
        "tumour_volumes_mm3": list(phantom.tumour_volumes_mm3),
        "tumour_volume_mm3": round(sum(phantom.tumour_volumes_mm3), 3),
        "tumour_voxels_mm3": round(phantom.counted_mm3(), 3),
        "tumour_centres_ras_mm": [
            [round(position, 3) for position in center] for center in phantom.tumour_centres_ras_mm
        ],
        "liver_volume_mm3": phantom.liver_volume_mm3,
        "labels": {"0": "background", "1": "liver", "2": "tumor"},
    }
