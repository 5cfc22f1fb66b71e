# SPDX-License-Identifier: GPL-3.0-or-later
"""Read Analyze 7.5 as SPM wrote it, a `.hdr` and a `.img` of one name; and NIfTI in such a pair.

Header and affine of Analyze by nibabel, which reads them as SPM2 does.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core import ReadError, Steps
from ..optional_imports import needed, quiet, reason
from ..registry import ANALYZE_LIBRARY
from ..result import RawValues, ReadRequest, VolumeSource
from ..series import Series
from ..streams.streams import STREAM_ERRORS
from ..value_kind import scaled_steps
from .grid import grid_slices
from .nifti import NiftiFile, checked_dtype, checked_scale, checked_size, header_errors, mended, mended_notes

HEADER = 348  # A header has this many bytes.
NIFTI_MAGIC = (b"ni1\0", b"ni2\0")
MOST_OFFSET = 1 << 24  # Bytes before the values.
DATA_SUFFIXES = (".img", ".img.gz", ".IMG")


class _AnalyzeFile(VolumeSource):
    """The `.hdr` of a pair, its values in `data_path`."""

    format = "Analyze"
    has_geometry = True

    def __init__(self, path: Path, data_path: Path) -> None:
        self.data_path = data_path
        self.header, self.pixdim = read_header(path)
        self.size, times = checked_size(self.header.get_data_shape(), path.name)
        self.dtype: np.dtype[Any] = checked_dtype(self.header.get_data_dtype(), path.name)
        slope, intercept = self.header.get_slope_inter()
        self.scaling = checked_scale(1.0 if slope is None else float(slope), float(intercept or 0.0), path.name)
        columns, rows, slices = self.size
        series = Series(1, "", slices, (columns, rows), "", self.dtype.newbyteorder("=").name, times)
        super().__init__(path, (series,), [path, data_path])

    def read_raw_steps(self, request: ReadRequest) -> Steps[RawValues]:
        """Read the values of one time."""
        offset = float(self.header["vox_offset"])
        if not (math.isfinite(offset) and 0 <= offset <= MOST_OFFSET):
            raise ReadError(f"{self.path.name} says that its values begin at byte {offset:g}; export it again")
        taken = np.array(self.header["pixdim"][1:4], np.float64)
        with quiet():  # of numbers that overflow
            affine = np.array(self.header.get_best_affine(), np.float64)
        matrix = " (the .mat beside it is not read)" if self.path.with_suffix(".mat").is_file() else ""
        note = (
            "Analyze has no orientation: taken as SPM does, columns towards the patient's left, rows towards the "
            f"front, slices towards the head{matrix}; flip x, y or z changes it"
        )
        stored = grid_slices(
            self.data_path, int(offset), self.size[::-1], self.dtype, request.time, self.series[0].times
        )
        values = yield from scaled_steps(stored, *self.scaling, request.whole, self.path.name, request.budget)
        return RawValues(values, affine, (note, *mended_notes(self.pixdim, taken)))


def open_source(path: Path) -> VolumeSource:
    """Return the volume of a `.hdr`, or of the `.img` beside it."""
    header_path = path.with_suffix(".hdr")
    data_path = next((file for file in map(header_path.with_suffix, DATA_SUFFIXES) if file.is_file()), None)
    for missing, exists in ((".hdr", header_path.is_file()), (".img", data_path is not None)):
        if not exists:
            raise ReadError(
                f"{path.name} belongs to a pair of files, and its {missing} is missing; put both into one folder"
            )
    assert data_path is not None
    with header_path.open("rb") as stream:
        magic = stream.read(HEADER)[-4:]
        stream.seek(4)
        second = stream.read(4) in NIFTI_MAGIC
    if second or magic in NIFTI_MAGIC:
        return NiftiFile(header_path, data_path)
    return _AnalyzeFile(header_path, data_path)


def read_header(path: Path) -> tuple[Any, NDArray[np.float64]]:
    """Return the header as nibabel mends it, and its pixdim (3,) as it is written."""
    kind = needed(*ANALYZE_LIBRARY, "Analyze").Spm2AnalyzeHeader
    try:
        with path.open("rb") as stream:
            content = stream.read(HEADER)
        if not kind.may_contain_header(content):
            raise ValueError("its first number is not its length, 348")
        header, pixdim = mended(kind, content)
        with quiet():
            header.get_data_dtype(), header.get_data_shape()
    except STREAM_ERRORS + header_errors() as error:
        raise ReadError(f"{path.name} is not a readable Analyze header ({reason(error)}); copy it again") from error
    return header, pixdim
