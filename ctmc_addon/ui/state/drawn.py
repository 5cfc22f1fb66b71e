# SPDX-License-Identifier: GPL-3.0-or-later
"""A drawn structure in memory; its CT keeps it, and `masks` makes and changes it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from ...core import Volume
from ...core.segmentation import Change, Flags


@dataclass
class Drawn:
    """A drawn structure in memory.

    Parameters
    ----------
    labels : Volume
        The mask as labels of the list of structures. After every change of the file they are another volume, as what
        is known of a volume, such as where its labels lie, is kept with it.
    unpacked : dict of int to bytes
        Slices of the file that the mask was made from.
    revision : int
        Another number after every change of the mask; what shows it asks whether it has shown this one.
    hash : str
        Of the slices of the file; empty until it is asked for.
    grown : tuple or None
        The clicks and settings of the last Grow, and what came of them, which the next click changes.
    """

    mask: Flags
    labels: Volume
    unpacked: dict[int, bytes] = field(default_factory=dict)
    revision: int = 0
    hash: str = ""
    grown: tuple[Any, Change] | None = None
