# SPDX-License-Identifier: GPL-3.0-or-later
"""The components of a label, found on its runs along x.

Two samples belong to one component where they are neighbors along x, y or z. That is what the surface does: the case
table separates inside corners that meet across the diagonal of a face. A run is a row's samples between two changes;
two runs are linked where they overlap in neighboring rows or slices, so the work grows with the surface.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...mesh.topology import component_roots_steps
from ...progress import PAUSE, Steps

Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class LabelComponents:
    """Components of a label, numbered from the smallest to the largest, and its runs.

    Parameters
    ----------
    z, y, start, stop, component : (runs,) int64
        Slice, row, first column, the column behind the last, and the component of every run; in the grid's order.
    voxels : (components,) int64
        Samples of every component, ascending.
    """

    z: Indices
    y: Indices
    start: Indices
    stop: Indices
    component: Indices
    voxels: Indices

    def boxes(self) -> tuple[Indices, Indices]:
        """First and last sample of every component, (components, 3) each, along z, y and x."""
        order = np.argsort(self.component, kind="stable")
        first = np.searchsorted(self.component[order], np.arange(len(self.voxels)))
        low = [np.minimum.reduceat(along[order], first) for along in (self.z, self.y, self.start)]
        high = [np.maximum.reduceat(along[order], first) for along in (self.z, self.y, self.stop - 1)]
        return np.stack(low, axis=1), np.stack(high, axis=1)

    def samples(self, selected: NDArray[np.bool_]) -> tuple[Indices, Indices, Indices, Indices]:
        """Slice, row, column and component of all samples of the selected components, (components,) bool."""
        runs = np.flatnonzero(selected[self.component])
        lengths = (self.stop - self.start)[runs]
        run = np.repeat(runs, lengths)
        x = np.arange(len(run)) - np.repeat(np.cumsum(lengths) - lengths, lengths) + self.start[run]
        return self.z[run], self.y[run], x, self.component[run]


def label_components_steps(mask: NDArray[np.bool_]) -> Steps[LabelComponents]:
    """Find the components of a label, (slices, rows, columns) bool; neighbors are those along the axes."""
    _, rows, columns = mask.shape
    changes = []
    for slice_, layer in enumerate(mask):
        if layer.any():
            turns = np.zeros((rows, columns + 1), bool)
            turns[:, 0], turns[:, -1] = layer[:, 0], layer[:, -1]
            np.not_equal(layer[:, 1:], layer[:, :-1], out=turns[:, 1:-1])
            changes.append(np.flatnonzero(turns) + slice_ * turns.size)
        if slice_ % 64 == 0:
            yield PAUSE
    at = np.concatenate(changes) if changes else np.empty(0, np.int64)
    start, stop = at[::2], at[1::2]  # places in rows that are one sample longer than the mask's
    y = start // (columns + 1) % rows
    links = []
    for step, linked in ((columns + 1, np.flatnonzero(y < rows - 1)), (rows * (columns + 1), np.arange(len(start)))):
        first = np.searchsorted(stop, start[linked] + step, side="right")
        count = np.searchsorted(start, stop[linked] + step, side="left") - first
        near = np.repeat(linked, count)
        far = np.arange(len(near)) - np.repeat(np.cumsum(count) - count, count) + np.repeat(first, count)
        links.append(np.stack([near, far, far], axis=1).astype(np.int32))
        yield PAUSE
    root = yield from component_roots_steps(np.concatenate(links), len(start))
    lengths = stop - start
    total = np.bincount(root, lengths, minlength=len(start)).astype(np.int64)
    roots = np.flatnonzero(root == np.arange(len(root)))
    by_size = roots[np.argsort(total[roots], kind="stable")]
    number = np.empty(len(start), np.int64)
    number[by_size] = np.arange(len(by_size))
    x = start % (columns + 1)
    z = start // (rows * (columns + 1))
    return LabelComponents(z, y, x, x + lengths, number[root], total[by_size])
