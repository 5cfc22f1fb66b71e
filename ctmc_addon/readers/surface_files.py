# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces from STL and PLY files, as triangles over shared vertices; positions are taken as RAS+ mm.

STL: 3D Systems 1989, binary and ASCII. PLY: Turk 1994, ASCII and binary of both byte orders.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core import ReadError, Step, Steps, TriangleMesh
from ..core.files.input_files import add_inputs

SURFACE_SUFFIXES = (".stl", ".ply")
_STL_FACE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
FEWEST_ROWS = 64  # Looked at first after a polygon of another kind, twice as many each time that all are alike.
_STL_HEAD = 84  # Bytes before the facets of a binary STL.
_PLY_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4"},
    **{"double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"float32": "f4", "float64": "f8"},
}
Element = tuple[str, int, list[tuple[str, ...]]]


def read_surface_steps(path: Path) -> Steps[TriangleMesh]:
    """Read an STL or PLY.

    Parameters
    ----------
    path : Path

    Returns
    -------
    TriangleMesh
        Polygons become fans of triangles; corners of an STL at one position become one vertex.

    Raises
    ------
    ReadError
        If the file is missing, neither format, truncated or empty, or has positions that are not numbers.
    """
    yield Step(0.0, f"Reading {path.name}")
    add_inputs([path])
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ReadError(f"{path.name} cannot be read ({error.strerror}); check the path") from error
    try:
        vertices, faces = (_ply if content[:3] == b"ply" else _stl)(content)
    except (ValueError, IndexError, KeyError, OverflowError) as error:
        raise ReadError(f"{path.name} is damaged or not {path.suffix[1:].upper()}; write it again") from error
    yield Step(0.8, f"Reading {path.name}")
    if not len(faces):
        raise ReadError(f"{path.name} has no triangles; give a surface")
    if not np.isfinite(vertices).all():
        raise ReadError(f"{path.name} has positions that are not numbers; write it again")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise ReadError(f"{path.name} has faces of missing vertices; write it again")
    return TriangleMesh(np.ascontiguousarray(vertices, np.float32), np.ascontiguousarray(faces, np.int32))


def _stl(content: bytes) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """Return vertices and faces of an STL; raise `ValueError` if it is none."""
    count = int.from_bytes(content[80:_STL_HEAD], "little")
    if len(content) >= _STL_HEAD and len(content) == _STL_HEAD + count * _STL_FACE.itemsize:
        corners = np.frombuffer(content, _STL_FACE, count, _STL_HEAD)["corners"].reshape(-1, 3)
    else:
        if not content.lstrip()[:5].lower() == b"solid" or b"endsolid" not in content.lower():
            raise ValueError("neither binary nor ASCII")
        words = re.findall(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)", content, re.IGNORECASE)
        corners = np.array(words, dtype="S32").astype(np.float32).reshape(-1, 3)
        if len(corners) % 3:
            raise ValueError("a facet without three corners")
    corners = corners + np.float32(0)  # -0 is 0
    rows = np.ascontiguousarray(corners).view(np.dtype((np.void, 12))).ravel()
    _, first, numbers = np.unique(rows, return_index=True, return_inverse=True)
    return corners[first], numbers.reshape(-1, 3)


def _ply(content: bytes) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return vertices and faces of a PLY; raise `ValueError` or `KeyError` if it is none."""
    head, mark, body = content.partition(b"end_header")
    if not mark:
        raise ValueError("no end of the header")
    body = body[2:] if body[:2] == b"\r\n" else body[1:]
    lines = [line.split() for line in head.decode("ascii").splitlines()]
    form = next((line[1] for line in lines if line[:1] == ["format"]), "")
    elements: list[Element] = []
    for line in lines:
        if line[:1] == ["element"]:
            elements.append((line[1], int(line[2]), []))
        elif line[:1] == ["property"]:
            elements[-1][2].append(tuple(line[1:]))
    order = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}[form]
    at = 0
    numbers = np.array(body.split(), dtype="S32").astype(np.float64).tobytes() if form == "ascii" else body
    vertices, polygons = None, None
    for name, count, properties in elements:
        kinds = [_kinds(words, order) for words in properties]
        columns, at = _element(numbers, at, count, kinds)
        if name == "vertex":
            vertices = np.stack([columns[axis][0] for axis in "xyz"], axis=1)
        elif name == "face":
            polygons = columns["vertex_indices" if "vertex_indices" in columns else "vertex_index"]
    if vertices is None or polygons is None:
        raise ValueError("no vertices or faces")
    return vertices, _fans(polygons)


def _kinds(words: Sequence[str], order: str) -> tuple[str, str, str]:
    """Return the name of a property, the type of its count, empty for a single value, and the type of its items."""
    of_list = words[0] == "list"
    kinds = [f"{order}{_PLY_TYPES[word]}" if order else "<f8" for word in words[of_list:-1]]
    return words[-1], kinds[0] if of_list else "", kinds[-1]


def _element(
    content: bytes, at: int, count: int, kinds: Sequence[tuple[str, str, str]]
) -> tuple[dict[str, list[NDArray[Any]]], int]:
    """Return the values of an element from byte `at`, by the name of the property, and where it ends.

    Rows whose lists are as long as those of the row before are read at once: arrays (rows,), of lists (rows, items).
    """
    if count < 0 or (count and not kinds):
        raise ValueError("an element without rows or properties")
    columns: dict[str, list[NDArray[Any]]] = {name: [] for name, _, _ in kinds}
    look = FEWEST_ROWS
    while count:
        fields: list[Any] = []
        sizes: dict[str, int] = {}
        there = at
        for name, of_count, of_item in kinds:
            items = 1
            if of_count:
                items = sizes[name] = int(np.frombuffer(content, of_count, 1, there)[0])
                fields.append((f"{name} count", of_count))
                there += np.dtype(of_count).itemsize
            fields.append((name, of_item, (items,)) if of_count else (name, of_item))
            there += items * np.dtype(of_item).itemsize
        row = np.dtype(fields)
        rows = np.frombuffer(content, row, min(count, look, (len(content) - at) // row.itemsize), at)
        same = np.ones(len(rows), bool)
        for name, items in sizes.items():
            same &= rows[f"{name} count"] == items
        run = len(rows) if same.all() else int(same.argmin())
        if not run:
            raise ValueError("truncated")
        for name, of_count, _ in kinds:
            columns[name].append(rows[name][:run].astype(np.int64 if of_count else np.float64))
        look = 2 * look if run == len(rows) else FEWEST_ROWS
        at += run * row.itemsize
        count -= run
    whole = {name: [np.concatenate(columns[name] or [np.empty(0)])] for name, of_count, _ in kinds if not of_count}
    return columns | whole, at


def _fans(polygons: Sequence[NDArray[np.int64]]) -> NDArray[np.int64]:
    """Return triangles, (f, 3), of polygons: arrays (n, k) of those with k corners."""
    fans = [corners[:, [0, at, at + 1]] for corners in polygons for at in range(1, corners.shape[1] - 1)]
    return np.concatenate(fans or [np.empty((0, 3), np.int64)])
