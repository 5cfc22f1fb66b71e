# SPDX-License-Identifier: GPL-3.0-or-later
"""Read consecutive values in one file, plain, gzip or bzip2, of one time or several."""

from __future__ import annotations

import math
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any

import numpy as np

from ...core import ReadError
from ...core.volume import SliceReader
from ..streams.stored_slices import PackedSlices, RawSlices, TimeSlices
from ..streams.streams import is_packed, opened


def check_bytes(path: Path, needed: int) -> None:
    """Refuse a file that is too short for all of its times, whichever is read.

    Parameters
    ----------
    path : Path
    needed : int
        Bytes.

    Raises
    ------
    ReadError
        If the file has fewer.
    """
    stored_bytes = path.stat().st_size
    if stored_bytes < needed:
        raise ReadError(f"{path.name} is truncated: {stored_bytes} of {needed} bytes are there; copy it again")


def grid_slices(
    path: Path, start: int, shape: tuple[int, int, int], dtype: np.dtype[Any], time: int, times: int
) -> SliceReader:
    """Return the reader of one of several volumes that follow each other in a file.

    Parameters
    ----------
    path : Path
    start : int
        Byte at which the first begins.
    shape : (slices, rows, columns) int
    dtype : dtype
        With its byte order.
    time : int
        Which volume, from 1 on.
    times : int
        How many there are.
    """
    size = math.prod(shape) * dtype.itemsize
    if not is_packed(path):
        if times > 1:
            check_bytes(path, start + size * times)
        return RawSlices(path, start + (time - 1) * size, shape, dtype)

    def unpacked(files: ExitStack) -> IO[bytes]:
        return files.enter_context(opened(path))

    stored = PackedSlices(path, unpacked, start, (shape[0] * times, *shape[1:]), dtype)
    return stored if times == 1 else TimeSlices(stored, (time - 1) * shape[0], shape[0])
