"""`ctmc figure turntable`: a surface turning about its vertical axis, as a film or as pictures."""

from __future__ import annotations

from typing import Any


def add_parser(commands: Any) -> None:
    """Add the command to `ctmc`."""
