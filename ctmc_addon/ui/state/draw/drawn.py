# SPDX-License-Identifier: GPL-3.0-or-later
"""Hold a drawn structure in memory; its CT keeps it, and `masks` makes and changes it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from ....core import Volume
from ....core.segmentation import Change, Flags


@dataclass
class Drawn:
    """A drawn structure in memory.

    Parameters
    ----------
    labels : Volume
        The mask as labels of the list of structures. Every change of the file replaces the volume, because derived
        data, such as the boxes of its labels, is kept with it.
    unpacked : dict of int to bytes
        Slices of the file that the mask was made from.
    revision : int
        A new number after every change of the mask, by which viewers notice it.
    hash : str
        Hash of the slices of the file; empty until it is requested.
    grown : tuple or None
        The clicks, settings and result of the last Grow, which the next click changes.
    """

    mask: Flags
    labels: Volume
    unpacked: dict[int, bytes] = field(default_factory=dict)
    revision: int = 0
    hash: str = ""
    grown: tuple[Any, Change] | None = None
