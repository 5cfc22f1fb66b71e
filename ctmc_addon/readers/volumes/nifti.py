# SPDX-License-Identifier: GPL-3.0-or-later
"""NIfTI-1 and NIfTI-2 in one file, plain or gzip, or in a pair; its values a few planes at a time.

The header's affine maps (i, j, k) to RAS+. i is the fastest index in the file, so the values are (k, j, i) in C order.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ...core import ReadError, Steps
from ...core.volume import ValueKind, axis_codes, determinant, farthest_corner_mm, spacing_of
from ..geometry import differ, lengths_text
from ..labels.colors import RGB, is_palette, rgb_of_shares
from ..length_units import in_mm
from ..optional_imports import reason
from ..result import RawValues, ReadRequest, Series, VolumeSource
from ..streams import STREAM_ERRORS, opened
from ..value_kind import scaled_steps
from .grid import grid_slices
from .nifti_header import SIZES, NiftiHeader, mended_sides, nifti_header

MOST_HEADER = 2**24  # bytes before the values; label tables of extensions take some thousands
MOST_SCALE = 1e20  # slope or intercept; its product with a value must be a float32
TABLE_END = b"</LabelTable>"


class NiftiFile(VolumeSource):
    """One `.nii` or `.nii.gz`, or the `.hdr` of a pair whose values are in `data_path`."""

    format = "NIfTI"
    has_geometry = True

    def __init__(self, path: Path, data_path: Path | None = None) -> None:
        name = path.name
        self.data_path = data_path or path
        with opened(path) as stream:
            self.header, self.extensions = read_header(stream, name, data_path is not None)
        self.size, times = checked_size(self.header.sides, name)
        self.dtype = checked_dtype(self.header.dtype, name)
        self.scaling = scaling(self.header, name)
        columns, rows, slices = self.size
        files = [path] if data_path is None else [path, data_path]
        super().__init__(path, (Series(1, "", slices, (columns, rows), "", self.dtype.name, times),), files)

    def read_raw_steps(self, request: ReadRequest) -> Steps[RawValues]:
        """Read the values; integers stay integers where slope and intercept are whole numbers."""
        with np.errstate(all="ignore"):  # of numbers that overflow, which Volume refuses
            affine, notes = placed(self.header, self.path.name)
        start = int(self.header.start)
        stored = grid_slices(self.data_path, start, self.size[::-1], self.dtype, request.time, self.series[0].times)
        values = yield from scaled_steps(stored, *self.scaling, request.whole, self.path.name, request.budget)
        kind = ValueKind.LABEL if self.header.holds_labels else None
        names, colors = label_table(self.extensions)
        return RawValues(values, affine, notes, kind, names, colors, is_palette(colors))


def open_steps(path: Path) -> Steps[NiftiFile]:
    """Open the file."""
    return NiftiFile(path)
    yield  # its header is short


def read_header(stream: IO[bytes], name: str, pair: bool = False) -> tuple[NiftiHeader, list[bytes]]:
    """Header of either version, and its extensions; of a pair the values begin in another file."""
    try:
        head = stream.read(SIZES[1])
        header = nifti_header(head)
        offset = header.start
        if not (math.isfinite(offset) and (0 if pair else header.size + 4) <= offset <= MOST_HEADER):
            raise ReadError(
                f"{name} says that its values begin at byte {offset:g}, which no NIfTI file has; export it again"
            )
        head += stream.read(MOST_HEADER if pair else max(0, int(offset) - len(head)))
    except STREAM_ERRORS as error:
        raise ReadError(f"{name} is not a readable NIfTI file ({reason(error)}); export or copy it again") from error
    whole = head if pair else head[: int(offset)]
    return header, extensions(whole, header.size, header.order, name)


def extensions(head: bytes, at: int, order: str, name: str) -> list[bytes]:
    """Contents of the extensions behind a header of `at` bytes, whatever each says it is.

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


