# SPDX-License-Identifier: GPL-3.0-or-later
"""Read NRRD with its data inside, in one other file or in many; its header by pynrrd.

The first axis is the fastest, so the values are (third, second, first) in C order.
teem.sourceforge.net/nrrd/format.html is the format's description.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from contextlib import ExitStack, closing
from contextvars import ContextVar, copy_context
from pathlib import Path, PurePath, PurePosixPath
from typing import IO, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...core import ReadError, Step, Steps, equal_part
from ...core.volume import SliceReader, ValueKind, ValuesInMemory
from ..geometry import AXIAL
from ..labels.names.segments import layered_steps, names_and_colors, segments_of
from ..optional_imports import needed, quiet, reason
from ..result import RawValues, ReadRequest, VolumeSource
from ..series import Series
from ..streams.stored_slices import InterleavedSlices, JoinedSlices, PackedSlices, RawSlices, TimeSlices
from ..streams.streams import skip_steps, unpacked
from ..value_kind import require_text_memory
from .nrrd_place import placed

Result = TypeVar("Result")

MOST_HEADER = 2**24  # Read at most this many bytes of header.
MOST_SKIP = 1 << 62  # Bytes; no file is that long.
HEADER_ERRORS = (ValueError, KeyError, IndexError, TypeError, StopIteration)  # Errors of pynrrd besides its own.
TYPES = {
    "i1": ("signed char", "int8", "int8_t"),
    "u1": ("uchar", "unsigned char", "uint8", "uint8_t"),
    "i2": ("short", "short int", "signed short", "signed short int", "int16", "int16_t"),
    "u2": ("ushort", "unsigned short", "unsigned short int", "uint16", "uint16_t"),
    "i4": ("int", "signed int", "int32", "int32_t"),
    "u4": ("uint", "unsigned int", "uint32", "uint32_t"),
    "i8": ("longlong", "long long", "long long int", "signed long long", "signed long long int", "int64", "int64_t"),
    "u8": ("ulonglong", "unsigned long long", "unsigned long long int", "uint64", "uint64_t"),
    "f4": ("float",),
    "f8": ("double",),
}
_outside: ContextVar[bool] = ContextVar("outside", default=False)
TEXT_ENCODINGS = ("ascii", "text", "txt")
LONGEST_WORD = 400  # Letters of a number; a double without exponent has 309.
WORDS_CHUNK = 2**17  # Bytes of numbers as text, read in about 0.005 s.


class _NrrdFile(VolumeSource):
    """One `.nrrd`, or one `.nhdr` with the data that it names."""

    format = "NRRD"
    has_geometry = True

    def __init__(self, path: Path) -> None:
        name = path.name
        with path.open("rb") as stream:
            self.header = read_header(stream, name)
            self.data_start = stream.tell()
        self.size, self.kept_axes, self.times, self.interleaved = checked_size(self.header, name)
        self.dtype = checked_dtype(self.header, name)
        self.segments = segments_of(self.header, name)
        columns, rows, slices = self.size
        times = 1 if self.segments else self.times  # else they are layers of segments that overlap
        series = Series(1, "", slices, (columns, rows), "", self.dtype.newbyteorder("=").name, times)
        self.data_files = data_files(self.header, path, slices * self.times)
        super().__init__(path, (series,), [path, *self.data_files])

    def read_raw_steps(self, request: ReadRequest) -> Steps[RawValues]:
        """Read the values of one time, or all layers of a segmentation."""
        with np.errstate(all="ignore"):  # of numbers that overflow, which Volume refuses
            affine, notes = placed(self.header, self.kept_axes)
        directions = None if "space directions" in self.header else AXIAL
        if self.segments and self.times > 1:
            layers = []
            for layer in range(self.times):
                layers.append((yield from self._time_steps(layer)))
            label_layers = yield from layered_steps(layers, self.segments, self.path.name)
            first, *further = label_layers.layers
            all_notes = (*notes, *label_layers.notes)
            return RawValues(
                first,
                affine,
                all_notes,
                ValueKind.LABEL,
                label_layers.names,
                label_layers.colors,
                directions=directions,
                layers=tuple(further),
            )
        values = yield from self._time_steps(request.time - 1)
        segments = [segment for segment in self.segments if not segment.layer]
        names, colors = names_and_colors(segments, [segment.value for segment in segments])
        return RawValues(values, affine, notes, None, names, colors, directions=directions)

    def _time_steps(self, time: int) -> Steps[SliceReader]:
        """Return the reader of the values of one time, counted from 0."""
        files = self.data_files or [self.path]
        columns, rows, slices = self.size
        stored_slices, stored_columns = slices * self.times, columns
        if self.interleaved:
            stored_slices, stored_columns = slices, columns * self.times
        if stored_slices % len(files):
            raise ReadError(
                f"{self.path.name} names {len(files)} data files for {stored_slices} slices; repair the header"
            )
        shape = (stored_slices // len(files), rows, stored_columns)  # in each data file
        start = 0 if self.data_files else self.data_start
        readers = []
        for number, file in enumerate(files):
            opening = _stored_steps(file, self.path, start, self.header, shape, self.dtype)
            readers.append((yield from equal_part(opening, number, len(files))))
        stored = readers[0] if len(readers) == 1 else JoinedSlices(readers)
        if self.times == 1:
            return stored
        if self.interleaved:
            return InterleavedSlices(stored, time, self.times)
        return TimeSlices(stored, time * slices, slices)


def open_source(path: Path) -> _NrrdFile:
    """Open the file."""
    return _NrrdFile(path)


def read_header(stream: IO[bytes], name: str) -> Mapping[str, Any]:
    """Return pynrrd's header; leave `stream` at the first byte of attached data."""
    nrrd = needed("nrrd", "pynrrd", "NRRD")
    lines, names = _header_lines(stream, name)
    try:
        with quiet():
            header = dict(nrrd.read_header(lines))
    except (*HEADER_ERRORS, nrrd.NRRDError) as error:
        raise ReadError(f"{name} is not a readable NRRD file ({reason(error)}); export or copy it again") from error
    if names:
        header["data file"] = names
    for field in ("type", "dimension", "sizes", "encoding"):
        if field not in header:
            raise ReadError(f"{name} lacks the field '{field}' in its header; export it again")
    if header["dimension"] != len(header["sizes"]):
        raise ReadError(
            f"{name} has {header['dimension']} dimensions but {len(header['sizes'])} sizes; export it again"
        )
    return header


