# SPDX-License-Identifier: GPL-3.0-or-later
"""Pack a mesh into few bytes for a page: positions of 16 bits over the box of the mesh, and small numbers.

Triangles are sorted by block, so that neighbors are written soon after each other. Vertices are sorted by their first
use in a triangle. A corner is then written as the number of vertices used so far less its own number: 0 for a new
vertex, small for one that was used lately (Chun, WebGL Models: End-to-End, in OpenGL
Insights, 2012). Positions are differences from vertex to vertex. Both are stored as planes of
bytes, so that Deflate finds long runs of zeros. Values of a map are packed like one axis, in the order of the vertices.
`viewer.js` reads both.
"""

from __future__ import annotations

import zlib
from typing import NamedTuple

import numpy as np

from ...arrays import Floats, Indices, Ints

LEVELS = 65535  # A position has this many levels along an axis.
EDGE_SHARE = 256  # A step is at least a usual edge divided by this.
# A block is this many usual edges long: 2.1 bytes of a triangle, where the order of extraction takes 2.8.
BLOCK_EDGES = 6
LEVEL = 9  # The level of Deflate.


class Packed(NamedTuple):
    """A mesh in few bytes.

    Parameters
    ----------
    vertices, faces : int
    low, step : 3 float
        A position is ``low + step * level``, mm.
    planes : int
        Bytes of a corner.
    content : bytes
        A zlib stream of: low bytes and high bytes of x, y and z of all vertices, then every plane of the corners.
    order : (vertices,) int
        Number in the mesh of each vertex.
    """

    vertices: int
    faces: int
    low: tuple[float, ...]
    step: tuple[float, ...]
    planes: int
    content: bytes
    order: Indices


class PackedValues(NamedTuple):
    """Values of a map in few bytes.

    Parameters
    ----------
    low, step : float
        A value is ``low + step * level``; level `LEVELS` is no value.
    content : bytes
        A zlib stream of low bytes and high bytes.
    """

    low: float
    step: float
    content: bytes


def packed(vertices: Floats, faces: Ints) -> Packed:
    """Return a mesh in few bytes; a vertex moves by at most half a step, and one without triangles is left out.

    Parameters
    ----------
    vertices : (V, 3) float32
    faces : (F, 3) int32
    """
    edge = _usual_edge(vertices, faces)
    corners = _block_by_block(vertices, faces, edge).ravel()
    used, first = np.unique(corners, return_index=True)
    order = used[np.argsort(first, kind="stable")]  # vertices by the first corner that names them
    rank = np.empty(len(vertices), np.int32)
    rank[order] = np.arange(len(order), dtype=np.int32)
    corners = rank[corners]
    named = np.empty_like(corners)  # how many were named before
    named[0] = 0
    np.maximum.accumulate(corners[:-1] + 1, out=named[1:])
    codes = named - corners
    planes = 1 + int(codes.max() >= 1 << 8) + int(codes.max() >= 1 << 16) + int(codes.max() >= 1 << 24)
    points = vertices[order].astype(np.float64)  # (v, 3)
    low = points.min(axis=0)
    step = np.maximum((points.max(axis=0) - low) / LEVELS, edge / EDGE_SHARE)
    levels = np.rint((points - low) / step).astype(np.int32)
    content = b"".join(_planes(_changes(levels).T, 2) + _planes(codes, planes))
    return Packed(
        len(order), len(faces), tuple(low.tolist()), tuple(step.tolist()), planes, zlib.compress(content, LEVEL), order
    )


def packed_values(values: Floats) -> PackedValues:
    """Return values of a map in few bytes; a value moves by at most half a step, 1/65,534 of their range.

    Parameters
    ----------
    values : (v,) float32
        In the order of the packed vertices; a value that is not finite becomes none.

    Examples
    --------
    >>> packed_values(np.array([2, np.nan, 6], np.float32))[:2]
    (2.0, 6.103701895199438e-05)
    """
    finite = np.isfinite(values)
    numbers = values[finite].astype(np.float64)
    low, high = (float(numbers.min()), float(numbers.max())) if len(numbers) else (0.0, 0.0)
    step = (high - low) / (LEVELS - 1) or 1.0
    levels = np.full(len(values), LEVELS, np.int32)
    levels[finite] = np.rint((numbers - low) / step)
    return PackedValues(low, step, zlib.compress(b"".join(_planes(_changes(levels), 2)), LEVEL))


def _changes(levels: Ints) -> Ints:
    """Changes of levels from row to row: 0, -1, 1, -2 as 0, 1, 2, 3, modulo 65,536."""
    change = np.diff(levels, axis=0, prepend=0)
    change = (change + (1 << 15)) % (1 << 16) - (1 << 15)
    return np.where(change < 0, -2 * change - 1, 2 * change)


def _planes(codes: Ints, count: int) -> list[bytes]:
    """Return the lowest bytes of all codes, then the next, `count` in all."""
    return [(codes >> (8 * place) & 255).astype(np.uint8).tobytes() for place in range(count)]


def _usual_edge(vertices: Floats, faces: Ints) -> float:
    """Return the median length of the triangles' first edges; 1 where it is 0."""
    edges = vertices[faces[:, 1]].astype(np.float64) - vertices[faces[:, 0]]
    squares = edges[:, 0] ** 2 + edges[:, 1] ** 2 + edges[:, 2] ** 2
    return float(np.sqrt(np.median(squares))) or 1.0


def _block_by_block(vertices: Floats, faces: Ints, edge: float) -> Ints:
    """Return the triangles (F, 3) sorted by block, then by their lowest vertex, which becomes their first."""
    lowest = faces.argmin(axis=1)
    turned = np.take_along_axis(faces, (lowest[:, None] + np.arange(3)) % 3, axis=1)
    first = vertices[turned[:, 0]].astype(np.float64)
    x, y, z = ((first - first.min(axis=0)) / (BLOCK_EDGES * edge)).astype(np.int32).T
    return turned[np.lexsort((turned[:, 2], turned[:, 1], turned[:, 0], x, y, z))]
