# SPDX-License-Identifier: GPL-3.0-or-later
"""Fill gaps between two labels that are closed all round, and smaller than four triangles of what shall be left.

One sample without a label between two organs leaves a gap of a cubic millimeter in their wall. It never has fewer than
four triangles, and a line around it. The label with the larger wall there takes it, and the other keeps its surface.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...arrays import Indices, Ints
from ...mesh.labels.label_complex import ComplexMesh, junction_vertices
from ...mesh.topology import compacted, component_numbers_steps, edges_steps
from ...mesh.vectors import cross, dot
from ...progress import PAUSE, Steps
from ..engine.component_removal import CollapsedComponents
from ..policy import POLICY, Policy

TETRAHEDRON = 4  # A closed surface has no fewer triangles.


def gaps_filled_steps(
    mesh: ComplexMesh, target: int, largest: float = math.inf, policy: Policy = POLICY
) -> Steps[tuple[ComplexMesh, dict[int, CollapsedComponents]]]:
    """Fill the small gaps between labels of a complex.

    Parameters
    ----------
    mesh : ComplexMesh
    target : int
        Triangles to keep.
    largest : float
        No larger volume is filled, in the cube of the mesh's unit.
    policy : Policy, optional

    Returns
    -------
    mesh : ComplexMesh
        A gap has two walls of one piece each: the larger has gone, and the other separates both labels. The same object
        where there is no gap.
    filled : dict of int to CollapsedComponents
        The gaps, by the label that took them.
    """
    nothing: tuple[ComplexMesh, dict[int, CollapsedComponents]] = mesh, {}
    near = yield from _near_lines_steps(mesh, policy.gap_rings)
    faces, all_sides = np.ascontiguousarray(mesh.faces[near].T), mesh.sides[near]
    outer = np.flatnonzero((all_sides == 0).any(axis=1))
    if not len(outer):
        return nothing
    edges, face_edges = yield from edges_steps(faces, len(mesh.vertices))
    edge_count = edges.shape[1]
    faces_at = np.bincount(face_edges.ravel(), minlength=edge_count)
    around = np.take(face_edges, outer, axis=1)  # (3, f)
    wall, walls = yield from _walls_steps(around, faces_at)
    own = all_sides[outer].max(axis=1)
    label = np.zeros(walls, np.int32)
    label[wall] = own
    a, b, c = (np.take(mesh.vertices.T, np.take(corner, outer), axis=1).astype(np.float64) for corner in faces)
    normal = cross(b - a, c - a)
    area = np.bincount(wall, np.sqrt(dot(normal, normal)) / 2.0, walls)
    yield PAUSE

    # Across the lines around a wall lies one other wall, and no border.
    slots, at = np.nonzero(np.take(faces_at, around) != 2)
    edge, wall_at = around[slots, at], wall[at]
    meets = np.bincount(edge, minlength=edge_count)
    total = np.bincount(edge, wall_at, edge_count).astype(np.int64)
    opposite = total[edge] - wall_at
    single = np.zeros(walls, np.int64)
    single[wall_at] = opposite
    odd = (faces_at[edge] != 3) | (meets[edge] != 2) | (single[wall_at] != opposite)
    closed = np.ones(walls, bool)
    closed[wall_at[odd]] = False
    closed &= np.bincount(wall_at, minlength=walls) > 0
    numbers = np.arange(walls)
    closed &= (single != numbers) & (single[single] == numbers) & closed[single] & (label != label[single])
    small = area + area[single] <= TETRAHEDRON * _area(mesh) / max(1, target)
    closed &= small & (_euler(wall, np.take(faces, outer, axis=1), around) == 1)
    closed &= closed[single]
    yield PAUSE

    first = np.flatnonzero(closed & (numbers < single))
    if not len(first):
        return nothing
    outer = near[outer]
    volume = _volumes(mesh, outer, wall, walls)
    volumes = volume[first] + volume[single[first]]
    fits = (volumes > 0) & (volumes <= largest)  # what lies around both labels is negative
    first, volumes = first[fits], volumes[fits]
    if not len(first):
        return nothing
    second = single[first]
    goes = np.where(area[first] >= area[second], first, second)
    stays = np.where(area[first] >= area[second], second, first)
    takes = np.zeros(walls, np.int32)
    takes[stays] = label[goes]
    removed = np.zeros(walls, bool)
    removed[goes] = True
    sides = mesh.sides.copy()
    filled = takes[wall] != 0
    at = outer[filled]
    sides[at] = np.where(sides[at] == 0, takes[wall[filled]][:, None], sides[at])
    left = np.ones(len(mesh.faces), bool)
    left[outer[removed[wall]]] = False
    used, faces = compacted(mesh.faces[left], len(mesh.vertices))
    normals = None if mesh.normals is None else mesh.normals[used]
    result = ComplexMesh(mesh.vertices[used], faces, sides[left], normals)
    filled_by = {}
    for taker in np.unique(label[goes]).tolist():
        own = volumes[label[goes] == taker]
        filled_by[taker] = CollapsedComponents(len(own), float(own.max()), math.fsum(own.tolist()))
    return result, filled_by


def _near_lines_steps(mesh: ComplexMesh, rings: int) -> Steps[Indices]:
    """Find the triangles up to `rings` away from a vertex of two interfaces: all of small gaps, and few more."""
    near = junction_vertices(mesh.faces, mesh.sides)
    yield PAUSE
    for _ in range(rings):
        touched = np.take(near, mesh.faces).any(axis=1)
        near[mesh.faces[touched]] = True
        yield PAUSE
    return np.flatnonzero(touched)


def _walls_steps(around: Ints, faces_at: Indices) -> Steps[tuple[Indices, int]]:
    """The number of the wall that each face is in, whose edges are (3, f), and how many walls there are.

    Faces are in one wall where they share an edge of two faces.
    """
    count = around.shape[1]
    face = np.tile(np.arange(count, dtype=np.int32), 3)
    node = np.where(np.take(faces_at, around).ravel() == 2, count + around.ravel(), face).astype(np.int32)
    number = (yield from component_numbers_steps(np.stack([face, node], axis=1), count + len(faces_at)))[:count]
    return number.astype(np.int64), int(number.max()) + 1


def _euler(wall: Indices, corners: Ints, around: Ints) -> Indices:
    """Euler number of every wall, whose faces have these corners and edges, (3, f)."""
    walls = int(wall.max()) + 1
    owner = np.tile(wall, 3)
    result = np.bincount(wall, minlength=walls)
    for part, sign in ((corners, 1), (around, -1)):
        count = int(part.max()) + 1
        result = result + sign * np.bincount(np.unique(owner * count + part.ravel()) // count, minlength=walls)
    return result


def _area(mesh: ComplexMesh) -> float:
    a, b, c = (np.take(mesh.vertices.T, corner, axis=1) for corner in mesh.faces.T)
    normal = cross(b - a, c - a)
    return float(np.sqrt(dot(normal, normal)).sum(dtype=np.float64)) / 2.0


def _volumes(mesh: ComplexMesh, outer: Indices, wall: Indices, walls: int) -> NDArray[np.float64]:
    """Return the share of every wall in the volume around the labels, which is positive in a gap."""
    corners = np.take(mesh.faces, outer, axis=0)
    origin = mesh.vertices[0].astype(np.float64)
    a, b, c = (mesh.vertices[corner].astype(np.float64).T - origin[:, None] for corner in corners.T)
    sign = np.where(mesh.sides[outer, 0] == 0, 1.0, -1.0)
    sums: NDArray[np.float64] = np.bincount(wall, sign * dot(a, cross(b, c)) / 6.0, walls).astype(np.float64)
    return sums
