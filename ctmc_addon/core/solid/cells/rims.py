# SPDX-License-Identifier: GPL-3.0-or-later
"""Cut cells into tetrahedra, and the surfaces of several fields in each tetrahedron into pieces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import Doubles, Flags, Floats
from ...extraction.case_table import NEAREST
from ...progress import PAUSE, Step, Steps
from ..fields.lattice_fields import LatticeField
from .arrangement import Node, pieces_of, signs_of, zero_of

TETRAHEDRA = np.array([[0, 1 << a, 1 << a | 1 << b, 7] for a, b, _ in permutations(range(3))], np.intp)
"""(6, 4) corners of a cell; the bits of a corner are its positions along x, y and z (Kuhn 1960)."""
TURNED = np.array([order not in ((0, 1, 2), (1, 2, 0), (2, 0, 1)) for order in permutations(range(3))])
AXES_OF_FACE = np.array([(-1, -1)] * 3 + [(0, 1), (-1, -1), (0, 2), (1, 2), (-1, -1)])
"""The two axes of a face, by the code of its diagonal; -1 if the code is not that of a diagonal."""
CODE_BITS, FIELD_BITS = 3, 5
FIELDS_OF_NODE, CORNERS_OF_NODE = 3, 4
APART = 2.0**-12  # Two vertices on one edge are at least this share of it apart.
INSIDE = 2.0**-14  # A point inside a face or tetrahedron gives each corner at least this weight.


@dataclass(frozen=True, eq=False)
class RimNodes:
    """Vertices of pieces, named by the lattice samples around them.

    Parameters
    ----------
    keys : (n,) int64
        Rising: the lowest sample, the offsets from it to the other samples, and the fields that are 0.
    """

    keys: NDArray[np.int64]

    @property
    def fields(self) -> NDArray[np.intp]:
        """Numbers of the fields that are 0, (n, 3), -1 for none."""
        shifts = FIELD_BITS * np.arange(FIELDS_OF_NODE)
        return np.asarray((self.keys[:, None] >> shifts & (1 << FIELD_BITS) - 1) - 1, np.intp)

    @property
    def codes(self) -> NDArray[np.intp]:
        """Offsets from the lowest sample to the other samples, (n, 3): bits along x, y and z; 0 for none."""
        shifts = FIELD_BITS * FIELDS_OF_NODE + CODE_BITS * np.arange(CORNERS_OF_NODE - 1)
        return np.asarray(self.keys[:, None] >> shifts & (1 << CODE_BITS) - 1, np.intp)

    @property
    def lowest(self) -> NDArray[np.intp]:
        """Flat numbers of the lowest samples, (n,)."""
        return np.asarray(self.keys >> FIELD_BITS * FIELDS_OF_NODE + CODE_BITS * (CORNERS_OF_NODE - 1), np.intp)


@dataclass(frozen=True, eq=False)
class CutRims:
    """The triangles of cells that several fields cut.

    Parameters
    ----------
    nodes : RimNodes
    weights : (n, 4) float64
        Weights of the samples around every node, the lowest first.
    faces : (f, 3) intp
        Numbers of nodes, counter-clockwise in index space.
    sides : (f, 2) unsigned
        Parts behind and in front of each triangle; the part behind has the larger number.
    """

    nodes: RimNodes
    weights: Doubles
    faces: NDArray[np.intp]
    sides: NDArray[Any]


def cut_rims_steps(
    fields: Sequence[LatticeField],
    table: NDArray[Any],
    words: NDArray[Any],
    cells: NDArray[np.intp],
    corners: NDArray[np.intp],
    threads: int,
) -> Steps[CutRims]:
    """Return the triangles in cells, given by their lowest samples (n,); `corners` (8,) are the offsets of a cell."""
    samples = np.unique((cells[:, None] + corners).reshape(-1))
    yield PAUSE
    cell, tetrahedron = np.repeat(cells, len(TETRAHEDRA)), np.tile(np.arange(len(TETRAHEDRA)), len(cells))
    at_corners = words.take(cell[:, None] + corners[TETRAHEDRA][tetrahedron]).astype(np.intp)
    base, any_set = at_corners[:, 0], at_corners[:, 0]
    for corner in range(1, 4):
        base, any_set = base & at_corners[:, corner], any_set | at_corners[:, corner]
    active = any_set & ~base
    keep = _with_walls(table, active, base)
    cell, tetrahedron, active, base = (each[keep] for each in (cell, tetrahedron, active, base))
    yield PAUSE
    used = int(np.bitwise_or.reduce(active)) if len(active) else 0
    numbers = [number for number in range(len(fields)) if used >> number & 1]
    values: dict[int, Floats] = {}
    for number in numbers:
        values[number] = yield from fields[number].values_steps(samples, threads)
    keys: list[NDArray[np.int64]] = []
    sides: list[NDArray[Any]] = []
    masks = np.unique(active).tolist()
    for at, mask in enumerate(masks):
        yield Step(at / len(masks))
        own = np.flatnonzero(active == mask)
        several = [number for number in numbers if mask >> number & 1]
        rank = np.searchsorted(samples, cell[own, None] + corners[TETRAHEDRA][tetrahedron[own]])
        of_fields = np.stack([values[number][rank] for number in several], axis=1).astype(np.float64)
        bits = signs_of(of_fields)
        rows, pattern = np.unique(bits, axis=0, return_inverse=True)
        order = np.argsort(pattern.reshape(-1), kind="stable")
        firsts = np.searchsorted(pattern.reshape(-1)[order], np.arange(len(rows) + 1))
        for number, row in enumerate(rows):
            members = own[order[firsts[number] : firsts[number + 1]]]
            for piece in pieces_of(row.tobytes(), len(several)):
                word = base[members]
                for field, above in zip(several, piece.above, strict=True):
                    word = word | (int(above) << field)
                behind, front = table.take(word | 1 << several[piece.field]), table.take(word)
                walls = np.flatnonzero(behind != front)
                if not len(walls):
                    continue
                which = members[walls]
                corner_of = TETRAHEDRA[tetrahedron[which]]
                loop = np.stack([_keys(node, several, cell[which], corner_of, corners) for node in piece.nodes], axis=1)
                fan = [(0, second, second + 1) for second in range(1, len(piece.nodes) - 1)]
                both = np.stack([behind[walls], front[walls]], axis=1)
                turned = TURNED[tetrahedron[which]] ^ (both[:, 0] < both[:, 1])
                both.sort(axis=1)
                for first, second, third in fan:
                    triangle = loop[:, [first, second, third]]
                    triangle[turned] = triangle[turned][:, ::-1]
                    keys.append(triangle)
                    sides.append(both[:, ::-1])
            yield PAUSE
    if not keys:
        nothing = np.empty((0, 3), np.int64)
        return CutRims(RimNodes(nothing[:, 0]), np.empty((0, 4)), nothing, np.empty((0, 2), table.dtype))
    unique, faces = np.unique(np.concatenate(keys).reshape(-1), return_inverse=True)
    yield PAUSE
    nodes = RimNodes(unique)
    return CutRims(nodes, _weights(nodes, samples, values, corners), faces.reshape(-1, 3), np.concatenate(sides))


def _with_walls(table: NDArray[Any], active: NDArray[np.intp], base: NDArray[np.intp]) -> Flags:
    """Return whether parts may differ in a tetrahedron, by its fields that change sign and those that do not."""
    both = np.stack([active, base], axis=1)
    unique, group = np.unique(both, axis=0, return_inverse=True)
    differs = []
    for mask, word in unique.tolist():
        words = [word]
        for bit in range(mask.bit_length()):
            if mask >> bit & 1:
                words += [each | 1 << bit for each in words]
        differs.append(len(set(table[words].tolist())) > 1)
    return np.array(differs, bool)[group.reshape(-1)]


def _keys(
    node: Node, fields: Sequence[int], cell: NDArray[np.intp], corner_of: NDArray[np.intp], corners: NDArray[np.intp]
) -> NDArray[np.int64]:
    """Return the keys of one node in several tetrahedra, (n,)."""
    of_corners, of_fields = node
    lowest = corner_of[:, of_corners[0]]
    key = (cell + corners[lowest]).astype(np.int64)
    for at in reversed(range(1, CORNERS_OF_NODE)):
        code = corner_of[:, of_corners[at]] ^ lowest if at < len(of_corners) else 0
        key = key << CODE_BITS | code
    for at in reversed(range(FIELDS_OF_NODE)):
        key = key << FIELD_BITS | (fields[of_fields[at]] + 1 if at < len(of_fields) else 0)
    return key


def _weights(
    nodes: RimNodes, samples: NDArray[np.intp], values: dict[int, Floats], corners: NDArray[np.intp]
) -> Doubles:
    """Return the weights of the samples around every node, (n, 4)."""
    fields, codes, lowest = nodes.fields, nodes.codes, nodes.lowest
    at_zero = np.count_nonzero(fields >= 0, axis=1)
    ranks = np.searchsorted(
        samples, lowest[:, None] + np.concatenate([np.zeros((len(lowest), 1), np.intp), corners[codes]], axis=1)
    )
    weights = np.zeros((len(lowest), CORNERS_OF_NODE))
    for count in (1, 2, 3):
        own = np.flatnonzero(at_zero == count)
        if not len(own):
            continue
        of_fields = np.empty((len(own), count, count + 1))
        for place in range(count):
            for field in np.unique(fields[own, place]).tolist():
                which = np.flatnonzero(fields[own, place] == field)
                of_fields[which, place] = values[field][ranks[own[which], : count + 1]]
        weights_at_zero = zero_of(of_fields)
        least = NEAREST if count == 1 else INSIDE
        weights_at_zero = np.clip(weights_at_zero, least, None)
        total = weights_at_zero[:, 0].copy()
        for corner in range(1, count + 1):
            total += weights_at_zero[:, corner]
        weights[own, : count + 1] = weights_at_zero / total[:, None]
    _part_crowded(nodes, weights, at_zero)
    return weights


def _part_crowded(nodes: RimNodes, weights: Doubles, at_zero: NDArray[np.intp]) -> None:
    """Move vertices on one edge apart, in place."""
    own = np.flatnonzero(at_zero == 1)
    edge = nodes.keys[own] >> FIELD_BITS * FIELDS_OF_NODE
    crowded = np.flatnonzero(np.diff(edge, prepend=-1, append=-1)[:-1] == 0)
    if not len(crowded):
        return
    several = own[np.isin(edge, edge[crowded])]
    edge, share = nodes.keys[several] >> FIELD_BITS * FIELDS_OF_NODE, weights[several, 1]
    order = np.lexsort((share, edge))
    several, edge, share = several[order], edge[order], share[order]
    for _ in range(2):
        same = np.flatnonzero(edge[1:] == edge[:-1])
        short = APART - (share[same + 1] - share[same])
        close = same[short > 0]
        move = short[short > 0] / 2
        np.subtract.at(share, close, move)
        np.add.at(share, close + 1, move)
    share = np.clip(share, NEAREST / 2, 1 - NEAREST / 2)
    weights[several, 1], weights[several, 0] = share, 1 - share


def straighten(
    places: Doubles, nodes: RimNodes, chains: dict[tuple[int, int], list[int]], lowest: Doubles, sides: Doubles
) -> None:
    """Move nodes between two vertices of cells onto the segment between them, in place.

    A node on the diagonal of a face goes to where the segment crosses the diagonal.

    Parameters
    ----------
    places : (n, 3) float64
        Vertices in index space, those of nodes last.
    nodes : RimNodes
    chains : mapping of (int, int) to list of int
        As in `Stitched`.
    lowest, sides : (m, 3) float64
        Positions of the nodes' lowest samples, and sides of the cells there.
    """
    first = len(places) - len(nodes.keys)
    vertices = np.array([node for chain in chains.values() for node in chain])  # (n,)
    ends = np.array([ends for ends, chain in chains.items() for _ in chain])  # (n, 2)
    own = vertices - first
    codes = nodes.codes[own]
    axes = AXES_OF_FACE[codes[:, 0]]  # (n, 2), -1 if the node is not on a face
    each = np.flatnonzero((axes[:, 0] >= 0) & (codes[:, 1] == 0))
    vertices, ends, own, axes = vertices[each], ends[each], own[each], axes[each]
    rows = np.arange(len(own))[:, None]
    begin, end = ((places[ends[:, at]] - lowest[own])[rows, axes] / sides[own][rows, axes] for at in (0, 1))
    step = end - begin
    turn = step[:, 0] - step[:, 1]
    turns = np.flatnonzero(np.abs(turn) > NEAREST)
    begin, step, turn, vertices, own, axes = (each[turns] for each in (begin, step, turn, vertices, own, axes))
    along = begin[:, 0] + (begin[:, 1] - begin[:, 0]) / turn * step[:, 0]
    places[vertices] = lowest[own]
    shares = np.clip(along, NEAREST, 1 - NEAREST)
    places[vertices[:, None], axes] += shares[:, None] * sides[own[:, None], axes]
    for (start, end), chain in chains.items():
        if len(chain) > 1:
            places[chain] = _along(places[start], places[end], places[chain])


def _along(start: Doubles, end: Doubles, between: Doubles) -> Doubles:
    """Return positions (n, 3) moved onto the segment from `start` to `end`, in their order."""
    way = end - start
    shares = ((between - start) * way).sum(axis=1) / (way * way).sum()
    gap = min(1 / 64, 1 / (2 * len(shares) + 2))
    for number, share in enumerate(shares.tolist()):
        before = 0.0 if number == 0 else shares[number - 1]
        shares[number] = min(max(share, before + gap), 1 - gap * (len(shares) - number))
    return np.asarray(start + shares[:, None] * way)


def touches_rims(is_rim: Flags, keys: NDArray[np.int64], steps: tuple[int, int, int]) -> Flags:
    """Return whether any of the four cells around each edge, `3 * sample + axis`, holds a rim."""
    flat, axis = np.divmod(keys, 3)
    first, second = (np.array(steps).take((axis + turn) % 3) for turn in (1, 2))
    out = is_rim[flat]
    for shift in (first, second, first + second):
        out |= is_rim[flat - shift]
    return out
