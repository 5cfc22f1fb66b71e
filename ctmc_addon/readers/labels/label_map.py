# SPDX-License-Identifier: GPL-3.0-or-later
"""Combine masks into labels, in as few layers as keep every mask whole; report overlaps and empty masks.

A layer has one number a voxel, so labels that overlap lie in different ones, as in 3D Slicer's segmentations. Where
none overlap there is one layer. The layers do not depend on the order in which masks are painted.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core import Budget, ReadError
from ...core.files.file_names import printable
from ..value_kind import require_volume_memory
from .colors import RGB

MOST_LABELS = 65535
LONGEST_NAME = 200  # Names are cut to this many characters.
MOST_NAMED = 8  # A note names at most this many labels.


class LabelMap:
    """A label volume to paint masks into.

    Parameters
    ----------
    shape : (slices, rows, columns) int
    names : mapping of int to str
        Of every label that will be painted.
    colors : mapping of int to (red, green, blue)
    what : str
        The file or folder, for the error when memory does not suffice.
    highest : int
        Highest label there may be, where some have no name.
    budget : Budget, optional
        The memory that the values may take; by default what is available.

    """

    def __init__(
        self,
        shape: tuple[int, int, int],
        names: Mapping[int, str],
        colors: Mapping[int, RGB],
        what: str,
        highest: int = 0,
        budget: Budget | None = None,
    ) -> None:
        most = max(highest, *names) if names else max(highest, 1)
        if most > MOST_LABELS:
            raise ReadError(f"{what} has the label {most}, and labels up to {MOST_LABELS} are read; renumber them")
        self.shape, self.what, self.budget = shape, what, budget or Budget()
        self.dtype: Any = np.uint8 if most < 256 else np.uint16
        self.names = {label: name for label, name in names.items() if label}
        self.colors = {label: color for label, color in colors.items() if label in self.names}
        self.painted = np.zeros(most + 1, bool)
        self.overlaps: dict[tuple[int, int], int] = {}  # voxels that two labels share, the lower label first
        self._layers: list[NDArray[Any]] = []  # a mask lies in the first where it covers no other, a window at a time
        self._add_layer()

    def _add_layer(self) -> None:
        require_volume_memory(self.shape, np.dtype(self.dtype).itemsize, self.what, self.budget)
        self._layers.append(np.zeros(self.shape, self.dtype))

    def paint(self, slice_: int, mask: NDArray[np.bool_], label: int, top: int = 0, left: int = 0) -> None:
        """Give `label` to the pixels of `mask`, (rows, columns), in a slice, from a row and a column on."""
        rows = np.flatnonzero(mask.any(axis=1))
        if not rows.size:
            return
        low, high = rows[0], rows[-1] + 1  # few voxels are the mask's
        columns = np.flatnonzero(mask[low:high].any(axis=0))
        first, last = columns[0], columns[-1] + 1
        mask = mask[low:high, first:last]
        window = np.s_[slice_, top + low : top + high, left + first : left + last]
        self.painted[label] = True
        free = None
        for layer in self._layers:
            before = layer[window][mask]
            covered = before[(before != 0) & (before != label)]
            if not covered.size:
                free = layer if free is None else free
                continue
            for covered_label, count in enumerate(np.bincount(covered).tolist()):
                if count:
                    pair = (min(label, covered_label), max(label, covered_label))
                    self.overlaps[pair] = self.overlaps.get(pair, 0) + count
        if free is None:
            self._add_layer()
            free = self._layers[-1]
        free[window][mask] = label

    def paint_labels(self, slice_: int, labels: NDArray[Any], top: int = 0, left: int = 0) -> None:
        """Put labels, (rows, columns), of which none overlap, into a slice where it has none."""
        rows, columns = labels.shape
        window = self._layers[0][slice_, top : top + rows, left : left + columns]
        self.painted[np.unique(labels)] = True
        np.maximum(window, labels, out=window, casting="unsafe")

    def layers(self) -> list[NDArray[Any]]:
        """Return the layers, (slices, rows, columns) uint8 or uint16 each; the first has what overlaps nothing.

        By their numbers, each label is in the first layer that has none which it overlaps.
        """
        if len(self._layers) == 1:
            return self._layers
        layer_of = np.zeros(len(self.painted), np.intp)
        for label in sorted({label for pair in self.overlaps for label in pair}):
            lower = {layer_of[first] for first, second in self.overlaps if second == label}
            layer_of[label] = next(at for at in range(len(lower) + 1) if at not in lower)
        count = int(layer_of.max()) + 1
        labels = np.arange(len(self.painted)).astype(self.dtype)
        own = [np.where(layer_of == at, labels, 0).astype(self.dtype) for at in range(count)]
        while len(self._layers) < count:
            self._add_layer()
        for slice_ in range(self.shape[0]):
            painted = [layer[slice_].copy() for layer in self._layers if layer[slice_].any()]
            if not painted:
                continue
            for layer, numbers in zip(self._layers, own, strict=False):
                layer[slice_] = np.maximum.reduce([numbers.take(window) for window in painted])
        del self._layers[count:]
        return self._layers

    def overlap_note(self, unit: str) -> list[str]:
        """Return the note on what overlaps and by how much, the most first; `unit` is such as 'segments'."""
        if not self.overlaps:
            return []
        pairs = sorted(self.overlaps.items(), key=lambda item: (-item[1], item[0]))
        shared = (f"{self.name(first)} and {self.name(second)} {count}" for (first, second), count in pairs)
        return [f"{unit} overlap and each is kept whole; they share {limited(shared, ' voxels')}"]

    def empty_note(self, unit: str) -> list[str]:
        """Return which labels have no voxel at all."""
        empty = [self.name(label) for label in sorted(self.names) if not self.painted[label]]
        if not empty:
            return []
        return [
            f"{len(empty)} of {len(self.names)} {unit} {'is' if len(empty) == 1 else 'are'} empty: {limited(empty)}"
        ]

    def undescribed_note(self) -> list[str]:
        """Return which labels have voxels and no name."""
        undescribed = [
            str(label) for label in np.flatnonzero(self.painted).tolist() if label and label not in self.names
        ]
        if not undescribed:
            return []
        return [f"labels without a described segment were kept: {limited(undescribed)}"]

    def name(self, label: int) -> str:
        """Return a label's name, or its number."""
        return self.names.get(label) or f"label {label}"


def limited(texts: Iterable[str], end: str = "") -> str:
    """Return the first texts, and how many more there are."""
    listed = list(texts)
    more = f"{end} and {len(listed) - MOST_NAMED} more" if len(listed) > MOST_NAMED else end
    return ", ".join(listed[:MOST_NAMED]) + more


def clean_name(text: object, fallback: str) -> str:
    r"""Return a name from a file, fit for one line.

    Examples
    --------
    >>> clean_name("  Left\n kidney ", "segment 1"), clean_name("", "segment 1")
    ('Left kidney', 'segment 1')
    """
    return printable(str(text))[:LONGEST_NAME] or fallback
