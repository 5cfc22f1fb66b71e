# SPDX-License-Identifier: GPL-3.0-or-later
"""How the zero planes of several linear fields cut each other in one tetrahedron.

A field is linear in a tetrahedron, so its zero set is a plane, and the other fields cut that plane into convex pieces
with straight rims. Signs decide which pieces exist: those of the fields at the corners, of the order of two zeros on
an edge, of a third field where two are 0 on a face, and of a fourth where three are 0 inside. The two tetrahedra at a
face use the same signs, so their pieces fit without a gap.

A node of a piece is named by its corners and its fields:

    on an edge     two corners, one field is 0
    on a face      three corners, two fields are 0
    inside         four corners, three fields are 0
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ...arrays import Doubles, Flags

CORNERS = range(4)
EDGES = tuple(combinations(CORNERS, 2))
TRIANGLES = tuple(combinations(CORNERS, 3))
Node = tuple[tuple[int, ...], tuple[int, ...]]  # Corners and fields, both rising.
Side = tuple[int, ...]  # The corners of the face that a piece's side lies in, or (-1, field) if that field cuts it.


@dataclass(frozen=True)
class Piece:
    """A convex piece of a field's zero plane.

    Parameters
    ----------
    field : int
        Number among the fields of the pattern.
    nodes : tuple of Node
        Counter-clockwise seen from where the field is below 0, in a right-handed tetrahedron.
    above : tuple of bool
        Whether each field is above 0 on the piece; False for its own field.
    """

    field: int
    nodes: tuple[Node, ...]
    above: tuple[bool, ...]


def signs_of(values: Doubles) -> NDArray[np.uint8]:
    """Return the signs that decide a pattern, (n, bits), of fields at the corners, (n, fields, 4), none of them 0."""
    fields = values.shape[1]
    bits: list[Flags] = [values[:, field, corner] > 0 for field in range(fields) for corner in CORNERS]
    for i, j in combinations(range(fields), 2):
        for a, b in EDGES:
            between = values[:, i, a] * values[:, j, b] - values[:, j, a] * values[:, i, b]
            same = (values[:, i, a] > 0) == (values[:, j, a] > 0)
            bits.append(np.where(same, between >= 0, between <= 0))  # Field i is 0 nearer to a than field j is.
    for count, corner_sets in ((2, TRIANGLES), (3, (tuple(CORNERS),))):
        for group in combinations(range(fields), count):
            for corners in corner_sets:
                place = zero_of(values[:, group][:, :, corners])
                for further in range(fields):
                    if further not in group:
                        at = np.zeros(len(values))
                        for number, corner in enumerate(corners):
                            at += values[:, further, corner] * place[:, number]
                        bits.append(at > 0)
    return np.stack(bits, axis=1).astype(np.uint8)


def zero_of(values: Doubles) -> Doubles:
    """Return the weights of corners, (n, k + 1), adding up to 1, where k linear fields, (n, k, k + 1), are all 0."""
    fields, corners = values.shape[1:]
    weights = np.stack(
        [
            _determinant([[values[:, f, c] for c in range(corners) if c != left] for f in range(fields)])
            * (1.0 if left % 2 == 0 else -1.0)
            for left in range(corners)
        ],
        axis=1,
    )
    total = weights[:, 0].copy()
    for corner in range(1, corners):
        total += weights[:, corner]
    return weights / np.where(total == 0, 1.0, total)[:, None]


def _determinant(rows: list[list[Doubles]]) -> Doubles:
    if len(rows) == 1:
        return rows[0][0]
    if len(rows) == 2:
        (a, b), (c, d) = rows
        return a * d - b * c
    out = np.zeros(len(rows[0][0]))
    for column, value in enumerate(rows[0]):
        rest = _determinant([[v for c, v in enumerate(row) if c != column] for row in rows[1:]])
        out += value * rest if column % 2 == 0 else -(value * rest)
    return out


class _Signs:
    """Look up the signs of a pattern by node and field."""

    def __init__(self, bits: bytes, fields: int) -> None:
        source = iter(bits)
        self.fields = fields
        self.at_corner = [[bool(next(source)) for _ in CORNERS] for _ in range(fields)]
        self._first: dict[tuple[int, int, tuple[int, ...]], bool] = {}
        for i, j in combinations(range(fields), 2):
            for edge in EDGES:
                self._first[i, j, edge] = bool(next(source))
        self._at_zero: dict[tuple[Node, int], bool] = {}
        for count, corner_sets in ((2, TRIANGLES), (3, (tuple(CORNERS),))):
            for group in combinations(range(fields), count):
                for corners in corner_sets:
                    for further in range(fields):
                        if further not in group:
                            self._at_zero[(corners, group), further] = bool(next(source))

    def at(self, node: Node, further: int) -> bool:
        """Return whether a field is above 0 at a node of other fields."""
        corners, group = node
        if len(group) > 3:
            return False
        if len(group) > 1:
            return self._at_zero[node, further]
        low, high = self.at_corner[further][corners[0]], self.at_corner[further][corners[1]]
        if low == high:
            return low
        field = group[0]
        is_first = self._first[field, further, corners] if field < further else not self._first[further, field, corners]
        return low if is_first else high


@cache
def pieces_of(bits: bytes, fields: int) -> tuple[Piece, ...]:
    """Return the pieces of all planes of a pattern."""
    signs = _Signs(bits, fields)
    return tuple(piece for field in range(fields) for piece in _pieces_of_plane(signs, field))


def _pieces_of_plane(signs: _Signs, field: int) -> list[Piece]:
    """Return the pieces into which the other fields cut a field's plane."""
    whole = _polygon(signs.at_corner[field], field)
    parts: list[tuple[list[Node], list[Side], list[bool]]] = [(*whole, [False] * signs.fields)] if whole else []
    for cutter in range(signs.fields):
        if cutter == field:
            continue
        cut = []
        for nodes, sides, above in parts:
            inside = [signs.at(node, cutter) for node in nodes]
            for keep in (True, False):
                own = _clipped(nodes, sides, inside, keep, field, cutter)
                if own is not None:
                    cut.append((*own, [keep if number == cutter else each for number, each in enumerate(above)]))
        parts = cut
    return [Piece(field, tuple(nodes), tuple(above)) for nodes, _, above in parts]


