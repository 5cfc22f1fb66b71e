# SPDX-License-Identifier: GPL-3.0-or-later
"""One label volume from several masks, with what overlapped and what stayed empty said.

Masks may overlap, and a label volume has one number a voxel: the label of the highest rank keeps it, in whichever order
they are painted.
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
LONGEST_NAME = 64  # characters, as in DICOM's short texts
MOST_NAMED = 8  # in one note


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
    ranks : mapping of int to float, optional
        By default the label itself: the higher number keeps the voxel.
    budget : Budget, optional
        The memory that the values may take; by default what is available.

    Attributes
    ----------
    values : (slices, rows, columns) uint8 or uint16
    """

    def __init__(
        self,
        shape: tuple[int, int, int],
        names: Mapping[int, str],
        colors: Mapping[int, RGB],
        what: str,
        highest: int = 0,
        ranks: Mapping[int, float] | None = None,
        budget: Budget | None = None,
    ) -> None:
        most = max(highest, *names) if names else max(highest, 1)
        if most > MOST_LABELS:
            raise ReadError(f"{what} has the label {most}, and labels up to {MOST_LABELS} are read; number them anew")
        dtype: Any = np.uint8 if most < 256 else np.uint16
        require_volume_memory(shape, np.dtype(dtype).itemsize, what, budget or Budget())
        self.values: NDArray[Any] = np.zeros(shape, dtype)
        self.names = {label: name for label, name in names.items() if label}
        self.colors = {label: color for label, color in colors.items() if label in self.names}
        self.rank = np.arange(most + 1, dtype=np.float64)
        for label, rank in (ranks or {}).items():
            self.rank[label] = rank
        self.lost = np.zeros(most + 1, np.int64)  # voxels that a label left to others
        self.painted = np.zeros(most + 1, bool)

    def paint(self, window: NDArray[Any], mask: NDArray[np.bool_], label: int) -> None:
        """Give `label` to the pixels of `mask` in `window`, a part of a slice, that no label of higher rank has."""
        rows = np.flatnonzero(mask.any(axis=1))
        if not rows.size:
            return
        columns = np.flatnonzero(mask[rows[0] : rows[-1] + 1].any(axis=0))
        box = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))  # few voxels are the mask's
        window, mask = window[box], mask[box]
        before = window[mask]
        self.painted[label] = True
        taken = before[(before != 0) & (before != label)]
        if not taken.size:
            window[mask] = label
            return
        stays = self.rank[before] > self.rank[label]
        stays &= before != 0
        self.lost[label] += int(stays.sum())
        self.lost += np.bincount(taken[self.rank[taken] <= self.rank[label]], minlength=len(self.lost))
        window[mask] = np.where(stays, before, label)

    def paint_labels(self, window: NDArray[Any], labels: NDArray[Any]) -> None:
        """Put a slice of labels, of which none overlap, where `window` has none."""
        self.painted[np.unique(labels)] = True
        np.maximum(window, labels, out=window, casting="unsafe")

    def overlap_note(self, unit: str, kept: str) -> list[str]:
        """Return what overlapped: `unit` is such as 'segments', `kept` says which of two keeps a voxel."""
        losers = np.flatnonzero(self.lost).tolist()
        if not losers:
            return []
        lost = [f"{self.name(label)} {self.lost[label]}" for label in losers]
        return [f"{unit} overlap, and {kept} keeps the voxel: lost to others are {limited(lost, ' voxels')}"]

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
        return [
            f"pixels have numbers of no segment that is described, and are labels all the same: {limited(undescribed)}"
        ]

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
