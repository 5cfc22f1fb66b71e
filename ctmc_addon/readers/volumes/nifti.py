# SPDX-License-Identifier: GPL-3.0-or-later
"""Read NIfTI-1 and NIfTI-2 in one file, plain or gzip, or in a pair; its values a few planes at a time.

nibabel reads and mends the header, whose affine maps (i, j, k) to RAS+. i is the fastest index in the file, so the
values are (k, j, i) in C order.
"""

from __future__ import annotations

import logging
import math
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ...core import ReadError, Steps, mm_text, spacing_text
from ...core.volume import ValueKind, axis_codes, determinant, farthest_corner_mm, spacing_of
from ..geometry import differ, lengths_text
from ..labels.colors import RGB, is_palette, rgb_of_shares
from ..length_units import in_mm
from ..optional_imports import needed, quiet, reason
from ..registry import NIFTI_LIBRARY
from ..result import RawValues, ReadRequest, VolumeSource
from ..series import Series
from ..streams.streams import STREAM_ERRORS, opened
from ..value_kind import scaled_steps
from .grid import grid_slices

LONGEST_HEADER = 540  # A header of NIfTI-2 has these bytes, one of NIfTI-1 fewer.
MOST_HEADER = 2**24  # At most these bytes are before the values; label tables of extensions take some thousands.
MOST_SCALE = 1e20  # The product of a slope, or of an intercept, and a value must be a float32.
TABLE_END = b"</LabelTable>"
LABEL_INTENT = 1002  # NIFTI_INTENT_LABEL says that each value is the number of a label.
DAMAGED_LEVEL = 40  # From this severity on nibabel refuses a header; it mends smaller damage.
SILENT = logging.Logger("nibabel's checks", logging.CRITICAL + 1)  # Mended fields are said in the notes.


class NiftiFile(VolumeSource):
    """One `.nii` or `.nii.gz`, or the `.hdr` of a pair whose values are in `data_path`."""

    format = "NIfTI"
    has_geometry = True

    def __init__(self, path: Path, data_path: Path | None = None) -> None:
        name = path.name
        self.data_path = data_path or path
        with opened(path) as stream:
            self.header, self.pixdim, self.extensions = read_header(stream, name, data_path is not None)
        self.size, times = checked_size(self.header.get_data_shape(), name)
        self.dtype = checked_dtype(self.header.get_data_dtype(), name)
        self.scaling = scaling(self.header, name)
        columns, rows, slices = self.size
        files = [path] if data_path is None else [path, data_path]
        super().__init__(path, (Series(1, "", slices, (columns, rows), "", self.dtype.name, times),), files)

    def read_raw_steps(self, request: ReadRequest) -> Steps[RawValues]:
        """Read the values; integers stay integers where slope and intercept are whole numbers."""
        with np.errstate(all="ignore"):  # of numbers that overflow, which Volume refuses
            affine, notes = placed(self.header, self.pixdim, self.path.name)
        start = int(self.header["vox_offset"])
        stored = grid_slices(self.data_path, start, self.size[::-1], self.dtype, request.time, self.series[0].times)
        values = yield from scaled_steps(stored, *self.scaling, request.whole, self.path.name, request.budget)
        kind = ValueKind.LABEL if int(self.header["intent_code"]) == LABEL_INTENT else None
        names, colors = label_table(self.extensions)
        return RawValues(values, affine, notes, kind, names, colors, is_palette(colors))


def open_source(path: Path) -> NiftiFile:
    """Open the file."""
    return NiftiFile(path)


