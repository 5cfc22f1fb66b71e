# SPDX-License-Identifier: GPL-3.0-or-later
"""NIfTI-1 and NIfTI-2 in one file, plain or gzip, by nibabel; its values a few planes at a time.

nibabel's affine maps (i, j, k) to RAS+ mm. i is the fastest index in the file, so the values are
(k, j, i) in C order. NIfTI-1 is described at nifti.nimh.nih.gov/nifti-1.
"""

from __future__ import annotations

import logging
import math
import struct
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ...core import ReadError, Steps
from ..labels.colors import RGB, rgb_of_shares
from ..optional_imports import imported_steps, needed, quiet, reason
from ..result import RawValues, ReadRequest, Series, VolumeSource
from ..streams import STREAM_ERRORS, opened
from ..value_kind import scaled_steps
from .grid import grid_slices

TO_MM = {"unknown": 1.0, "mm": 1.0, "meter": 1000.0, "micron": 0.001}
MOST_HEADER = 2**24  # bytes before the values; label tables of extensions take some thousands
MOST_SCALE = 1e20  # slope or intercept; its product with a value must be a float32
TABLE_END = b"</LabelTable>"
SILENT = logging.Logger("silent")  # nibabel's own prints what it mends in a header
SILENT.addHandler(logging.NullHandler())


class NiftiFile(VolumeSource):
    """One `.nii` or `.nii.gz`, or the `.hdr` of a pair whose values are in `data_path`."""

    format = "NIfTI"
    has_geometry = True

    def __init__(self, path: Path, data_path: Path | None = None) -> None:
        name = path.name
        self.data_path = data_path or path
        with opened(path) as stream:
            self.header, self.extensions = read_header(stream, name, data_path is not None)
        self.size, times = checked_size(self.header.get_data_shape(), name)
        self.dtype = checked_dtype(self.header, name)
        self.scaling = scaling(self.header, name)
        columns, rows, slices = self.size
        files = [path] if data_path is None else [path, data_path]
        super().__init__(path, (Series(1, "", slices, (columns, rows), "", self.dtype.name, times),), files)

    def read_raw_steps(self, request: ReadRequest) -> Steps[RawValues]:
        """Read the values; integers stay integers where slope and intercept are whole numbers."""
        affine, notes = placed(self.header, self.path.name)
        start = int(self.header["vox_offset"])
        stored = grid_slices(self.data_path, start, self.size[::-1], self.dtype, request.time, self.series[0].times)
        values = yield from scaled_steps(stored, *self.scaling, request.whole, self.path.name, request.budget)
        return RawValues(values, affine, notes, None, *label_table(self.extensions))


def open_steps(path: Path) -> Steps[NiftiFile]:
    """Open the file; nibabel brings much with it, so that its first import is long."""
    yield from imported_steps("nibabel.nifti1", "nibabel", "NIfTI")
    return NiftiFile(path)


def read_header(stream: IO[bytes], name: str, pair: bool = False) -> tuple[Any, list[bytes]]:
    """Header by nibabel, of either version, and its extensions; of a pair the values begin in another file."""
    nifti1 = needed("nibabel.nifti1", "nibabel", "NIfTI")
    nifti2 = needed("nibabel.nifti2", "nibabel", "NIfTI")
    try:
        head = stream.read(540)
        # The first number is the header's own length, in either byte order.
        second_version = 540 in (int.from_bytes(head[:4], "little"), int.from_bytes(head[:4], "big"))
        module, number = (nifti2, 2) if second_version else (nifti1, 1)
        kind = getattr(module, f"Nifti{number}{'Pair' if pair else ''}Header")
        offset = float(kind(head[: kind.sizeof_hdr], check=False)["vox_offset"])
        if not (math.isfinite(offset) and (0 if pair else kind.sizeof_hdr + 4) <= offset <= MOST_HEADER):
            raise ReadError(
                f"{name} says that its values begin at byte {offset:g}, which no NIfTI file has; export it again"
            )
        head += stream.read(MOST_HEADER if pair else max(0, int(offset) - len(head)))
        with quiet():
            header = kind(head[: kind.sizeof_hdr], check=False)
            header.check_fix(SILENT, 40)
    except header_errors() as error:
        raise ReadError(f"{name} is not a readable NIfTI file ({reason(error)}); export or copy it again") from error
    whole = head if pair else head[: int(offset)]
    return header, extensions(whole, kind.sizeof_hdr, header.endianness, name)


def extensions(head: bytes, at: int, order: str, name: str) -> list[bytes]:
    """Contents of the extensions behind a header of `at` bytes, not by nibabel: it parses each by what it says it is.

    Parameters
    ----------
    head : bytes
        All that is before the values.
    order : {"<", ">"}
        Of the bytes of a number.
    """
    found: list[bytes] = []
    more, at = head[at : at + 1] > b"\0", at + 4
    while more and at + 8 <= len(head):
        (size,) = struct.unpack_from(f"{order}i", head, at)
        if size < 8 or at + size > len(head):
            raise ReadError(
                f"{name} has a header extension of {size} bytes, and {len(head) - at} bytes are there; export it again"
            )
        found.append(head[at + 8 : at + size])
        at += size
    return found


