# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the interfaces of a complex meet, and which collapses keep every label closed.

An interface is the triangles between one pair of labels. A junction edge has more than two triangles, or one at a
border; most vertices of junction edges have two of them, between the same labels, and lie on a junction line. Where
lines end, branch or change their labels is a corner, which is locked. Where nothing meets but two labels and what has
none is a contact, which moves: however its lines branch, both labels are manifold there.

A collapse keeps the complex homeomorphic, so that every label's surface stays closed and manifold, if

- the ends share the vertices across the edge's triangles and no others, and no edge across: no two triangles coincide;
- it does not connect two vertices of junction lines, or only along the line, and no line of three edges becomes two.

A line around a single triangle between two labels may go all the same, and both then touch at an edge, or a point: each
label has the surface that it had. Hundreds of contacts as small as a voxel would else keep three vertices each.

Dey, Edelsbrunner, Guha and Nekhayev 1999, Theorem for 2-complexes; Vivodtzev, Bonneau and Hahmann 2010,
doi:10.1109/TVCG.2009.79.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...arrays import Flags, Ints
from ...progress import PAUSE, Steps
from ..engine.collapses import Collapses, shared_neighbors_steps, shuffled

INTERIOR, CONTACT, ON_LINE, CORNER = 0, 1, 2, 3  # The ranks of vertices.


@dataclass(eq=False)
class Junctions:
    """Junctions of a complex.

    edges : (E,) bool
        Edges that are junction edges.
    interface : (E,) int32
        Number of an interface that each edge is in, between two labels where there is one.
    rank : (V,) int8
        `INTERIOR` of an interface, `CONTACT`, `ON_LINE` or `CORNER`; of two ends the higher stays.
    border : (b,) int32
        Vertices of edges with one triangle.
    """

    edges: Flags
    interface: Ints
    rank: NDArray[np.int8]
    border: Ints


def interfaces_of(sides: Ints) -> tuple[Ints, Ints]:
    """Number the interfaces of a complex.

    Parameters
    ----------
    sides : (F, 2) int32
        As in `ComplexMesh`.

    Returns
    -------
    labels : (2, interfaces) int32
        The larger label of each interface, and the other.
    interface : (F,) int32
        Number of the interface that each triangle is in.
    """
    keys = (np.maximum(*sides.T).astype(np.int64) << 32) | np.minimum(*sides.T)
    pairs, interface = np.unique(keys, return_inverse=True)
    return np.stack([pairs >> 32, pairs & 0xFFFFFFFF]).astype(np.int32), interface.reshape(-1).astype(np.int32)


def junctions_steps(
    faces: Ints, edges: Ints, face_edges: Ints, interface: Ints, labels: Ints, vertex_count: int
) -> Steps[Junctions]:
    """Find the junctions of a complex.

    Parameters
    ----------
    faces : (3, F) int32
    edges, face_edges : (2, E) and (3, F) int32
        As `edges_steps` returns them.
    interface : (F,) int32
        Number of the interface that each face is in.
    labels : (2, interfaces) int32
        The two labels of each interface.
    vertex_count : int
    """
    edge_count = edges.shape[1]
    faces_at = np.bincount(face_edges.ravel(), minlength=edge_count)
    yield PAUSE
    first, last = np.zeros(edge_count, np.int32), np.zeros(edge_count, np.int32)
    # The one between two labels comes last and stays: a collapse at a line concerns both.
    for interfaces in (np.flatnonzero(labels[1, interface] == 0), np.flatnonzero(labels[1, interface] != 0)):
        for row in face_edges:
            last[row[interfaces]] = interface[interfaces]
        yield PAUSE
    for row in face_edges[::-1]:
        first[row[::-1]] = interface[::-1]
    yield PAUSE
    junction = (faces_at != 2) | (first != last)
    rank = np.zeros(vertex_count, np.int8)
    ends = edges[:, junction]
    rank[ends] = ON_LINE
    contact = yield from _contacts_steps(faces, interface, labels, vertex_count)

    # The faces at junction edges, and the labels on both sides of these.
    slots, at = np.nonzero(np.take(junction, face_edges))
    edge = face_edges[slots, at]
    yield PAUSE
    numbers = np.unique(labels)
    keys = [edge.astype(np.int64) * len(numbers) + np.searchsorted(numbers, side[interface[at]]) for side in labels]
    key, times = np.unique(np.concatenate(keys), return_counts=True)
    edge_of, number = np.divmod(key, len(numbers))
    odd = np.zeros(edge_count, bool)
    odd[edge_of[(times != 2) & (numbers[number] != 0) & (faces_at[edge_of] != 1)]] = True
    odd |= edges[0] == edges[1]
    yield PAUSE

    # The sum of numbers of interfaces, shuffled, tells edges between different interfaces apart.
    kind = np.bincount(edge, shuffled(interface[at].astype(np.int64) + 1).astype(np.float64), edge_count)[junction]
    degree = np.bincount(ends.ravel(), minlength=vertex_count)
    lowest, highest = np.full(vertex_count, np.inf), np.full(vertex_count, -np.inf)
    for end in ends:
        np.minimum.at(lowest, end, kind)
        np.maximum.at(highest, end, kind)
    rank[(degree > 0) & ((degree != 2) | (lowest != highest))] = CORNER
    rank[contact] = CONTACT
    border = edges[:, faces_at == 1].ravel()
    rank[border] = CORNER
    rank[faces[:, odd[face_edges].any(axis=0)]] = CORNER
    return Junctions(junction, last, rank, border)


