"""NIfTI-1 and NIfTI-2 in one file, plain or gzip: nibabel reads the header, the values come straight in.

nibabel's affine maps (i, j, k) to RAS+ mm. i is the fastest index in the file, so the values are
(k, j, i) in C order without a copy. NIfTI-1 is described at nifti.nimh.nih.gov/nifti-1.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ..core import ReadError, Steps, within
from .optional_imports import BROKEN, imported_steps, needed, quiet, reason
from .result import Reading, Series
from .streams import check_end, fill_steps, opened, skip
from .value_kind import PLANES, native_steps, require_memory, scaled_whole_steps

WHAT = "NIfTI"
TO_MM = {"unknown": 1.0, "mm": 1.0, "meter": 1000.0, "micron": 0.001}


def library_steps() -> Steps[None]:
    """Import nibabel, which brings much with it, so that reading begins at once."""
    yield from imported_steps("nibabel.nifti1", "nibabel", WHAT)


def read_steps(path: Path) -> Steps[Reading]:
    """Read one NIfTI file."""
    with opened(path) as stream:
        header = read_header(stream, path.name)
        size = checked_size(header, path.name)
        dtype = checked_dtype(header, path.name)
        slope, intercept = scaling(header, path.name)
        skip(stream, int(header["vox_offset"]) - stream.tell(), path.name)
        shape = size[::-1]  # (k, j, i)
        if dtype.kind in "iu" and slope.is_integer() and intercept.is_integer():
            values = yield from whole_steps(stream, shape, dtype, int(slope), int(intercept), path.name)
        elif (slope, intercept) == (1.0, 0.0):
            values = yield from whole_steps(stream, shape, dtype, 1, 0, path.name)
        else:
            values = yield from fractional_steps(stream, shape, dtype, slope, intercept, path.name)
        check_end(stream, path.name)
    affine, notes = placed(header, path.name)
    names = label_names(header)
    return Reading(values, affine, notes, "", names, WHAT)


def whole_steps(
    stream: IO[bytes], shape: tuple[int, ...], dtype: np.dtype[Any], slope: int, intercept: int, name: str
) -> Steps[NDArray[Any]]:
    """Values as they stand in the file, or integers scaled to integers."""
    plain = (slope, intercept) == (1, 0)
    scaled_bytes = 2 if dtype.itemsize == 1 and not plain else 0  # wider integers mostly stay in their place
    require_memory(shape, dtype.itemsize + scaled_bytes, name)
    values = np.empty(shape, dtype)
    yield from within(fill_steps(values, stream, name), 0.0, 1.0 if plain else 0.8)
    values = yield from native_steps(values)
    return values if plain else (yield from within(scaled_whole_steps(values, slope, intercept), 0.8, 1.0))


def fractional_steps(
    stream: IO[bytes], shape: tuple[int, ...], dtype: np.dtype[Any], slope: float, intercept: float, name: str
) -> Steps[NDArray[np.float32]]:
    """Values scaled as nibabel does, in float64, and rounded to float32; a few planes at a time."""
    require_memory(shape, 4, name)
    values = np.empty(shape, np.float32)
    for start in range(0, len(values), PLANES):
        target = values[start : start + PLANES]
        stored = np.empty(target.shape, dtype)
        yield from within(fill_steps(stored, stream, name), start / len(values), (start + len(target)) / len(values))
        target[...] = stored.astype(np.float64) * slope + intercept
    return values


def describe(path: Path) -> Series:
    """Size of the volume, from the header alone."""
    with opened(path) as stream:
        columns, rows, slices = checked_size(read_header(stream, path.name), path.name)
    return Series(1, "", slices, (columns, rows))


def read_header(stream: IO[bytes], name: str) -> Any:
    """Header by nibabel, of either version; `stream` is left behind the header's extensions."""
    nifti1 = needed("nibabel.nifti1", "nibabel", WHAT)
    nifti2 = needed("nibabel.nifti2", "nibabel", WHAT)
    globals_ = needed("nibabel.imageglobals", "nibabel", WHAT)
    try:
        first = stream.read(4)
        stream.seek(0)
        # The first number is the header's own length, in either byte order.
        second_version = 540 in (int.from_bytes(first, "little"), int.from_bytes(first, "big"))
        kind = nifti2.Nifti2Header if second_version else nifti1.Nifti1Header
        with quiet(), globals_.LoggingOutputSuppressor():
            return kind.from_fileobj(stream)
    except header_errors() as error:
        raise ReadError(f"{name} is no readable NIfTI file ({reason(error)}); export or copy it again") from error


def header_errors() -> tuple[Any, ...]:
    """What nibabel raises on a header it cannot accept."""
    spatial = needed("nibabel.spatialimages", "nibabel", WHAT)
    wrapped = needed("nibabel.wrapstruct", "nibabel", WHAT)
    return (*BROKEN, spatial.HeaderDataError, spatial.HeaderTypeError, wrapped.WrapStructError)


def checked_size(header: Any, name: str) -> tuple[int, int, int]:
    """(columns, rows, slices), or a `ReadError` for anything that is not one volume."""
    shape = tuple(int(side) for side in header.get_data_shape())
    if any(side < 1 for side in shape) or len(shape) < 2:
        raise ReadError(f"{name} has the size {shape}, which is no volume; export it again")
    if any(side > 1 for side in shape[3:]):
        raise ReadError(
            f"{name} has {len(shape)} dimensions {shape}, and a volume has 3; "
            "save one time point or channel as a file of its own"
        )
    columns, rows, slices = (*shape, 1)[:3]
    if slices < 2:
        raise ReadError(f"{name} holds one slice only ({columns} x {rows}); a surface needs at least 2 slices")
    return columns, rows, slices


def checked_dtype(header: Any, name: str) -> np.dtype[Any]:
    """The type of the values in the file, or a `ReadError` for colour, complex and long double."""
    dtype: np.dtype[Any] = header.get_data_dtype()
    if dtype.names is not None:
        raise ReadError(f"{name} has RGB voxels; convert it to grey values or labels (one number a voxel)")
    if dtype.kind not in "iuf" or dtype.itemsize > 8:
        raise ReadError(f"{name} has voxels of type {dtype}; convert it to int16 or float32")
    return dtype


def scaling(header: Any, name: str) -> tuple[float, float]:
    """Slope and intercept of the values; 1 and 0 where the header has none."""
    try:
        slope, intercept = header.get_slope_inter()
    except header_errors() as error:
        raise ReadError(f"{name} has a broken scale ({reason(error)}); export it again") from error
    return (1.0 if slope is None else float(slope)), float(intercept or 0.0)


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


def label_names(header: Any) -> dict[int, str]:
    """Names of labels from a `LabelTable` in one of the header's extensions, as TotalSegmentator writes it."""
    names: dict[int, str] = {}
    for extension in header.extensions:
        content = extension.get_content()
        text = content.decode("utf-8", "replace") if isinstance(content, bytes) else str(content)
        found = re.search(r"<LabelTable>.*?</LabelTable>", text, re.DOTALL)
        if not found:
            continue
        try:
            table = ElementTree.fromstring(found[0])
            names.update({int(label.attrib["Key"]): (label.text or "").strip() for label in table.iter("Label")})
        except (ElementTree.ParseError, KeyError, ValueError):
            continue  # names are a comfort, the values do without
    return names
