# SPDX-License-Identifier: GPL-3.0-or-later
"""Read the surface of an STL or PLY, in mm, in whatever axes the file has.

An STL repeats the corners of every triangle: those at one position become one vertex. Polygons of a PLY are cut into
triangles around their first corner.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core import ReadError, Steps, TriangleMesh
from ..core.progress import PAUSE

SUFFIXES = (".stl", ".ply")
STL_HEAD = 84
STL_FACE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
NUMBER = rb"\s+([^\s]+)"
STL_VERTEX = re.compile(rb"\bvertex" + 3 * NUMBER, re.IGNORECASE)
PLY_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2"},
    **{"int32": "i4", "uint32": "u4", "float32": "f4", "float64": "f8"},
}
PLY_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
PLY_CORNERS = ("vertex_indices", "vertex_index")
ROWS_PER_STEP = 1 << 16
MOST_ROWS = 1 << 31  # Numbers of vertices are int32.


def read_surface_steps(path: str | Path) -> Steps[TriangleMesh]:
    """Read a surface.

    Parameters
    ----------
    path : path
        An STL or PLY, binary or ASCII.

    Raises
    ------
    ReadError
        If the file is missing, damaged or empty, or is not an STL or PLY.
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise ReadError(f"{path.name} is not an STL or PLY; give a file that ends in {' or '.join(SUFFIXES)}")
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        raise ReadError(f"{path} does not exist; check the path") from None
    except OSError as error:
        raise ReadError(f"{path} cannot be read ({error.strerror}); give another file") from None
    yield PAUSE
    read = _stl_steps if path.suffix.lower() == ".stl" else _ply_steps
    vertices, faces = yield from read(path.name, content)
    if not len(faces):
        raise ReadError(f"{path.name} has no triangles; export it as a surface")
    if not np.isfinite(vertices).all():
        count = int((~np.isfinite(vertices).all(axis=1)).sum())
        raise ReadError(f"{path.name} has {count} vertices that are not finite numbers; repair it and export it again")
    return TriangleMesh(vertices, faces)


def _stl_steps(name: str, content: bytes) -> Steps[tuple[NDArray[np.float32], NDArray[np.int32]]]:
    count = int.from_bytes(content[80:STL_HEAD], "little") if len(content) >= STL_HEAD else 0
    needed = STL_HEAD + count * STL_FACE.itemsize
    text = content.lstrip()[:5].lower() == b"solid"
    if len(content) != needed and text and b"\0" not in content[:1000]:
        if b"endsolid" not in content[-1000:].lower():
            raise ReadError(f"{name} ends before its line endsolid; export it again")
        found = STL_VERTEX.findall(content)
        yield PAUSE
        corners = _numbers(name, [number for row in found for number in row], np.dtype(np.float32)).reshape(-1, 3)
        if len(corners) % 3:
            raise ReadError(f"{name} has {len(corners)} corners, which are not 3 for each triangle; export it again")
    elif len(content) < needed or len(content) < STL_HEAD:
        whole = max(0, len(content) - STL_HEAD) // STL_FACE.itemsize
        raise ReadError(f"{name} ends after {whole:,} of {count:,} triangles; export or copy it again")
    else:
        corners = np.frombuffer(content, STL_FACE, count, STL_HEAD)["corners"].reshape(-1, 3)
    vertices, numbers = yield from _merged_steps(np.ascontiguousarray(corners, np.float32))
    faces = numbers.reshape(-1, 3)
    apart = (faces != faces[:, (1, 2, 0)]).all(axis=1)  # Triangles whose corners have come together are gone.
    return vertices, np.ascontiguousarray(faces[apart])


def _merged_steps(corners: NDArray[np.float32]) -> Steps[tuple[NDArray[np.float32], NDArray[np.int32]]]:
    """Return each position once, in the order in which they come, and the number of every corner's."""
    corners = corners + np.float32(0)  # -0 is 0.
    order = np.arange(len(corners))
    for axis in range(3):
        yield PAUSE
        order = order[np.argsort(corners[order, axis], kind="stable")]
    yield PAUSE
    ordered = corners[order]
    new = np.concatenate([[True], (ordered[1:] != ordered[:-1]).any(axis=1)])[: len(corners)]
    group = np.cumsum(new) - 1
    first = order[new]  # The sorts are stable: the first of equal corners.
    turn = np.argsort(first, kind="stable")
    number = np.empty(len(first), np.int32)
    number[turn] = np.arange(len(first), dtype=np.int32)
    yield PAUSE
    numbers = np.empty(len(corners), np.int32)
    numbers[order] = number[group]
    return corners[first[turn]], numbers


