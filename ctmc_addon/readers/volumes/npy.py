# SPDX-License-Identifier: GPL-3.0-or-later
"""Read one NumPy file of (slices, rows, columns), in the order it was saved; it has neither spacing nor orientation."""

from __future__ import annotations

from pathlib import Path
from tokenize import TokenError
from typing import Any

import numpy as np

from ...core import ReadError
from ..optional_imports import quiet
from ..result import RawValues, ReadRequest, VolumeSource
from ..series import Series
from ..streams.stored_slices import RawSlices, TransposedSlices

# Of NumPy on a header, which is a line of Python.
HEADER_ERRORS = (ValueError, TypeError, EOFError, SyntaxError, TokenError, RecursionError, MemoryError)


class NpyFile(VolumeSource):
    """One `.npy`."""

    format = "NumPy"
    has_geometry = False

    def __init__(self, path: Path) -> None:
        with path.open("rb") as stream:
            self.shape, self.fortran, self.dtype = read_header(stream, path.name)
            self.start = stream.tell()
        slices, rows, columns = self.shape
        super().__init__(path, (Series(1, "", slices, (columns, rows), "", self.dtype.name),), [path])

    def raw_values(self, request: ReadRequest) -> RawValues:
        """Return the values."""
        del request
        if not self.fortran:
            return RawValues(RawSlices(self.path, self.start, self.shape, self.dtype), None)
        stored = RawSlices(self.path, self.start, self.shape[::-1], self.dtype)
        return RawValues(TransposedSlices(stored), None)


def open_source(path: Path) -> NpyFile:
    """Open the file."""
    return NpyFile(path)


def read_header(stream: Any, name: str) -> tuple[tuple[int, int, int], bool, np.dtype[Any]]:
    """Return the shape without axes of 1 beyond the third, memory order and type; leave `stream` at the values."""
    npy: Any = np.lib.format
    try:
        read = npy.read_array_header_1_0 if npy.read_magic(stream) == (1, 0) else npy.read_array_header_2_0
        with quiet():
            shape, fortran, dtype = read(stream)
    except HEADER_ERRORS as error:
        raise ReadError(f"{name} is not a readable NumPy file; save it again with numpy.save") from error
    sides = [int(side) for side in shape if side != 1] if len(shape) > 3 else [int(side) for side in shape]
    if len(sides) != 3 or min(sides) < 1 or bool in map(type, shape) or (len(shape) == 4 and shape[-1] in (3, 4)):
        raise ReadError(f"{name} has the shape {shape}, and a volume is (slices, rows, columns); save one volume")
    if dtype.kind not in "buif" or dtype.itemsize > 8 or dtype == np.float16:
        raise ReadError(f"{name} holds values of type {dtype}; convert them to int16 or float32")
    return (sides[0], sides[1], sides[2]), fortran, dtype
