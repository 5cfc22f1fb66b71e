# SPDX-License-Identifier: GPL-3.0-or-later
"""The rule that decides the part of a point by the signs of all fields."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Flags


@dataclass
class PartRule:
    """Decide the part of a point by the signs of fields, given by their numbers.

    The first field is above 0 in all structures; further fields separate each structure from those behind it.
    Structures far from each other share a slot and count as one structure here (`slots.py`).

    Parameters
    ----------
    structures : int
    hollow : int or None
        Field above 0 in the hollows of all structures.
    added : dict of int to int
        By the number of a slot from 0 on: the field above 0 in shapes added to it.
    drains : int or None
    cuts : list of int
        Fields above 0 on the side of part a.
    pegs : list of (int, int) or None
        Fields of the pegs and of the holes of every cut, the same without a clearance; None for a cut without pegs.
    bosses : int or None
        Field above 0 in the material around pegs in a hollow.
    feet : dict of int to int
        By the number of a part of a slot: the field above 0 in its foot.
    """

    structures: int
    hollow: int | None = None
    added: dict[int, int] = field(default_factory=dict)
    drains: int | None = None
    cuts: list[int] = field(default_factory=list)
    pegs: list[tuple[int, int] | None] = field(default_factory=list)
    bosses: int | None = None
    feet: dict[int, int] = field(default_factory=dict)

    @property
    def parts(self) -> int:
        """Number of parts of each structure."""
        return 1 << len(self.cuts)

    def __call__(self, above: list[Flags]) -> NDArray[Any]:
        """Return the number of the part at every point, from 1 on by structure; 0 outside of all parts."""
        owner = np.zeros(above[0].shape, np.int64)  # Structures, from 1 on.
        is_hollow = np.zeros(above[0].shape, bool)
        if self.hollow is not None:
            is_hollow = above[0] & above[self.hollow]
            if self.bosses is not None:
                is_hollow &= ~above[self.bosses]
        rest = above[0] & ~is_hollow
        for number in range(self.structures):
            own = rest & above[1 + number] if number + 1 < self.structures else rest
            rest = rest & ~own
            owner[own] = number + 1
        for number, shape in self.added.items():
            owner[(owner == 0) & above[shape]] = number + 1
        is_open = np.zeros(owner.shape, bool) if self.drains is None else above[self.drains].copy()
        side, side_of_plane = np.zeros(owner.shape, np.int64), np.zeros(owner.shape, np.int64)
        for number, cut in enumerate(self.cuts):
            is_above = above[cut]
            side_of_plane += (~is_above).astype(np.int64) * (1 << number)
            both = self.pegs[number] if self.pegs else None
            if both is not None:
                peg, hole = (above[each] for each in both)
                is_open |= ~is_above & ~peg & hole
                is_above = is_above | peg
            side += (~is_above).astype(np.int64) * (1 << number)
        part = np.where(owner > 0, 1 + (owner - 1) * self.parts + side, 0)
        for number, shape in self.feet.items():
            is_foot = (owner == 0) & ~is_hollow & above[shape] & (side_of_plane == (number - 1) % self.parts)
            part[is_foot & (part == 0)] = number
        return np.where(is_open, 0, part)
