"""`ctmc experiment voxels|rotation|alpha|simplify`: the experiments of Su and Ma on any CT."""

from __future__ import annotations

from typing import Any

from . import alpha as experiment_alpha
from . import rotation as experiment_rotation
from . import simplify as experiment_simplify
from . import voxels as experiment_voxels

EXPERIMENTS = (experiment_voxels, experiment_rotation, experiment_alpha, experiment_simplify)


def add_parser(commands: Any) -> None:
    """Add the command to `ctmc`, and a subcommand for every experiment."""
    parser = commands.add_parser(
        "experiment",
        help="measure: larger voxels, rotation, alpha, simplification",
        description="Measure on your own data what the paper measured, and write table.csv, table.json, table.md "
        "and pictures into a folder.",
        allow_abbrev=False,
    )
    experiments = parser.add_subparsers(dest="experiment", metavar="EXPERIMENT", required=True)
    for experiment in EXPERIMENTS:
        experiment.add_parser(experiments)
