# SPDX-License-Identifier: GPL-3.0-or-later
"""Which components of the pieces of a surface are one across the seams."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...progress import PAUSE, Steps
from ..topology import FACES_PER_STEP, component_numbers_steps


class PieceLinks:
    """Components of pieces, from the first piece to the last.

    Attributes
    ----------
    first : list of int
        The number of each piece's first component, counted over all pieces; then the total.
    """

    def __init__(self) -> None:
        self.first = [0]
        self._links: list[NDArray[np.int64]] = []
        # Components of the piece before, at the first vertices of the next; -1 for none.
        self._above = np.empty(0, np.int64)

    def add_steps(
        self, faces: NDArray[np.int32], own: int, components: NDArray[np.int32] | None = None
    ) -> Steps[NDArray[np.int32]]:
        """Take in the triangles of the next piece, and return the component of each among the piece's own, (f,).

        The piece has `own` vertices; higher numbers belong to the next piece. `components` saves counting them.
        """
        total = max(own, int(faces.max(initial=-1)) + 1)
        numbers = (yield from component_numbers_steps(faces, total)) if components is None else components
        at_vertex = np.full(max(total, len(self._above)), -1, np.int64)
        for start in range(0, len(faces), FACES_PER_STEP):
            block = slice(start, start + FACES_PER_STEP)
            at_vertex[faces[block]] = (numbers[block] + np.int64(self.first[-1]))[:, None]
            yield PAUSE
        here = at_vertex[: len(self._above)]
        both = (self._above >= 0) & (here >= 0)
        if both.any():
            self._links.append(np.unique(np.stack([self._above[both], here[both]], axis=1), axis=0))
        self._above = at_vertex[own:total]
        self.first.append(self.first[-1] + int(numbers.max(initial=-1)) + 1)
        return numbers

    def joined_steps(self) -> Steps[NDArray[np.int32]]:
        """Return the surface's component of every component of a piece, in the order of their first triangles."""
        nodes = np.arange(self.first[-1], dtype=np.int32)
        links = np.concatenate([np.stack([nodes, nodes], axis=1), *self._links]).astype(np.int32)
        numbers = yield from component_numbers_steps(links, len(nodes))
        return numbers[: len(nodes)]