def _header_lines(stream: IO[bytes], name: str) -> tuple[list[str], list[str]]:
    """Return the lines up to the empty one, and the names after `data file: LIST`, which pynrrd cannot read.

    They are decoded here: of bytes pynrrd drops every letter that is not ASCII.
    """
    if stream.read(4) != b"NRRD":
        raise ReadError(f"{name} is not an NRRD file: it does not begin with 'NRRD'; export or copy it again")
    lines, names = [header_text(b"NRRD" + stream.readline(MOST_HEADER))], []
    listing = False
    while line := stream.readline(MOST_HEADER).strip(b"\r\n"):
        if stream.tell() > MOST_HEADER:
            raise ReadError(f"{name} has a header of more than {MOST_HEADER} bytes; export it again")
        if listing:
            names.append(header_text(line).strip())
        elif re.match(rb"data ?file:\s*LIST", line, re.IGNORECASE):
            listing = True
        else:
            lines.append(header_text(line))
    return lines, names


def header_text(line: bytes) -> str:
    """Return a line as UTF-8, as 3D Slicer writes it; as Latin-1 where it is not."""
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        return line.decode("latin-1")


def checked_size(header: Mapping[str, Any], name: str) -> tuple[tuple[int, int, int], list[int], int, bool]:
    """Return the size along the three axes of space, which axes those are, and the number of volumes along a fourth.

    Parameters
    ----------
    header : mapping
        As pynrrd reads it.
    name : str
        Of the file, for errors.

    Returns
    -------
    size, axes, count, and whether a voxel's values of all volumes lie together

    Raises
    ------
    ReadError
        For anything else.
    """
    sizes = [int(side) for side in header["sizes"]]
    kept = [axis for axis, side in enumerate(sizes) if side > 1 or len(sizes) <= 3]
    kinds = [str(kind) for kind in header.get("kinds", ())]
    listed = [axis for axis in kept if axis < len(kinds) and kinds[axis].lower() in ("list", "time")]
    color = [kind for kind in kinds if any(word in kind.lower() for word in ("color", "vector", "complex", "matrix"))]
    apart = (listed or [kept[-1]])[0] if len(kept) == 4 else -1
    words = f" ({' '.join(kinds)})" if kinds else ""
    unclear = apart >= 0 and (len(listed) > 1 or color or apart not in (kept[0], kept[-1]))
    if min(sizes) < 1 or len(kept) > 4 or unclear:
        raise ReadError(
            f"{name} has the sizes {tuple(sizes)}{words}, and a volume has 3, or 4 "
            "with time; save one channel as a file of its own"
        )
    if len(kept) == 3 and color:
        raise ReadError(f"{name} has {color[0]} voxels; convert it to gray values or labels (one number a voxel)")
    times, interleaved = (sizes[apart], apart == kept[0]) if apart >= 0 else (1, False)
    kept = [axis for axis in kept if axis != apart]
    if len(kept) < 3 or sizes[kept[2]] < 2:
        raise ReadError(f"{name} has only one slice, sizes {tuple(sizes)}; a surface needs at least 2 slices")
    return (sizes[kept[0]], sizes[kept[1]], sizes[kept[2]]), kept, times, interleaved


