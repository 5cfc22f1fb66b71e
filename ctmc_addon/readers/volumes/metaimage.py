# SPDX-License-Identifier: GPL-3.0-or-later
"""Read MetaImage: `.mha` with its values after the header, `.mhd` with the files that it names.

Positions are in LPS+ mm; the n-th three numbers of TransformMatrix are the direction of axis n. As ITK reads it;
itk.org/Wiki/ITK/MetaIO/Documentation is the format's description.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ...core import ReadError, Steps, equal_part
from ...core.volume import SliceReader, ValuesInMemory
from ..geometry import turned_notes
from ..length_units import in_mm
from ..result import RawValues, ReadRequest, VolumeSource
from ..series import Series
from ..streams.stored_slices import JoinedSlices, PackedSlices, RawSlices, TimeSlices
from ..streams.zlib_stream import ZlibFile
from ..value_kind import require_text_memory
from .grid import check_bytes
from .nrrd import data_files, header_text, open_data_file, words_steps
from .text_header import MOST_HEADER, numbers, whole

TYPES = {
    **{"CHAR": "i1", "UCHAR": "u1", "SHORT": "i2", "USHORT": "u2", "INT": "i4", "UINT": "u4", "LONG": "i4"},
    **{"ULONG": "u4", "LONG_LONG": "i8", "ULONG_LONG": "u8", "FLOAT": "f4", "DOUBLE": "f8"},
}


# Names of one field, the first of which is taken.
MATRIX = ("TransformMatrix", "Rotation", "Orientation")
SPACING = ("ElementSpacing", "ElementSize")
OFFSET = ("Offset", "Position", "Origin")


class _MetaImageFile(VolumeSource):
    """One `.mha`, or one `.mhd` with the files that it names."""

    format = "MetaImage"
    has_geometry = True

    def __init__(self, path: Path) -> None:
        with path.open("rb") as stream:
            self.fields, names = read_header(stream, path.name)
            self.start = stream.tell()
        self.size, times = checked_size(self.fields, path.name)
        self.dtype = checked_dtype(self.fields, path.name)
        self.geometry = placed(self.fields, path.name)
        columns, rows, slices = self.size
        self.data_files = data_files({"data file": names}, path, slices * times) if names else []
        series = Series(1, "", slices, (columns, rows), "", self.dtype.newbyteorder("=").name, times)
        super().__init__(path, (series,), [path, *self.data_files])

    def read_raw_steps(self, request: ReadRequest) -> Steps[RawValues]:
        """Read the values of one time."""
        affine, directions, notes = self.geometry
        columns, rows, slices = self.size
        times = self.series[0].times
        files, count = self.data_files or [self.path], slices * times
        if count % len(files):
            raise ReadError(f"{self.path.name} names {len(files)} data files for {count} slices; repair the header")
        readers = []
        for number, file in enumerate(files):
            opening = self._stored_steps(file, (count // len(files), rows, columns))
            readers.append((yield from equal_part(opening, number, len(files))))
        stored = readers[0] if len(readers) == 1 else JoinedSlices(readers)
        if times > 1:
            stored = TimeSlices(stored, (request.time - 1) * slices, slices)
        return RawValues(stored, affine, notes, directions=directions)

    def _stored_steps(self, file: Path, shape: tuple[int, int, int]) -> Steps[SliceReader]:
        """Return the reader of the values of one file."""
        header_bytes = whole(self.fields.get("headersize", "0"), "HeaderSize", self.path.name)
        packed = _is_true(self.fields.get("compresseddata", "False"))
        text = not _is_true(self.fields.get("binarydata", "True"))
        start = 0 if self.data_files else self.start
        with open_data_file(file, self.path) as stream:
            if text:
                require_text_memory(shape, self.dtype.itemsize, file.name)
                values = np.empty(shape, self.dtype.newbyteorder("="))
                stream.seek(start)
                yield from words_steps(values.reshape(-1), stream, file.name)
                return ValuesInMemory(values)
        if header_bytes == -1 and not packed:  # the values are the file's last bytes
            start = max(start, file.stat().st_size - math.prod(shape) * self.dtype.itemsize)
        elif header_bytes < 0:
            raise ReadError(f"{self.path.name} has a HeaderSize of {header_bytes}; export it again")
        start += max(header_bytes, 0)
        if not packed:
            if self.series[0].times > 1:
                check_bytes(file, start + math.prod(shape) * self.dtype.itemsize)
            return RawSlices(file, start, shape, self.dtype)

        def unpacked(files: ExitStack) -> Any:
            stream = files.enter_context(file.open("rb"))
            stream.seek(start)
            return files.enter_context(ZlibFile(stream))

        return PackedSlices(file, unpacked, 0, shape, self.dtype)


def open_source(path: Path) -> _MetaImageFile:
    """Open the file."""
    return _MetaImageFile(path)


def read_header(stream: IO[bytes], name: str) -> tuple[dict[str, str], list[str]]:
    """Return the fields by lower-case name, and the data files; none if the values follow the header.

    `stream` is left at the first byte of values behind it.
    """
    fields: dict[str, str] = {}
    while line := stream.readline(MOST_HEADER):
        key, separator, value = re.sub(r"[=:]", "\0", header_text(line), count=1).partition("\0")
        if not separator or stream.tell() > MOST_HEADER or not key.isprintable():
            break
        fields[key.strip().lower()] = value.strip()
        if key.strip().lower() != "elementdatafile":
            continue
        if value.strip().upper() == "LOCAL":
            return fields, []
        if not value.strip().upper().startswith("LIST"):
            return fields, [value.strip()]
        listed = header_text(stream.read(MOST_HEADER)).splitlines()
        return fields, [text.strip() for text in listed if text.strip()]
    raise ReadError(f"{name} is not a readable MetaImage: its header lacks ElementDataFile; export or copy it again")


def _told_twice(fields: Mapping[str, str], keys: Sequence[str]) -> list[str]:
    """Return a note for each of `keys` that differs from the first one, which is used."""
    first, *other_keys = [key for key in keys if key.lower() in fields] or [""]
    return [
        f"the file has {first} {fields[first.lower()][:60]} and {key} {fields[key.lower()][:60]}: {first} is taken"
        for key in other_keys
        if words_of(fields[key.lower()]) != words_of(fields[first.lower()])
    ]


def words_of(text: str) -> list[float | str]:
    """Return the words of a field, as numbers where they are.

    Examples
    --------
    >>> words_of("1.0 2 x")
    [1.0, 2.0, 'x']
    """
    words: list[float | str] = []
    for word in text.split():
        try:
            words.append(float(word))
        except ValueError:
            words.append(word)
    return words


def _is_true(text: str) -> bool:
    """Return whether a field holds the word true."""
    return text[:1] in ("T", "t", "1", "Y", "y")


def checked_size(fields: Mapping[str, str], name: str) -> tuple[tuple[int, int, int], int]:
    """Return (columns, rows, slices) and the number of times.

    Parameters
    ----------
    fields : mapping of str to str
        The header.
    name : str
        Of the file, for errors.

    Raises
    ------
    ReadError
        For anything that is not one volume.
    """
    sides = [whole(word, "DimSize", name) for word in fields.get("dimsize", "").split()[:9]]
    dimensions = whole(fields.get("ndims", "0"), "NDims", name)
    if dimensions != len(sides) or not sides or min(sides) < 1:
        raise ReadError(f"{name} has {dimensions} dimensions and the sizes {tuple(sides)}; export it again")
    if len(sides) > 4 or len(sides) < 2:
        raise ReadError(f"{name} has {len(sides)} dimensions {tuple(sides)}, and a volume has 3; save one volume")
    columns, rows, slices, times = (*sides, 1, 1)[:4]
    if slices < 2:
        raise ReadError(f"{name} has only one slice ({columns} x {rows}); a surface needs at least 2 slices")
    channels = whole(fields.get("elementnumberofchannels", "1"), "ElementNumberOfChannels", name)
    if channels != 1:
        raise ReadError(f"{name} has {channels} numbers a voxel; convert it to gray values or labels (one number)")
    return (columns, rows, slices), times


def checked_dtype(fields: Mapping[str, str], name: str) -> np.dtype[Any]:
    """Return the type of the values in the file, with its byte order."""
    word = fields.get("elementtype", "").upper()
    code = TYPES.get(word.removeprefix("MET_"))
    if code is None:
        raise ReadError(f"{name} has values of type '{word[:60]}'; convert it to MET_SHORT or MET_FLOAT")
    big = _is_true(fields.get("binarydatabyteordermsb", fields.get("elementbyteordermsb", "False")))
    return np.dtype((">" if big else "<") + code)


def placed(
    fields: Mapping[str, str], name: str
) -> tuple[NDArray[np.float64] | None, NDArray[np.float64] | None, tuple[str, ...]]:
    """Return the affine to RAS+ mm, directions and assumptions; no affine if the file has no spacing and direction."""
    count = len(fields["dimsize"].split())
    matrix = numbers(fields, MATRIX, count * count, name)
    spacing = numbers(fields, SPACING, count, name)
    offset = numbers(fields, OFFSET, count, name)
    notes = [note for keys in (MATRIX, SPACING, OFFSET) for note in _told_twice(fields, keys)]
    slope = numbers(fields, ("ElementToIntensityFunctionSlope",), 1, name) or [1.0]
    intercept = numbers(fields, ("ElementToIntensityFunctionOffset",), 1, name) or [0.0]
    if (slope, intercept) != ([1.0], [0.0]):
        notes.append("the file's ElementToIntensityFunction is not applied, as in ITK: the values are those stored")
    if spacing is None and matrix is None:
        return None, None, tuple(notes)
    axes = np.eye(count) if matrix is None else np.array(matrix).reshape(count, count)
    directions = axes[:3, :3].T * [[-1.0], [-1.0], [1.0]]  # LPS to RAS
    lengths = np.array(spacing) if spacing is not None else np.ones(count)  # below 0 turns the axis round
    affine = np.eye(4)
    affine[:3, :3] = directions * lengths[:3]
    affine[:3, 3] = (offset or [0.0] * count)[:3]
    affine[:2, 3] *= -1.0
    if spacing is None:
        notes.append("the file has a direction but no spacing: 1 mm is assumed along x, y and z")
    notes += turned_notes(next((key for key in SPACING if key.lower() in fields), ""), lengths[:3])
    lengths_mm, unit_notes = in_mm([fields.get("distanceunits", "")])
    affine[:3] *= lengths_mm[0]
    return affine, directions, (*notes, *unit_notes)
