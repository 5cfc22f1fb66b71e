# SPDX-License-Identifier: GPL-3.0-or-later
"""Run `ctmc settings > case.toml`: print the settings with their texts, to edit and to read back with --settings."""

from __future__ import annotations

import argparse
from typing import Any

from ...reporting.settings_toml import to_toml
from ..flags.arguments import add_reading, add_settings, given_table, settings_and_labels, tables


def add_parser(commands: Any) -> None:
    """Add the command to `ctmc`."""
    parser = commands.add_parser(
        "settings",
        help="print all settings as TOML, with explanations",
        description="Print every setting with its explanation and value, as a file for --settings: ctmc settings "
        "--label 2 > case.toml",
    )
    add_settings(parser, many=("label",))
    add_reading(parser, names=False)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Print the settings that the flags give."""
    given = {table: given_table(args, table) for table in tables()}
    print(to_toml(*settings_and_labels(args), tables(), given), end="")
