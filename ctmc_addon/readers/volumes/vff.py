# SPDX-License-Identifier: GPL-3.0-or-later
"""Read VFF, Sun's visualization format as GE's micro-CT scanners write it: a text header, then big-endian values.

Lines `key=value;` from the word `ncaa` to a form feed. A voxel's side is `elementsize` in mm times `spacing`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ...core import ReadError, Steps
from ..result import RawValues, ReadRequest, VolumeSource
from ..series import Series
from ..streams.stored_slices import RawSlices
from ..value_kind import scaled_steps
from .nrrd import header_text
from .text_header import MOST_HEADER, numbers, volume_size, whole

LARGEST = 1e30  # Limit of a value, far below the largest float32.
TYPES = {8: ">u1", 16: ">i2", 32: ">f4"}  # Types by the bits of a value.


class _VffFile(VolumeSource):
    """One `.vff`."""

    format = "VFF"
    has_geometry = True

    def __init__(self, path: Path) -> None:
        self.fields, header_end = read_header(path)
        name = path.name
        sides = [whole(word, "size", name) for word in self.fields.get("size", "").split()[:9]]
        columns, rows, slices = self.size = volume_size(sides, name)
        if (bands := whole(self.fields.get("bands", "1"), "bands", name)) != 1:
            raise ReadError(f"{name} has {bands} numbers a voxel; convert it to gray values or labels (one number)")
        bits = whole(self.fields.get("bits", ""), "bits", name)
        if bits not in TYPES:
            raise ReadError(f"{name} has values of {bits} bits, and 8, 16 and 32 are read; export it as 16 bits")
        self.dtype: np.dtype[Any] = np.dtype(TYPES[bits])
        self.start = _values_start(path, header_end, columns * rows * slices * self.dtype.itemsize)
        series = Series(1, "", slices, (columns, rows), "", self.dtype.newbyteorder("=").name)
        super().__init__(path, (series,), [path])

    def read_raw_steps(self, request: ReadRequest) -> Steps[RawValues]:
        """Read the values, scaled as the header says."""
        name = self.path.name
        (slope,) = numbers(self.fields, ("data_scale",), 1, name) or [1.0]
        (intercept,) = numbers(self.fields, ("data_offset",), 1, name) or [0.0]
        slope = slope or 1.0
        if abs(slope) * np.iinfo(np.int32).max > LARGEST or abs(intercept) > LARGEST:
            raise ReadError(f"{name} has a data_scale of {slope:g} and a data_offset of {intercept:g}; export it again")
        notes = ("values of 32 bits are taken as floating point",) if self.dtype.itemsize == 4 else ()
        if (slope, intercept) != (1.0, 0.0):
            notes = (*notes, f"the file's data_scale {slope:g} and data_offset {intercept:g} are applied")
        stored = RawSlices(self.path, self.start, self.size[::-1], self.dtype)
        values = yield from scaled_steps(stored, slope, intercept, request.whole, name, request.budget)
        return RawValues(values, None, notes, spacing=_spacing_of_fields(self.fields, name))


def open_source(path: Path) -> _VffFile:
    """Open the file."""
    return _VffFile(path)


def read_header(path: Path) -> tuple[dict[str, str], int]:
    """Return the fields by name in small letters, and the byte behind the form feed."""
    with path.open("rb") as stream:
        text, end, _ = stream.read(MOST_HEADER).partition(b"\f")
    if not text.startswith(b"ncaa") or not end:
        raise ReadError(f"{path.name} is not a readable VFF: its header has no end; export or copy it again")
    fields = re.findall(r"(\w+)[ \t]*=[ \t]*([^;\r\n]*)", header_text(text))
    return {key.lower(): value.strip() for key, value in fields}, len(text) + 1


def _values_start(path: Path, header_end: int, needed: int) -> int:
    """Return the byte at which the values begin: the last ones of a file that ends with them, else behind the line.

    The line of the form feed ends at once, with a line feed, or with a carriage return too.
    """
    last = path.stat().st_size - needed
    if header_end <= last <= header_end + 2:
        return last
    with path.open("rb") as stream:
        stream.seek(header_end)
        behind = stream.read(2)
    return header_end + (2 if behind == b"\r\n" else behind.startswith(b"\n"))


def _spacing_of_fields(fields: Mapping[str, str], name: str) -> tuple[float, float, float] | None:
    """Return the voxel's sides in mm, None where the file does not say the size of its elements."""
    size = numbers(fields, ("elementsize",), 1, name)
    if size is None:
        return None
    x, y, z = numbers(fields, ("spacing",), 3, name) or (1.0, 1.0, 1.0)
    return abs(x) * size[0], abs(y) * size[0], abs(z) * size[0]
