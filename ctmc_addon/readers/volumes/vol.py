# SPDX-License-Identifier: GPL-3.0-or-later
"""Read flat values with a text beside them: `.vgi` of Volume Graphics, `.vol.info` of PyHST.

Either file opens the pair. `.vgi` has sections with lines `key = value`, sizes of voxels in the unit that it says;
`.vol.info` has lines `NUM_X = 512`, and the side of a voxel in micrometers.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...core import ReadError
from ..file_formats import companion_text
from ..length_units import in_mm
from ..result import RawValues, ReadRequest, VolumeSource
from ..series import Series
from ..streams.stored_slices import RawSlices
from .nrrd import header_text, inner_path, open_data_file
from .text_header import MOST_HEADER, numbers, volume_size, whole

VGI, INFO = ".vgi", ".info"
TYPES = {
    **{("unsigned integer", bits): f"u{bits // 8}" for bits in (8, 16, 32)},
    **{(word, bits): f"i{bits // 8}" for word in ("signed integer", "integer") for bits in (8, 16, 32)},
    **{("float", bits): f"f{bits // 8}" for bits in (32, 64)},
}
NO_UNIT = "the file has no unit: its resolution is taken as mm; if it is another unit, give the spacing in mm"
PYHST_TYPES = ("int8", "uint8", "int16", "uint16", "int32", "uint32", "float32", "float64")
PYHST_ORDERS = {"LOWBYTEFIRST": "<", "HIGHBYTEFIRST": ">"}


class _FlatValues(NamedTuple):
    """The layout of flat values, from the text beside them.

    Parameters
    ----------
    path : Path
        Of the values.
    size : (columns, rows, slices) int
    dtype : dtype
        With its byte order.
    start : int
        Byte of the first value.
    spacing : (x, y, z) float or None
        Millimeters.
    notes : tuple of str
    """

    path: Path
    size: tuple[int, int, int]
    dtype: np.dtype[Any]
    start: int
    spacing: tuple[float, float, float] | None
    notes: tuple[str, ...]


class _VolFile(VolumeSource):
    """A text and the `.vol` beside it."""

    format = "VOL"
    has_geometry = True

    def __init__(self, path: Path) -> None:
        self.flat = flat = (_volume_graphics if path.name.lower().endswith(VGI) else _pyhst)(path)
        open_data_file(flat.path, path).close()
        columns, rows, slices = flat.size
        series = Series(1, "", slices, (columns, rows), "", flat.dtype.newbyteorder("=").name)
        super().__init__(path, (series,), [path, flat.path])

    def raw_values(self, request: ReadRequest) -> RawValues:
        """Return the values."""
        del request
        flat = self.flat
        stored = RawSlices(flat.path, flat.start, flat.size[::-1], flat.dtype)
        return RawValues(stored, None, flat.notes, spacing=flat.spacing)


def open_source(path: Path) -> _VolFile:
    """Open a text, or the text beside values."""
    return _VolFile(companion_text(path) or path)


def read_text(path: Path) -> str:
    """Return a whole text."""
    with path.open("rb") as stream:
        content = stream.read(MOST_HEADER + 1)
    if len(content) > MOST_HEADER:
        raise ReadError(f"{path.name} has more than {MOST_HEADER} bytes, and it should be a short text; copy it again")
    return header_text(content)


def fields_of(text: str) -> dict[str, str]:
    """Return the lines `key = value` by their key in small letters; of equal keys the first."""
    fields: dict[str, str] = {}
    for key, value in re.findall(r"^[ \t]*(\w+)[ \t]*=[ \t]*(.*?)[ \t\r]*$", text, re.MULTILINE):
        fields.setdefault(key.lower(), value)
    return fields


def _volume_graphics(path: Path) -> _FlatValues:
    """Return the layout of values from a `.vgi`.

    Raises
    ------
    ReadError
        If it has not one file of plain values.
    """
    sections = re.split(r"^[ \t]*\[(\w+)\][ \t\r]*$", read_text(path), flags=re.MULTILINE)
    named = [(name.lower(), fields_of(text)) for name, text in zip(sections[1::2], sections[2::2], strict=True)]
    files = [fields for name, fields in named if re.fullmatch(r"file\d+", name)]
    if len(files) != 1:
        raise ReadError(f"{path.name} has {len(files)} files of values, and one is read; export the volume as one file")
    file = files[0]
    if file.get("fileformat", "raw").lower() != "raw":
        raise ReadError(f"{path.name} has values as '{file['fileformat'][:60]}'; export them as raw")
    bits = whole(file.get("bitsperelement", ""), "BitsPerElement", path.name)
    kind = file.get("datatype", "").lower()
    if (kind, bits) not in TYPES:
        raise ReadError(f"{path.name} has values of type '{kind[:60]}' of {bits} bits; export them as 16 bits or float")
    start = whole(file.get("skipheader", "0"), "SkipHeader", path.name)
    if start < 0:
        raise ReadError(f"{path.name} has a SkipHeader of {start}; export it again")
    whole_volume: dict[str, str] = next((fields for name, fields in named if name == "representation"), {})
    mirrors = [fields["mirror"] for fields in (file, whole_volume) if set(fields.get("mirror", "0")) - set("0 ")]
    if mirrors:
        raise ReadError(
            f"{path.name} has mirrored values ('{mirrors[0][:60]}' as Mirror); export them without mirroring"
        )
    geometry: dict[str, str] = next((fields for name, fields in named if name == "geometry"), {})
    sides = numbers(geometry, ("resolution",), 3, path.name)
    (mm,), notes = in_mm([geometry.get("unit", "")])
    if sides is not None and not geometry.get("unit"):
        notes = (*notes, NO_UNIT)
    return _FlatValues(
        _values_path(path, file.get("name", "").strip("\"'")),
        volume_size([whole(word, "Size", path.name) for word in file.get("size", "").split()[:9]], path.name),
        np.dtype("<" + TYPES[kind, bits]),
        start,
        None if sides is None else (sides[0] * mm, sides[1] * mm, sides[2] * mm),
        notes,
    )


def _values_path(path: Path, name: str) -> Path:
    """Return the path of a `.vgi`'s values: as it says, else beside it, because the folder may be another machine's."""
    last = re.split(r"[/\\]", name)[-1]
    if last.lower().endswith(VGI) or not last:
        raise ReadError(f"{path.name} has '{name[:60]}' as Name, not a file of values; export it again")
    in_folder, as_written = path.parent / last, path.parent / name.replace("\\", "/")
    is_inside = as_written.is_relative_to(path.parent) and as_written.is_file()
    return in_folder if in_folder.is_file() and not is_inside else path.parent / inner_path(name, path.name)


def _pyhst(path: Path) -> _FlatValues:
    """Return the layout of values from a `.vol.info`.

    Raises
    ------
    ReadError
        If its size or type cannot be read.
    """
    fields, name = fields_of(read_text(path)), path.name
    sides = [whole(fields.get(key.lower(), ""), key, name) for key in ("NUM_X", "NUM_Y", "NUM_Z")]
    kind, order = fields.get("data_type", "float32").lower(), fields.get("byteorder", "LOWBYTEFIRST").upper()
    if kind not in PYHST_TYPES or order not in PYHST_ORDERS:
        raise ReadError(
            f"{name} has values of type '{kind[:60]}' in the order '{order[:60]}'; save them as float32, LOWBYTEFIRST"
        )
    notes = []
    if "data_type" not in fields:
        notes.append("the file has no DATA_TYPE: its values are taken as float32, as PyHST writes them")
    side = numbers(fields, ("voxelSize",), 1, name)
    if side is not None:
        notes.append(
            f"the file's voxelSize {side[0]:g} is taken as micrometers, as PyHST writes it; if it is another "
            "unit, give the spacing in mm"
        )
    return _FlatValues(
        path.with_name(name[: -len(INFO)]),
        volume_size(sides, name),
        np.dtype(PYHST_ORDERS[order] + np.dtype(kind).str[1:]),
        0,
        None if side is None else (side[0] * 1e-3, side[0] * 1e-3, side[0] * 1e-3),
        tuple(notes),
    )
