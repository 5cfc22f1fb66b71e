# SPDX-License-Identifier: GPL-3.0-or-later
"""The rule that tells the part of a point from the signs of all fields."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Flags


@dataclass
class PartRule:
    """What parts are, by numbers of fields.

    The first field is above 0 in all structures. Of several, further fields tell a structure from those behind it.
    Structures that are far from each other count as one here, a slot (`together.py`).

    Parameters
    ----------
    structures : int
    hollow : int or None
        Above 0 in the hollows of all structures.
    added : dict of int to int
        Above 0 in what belongs to a slot too, by its number from 0 on.
    drains : int or None
    cuts : list of int
        Above 0 on the side of part a.
    pegs : list of (int, int) or None
        Pegs of every cut, and their holes, the same field where there is no clearance; None for a cut without.
    bosses : int or None
        Above 0 in what is not hollow, around pegs.
    feet : dict of int to int
        Above 0 in the feet of parts, by the number that such a part of its slot has.
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
        """Numbers of parts that a structure has."""
        return 1 << len(self.cuts)

    def __call__(self, above: list[Flags]) -> NDArray[Any]:
        """Return the part of every point from 1 on, structure by structure; 0 for none."""
        owner = np.zeros(above[0].shape, np.int64)  # structure from 1 on
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