@dataclass(frozen=True)
class _Element:
    """An element of a PLY: its name, rows and properties, each with the type of a list's length or ''."""

    name: str
    count: int
    properties: tuple[tuple[str, str, str], ...]

    @property
    def plain(self) -> bool:
        return not any(length for _, _, length in self.properties)


def _ply_steps(name: str, content: bytes) -> Steps[tuple[NDArray[np.float32], NDArray[np.int32]]]:
    order, elements, start = _ply_head(name, content)
    body: _TextBody | _BinaryBody = (
        _BinaryBody(name, content, start, order) if order else _TextBody(name, content, start)
    )
    vertices, faces = None, np.empty((0, 3), np.int64)
    for element in elements:
        yield PAUSE
        if element.name == "vertex":
            if not element.plain:
                raise ReadError(f"{name} has lists of numbers at its vertices, which no program shows; export it again")
            columns = {each: column for column, (each, _, _) in enumerate(element.properties)}
            if not {"x", "y", "z"} <= columns.keys():
                raise ReadError(f"{name} has no x, y and z at its vertices; export it again")
            vertices = body.plain_rows(element, [columns[axis] for axis in "xyz"])
        elif element.plain:
            body.plain_rows(element, [])
        else:
            at = next(
                (i for i, (each, _, length) in enumerate(element.properties) if length and each in PLY_CORNERS), -1
            )
            polygons = yield from body.list_rows_steps(element, at)
            if element.name == "face" and at >= 0:
                faces = _fans(*polygons)
    if vertices is None:
        raise ReadError(f"{name} has no vertices; export it as a surface")
    if len(faces) and not (0 <= int(faces.min()) and int(faces.max()) < len(vertices)):
        outside = int(faces.min()) if int(faces.min()) < 0 else int(faces.max())
        raise ReadError(f"{name} names vertex {outside}, and it has {len(vertices):,}; export it again")
    return vertices, faces.astype(np.int32)


def _ply_head(name: str, content: bytes) -> tuple[str, list[_Element], int]:
    """Return the byte order ('' for text), the elements, and where the values start."""
    end = re.search(rb"(^|[\r\n])end_header[ \t]*(\r\n|\n|\r)", content[: 1 << 20])
    if not content.startswith(b"ply") or end is None:
        raise ReadError(f"{name} is not a PLY, which begins with ply and has a line end_header; export it again")
    order, elements = None, []
    for line in content[: end.start()].decode("latin-1").splitlines():
        words = line.split()
        try:
            if words[:1] == ["format"]:
                order = PLY_ORDERS[words[1]]
            elif words[:1] == ["element"]:
                count = int(words[2])
                if not 0 <= count < MOST_ROWS:
                    raise ValueError
                elements.append(_Element(words[1], count, ()))
            elif words[:1] == ["property"]:
                kind, length = (
                    (PLY_TYPES[words[3]], PLY_TYPES[words[2]]) if words[1] == "list" else (PLY_TYPES[words[1]], "")
                )
                last = elements[-1]
                elements[-1] = _Element(last.name, last.count, (*last.properties, (words[-1], kind, length)))
        except (KeyError, IndexError, ValueError):
            raise ReadError(
                f"{name} has a header line that no PLY has, {line.strip()[:60]!r}; export it again"
            ) from None
    if order is None:
        raise ReadError(f"{name} does not say its format in the header; export it again")
    return order, elements, end.end()