def header_errors() -> tuple[type[Exception], ...]:
    """Return the errors that nibabel raises on a header that it does not accept."""
    spatial = needed("nibabel.spatialimages", "nibabel", "NIfTI")
    wrapped = needed("nibabel.wrapstruct", "nibabel", "NIfTI")
    return (spatial.HeaderDataError, spatial.HeaderTypeError, wrapped.WrapStructError, *STREAM_ERRORS)


def checked_size(sides: Sequence[int], name: str) -> tuple[tuple[int, int, int], int]:
    """Return (columns, rows, slices) and the number of times.

    Parameters
    ----------
    sides : sequence of int
        The size along each axis, x first.
    name : str
        Of the file, for errors.

    Raises
    ------
    ReadError
        For anything that is not a volume at times.
    """
    shape = tuple(int(side) for side in sides)
    if any(side < 1 for side in shape) or len(shape) < 2:
        raise ReadError(f"{name} has the size {shape}, which is not a volume; export it again")
    if any(side > 1 for side in shape[4:]):
        raise ReadError(
            f"{name} has {len(shape)} dimensions {shape}, and a volume has 3, or 4 with time; "
            "save one channel as a file of its own"
        )
    columns, rows, slices, times = (*shape, 1, 1)[:4]
    if slices < 2:
        raise ReadError(f"{name} holds one slice only ({columns} x {rows}); a surface needs at least 2 slices")
    return (columns, rows, slices), times


def checked_dtype(header: Any, name: str) -> np.dtype[Any]:
    """Return the type of the values in the file, or a `ReadError` for color, complex and long double."""
    dtype: np.dtype[Any] = header.get_data_dtype()
    if dtype.names is not None:
        raise ReadError(f"{name} has RGB voxels; convert it to gray values or labels (one number a voxel)")
    if dtype.kind not in "iuf" or dtype.itemsize > 8:
        raise ReadError(f"{name} has voxels of type {dtype}; convert it to int16 or float32")
    return dtype


def scaling(header: Any, name: str) -> tuple[float, float]:
    """Slope and intercept of the values; 1 and 0 where the header has none."""
    try:
        slope, intercept = header.get_slope_inter()
    except header_errors() as error:
        raise ReadError(f"{name} has a broken scale ({reason(error)}); export it again") from error
    scale = (1.0 if slope is None else float(slope)), float(intercept or 0.0)
    if max(map(abs, scale)) > MOST_SCALE:
        raise ReadError(f"{name} has a broken scale ({scale[0]:g} and {scale[1]:g}); export it again")
    return scale


def placed(header: Any, name: str) -> tuple[NDArray[np.float64], tuple[str, ...]]:
    """Affine by nibabel, in mm, and what had to be assumed."""
    try:
        affine = np.array(header.get_best_affine(), np.float64)
    except header_errors() as error:
        raise ReadError(f"{name} has a broken orientation ({reason(error)}); export it again") from error
    notes = []
    if not int(header["sform_code"]) and not int(header["qform_code"]):
        notes.append(
            "the file has no orientation (sform and qform codes are 0): taken as columns towards the patient's left, "
            "rows towards the front, slices towards the head; flip x, y or z changes it"
        )
    try:
        unit = header.get_xyzt_units()[0]
    except KeyError:
        unit = "unknown"
    if TO_MM[unit] != 1.0:
        affine[:3] *= TO_MM[unit]
        notes.append(f"the file's positions are in {unit}s and were converted to mm")
    return affine, tuple(notes)


def label_table(extensions: Sequence[bytes]) -> tuple[dict[int, str], dict[int, RGB]]:
    """Names and colors of labels from a `LabelTable` in one of the header's extensions, as TotalSegmentator writes it.

    Colors are shares of 1, as GIFTI and Caret have them.
    """
    names: dict[int, str] = {}
    colors: dict[int, RGB] = {}
    for content in extensions:
        start = content.find(b"<LabelTable>")
        end = content.find(TABLE_END, max(start, 0))
        if min(start, end) < 0:
            continue
        text = content[start : end + len(TABLE_END)].decode("utf-8", "replace")
        try:
            for label in ElementTree.fromstring(text).iter("Label"):
                number = int(label.attrib["Key"])
                names[number] = (label.text or "").strip()
                color = rgb_of_shares([label.attrib.get(channel, "") for channel in ("Red", "Green", "Blue")])
                if color is not None:
                    colors[number] = color
        except (ElementTree.ParseError, KeyError, ValueError):
            continue  # names are a comfort, the values do without
    return names, colors
