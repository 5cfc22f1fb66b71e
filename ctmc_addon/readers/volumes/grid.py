# SPDX-License-Identifier: GPL-3.0-or-later
"""Values one behind the other in one file, plain, gzip or bzip2, of one time or several."""

from __future__ import annotations

import math
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ...core import ReadError, Steps
from ...core.volume import SliceReader
from ..stored_slices import PackedSlices, RawSlices
from ..streams import is_packed, opened


class TimeSlices(SliceReader):
    """One of several volumes that follow each other: `slices` slices of another reader, from number `first` on."""

    def __init__(self, stored: SliceReader, first: int, slices: int) -> None:
        self.stored, self.first = stored, first
        self.shape, self.dtype = (slices, *stored.shape[1:]), stored.dtype

    def fill(self, out: NDArray[Any], slices: range, rows: range, columns: range) -> None:
        """Read the slices further on."""
        moved = range(slices.start + self.first, slices.stop + self.first, slices.step)
        self.stored.fill(out, moved, rows, columns)

    def values_steps(self, slices: range, rows: range, columns: range) -> Steps[NDArray[Any]]:
        """Of all slices of a packed file also what lies before and behind is unpacked, up to the check sum."""
        checked = self.stored if isinstance(self.stored, PackedSlices) and slices == self.everything[0] else None
        if checked is not None:
            yield from checked.pass_to_steps(self.first)
        values = yield from super().values_steps(slices, rows, columns)
        if checked is not None:
            yield from checked.pass_to_steps(checked.shape[0])
        return values


def check_bytes(path: Path, needed: int) -> None:
    """Refuse a file that is too short for all times, whichever is read: it is not as its header says."""
    there = path.stat().st_size
    if there < needed:
        raise ReadError(f"{path.name} is truncated: {there} of {needed} bytes are there; copy it again")


def grid_slices(
    path: Path, start: int, shape: tuple[int, int, int], dtype: np.dtype[Any], time: int, times: int
) -> SliceReader:
    """Volume `time` (from 1 on) of `times` volumes (slices, rows, columns) that begin at byte `start` of a file."""
    size = math.prod(shape) * dtype.itemsize
    if not is_packed(path):
        if times > 1:
            check_bytes(path, start + size * times)
        return RawSlices(path, start + (time - 1) * size, shape, dtype)

    def unpacked(files: ExitStack) -> IO[bytes]:
        return files.enter_context(opened(path))

    stored = PackedSlices(path, unpacked, start, (shape[0] * times, *shape[1:]), dtype)
    return stored if times == 1 else TimeSlices(stored, (time - 1) * shape[0], shape[0])
