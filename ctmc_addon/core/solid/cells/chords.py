# SPDX-License-Identifier: GPL-3.0-or-later
"""Estimate how far vertices on lattice edges, and the triangles between them, lie below a field's surface.

Triangles cut off a part of a surface that bulges. A ball of ten steps is 0.6 % too small; 0.1 % of that comes from its
vertices, which lie where the field would be 0 if it were linear along the edge.

    between vertices   A field that is 0 at both ends of a vector e, with gradients g and h there, is (g - h) e / 8 in
                       the middle. Its mean on a triangle is a third of the sum over the three sides.
    along an edge      The change of the gradient along the edge gives all but the second derivative along the edge.
                       That one follows, since a distance has no second derivative along its own gradient.

Both are exact for a quadratic field. At a crease no quadratic fits, so the depth there is 0.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...arrays import Doubles
from ...mesh.vectors import cross, dot
from ...progress import PAUSE, Steps
from ...volume.affine import cofactors, determinant
from ..fields.lattice import Lattice
from ..fields.lattice_fields import LatticeField

CREASE = 0.4  # A unit gradient that changes by more than this, 23 degrees, marks a crease.
STEEPEST = 2.0  # Skip an edge if the gradient is longer by more than this factor than its part along the edge.
AT_ONCE = 1 << 18
SIDES = ((0, 1), (1, 2), (2, 0))


def gradients_steps(
    field: LatticeField, lattice: Lattice, keys: NDArray[np.int64], share: Doubles, threads: int
) -> Steps[tuple[Doubles, Doubles]]:
    """Return the gradients of a distance at vertices on edges of a lattice, and its values there.

    Parameters
    ----------
    field : LatticeField
        Sampled at corners of the cells around the edges.
    lattice : Lattice
    keys : (n,) int64
        `3 * sample + axis`; none lies in the border of the lattice.
    share : (n,) float64
        Share of the edge from the sample to the vertex, which lies where a linear field would be 0.
    threads : int

    Returns
    -------
    gradients : (3, n) float64
        Along RAS+ mm.
    values : (n,) float64
        0 for a linear field.
    """
    sides = (1, lattice.shape[2], lattice.shape[1] * lattice.shape[2])
    inverse = cofactors(lattice.affine)[:3, :3].T / determinant(lattice.affine)
    out, values = np.empty((3, len(keys))), np.empty(len(keys))
    for along in range(3):
        of_axis = np.flatnonzero(keys % 3 == along)
        across = [axis for axis in range(3) if axis != along]
        for start in range(0, len(of_axis), AT_ONCE):
            own = of_axis[start : start + AT_ONCE]
            low, part = keys[own] // 3, share[own]
            ends = np.stack([low, low + sides[along]])
            asked = np.stack([ends, *(ends + side for axis in across for side in (-sides[axis], sides[axis]))])
            samples, place = np.unique(asked, return_inverse=True)
            at_corners = (yield from field.values_steps(samples, threads)).astype(np.float64)
            at = at_corners.take(place.reshape(asked.shape))  # (5, 2, n)
            step = _way(lattice, along, low, 0, 1)
            slopes, turns = np.empty((3, len(own))), np.zeros((3, len(own)))
            slopes[along] = (at[0, 1] - at[0, 0]) / step
            for before, axis in zip((1, 3), across, strict=True):
                both = (at[before + 1] - at[before]) / _way(lattice, axis, low, -1, 1)  # (2, n)
                slopes[axis], turns[axis] = both[0] + part * (both[1] - both[0]), both[1] - both[0]
            way = _product(inverse, _product(inverse.T, slopes))
            turn = _product(inverse.T, turns)
            unclear = (np.abs(way[along]) * STEEPEST < np.sqrt(dot(way, way))) | (dot(turn, turn) > CREASE * CREASE)
            bend = np.where(unclear, 0.0, -dot(turns, way) / np.where(unclear, 1.0, way[along]))
            slopes[along] += (part - 0.5) * bend
            out[:, own], values[own] = _product(inverse.T, slopes), part * (part - 1) / 2 * step * bend
    return out, values


def _product(matrix: Doubles, vectors: Doubles) -> Doubles:
    """Multiply vectors (3, n) by a matrix."""
    return np.stack([dot(row[:, None], vectors) for row in matrix])


def _way(lattice: Lattice, axis: int, flat: NDArray[np.int64], begin: int, end: int) -> Doubles:
    """Return the vector along an axis between two neighbors of samples."""
    positions = (lattice.x, lattice.y, lattice.z)[axis]
    side = (1, lattice.shape[2], lattice.shape[1] * lattice.shape[2])[axis]
    number = flat // side % len(positions)
    return np.asarray(positions.take(number + end) - positions.take(number + begin))


def depths_steps(vertices: Doubles, gradients: Doubles, faces: NDArray[np.int32]) -> Steps[Doubles]:
    """Return how far the triangles at every vertex lie below the surface through the vertices.

    Parameters
    ----------
    vertices, gradients : (3, n) float64
        RAS+ mm.
    faces : (f, 3) int32

    Returns
    -------
    (n,) float64
        The mean of the field on the triangles, weighted by area; 0 for a vertex without triangles.
    """
    total, area = np.zeros(vertices.shape[1]), np.zeros(vertices.shape[1])
    for start in range(0, len(faces), AT_ONCE):
        corners = faces[start : start + AT_ONCE].T
        at, of = vertices[:, corners], gradients[:, corners]  # (3, 3, n)
        mean, crease = np.zeros(corners.shape[1]), np.zeros(corners.shape[1], bool)
        for begin, end in SIDES:
            turn = of[:, begin] - of[:, end]
            mean += dot(turn, at[:, end] - at[:, begin]) / 24
            crease |= dot(turn, turn) > CREASE * CREASE
        mean[crease] = 0.0
        normal = cross(at[:, 1] - at[:, 0], at[:, 2] - at[:, 0])
        size = np.sqrt(dot(normal, normal))
        for corner in corners:
            total += np.bincount(corner, size * mean, len(total))
            area += np.bincount(corner, size, len(area))
        yield PAUSE
    return np.divide(total, area, out=total, where=area > 0)