def read_header(stream: IO[bytes], name: str, pair: bool = False) -> tuple[Any, NDArray[np.float64], list[bytes]]:
    """Return the header of either version, its pixdim (3,) as it is written, and the contents of its extensions.

    Parameters
    ----------
    stream : binary file
    name : str
        Of the file, for errors.
    pair : bool
        Whether the values are in another file.
    """
    second, first = needed(*NIFTI_LIBRARY, "NIfTI"), needed("nibabel.nifti1", "nibabel", "NIfTI")
    try:
        head = stream.read(LONGEST_HEADER)
        kind = second.Nifti2Header if second.Nifti2Header.may_contain_header(head) else first.Nifti1Header
        header, pixdim = mended(kind, head[: kind.sizeof_hdr])
        header.get_data_shape()
        offset = float(header["vox_offset"])
        if not (math.isfinite(offset) and (0 if pair else kind.sizeof_hdr + 4) <= offset <= MOST_HEADER):
            raise ReadError(
                f"{name} says that its values begin at byte {offset:g}, which no NIfTI file has; export it again"
            )
        head += stream.read(MOST_HEADER if pair else max(0, int(offset) - len(head)))
    except STREAM_ERRORS + header_errors() as error:
        raise ReadError(f"{name} is not a readable NIfTI file ({reason(error)}); export or copy it again") from error
    whole = head if pair else head[: int(offset)]
    return header, pixdim, extensions(whole, kind.sizeof_hdr, header.endianness, name)


def header_errors() -> tuple[type[Exception], ...]:
    """Return the errors that nibabel's headers of NIfTI and Analyze raise."""
    spatial = needed("nibabel.spatialimages", "nibabel", "NIfTI")
    struct_error = needed("nibabel.wrapstruct", "nibabel", "NIfTI").WrapStructError
    # KeyError: a type of values that does not exist. OverflowError: an offset that is infinite.
    return (spatial.HeaderDataError, spatial.HeaderTypeError, struct_error, ValueError, KeyError, OverflowError)


def mended(kind: Any, content: bytes) -> tuple[Any, NDArray[np.float64]]:
    """Return a header that nibabel has checked and mended, and its pixdim (3,) as it is written.

    A side of 0 mm becomes 1 mm, a negative one positive, and an orientation of an unknown code none.
    """
    with quiet():
        header = kind(content, check=False)
        pixdim = np.array(header["pixdim"][1:4], np.float64)
        header.check_fix(SILENT, DAMAGED_LEVEL)
    return header, pixdim


def extensions(head: bytes, at: int, order: str, name: str) -> list[bytes]:
    """Return the contents of the extensions after a header of `at` bytes, whatever their codes.

    nibabel's own reader of extensions takes minutes for a file that is full of empty ones.

    Parameters
    ----------
    head : bytes
        All that is before the values.
    order : {"<", ">"}
        Of the bytes of a number.
    """
    contents: list[bytes] = []
    more, at = head[at : at + 1] > b"\0", at + 4
    while more and at + 8 <= len(head):
        (size,) = struct.unpack_from(f"{order}i", head, at)
        if size < 8 or at + size > len(head):
            raise ReadError(
                f"{name} has a header extension of {size} bytes, and {len(head) - at} bytes are there; export it again"
            )
        contents.append(head[at + 8 : at + size])
        at += size
    return contents


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
        raise ReadError(f"{name} has only one slice ({columns} x {rows}); a surface needs at least 2 slices")
    return (columns, rows, slices), times


def checked_dtype(dtype: np.dtype[Any], name: str) -> np.dtype[Any]:
    """Return the type of the values in the file, or a `ReadError` for color, complex and long double."""
    if dtype.names is not None:
        raise ReadError(f"{name} has RGB voxels; convert it to gray values or labels (one number a voxel)")
    if dtype.kind not in "iuf" or dtype.itemsize > 8:
        raise ReadError(f"{name} has voxels of type {dtype}; convert it to int16 or float32")
    return dtype


def scaling(header: Any, name: str) -> tuple[float, float]:
    """Return slope and intercept of the values; 1 and 0 if the header has none."""
    try:
        slope, intercept = header.get_slope_inter()
    except header_errors() as error:
        raise ReadError(f"{name} has a broken scale ({reason(error)}); export it again") from error
    return checked_scale(1.0 if slope is None else float(slope), float(intercept or 0.0), name)


def checked_scale(slope: float, intercept: float, name: str) -> tuple[float, float]:
    """Return slope and intercept, or a `ReadError` where scaled values would not be a float32."""
    if max(abs(slope), abs(intercept)) > MOST_SCALE:
        raise ReadError(f"{name} has a broken scale ({slope:g} and {intercept:g}); export it again")
    return slope, intercept


