# SPDX-License-Identifier: GPL-3.0-or-later
"""Flat discs that bound neighboring triangles: much thinner than boxes where a surface is tilted.

A disc is a cylinder about the mean normal of its triangles. From far away a box's corner is nearer than its triangles
by up to its size, so a search keeps hundreds of boxes; of discs it keeps the few around the nearest point.

All is float32, and every disc is a little too large, so that rounding loses no triangle.
"""

from __future__ import annotations

import numpy as np

from ...arrays import Doubles, Floats, Indices
from ...progress import PAUSE, Steps
from ..topology import FACES_PER_STEP
from ..vectors import cross, dot

HEIGHTS = 5  # Bound every 1, 4, 16, 64 and 256 triangles.
BRANCH = 4
MARGIN = 2.0**-20  # Discs are too large by this share of the extent.
FAR = 1e18
ROUNDED = np.float32(2e-6)  # A difference of squares is wrong by less than this share of them.


def discs_steps(corners: Doubles, middle: Doubles, extent: float) -> Steps[list[Floats]]:
    """Return the discs of triangles, of every 4 of them, of every 16 and so on.

    Parameters
    ----------
    corners : (3, 3, F) float64
        Corner, axis, triangle; neighbors in space are neighbors here.
    middle : (3, 1) float64
        Taken from positions.
    extent : float
        The largest side of the mesh's box.

    Returns
    -------
    list of (8, parents, 4) float32
        Center, axis of unit length, half of the thickness and radius, of every four; no point is near what fills the
        last four.
    """
    count, most = corners.shape[2], BRANCH ** (HEIGHTS - 1)
    margin = np.float32(extent * MARGIN)
    parents = [-(-count // BRANCH ** (height + 1)) for height in range(HEIGHTS)]
    discs = [np.zeros((8, number * BRANCH), np.float32) for number in parents]
    for each in discs:
        each[:3] = FAR
    for start in range(0, count, FACES_PER_STEP):
        columns = (corners[:, :, start : start + FACES_PER_STEP] - middle).astype(np.float32)
        here = columns.shape[2]
        if here % most:  # The last triangle fills the last group.
            columns = np.concatenate([columns, np.repeat(columns[:, :, -1:], -here % most, axis=2)], axis=2)
        a, b, c = columns
        vectors = cross(b - a, c - a)
        for height in range(HEIGHTS):
            group = BRANCH**height
            first, last = start // group, -(-(start + here) // group)
            discs[height][:, first:last] = _discs(columns, vectors, group, margin)[:, : last - first]
            yield PAUSE
    return [each.reshape(8, -1, BRANCH) for each in discs]


def _discs(columns: Floats, vectors: Floats, group: int, margin: np.float32) -> Floats:
    """Return the discs of every `group` triangles, from their corners (3, 3, n) and the vectors of their areas."""
    out = np.empty((8, columns.shape[2] // group), np.float32)
    center, axis = out[:3], out[3:6]
    # The triangles of a group are one below the other, so that NumPy works along the groups.
    apart = np.ascontiguousarray(columns.reshape(3, 3, -1, group).transpose(1, 0, 3, 2)).reshape(3, 3 * group, -1)
    center[:] = apart.mean(axis=1)
    axis[:] = vectors.reshape(3, -1, group).sum(axis=2)
    length = np.sqrt(dot(axis, axis))
    has_axis = length > 0
    axis /= np.where(has_axis, length, 1)
    axis[2, ~has_axis] = 1
    apart -= center[:, None]
    along = dot(apart, axis[:, None])
    squared = dot(apart, apart)
    across = (squared - along * along).max(axis=0) + ROUNDED * squared.max(axis=0)
    low, high = along.min(axis=0), along.max(axis=0)
    center += axis * ((low + high) / 2)
    out[6] = (high - low) / 2 + margin
    out[7] = np.sqrt(np.maximum(across, 0)) + margin
    return out


def squared_outside(discs: Floats, positions: Floats, parents: Indices) -> Floats:
    """Squared distance from every position (3, n) to the four discs of its parent, (4 n,); 0 inside them."""
    own = np.take(discs, parents, axis=1).reshape(8, -1)
    apart = np.repeat(positions, BRANCH, axis=1)
    apart -= own[:3]
    along = dot(apart, own[3:6])
    across = dot(apart, apart)
    across *= 1 - ROUNDED
    across -= along * along
    np.sqrt(np.maximum(across, 0, out=across), out=across)
    across -= own[7]
    np.maximum(across, 0, out=across)
    across *= across
    np.abs(along, out=along)
    along -= own[6]
    np.maximum(along, 0, out=along)
    along *= along
    across += along
    return across
