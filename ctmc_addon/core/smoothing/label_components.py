# SPDX-License-Identifier: GPL-3.0-or-later
"""The components of a label, or of every label of a volume, found on runs along x.

Two samples of a label belong to one component where they are neighbors along x, y or z. That is what the surface does:
the case table separates inside corners that meet across the diagonal of a face. A run is a row's samples between two
changes; two runs of a label are linked where they overlap in neighboring rows or slices, so the work grows with the
surface.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Indices
from ..mesh.topology import component_roots_steps
from ..progress import PAUSE, Steps


@dataclass(frozen=True, eq=False)
class LabelComponents:
    """Components of a label, numbered from the smallest to the largest, and its runs.

    Parameters
    ----------
    z, y, start, stop, component : (runs,) int64
        Slice, row, first column, the column behind the last, and the component of every run; in the grid's order.
    voxels : (components,) int64
        Samples of every component, ascending.
    label : (components,)
        The value of these samples.
    """

    z: Indices
    y: Indices
    start: Indices
    stop: Indices
    component: Indices
    voxels: Indices
    label: NDArray[Any]

    def select(self, selected: NDArray[np.bool_]) -> LabelComponents:
        """Return only the selected components, (components,) bool."""
        number = np.cumsum(selected) - 1
        kept = selected[self.component]
        z, y, start, stop = (each[kept] for each in (self.z, self.y, self.start, self.stop))
        component = number[self.component[kept]]
        return LabelComponents(z, y, start, stop, component, self.voxels[selected], self.label[selected])

    def moved(self, z: int, y: int, x: int) -> LabelComponents:
        """Return the components moved by a number of samples along each axis."""
        return replace(self, z=self.z + z, y=self.y + y, start=self.start + x, stop=self.stop + x)

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


def label_components_steps(labels: NDArray[Any]) -> Steps[LabelComponents]:
    """Find the components of a label, (slices, rows, columns) bool, or of every label but 0, (...) unsigned.

    Neighbors are those along the axes.
    """
    _, rows, columns = labels.shape
    starts, stops, values = [np.empty(0, np.int64)], [np.empty(0, np.int64)], [np.empty(0, labels.dtype)]
    for slice_, layer in enumerate(labels):
        if layer.any():
            padded = np.zeros((rows, columns + 2), labels.dtype)
            padded[:, 1:-1] = layer
            # Places are in rows that are one sample longer than the layer's: between a sample and the one before it.
            at = np.flatnonzero(padded[:, 1:] != padded[:, :-1])
            behind = at + at // (columns + 1) + 1
            first, last = padded.reshape(-1)[behind], padded.reshape(-1)[behind - 1]
            starts.append(at[first > 0] + slice_ * rows * (columns + 1))
            stops.append(at[last > 0] + slice_ * rows * (columns + 1))
            values.append(first[first > 0])
        if slice_ % 64 == 0:
            yield PAUSE
    start, stop, value = np.concatenate(starts), np.concatenate(stops), np.concatenate(values)
    y = start // (columns + 1) % rows
    links = []
    for step, linked in ((columns + 1, np.flatnonzero(y < rows - 1)), (rows * (columns + 1), np.arange(len(start)))):
        first = np.searchsorted(stop, start[linked] + step, side="right")
        count = np.searchsorted(start, stop[linked] + step, side="left") - first
        near = np.repeat(linked, count)
        far = np.arange(len(near)) - np.repeat(np.cumsum(count) - count, count) + np.repeat(first, count)
        if labels.dtype != bool:
            same = value[near] == value[far]
            near, far = near[same], far[same]
        links.append(np.stack([near, far], axis=1).astype(np.int32))
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
    return LabelComponents(z, y, x, x + lengths, number[root], total[by_size], value[by_size])
