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

    Parameters
    ----------
    structures : int
    hollows : list of int
        Above 0 in the hollow of every structure; empty if none is hollow.
    added : dict of int to int
        Above 0 in what belongs to a structure too, by its number from 0 on.
    drains : int or None
    cuts : list of int
        Above 0 on the side of part a.
    pegs : list of (int, int)
        Pegs of every cut, and their holes; the same field where there is no clearance.
    """

    structures: int
    hollows: list[int] = field(default_factory=list)
    added: dict[int, int] = field(default_factory=dict)
    drains: int | None = None
    cuts: list[int] = field(default_factory=list)
    pegs: list[tuple[int, int]] = field(default_factory=list)

    def __call__(self, above: list[Flags]) -> NDArray[Any]:
        """Return the part of every point from 1 on, structure by structure; 0 for none."""
        owner = np.zeros(above[0].shape, np.int64)  # structure from 1 on
        rest = above[0].copy()
        for number in range(self.structures):
            own = rest & above[1 + number] if number + 1 < self.structures else rest
            rest = rest & ~own
            if self.hollows:
                own = own & ~above[self.hollows[number]]
            owner[own] = number + 1
        for number, shape in self.added.items():
            owner[(owner == 0) & above[shape]] = number + 1
        solid = owner > 0
        if self.drains is not None:
            solid &= ~above[self.drains]
        side = np.zeros(owner.shape, np.int64)
        for number, cut in enumerate(self.cuts):
            is_above = above[cut]
            if self.pegs:
                peg, hole = (above[each] for each in self.pegs[number])
                solid = solid & (is_above | peg | ~hole)
                is_above = is_above | peg
            side = side + (~is_above).astype(np.int64) * (1 << number)
        return np.where(solid, 1 + (owner - 1) * (1 << len(self.cuts)) + side, 0)