class _BinaryBody:
    """The values of a binary PLY, read from the first to the last."""

    def __init__(self, name: str, content: bytes, start: int, order: str) -> None:
        self._name, self._content, self._at, self._order = name, content, start, order

    def plain_rows(self, element: _Element, columns: list[int]) -> NDArray[np.float32]:
        """Read rows without lists; return some columns, (rows, columns)."""
        rows = self._take(element, self._row_type(element, ()), element.count)
        return np.stack([rows[f"p{column}"].astype(np.float32) for column in columns], axis=1) if columns else _NONE

    def list_rows_steps(self, element: _Element, corners: int) -> Steps[tuple[NDArray[np.int64], NDArray[np.int64]]]:
        """Read rows with lists; return the length of the list `corners` in every row, and all its numbers."""
        lengths, numbers, done = [], [], 0
        while done < element.count:
            # Rows whose lists are as long as those of this one are read at once; most files have no others.
            row_type = self._row_type(element, self._lengths_here(element))
            room = (len(self._content) - self._at) // row_type.itemsize
            count = min(element.count - done, max(1, room), ROWS_PER_STEP)
            rows = self._take(element, row_type, count, move=False)
            alike = np.ones(count, bool)
            for at, (_, _, length) in enumerate(element.properties):
                if length:
                    alike &= rows[f"n{at}"] == rows[f"n{at}"][0]
            same = count if alike.all() else int(np.argmin(alike))
            self._at += same * row_type.itemsize
            done += same
            if corners >= 0:
                own = rows[f"p{corners}"][:same].astype(np.int64).reshape(same, -1)
                lengths.append(np.full(same, own.shape[1]))
                numbers.append(own.ravel())
            yield PAUSE
        return _joined(lengths), _joined(numbers)

    def _lengths_here(self, element: _Element) -> tuple[int, ...]:
        """Return the lengths of the lists in the next row."""
        at, lengths = self._at, []
        for _, kind, length in element.properties:
            many = 1
            if length:
                size = np.dtype(length).itemsize
                if at + size > len(self._content):
                    raise self._ends(element)
                many = int(np.frombuffer(self._content, self._order + length, 1, at)[0])
                at += size
                if many < 0 or at + many * np.dtype(kind).itemsize > len(self._content):
                    raise self._ends(element)
                lengths.append(many)
            at += many * np.dtype(kind).itemsize
        return tuple(lengths)

    def _row_type(self, element: _Element, lengths: tuple[int, ...]) -> np.dtype[Any]:
        fields: list[Any] = []
        left = iter(lengths)
        for at, (_, kind, length) in enumerate(element.properties):
            if length:
                fields += [(f"n{at}", self._order + length), (f"p{at}", self._order + kind, (next(left),))]
            else:
                fields.append((f"p{at}", self._order + kind))
        return np.dtype(fields)

    def _take(self, element: _Element, row_type: np.dtype[Any], count: int, move: bool = True) -> NDArray[Any]:
        if self._at + count * row_type.itemsize > len(self._content):
            raise self._ends(element)
        rows = np.frombuffer(self._content, row_type, count, self._at)
        self._at += count * row_type.itemsize * move
        return rows

    def _ends(self, element: _Element) -> ReadError:
        return _ends(self._name, element)


class _TextBody:
    """The values of an ASCII PLY, read from the first to the last."""

    def __init__(self, name: str, content: bytes, start: int) -> None:
        self._name, self._words, self._at = name, content[start:].split(), 0

    def plain_rows(self, element: _Element, columns: list[int]) -> NDArray[np.float32]:
        """Read rows without lists; return some columns, (rows, columns)."""
        width = len(element.properties)
        words = self._take(element, element.count * width)
        if not columns:
            return _NONE
        return np.stack([_numbers(self._name, words[at::width], np.dtype(np.float32)) for at in columns], axis=1)

    def list_rows_steps(self, element: _Element, corners: int) -> Steps[tuple[NDArray[np.int64], NDArray[np.int64]]]:
        """Read rows with lists; return the length of the list `corners` in every row, and all its numbers."""
        lengths: list[int] = []
        words: list[bytes] = []
        for row in range(element.count):
            for at, (_, _, length) in enumerate(element.properties):
                many = 1
                if length:
                    many = int(_numbers(self._name, self._take(element, 1), np.dtype(np.int64))[0])
                values = self._take(element, many)
                if at == corners:
                    lengths.append(many)
                    words += values
            if row % ROWS_PER_STEP == 0:
                yield PAUSE
        return np.array(lengths, np.int64), _numbers(self._name, words, np.dtype(np.int64))

    def _take(self, element: _Element, count: int) -> list[bytes]:
        if count < 0 or self._at + count > len(self._words):
            raise _ends(self._name, element)
        self._at += count
        return self._words[self._at - count : self._at]


_NONE = np.empty((0, 0), np.float32)


def _ends(name: str, element: _Element) -> ReadError:
    return ReadError(f"{name} ends before its {element.count:,} rows of {element.name} do; export or copy it again")


def _numbers(name: str, words: list[bytes], kind: np.dtype[Any]) -> NDArray[Any]:
    try:
        return np.array(words, "S").astype(kind) if words else np.empty(0, kind)
    except (ValueError, OverflowError):
        raise ReadError(f"{name} has a word where a number must be; export it again") from None


def _joined(parts: list[NDArray[np.int64]]) -> NDArray[np.int64]:
    return np.concatenate(parts) if parts else np.empty(0, np.int64)


def _fans(lengths: NDArray[np.int64], numbers: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the triangles of polygons, (F, 3), each around its first corner."""
    starts = np.cumsum(lengths) - lengths
    counts = np.maximum(lengths - 2, 0)
    first = np.repeat(starts, counts)
    turn = np.arange(int(counts.sum())) - np.repeat(np.cumsum(counts) - counts, counts)
    return numbers[np.stack([first, first + turn + 1, first + turn + 2], axis=1)]