def checked_dtype(header: Mapping[str, Any], name: str) -> np.dtype[Any]:
    """Return the type of the values in the file, with its byte order."""
    word = str(header["type"]).strip().lower()
    code = next((code for code, words in TYPES.items() if word in words), None)
    if code is None:
        raise ReadError(f"{name} has values of type '{word}'; convert it to short or float")
    dtype = np.dtype(code)
    endian = str(header.get("endian", "")).strip().lower()
    text = str(header["encoding"]).lower() in TEXT_ENCODINGS
    if endian not in ("little", "big") and (endian or (dtype.itemsize > 1 and not text)):
        raise ReadError(
            f"{name} has '{endian[:60]}' as endian, so that the order of each value's bytes is unknown; write "
            "'endian: little' into its header, or big"
        )
    return dtype.newbyteorder(">" if endian == "big" else "<")


def data_files(header: Mapping[str, Any], path: Path, slices: int) -> list[Path]:
    """Return the files that hold the values, in order; none where they follow the header.

    `data file` is a name, a list under `LIST`, or a pattern `name%d first last step [dimension]`. Each lies in the
    header's folder or below: a header that came by mail must not name another file of the machine, or of the network.
    """
    named = header.get("data file", header.get("datafile", []))
    names: list[str] = [named] if isinstance(named, str) else named
    words = names[0].split() if len(names) == 1 else []
    pattern = re.fullmatch(r"([^%]*%0?\d{0,2}d[^%]*?)((?:\s+-?\d{1,9}){3})(?:\s+\d{1,9})?", names[0]) if words else None
    if pattern:
        first, last, step = (int(number) for number in pattern[2].split())
        numbers = range(first, last + (1 if step > 0 else -1), step) if step else range(0)
        if not 0 < len(numbers) <= slices:
            raise ReadError(f"{path.name} names {len(numbers)} data files for {slices} slices; repair the header")
        names = [pattern[1] % number for number in numbers]
    if len(names) > slices:
        raise ReadError(f"{path.name} names {len(names)} data files for {slices} slices; repair the header")
    return [path.parent / inner_path(name, path.name) for name in names]


def outside_allowed_steps(steps: Steps[Result]) -> Steps[Result]:
    """Return the same steps, in which headers may name data files anywhere; between two steps they may not."""
    context = copy_context()
    context.run(_outside.set, True)
    with closing(steps):
        while True:
            try:
                step = context.run(next, steps)
            except StopIteration as stop:
                result: Result = stop.value
                return result
            yield step


def inner_path(name: str, header_name: str) -> PurePath:
    """Return a data file's name as a path below the header's folder; a `ReadError` where it leads elsewhere."""
    if _outside.get() and "\0" not in name:
        return PurePath(name)
    inner = PurePosixPath(name.replace("\\", "/"))
    if inner.is_absolute() or ".." in inner.parts or ":" in name or "\0" in name or not inner.name:
        raise ReadError(
            f"{header_name} names the data file '{name[:80]}', and only a file in the header's own folder or below "
            "is read; put the two together and name the file alone, or trust the header and read it by `ctmc` with "
            "--allow-outside"
        )
    return inner


