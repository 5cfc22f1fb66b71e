"""`ctmc phantom DIR`: a CT with known truth as files of the usual formats."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ...core import Step, Steps, within
from ...core.phantom import Phantom, phantom_steps
from ...reporting.atomic_write import made_folder, require_writable, write_json
from ..terminal import Progress, by, listing
from .files import WRITERS, require_no_strangers

FORMATS = (*WRITERS, "all")


def add_parser(commands: Any) -> None:
    """Add the command to `ctmc`."""
    parser = commands.add_parser(
        "phantom",
        help="make a CT with known truth",
        description="Make an abdominal CT with a liver and tumours of known volume.",
        allow_abbrev=False,
    )
    parser.add_argument("folder", metavar="DIR", help="where to write; made with its parents")
    parser.add_argument("--slices", type=int, default=29, metavar="N", help="3 or more (default 29)")
    parser.add_argument("--size", type=int, default=512, metavar="N", help="rows and columns, 16 or more (default 512)")
    parser.add_argument(
        "--spacing",
        nargs=3,
        type=float,
        metavar=("X", "Y", "Z"),
        help="mm (default: a field of view of 379 mm, and slices at most 5 mm apart over 145 mm)",
    )
    parser.add_argument("--format", choices=FORMATS, default="all", help="(default all)")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="0 or more (default 0)")
    parser.set_defaults(run=run)


def run(chosen: argparse.Namespace) -> None:
    """Make the phantom, write it and print its truth."""
    folder = made_folder(chosen.folder)
    require_writable(folder / "truth.json")
    formats = list(WRITERS) if chosen.format == "all" else [chosen.format]
    require_no_strangers(folder, formats, chosen.slices)
    spacing = None if chosen.spacing is None else tuple(chosen.spacing)
    with Progress() as progress:
        made = progress.drive(within(phantom_steps(chosen.slices, chosen.size, spacing, chosen.seed), 0.0, 0.5))
        written = progress.drive(within(write_phantom_steps(made, folder, formats), 0.5, 1.0))
    volumes = ", ".join(f"{volume / 1000:.2f}" for volume in made.tumour_volumes_mm3)
    columns, rows, slices = made.volume.size
    print(
        listing(
            [
                ("phantom", f"{columns} x {rows} x {slices}, {by(made.volume.spacing)} mm, seed {made.seed}"),
                ("tumours", f"{volumes} ml, together {sum(made.tumour_volumes_mm3) / 1000:.2f} ml"),
                ("liver", f"{made.liver_volume_mm3 / 1000:.2f} ml with its tumours"),
                ("written", ", ".join(written)),
            ]
        )
    )


def write_phantom_steps(made: Phantom, folder: Path, formats: list[str]) -> Steps[list[str]]:
    """Write the phantom in these formats, and its truth; returns the names, folders with a slash."""
    written = []
    for at, name in enumerate(formats):
        share = len(formats)
        written += yield from within(WRITERS[name](made, folder), at / share, (at + 1) / share)
    yield Step(1.0, "Writing the truth")
    write_json(folder / "truth.json", truth_of(made))
    return [*written, "truth.json"]


def truth_of(made: Phantom) -> dict[str, Any]:
    """What is known of the phantom, as plain data."""
    return {
        "seed": made.seed,
        "slices": made.volume.size[2],
        "size": made.volume.size[0],
        "spacing_mm": list(made.volume.spacing),
        "tumours": len(made.tumour_volumes_mm3),
        "tumour_volumes_mm3": list(made.tumour_volumes_mm3),
        "tumour_volume_mm3": round(sum(made.tumour_volumes_mm3), 3),
        "tumour_voxels_mm3": round(made.counted_mm3(), 3),
        "tumour_centres_ras_mm": [[round(at, 3) for at in centre] for centre in made.tumour_centres_ras_mm],
        "liver_volume_mm3": made.liver_volume_mm3,
        "labels": {"0": "background", "1": "liver", "2": "tumour"},
    }
