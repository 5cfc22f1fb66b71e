# SPDX-License-Identifier: GPL-3.0-or-later
"""Read FreeSurfer's `.mgh` and `.mgz`; header by nibabel, values from byte 284 on.

surfer.nmr.mgh.harvard.edu/fswiki/FsTutorial/MghFormat is the format's description.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...core import ReadError
from ...core.volume import transform_points
from ..optional_imports import needed, quiet, reason
from ..registry import MGH_LIBRARY
from ..result import RawValues, ReadRequest, VolumeSource
from ..series import Series
from ..streams.streams import STREAM_ERRORS, opened
from .grid import grid_slices

HEADER = 284  # Bytes; most are unused.
FIELDS = 90  # Bytes in use.
RAS_FLAG = 28  # Byte of the flag; nibabel sets it, with directions that are not FreeSurfer's.
CORONAL = np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
HEADER_ERRORS = (*STREAM_ERRORS, KeyError, ArithmeticError)  # Errors that nibabel raises besides its own.


class _MghFile(VolumeSource):
    """One `.mgh` or `.mgz`."""

    format = "MGH"
    has_geometry = True

    def __init__(self, path: Path) -> None:
        self.header, self.is_placed = read_header(path)
        self.dtype: np.dtype[Any] = self.header.get_data_dtype()
        sides = [int(side) for side in self.header["dims"]]
        if min(sides) < 1:
            raise ReadError(f"{path.name} has the sizes {tuple(sides)}, which is not a volume; export it again")
        columns, rows, slices, times = sides
        if slices < 2:
            raise ReadError(f"{path.name} has only one slice ({columns} x {rows}); a surface needs at least 2 slices")
        series = Series(1, "", slices, (columns, rows), "", self.dtype.newbyteorder("=").name, times)
        super().__init__(path, (series,), [path])

    def raw_values(self, request: ReadRequest) -> RawValues:
        """Return the values of one time."""
        line = self.series[0]
        affine, notes = np.eye(4), []
        # nibabel's own affine is rounded to float32, from a product whose last bit depends on the processor.
        with quiet():  # of numbers that overflow
            affine[:3, :3] = self.header["Mdc"].T * self.header["delta"] if self.is_placed else CORONAL
            half = transform_points(affine, self.header["dims"][None, :3])[0] / 2  # of the volume
            affine[:3, 3] = (self.header["Pxyz_c"] if self.is_placed else 0.0) - half
        if not self.is_placed:
            notes.append(
                "the file has no orientation: taken as FreeSurfer does, columns towards the patient's left, "
                "rows towards the feet, slices towards the front; flip x, y or z changes it"
            )
        values = grid_slices(self.path, HEADER, line.shape, self.dtype, request.time, line.times)
        return RawValues(values, affine, tuple(notes))


def open_source(path: Path) -> _MghFile:
    """Open the file."""
    return _MghFile(path)


def read_header(path: Path) -> tuple[Any, bool]:
    """Return the header by nibabel, and whether it has directions."""
    mgh = needed(*MGH_LIBRARY, "MGH")
    errors = (*HEADER_ERRORS, mgh.HeaderDataError, mgh.MGHError)
    try:
        with opened(path) as stream, quiet():
            content = stream.read(HEADER)
            if len(content) < HEADER:
                raise ValueError(f"{len(content)} of {HEADER} bytes")
            header = mgh.MGHHeader(content[:FIELDS], check=False)
            version = int(header["version"])
            if version != 1:
                raise ValueError(f"version {version}")
            header.get_data_dtype()
    except errors as error:
        raise ReadError(f"{path.name} is not a readable MGH file ({reason(error)}); copy it again") from error
    return header, any(content[RAS_FLAG : RAS_FLAG + 2])