def open_data_file(file: Path, header: Path) -> IO[bytes]:
    """Return a data file for reading, or a `ReadError` if there is no such file."""
    if not file.is_file():
        raise ReadError(
            f"{header.name} names the data file {file.name[:80]}, which is missing; put both files into one folder"
        )
    return file.open("rb")


def _stored_steps(
    file: Path,
    header_path: Path,
    start: int,
    header: Mapping[str, Any],
    shape: tuple[int, int, int],
    dtype: np.dtype[Any],
) -> Steps[SliceReader]:
    """Return a reader of the values of one data file, after byte `start` and the bytes that the header skips.

    Not by pynrrd, which unpacks a whole file at once, however long it gets, and holds it beside the values.
    """
    encoding = str(header["encoding"]).lower()
    line_skip = int(header.get("line skip", header.get("lineskip", 0)))
    byte_skip = int(header.get("byte skip", header.get("byteskip", 0)))
    if max(line_skip, byte_skip) > MOST_SKIP:
        raise ReadError(f"{file.name} would have to be read from behind byte {MOST_SKIP} on; export it again")
    if not 0 <= line_skip <= MOST_HEADER or byte_skip < (-1 if encoding == "raw" else 0):
        raise ReadError(
            f"{file.name} would have to be read from byte {byte_skip} and line {line_skip} on, encoded as "
            f"'{encoding}'; export it again"
        )
    with open_data_file(file, header_path) as stream:
        stream.seek(start)
        for _ in range(line_skip):
            if not stream.readline():
                break
        start = stream.tell()
        if encoding in TEXT_ENCODINGS:
            require_text_memory(shape, dtype.itemsize, file.name)
            values = np.empty(shape, dtype.newbyteorder("="))
            yield from skip_steps(stream, byte_skip, file.name)
            yield from words_steps(values.reshape(-1), stream, file.name)
            return ValuesInMemory(values)
    if encoding == "raw":
        if byte_skip < 0:  # -1: the values are the file's last bytes
            start = max(0, file.stat().st_size - math.prod(shape) * dtype.itemsize)
        return RawSlices(file, start + max(0, byte_skip), shape, dtype)
    if encoding in ("gzip", "gz", "bzip2", "bz2"):

        def opened(files: ExitStack) -> IO[bytes]:
            stream = files.enter_context(file.open("rb"))
            stream.seek(start)
            return files.enter_context(unpacked(stream, encoding))

        return PackedSlices(file, opened, byte_skip, shape, dtype)
    raise ReadError(f"{file.name} is encoded as '{encoding}'; save it as raw or gzip")


def words_steps(values: NDArray[Any], stream: IO[bytes], name: str) -> Steps[None]:
    """Fill values from numbers in words.

    Parameters
    ----------
    values : (n,) array
        Is filled.
    stream : binary file
    name : str
        Of the file, for errors.

    Raises
    ------
    ReadError
        For too few, too many and other words.
    """
    done, unfinished_word, more = 0, b"", True
    while more:
        yield Step(min(1.0, done / len(values)), f"Reading {name}")
        piece = stream.read(WORDS_CHUNK)
        more = bool(piece)
        words = (unfinished_word + piece).split()
        # The next piece may go on with the last word.
        unfinished_word = words.pop() if words and more and not piece[-1:].isspace() else b""
        end = done + len(words)
        if end < len(values) and not more:
            raise ReadError(f"{name} is truncated: {end} of {len(values)} values are there; copy it again")
        if end > len(values):
            raise ReadError(f"{name} holds more than the {len(values)} values of its sizes; repair the header")
        odd = next((word for word in (*words, unfinished_word) if len(word) > LONGEST_WORD or b"_" in word), b"")
        if odd:  # NumPy makes room for the longest at each, and takes 1_0 for 10
            raise ReadError(f"{name} has '{odd[:20].decode('ascii', 'replace')}', not a number; export it again")
        numbers = np.array(words, dtype="S")
        try:
            values[done:end] = numbers.astype(values.dtype)
            exact = values.dtype.kind == "f" or (values[done:end] == numbers.astype(np.float64)).all()
        except (ValueError, OverflowError) as error:
            raise ReadError(f"{name} has a value that is not a number ({reason(error)}); export it again") from error
        if not exact:
            raise ReadError(f"{name} has values outside its type {values.dtype}; export it again")
        done = end