def placed(header: Any, pixdim: NDArray[np.float64], name: str) -> tuple[NDArray[np.float64], tuple[str, ...]]:
    """Return the affine in mm and the assumptions; `pixdim` is as stored."""
    try:
        affine = np.array(header.get_best_affine(), np.float64)
    except header_errors() as error:
        raise ReadError(f"{name} has a broken orientation ({reason(error)}); export it again") from error
    notes = []
    if not (header["qform_code"] or header["sform_code"]):
        notes.append(
            "the file has no orientation (sform and qform codes are 0): taken as columns towards the patient's left, "
            "rows towards the front, slices towards the head; flip x, y or z changes it"
        )
    (mm,), unit_notes = in_mm([unit_of(header)])
    affine[:3] *= mm
    return affine, (*notes, *_geometry_notes(header, pixdim, mm), *unit_notes)


def unit_of(header: Any) -> str:
    """Return the unit of positions, '' where it is not known; of another code its number."""
    try:
        unit = str(header.get_xyzt_units()[0])
    except KeyError:
        code = int(header["xyzt_units"]) & 7
        unit = str(needed("nibabel.nifti1", "nibabel", "NIfTI").unit_codes.label.get(code, f"xyzt_units {code}"))
    return "" if unit == "unknown" else unit


def _geometry_notes(header: Any, pixdim: NDArray[np.float64], mm: float) -> tuple[str, ...]:
    """Return notes on positions that the file states twice and differently, or wrongly.

    Parameters
    ----------
    header : nibabel.Nifti1Header
        Mended.
    pixdim : (3,) float64
        As it is written.
    mm : float
        The header's unit.
    """
    if not header["sform_code"]:
        return mended_notes(pixdim * mm, np.array(header["pixdim"][1:4], np.float64) * mm)
    affine = np.array(header.get_sform(), np.float64)
    lengths, pixdim_lengths = spacing_of(affine) * mm, np.abs(pixdim) * mm
    parts = [f"spacing {lengths_text(lengths)} and {spacing_text(pixdim_lengths)}"] * differ(pixdim_lengths, lengths)
    if not header["qform_code"]:
        return (f"the file's sform and pixdim differ ({parts[0]}): sform is taken",) if parts else ()
    try:
        qform = np.array(header.get_qform(), np.float64)
    except header_errors() as error:
        return (f"the file's qform is broken ({reason(error)}): sform is taken",)
    if not np.isfinite([affine, qform]).all() or not lengths.all():
        return ()  # refused, or without directions
    axes = [f"{axis_codes(place)}, {'left' if determinant(place) < 0 else 'right'}-handed" for place in (affine, qform)]
    if axes[0] != axes[1]:
        parts.append(f"axes to {axes[0]}, and to {axes[1]}")
    columns, rows, slices = header.get_data_shape()[:3]
    away_mm = farthest_corner_mm(affine, qform, (columns, rows, slices)) * mm
    if not parts and away_mm > lengths.min():  # float32 rounds quaternions of half turns badly
        parts.append(f"places up to {mm_text(away_mm, 3)} apart")
    return (f"the file's sform and qform differ ({'; '.join(parts)}): sform is taken",) if parts else ()


def mended_notes(written_mm: NDArray[np.float64], taken_mm: NDArray[np.float64]) -> tuple[str, ...]:
    """Return the note on distances between samples, (3,) mm, that are not above 0, and those that are taken."""
    if not (written_mm <= 0).any():
        return ()
    taken = spacing_text(taken_mm)
    return (f"the file's pixdim is {lengths_text(written_mm)}: taken as {taken}; give the spacing in mm for another",)


def label_table(extensions: Sequence[bytes]) -> tuple[dict[int, str], dict[int, RGB]]:
    """Return label names and colors from a `LabelTable` in an extension of the header, as TotalSegmentator writes it.

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
        from xml.etree import ElementTree  # takes long to import, and few files have a table

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
