# SPDX-License-Identifier: GPL-3.0-or-later
"""Changes of a stroke as runs of flipped samples: all that undo has to keep.

Turning the same runs over again takes the change back, so one record serves undo and redo.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays import Flags
from ..errors import SettingsError
from .distance import Window, window_of


@dataclass(frozen=True, eq=False)
class Change:
    """Runs of samples that turned over.

    Parameters
    ----------
    shape : (slices, rows, columns) int
        Shape of the mask.
    start, stop : (runs,) int64
        First sample of every run, and the one behind its last, counted along columns, rows, slices.
    """

    shape: tuple[int, ...]
    start: NDArray[np.int64]
    stop: NDArray[np.int64]

    @property
    def voxels(self) -> int:
        """Number of flipped samples."""
        return int((self.stop - self.start).sum())

    @property
    def nbytes(self) -> int:
        """Bytes that the record takes."""
        return self.start.nbytes + self.stop.nbytes

    def apply(self, mask: Flags) -> None:
        """Turn the samples of the runs over in a mask, in place: redo, or undo.

        Raises
        ------
        SettingsError
            If the mask has another shape than the one that was changed.
        """
        if mask.shape != self.shape or not mask.flags.c_contiguous:
            raise SettingsError(
                f"a change of a mask {self.shape} cannot be undone in one of {mask.shape}; undo it where it was made"
            )
        lengths = self.stop - self.start
        at = np.arange(int(lengths.sum())) + np.repeat(self.start - (np.cumsum(lengths) - lengths), lengths)
        flat = mask.reshape(-1)
        flat[at] ^= True


def change_of(before: Flags, after: Flags, window: Window | None = None) -> Change:
    """Return the samples that changed between two masks of one shape, inside a window (z, y, x) if given.

    Examples
    --------
    >>> before, after = np.zeros((1, 2, 3), bool), np.array([[[False, True, True], [True, False, False]]])
    >>> change = change_of(before, after)
    >>> list(zip(change.start.tolist(), change.stop.tolist()))
    [(1, 4)]
    >>> change.apply(after)
    >>> bool(after.any())
    False
    """
    if window is None:
        window = (slice(0, before.shape[0]), slice(0, before.shape[1]), slice(0, before.shape[2]))
    differ = before[window] != after[window]
    inner = window_of(differ)
    empty = np.empty(0, np.int64)
    if inner is None:
        return Change(before.shape, empty, empty)
    z, y, x = (own.start + side.start for own, side in zip(inner, window, strict=True))
    differ = differ[inner]
    turns = np.zeros((*differ.shape[:2], differ.shape[2] + 1), bool)
    turns[..., 0], turns[..., -1] = differ[..., 0], differ[..., -1]
    np.not_equal(differ[..., 1:], differ[..., :-1], out=turns[..., 1:-1])
    layer, row, column = np.nonzero(turns)
    flat = ((layer + z) * before.shape[1] + (row + y)) * before.shape[2] + (column + x)
    start, stop = flat[::2].astype(np.int64), flat[1::2].astype(np.int64)
    begins = np.ones(len(start), bool)
    begins[1:] = start[1:] != stop[:-1]  # runs that meet across the end of a row are one
    ends = np.append(begins[1:], True)
    return Change(before.shape, start[begins], stop[ends])