def _contacts_steps(faces: Ints, interface: Ints, labels: Ints, vertex_count: int) -> Steps[Flags]:
    """Return the vertices at which only two labels and the outside meet, (V,) bool."""
    of_vertex = np.zeros(vertex_count, np.int32)
    for corner in faces:
        of_vertex[corner] = interface
    mixed = np.zeros(vertex_count, bool)
    for corner in faces:
        mixed[corner[np.take(of_vertex, corner) != interface]] = True
    yield PAUSE
    vertices, sides = [], []
    for corner in faces:
        at = np.flatnonzero(np.take(mixed, corner))
        for side in labels:
            vertices.append(corner[at])
            sides.append(side[interface[at]])
    keys = np.unique(np.concatenate(vertices).astype(np.int64) << 32 | np.concatenate(sides))
    vertex, label = keys >> 32, keys & 0xFFFFFFFF
    yield PAUSE
    return (np.bincount(vertex[label != 0], minlength=vertex_count) == 2) & mixed


def violates_link_condition_steps(
    collapses: Collapses, faces: Ints, edges: Ints, face_edges: Ints, junctions: Junctions, walls: Flags
) -> Steps[Flags]:
    """Return which collapses would change how the labels are connected, (n,) bool.

    `edges` are (2, E), the other arrays (3, F); `walls` says which faces are between two labels.
    """
    count, vertex_count = len(collapses.edges), len(junctions.rank)
    across = np.bincount(collapses.owner[collapses.vanishing], minlength=count)
    shared, _ = yield from shared_neighbors_steps(collapses, edges, vertex_count)
    refused = np.bincount(shared, minlength=count) != across
    lines, third = yield from shared_neighbors_steps(collapses, edges[:, junctions.edges], vertex_count)
    # Of a contact of one triangle both labels have the face that goes, so neither sees a third neighbor.
    at = np.flatnonzero(collapses.vanishing & np.take(walls, collapses.faces))
    at = at[(np.take(junctions.rank, np.take(faces, collapses.faces[at], axis=1)) == CONTACT).all(axis=0)]
    owner = collapses.owner[at].astype(np.int64)
    apex = np.take(faces, collapses.faces[at], axis=1).sum(axis=0, dtype=np.int64)
    apex -= collapses.kept[owner].astype(np.int64) + collapses.dropped[owner]
    refused[lines[~np.isin(lines * vertex_count + third, owner * vertex_count + apex)]] = True

    moves = np.zeros(vertex_count, bool)
    moves[collapses.kept] = moves[collapses.dropped] = True
    left = np.flatnonzero(~collapses.vanishing)
    number = collapses.faces[left]
    slot = np.argmax(np.take(moves, np.take(faces, number, axis=1)), axis=0)
    opposite = face_edges[(slot + 1) % 3, number]
    yield PAUSE
    owner, here = collapses.owner[left], np.arange(len(left))
    last = np.empty(len(junctions.edges), np.int64)
    last[opposite] = here
    twice = np.take(last, opposite)  # beside an edge of one interface there are no more than two
    refused[owner[(twice != here) & (owner[twice] == owner)]] = True
    at = np.flatnonzero(junctions.edges[opposite])
    keys = np.sort(owner[at].astype(np.int64) * len(junctions.edges) + opposite[at])
    refused[keys[1:][keys[1:] == keys[:-1]] // len(junctions.edges)] = True
    return refused
