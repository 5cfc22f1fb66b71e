# SPDX-License-Identifier: GPL-3.0-or-later
"""Run `ctmc foam OUTPUT`: write a foam of any size as one file, to try volumes that do not fit in memory."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core import Step, Steps, Volume, sizes_text
from ...core.files.atomic_write import require_writable, whole_file
from ...core.phantom import FOAM_THRESHOLD, foam
from ..flags.arguments import add_quiet, at_least
from ..terminal import Progress, dimensions, listing
from .files import library

SUFFIXES = (".npy", ".tif")
SLICES_AT_ONCE = 8


def add_parser(commands: Any) -> None:
    """Add the command to `ctmc`."""
    parser = commands.add_parser(
        "foam",
        help="make a large CT of an open foam",
        description="Make a uint8 CT of an open foam slice by slice, so that any size needs little memory.",
    )
    parser.add_argument("output", metavar="OUTPUT", help=f"{' or '.join(SUFFIXES)}; its folder must exist")
    parser.add_argument(
        "--slices", type=at_least(2), default=256, metavar="N", help="Number of slices, 2 or more (default 256)"
    )
    parser.add_argument(
        "--size", type=at_least(2), default=256, metavar="N", help="rows and columns, 2 or more (default 256)"
    )
    parser.add_argument(
        "--pore", type=at_least(4), default=64, metavar="N", help="width of a pore in voxels, 4 or more (default 64)"
    )
    parser.add_argument("--seed", type=at_least(0), default=0, metavar="N", help="Random seed, 0 or more (default 0)")
    add_quiet(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Make the foam and write it as it is made."""
    path = require_writable(args.output, SUFFIXES)
    volume = foam(args.slices, args.size, args.pore, args.seed)
    with Progress() as progress, whole_file(path) as temporary:
        if path.suffix.lower() == ".npy":
            progress.finish(_npy_steps(volume, temporary))
        else:
            _write_tiff(volume, temporary)
    facts = [
        ("foam", f"{dimensions(volume.size)}, {sizes_text(volume.spacing, digits=6)}, seed {args.seed}"),
        ("threshold", f"{FOAM_THRESHOLD:g}"),
        ("written", path.name),
    ]
    print(listing(facts))


def _npy_steps(volume: Volume, path: Path) -> Steps[None]:
    with path.open("wb") as stream:
        npy: Any = np.lib.format
        npy.write_array_header_2_0(stream, {"descr": "|u1", "fortran_order": False, "shape": volume.shape})
        for number, slab in enumerate(slabs(volume)):
            yield Step(number * SLICES_AT_ONCE / volume.shape[0], "Making slices")
            stream.write(slab.data)


def _write_tiff(volume: Volume, path: Path) -> None:
    """Write a .tif file, a page for each slice; BigTIFF beyond 4 GB."""
    with path.open("wb") as stream:
        library("tifffile", "tifffile").imwrite(
            stream,
            (plane for slab in slabs(volume) for plane in slab),
            shape=volume.shape,
            dtype=volume.dtype,
            bigtiff=volume.nbytes > 2**32 - 2**25,
            photometric="minisblack",
            metadata=None,
            software="ctmc",
        )


def slabs(volume: Volume) -> Iterator[NDArray[np.uint8]]:
    """Yield the values, a few slices at a time."""
    for low in range(0, volume.shape[0], SLICES_AT_ONCE):
        yield volume.slab(low, min(low + SLICES_AT_ONCE, volume.shape[0]))
