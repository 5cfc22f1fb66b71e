# SPDX-License-Identifier: GPL-3.0-or-later
"""Run `ctmc experiment voxels|rotation|alpha|simplify`: the experiments of Su and Ma on any CT."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ...core.files.atomic_write import own_folder
from ...core.files.input_files import plan_output
from ..terminal import Progress, require_empty
from . import alpha, rotation, simplify, voxels
from .common import Work, add_common
from .table import FILES

EXPERIMENTS = {"voxels": voxels, "rotation": rotation, "alpha": alpha, "simplify": simplify}


def add_parser(commands: Any) -> None:
    """Add the command to `ctmc`, and a subcommand for every experiment."""
    parser = commands.add_parser(
        "experiment",
        help="measure larger voxels, rotation, alpha and simplification",
        description="Measure on your own data what the paper measured, and write table.csv, table.json, table.md "
        "and pictures into a folder.",
    )
    experiments = parser.add_subparsers(dest="experiment", metavar="EXPERIMENT", required=True)
    for name, experiment in EXPERIMENTS.items():
        parser = experiments.add_parser(name, help=experiment.HELP, description=experiment.DESCRIPTION)
        add_common(parser)
        experiment.add_flags(parser)
        parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Measure, write the table and its pictures, and print the table."""
    if not args.overwrite:
        require_empty(Path(args.output), "replace an older experiment with --overwrite, or choose another folder")
    experiment = EXPERIMENTS[args.experiment]
    with own_folder(args.output) as folder:
        for name in FILES:
            plan_output(folder / name)
        with Progress() as progress:
            table = experiment.table_of(args, Work(args, experiment.STAGES, progress), folder)
        table.write(folder)
    print(table.printed())
