# SPDX-License-Identifier: GPL-3.0-or-later
"""The recipe of parts: fields on a lattice, and the part of every combination of their signs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import Flags, Floats
from ...errors import SettingsError
from ..fields.lattice import Lattice
from ..fields.lattice_fields import HeldField, LatticeField, ShapeField

MOST_FIELDS = 20  # The table of parts has an entry for each combination of their signs.


@dataclass(frozen=True, eq=False)
class Recipe:
    """Fields on a lattice, and the part of every combination of their signs.

    Parameters
    ----------
    lattice : Lattice
        Its outermost samples belong to no part.
    fields : sequence of LatticeField
    part_of : callable
        Takes a list of bool arrays, whether each field is above 0; returns an array of the numbers of parts, from 1 on,
        0 for none.
    on_edges : mapping of int to (keys, positions), optional
        By the number of a field: exact points of its surface on edges of the lattice, as rising keys
        `3 * sample + axis` and positions (n, 3) float32 in RAS+ mm.
    """

    lattice: Lattice
    fields: Sequence[LatticeField]
    part_of: Callable[[list[Flags]], NDArray[Any]]
    on_edges: dict[int, tuple[NDArray[np.int64], Floats]]

    def table(self) -> NDArray[Any]:
        """Return the part of every combination of signs; the bits of an index are the signs."""
        count = len(self.fields)
        if count > MOST_FIELDS:
            raise SettingsError(
                f"{count} surfaces and cuts are more than {MOST_FIELDS}; "
                "make fewer structures or cuts at once, or leave out --base"
            )
        words = np.arange(1 << count)
        parts = self.part_of([(words >> bit & 1).astype(bool) for bit in range(count)])
        return np.asarray(parts).astype(np.min_scalar_type(int(parts.max())))

    @property
    def movable(self) -> list[int]:
        """Numbers of fields that may move a little: shapes, and fields between structures."""
        kinds = (ShapeField, HeldField)
        return [at for at, field in enumerate(self.fields) if isinstance(field, kinds[: 2 if at else 1])]

    def moved(self, share: float) -> Recipe:
        """Return the recipe with movable fields moved inward, each one farther, up to a share of the shortest step."""
        step = share * self.lattice.shortest_mm / len(self.fields)
        fields: list[LatticeField] = list(self.fields)
        for number in self.movable:
            field = fields[number]
            assert isinstance(field, (ShapeField, HeldField)), "these are movable"
            fields[number] = replace(field, shift=step * (number + 1))
        return replace(self, fields=fields)