def _polygon(above: list[bool], field: int) -> tuple[list[Node], list[Side]] | None:
    """Return the nodes around a field's whole plane, and for each the face that the side to the next node lies in."""
    inside = [corner for corner in CORNERS if above[corner]]
    outside = [corner for corner in CORNERS if not above[corner]]
    if not inside or not outside:
        return None
    if len(inside) == 2:
        (a, b), (c, d) = inside, outside
        edges = [(a, c), (a, d), (b, d), (b, c)]
    elif len(inside) == 1:
        edges = [(inside[0], corner) for corner in outside]
    else:
        edges = [(corner, outside[0]) for corner in inside]
    if _is_turned(edges, inside):
        edges.reverse()
    corners = [tuple(sorted(edge)) for edge in edges]
    sides: list[Side] = [
        tuple(sorted({*edge, *following})) for edge, following in zip(corners, [*corners[1:], corners[0]], strict=True)
    ]
    return [(edge, (field,)) for edge in corners], sides


def _is_turned(edges: list[tuple[int, int]], inside: list[int]) -> bool:
    """Return whether a polygon through the middles of edges is clockwise, seen from where the field is below 0."""
    place = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [1, 1, 1]], float)  # A right-handed tetrahedron.
    a, b, c = (place[list(edge)].mean(axis=0) for edge in edges[:3])
    u, v = b - a, c - a
    normal = np.array([u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]])
    return bool(((a - place[inside[0]]) * normal).sum() < 0)


def _clipped(
    nodes: list[Node], sides: list[Side], inside: list[bool], keep: bool, field: int, cutter: int
) -> tuple[list[Node], list[Side]] | None:
    """Return the part of a convex piece on one side of another field's plane."""
    if all(each != keep for each in inside):
        return None
    out: list[Node] = []
    out_sides: list[Side] = []
    for at, (node, side) in enumerate(zip(nodes, sides, strict=True)):
        following = inside[(at + 1) % len(nodes)]
        if inside[at] == keep:
            out.append(node)
            out_sides.append(side)
        if inside[at] != following:
            of_side = side if side[0] >= 0 else tuple(CORNERS)
            cutters = {field, cutter} if side[0] >= 0 else {field, cutter, side[1]}
            out.append((of_side, tuple(sorted(cutters))))
            out_sides.append((-1, cutter) if inside[at] == keep else side)
    return out, out_sides