def checked_dtype(dtype: np.dtype[Any], name: str) -> np.dtype[Any]:
    """Return the type of the values in the file, or a `ReadError` for color, complex and long double."""
    if dtype.names is not None:
        raise ReadError(f"{name} has RGB voxels; convert it to gray values or labels (one number a voxel)")
    if dtype.kind not in "iuf" or dtype.itemsize > 8:
        raise ReadError(f"{name} has voxels of type {dtype}; convert it to int16 or float32")
    return dtype


def scaling(header: NiftiHeader, name: str) -> tuple[float, float]:
    """Slope and intercept of the values; 1 and 0 where the header has none."""
    try:
        return checked_scale(*header.scale, name)
    except ValueError as error:
        raise ReadError(f"{name} has a broken scale ({reason(error)}); export it again") from error


def checked_scale(slope: float, intercept: float, name: str) -> tuple[float, float]:
    """Return slope and intercept, or a `ReadError` where scaled values would not be a float32."""
    if max(abs(slope), abs(intercept)) > MOST_SCALE:
        raise ReadError(f"{name} has a broken scale ({slope:g} and {intercept:g}); export it again")
    return slope, intercept


def placed(header: NiftiHeader, name: str) -> tuple[NDArray[np.float64], tuple[str, ...]]:
    """Affine in mm, and what had to be assumed."""
    try:
        affine = header.affine
    except ValueError as error:
        raise ReadError(f"{name} has a broken orientation ({reason(error)}); export it again") from error
    notes = []
    if not any(header.codes):
        notes.append(
            "the file has no orientation (sform and qform codes are 0): taken as columns towards the patient's left, "
            "rows towards the front, slices towards the head; flip x, y or z changes it"
        )
    (mm,), said = in_mm(["" if header.unit == "unknown" else header.unit])
    affine[:3] *= mm
    return affine, (*notes, *geometry_notes(header, mm), *said)


def geometry_notes(header: NiftiHeader, mm: float) -> tuple[str, ...]:
    """Return what the file says of its place in two ways that differ, or in none that can be.

    Parameters
    ----------
    header : NiftiHeader
    mm : float
        The header's unit.
    """
    has_qform, has_sform = header.codes
    if not has_sform:
        return mended_notes(header.pixdim * mm)
    affine = header.sform
    lengths, others = spacing_of(affine) * mm, np.abs(header.pixdim) * mm
    parts = [f"spacing {lengths_text(lengths)} and {lengths_text(others)} mm"] * differ(others, lengths)
    if not has_qform:
        return (f"the file's sform and pixdim differ ({parts[0]}): sform is taken",) if parts else ()
    try:
        qform = header.qform
    except ValueError as error:
        return (f"the file's qform is broken ({reason(error)}): sform is taken",)
    if not np.isfinite([affine, qform]).all() or not lengths.all():
        return ()  # refused, or without directions
    axes = [f"{axis_codes(place)}, {'left' if determinant(place) < 0 else 'right'}-handed" for place in (affine, qform)]
    if axes[0] != axes[1]:
        parts.append(f"axes to {axes[0]}, and to {axes[1]}")
    columns, rows, slices = header.sides[:3]
    away_mm = farthest_corner_mm(affine, qform, (columns, rows, slices)) * mm
    if not parts and away_mm > lengths.min():  # float32 rounds quaternions of half turns badly
        parts.append(f"places up to {away_mm:.3g} mm apart")
    return (f"the file's sform and qform differ ({'; '.join(parts)}): sform is taken",) if parts else ()


def mended_notes(pixdim_mm: NDArray[np.float64]) -> tuple[str, ...]:
    """Return the note on distances between samples, (3,) mm, that are not above 0."""
    if not (pixdim_mm <= 0).any():
        return ()
    taken = lengths_text(mended_sides(pixdim_mm))
    return (f"the file's pixdim is {lengths_text(pixdim_mm)}: taken as {taken} mm; give the spacing in mm for another",)


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
