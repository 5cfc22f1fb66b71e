# SPDX-License-Identifier: GPL-3.0-or-later
"""A tree of small patches of a surface, to find the samples that a ball touches.

Samples of the surface are grouped into patches of 16 that face one way and lie near each other. They are sorted by the
axis nearest to their normals, then in Morton order, and each chunk is halved along its longest side. So the two sides
of a thin wall never share a patch. Every patch, every four patches and so on are bounded by a flat disc across their
mean normal, which is much thinner than a box where the surface is tilted.

Positions are float32 about the middle of the samples.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import Doubles, Floats, Indices
from ...progress import PAUSE, Steps
from ..vectors import cross, dot
from .triangle_tree import CODE_BITS, morton_codes, order_steps

PATCH = 16  # A patch has this many samples.
BRANCH = 4  # A disc bounds this many discs of the level below.
CHUNK = 4096  # Halve this many samples at once; a power of 4 times PATCH.
MARGIN = 2.0**-20  # Discs are too large by this share of the extent, because of float32.
CODES_AT_ONCE = 1 << 17
CHUNKS_AT_ONCE = 32


class PatchTree:
    """Samples of a surface in patches, with discs that bound them.

    Attributes
    ----------
    order : (n,) int64
        The sample at each place; at the end the last one is repeated until chunks are full.
    middle : (3,) float64
        Subtracted from all positions.
    positions, normals : (3, n) float32
        By place; patch k holds the places 16 k to 16 k + 15.
    patches : (3, 16, n / 16) float32
        The positions again, patch by patch.
    levels : list of (8, discs) float32
        Center, axis, half of the thickness and radius of the discs; of patches first.
    """

    order: Indices
    middle: Doubles
    positions: Floats
    normals: Floats
    patches: Floats
    levels: list[Floats]

    def prepare_steps(self, positions: NDArray[Any], normals: NDArray[Any]) -> Steps[None]:
        """Build the tree from samples (n, 3), at least one, and their unit normals."""
        low, high = positions.min(axis=0).astype(np.float64), positions.max(axis=0).astype(np.float64)
        extent = float((high - low).max()) or 1.0
        self.middle = (low + high) / 2
        order = yield from _chunk_order_steps(positions, normals, low, (2**CODE_BITS - 1) / extent)
        for start in range(0, len(order), CHUNK * CHUNKS_AT_ONCE):
            block = slice(start, start + CHUNK * CHUNKS_AT_ONCE)
            order[block] = _halved(order[block], positions)
            yield PAUSE
        self.order = order
        self.positions, self.normals = np.empty((2, 3, len(order)), np.float32)
        for axis in range(3):
            self.positions[axis] = (positions[:, axis].astype(np.float64) - self.middle[axis])[order]
            self.normals[axis] = normals[:, axis].astype(np.float32)[order]
            yield PAUSE
        self.patches = np.ascontiguousarray(self.positions.reshape(3, -1, PATCH).swapaxes(1, 2))
        yield PAUSE
        yield from self._levels_steps(np.float32(extent * MARGIN))

    def _levels_steps(self, margin: np.float32) -> Steps[None]:
        sums = _added(np.ascontiguousarray(self.normals.reshape(3, -1, PATCH).swapaxes(1, 2)))
        low, high = self.patches.min(axis=1), self.patches.max(axis=1)
        yield PAUSE
        center, axis = (low + high) * np.float32(0.5), _unit(sums)
        height, aside = _from_disc(self.patches - center[:, None], axis[:, None])
        half, radius = np.abs(height).max(axis=0) + margin, aside.max(axis=0) + margin
        self.levels = [np.concatenate([center, axis, half[None], radius[None]])]
        yield PAUSE
        while self.levels[-1].shape[1] > BRANCH:
            discs, low, high, sums = (_in_fours(each) for each in (self.levels[-1], low, high, sums))
            low, high, sums = low.min(axis=1), high.max(axis=1), _added(sums)
            center, axis = (low + high) * np.float32(0.5), _unit(sums)
            height, aside = _from_disc(discs[:3] - center[:, None], axis[:, None])
            along = np.abs(dot(discs[3:6], axis[:, None]))
            across = np.sqrt(np.maximum(1 - along * along, 0))
            half = (np.abs(height) + discs[6] * along + discs[7] * across).max(axis=0)
            radius = (aside + discs[7] + discs[6] * across).max(axis=0)
            self.levels.append(np.concatenate([center, axis, half[None] + margin, radius[None] + margin]))
            yield PAUSE


def _chunk_order_steps(
    positions: NDArray[Any], normals: NDArray[Any], low: Doubles, cells_per_unit: float
) -> Steps[Indices]:
    """Return the samples by the axis their normals are nearest to and in Morton order, the last one repeated."""
    codes = np.empty(len(positions), np.uint64)
    for start in range(0, len(codes), CODES_AT_ONCE):
        block = slice(start, start + CODES_AT_ONCE)
        x, y, z = np.abs(normals[block].T)
        axis = np.where(x >= np.maximum(y, z), 0, np.where(y >= z, 1, 2))
        sign = np.take_along_axis(normals[block], axis[:, None], axis=1)[:, 0] < 0
        side = (2 * axis + sign).astype(np.uint64) << np.uint64(3 * CODE_BITS - 3)
        codes[block] = (morton_codes(positions[block].astype(np.float64), low, cells_per_unit) >> np.uint64(3)) | side
        yield PAUSE
    order = yield from order_steps(codes)
    filled = np.minimum(np.arange(-(-len(order) // CHUNK) * CHUNK), len(order) - 1)
    return order[filled].astype(np.int64)


def _halved(order: Indices, positions: NDArray[Any]) -> Indices:
    """Return whole chunks in which every half, quarter and so on down to a patch is cut along its longest side."""
    size = CHUNK
    while size > PATCH:
        rows = order.reshape(-1, size)
        points = np.stack([positions[:, axis].take(rows) for axis in range(3)])
        low = points.min(axis=2)
        sides = points.max(axis=2) - low
        longest = sides.argmax(axis=0)
        row = np.arange(len(rows))
        along, side = points[longest, row] - low[longest, row][:, None], sides[longest, row][:, None]
        # NumPy sorts 16 bits by counting.
        ticks = (along / np.where(side > 0, side, 1) * 65535).astype(np.uint16)
        order = np.take_along_axis(rows, np.argsort(ticks, axis=1, kind="stable"), axis=1).ravel()
        size //= 2
    return order


def _in_fours(columns: Floats) -> Floats:
    """Return columns (k, n) as (k, 4, n / 4), the last one repeated."""
    fours = -(-columns.shape[1] // BRANCH)
    filled = np.minimum(np.arange(fours * BRANCH), columns.shape[1] - 1)
    return np.ascontiguousarray(columns[:, filled].reshape(len(columns), fours, BRANCH).swapaxes(1, 2))


def _added(vectors: Floats) -> Floats:
    """Sum vectors (3, k, n) over k, in that order."""
    total = vectors[:, 0].copy()
    for number in range(1, vectors.shape[1]):
        total += vectors[:, number]
    return total


def _unit(vectors: Floats) -> Floats:
    """Return vectors at length 1, z for those of length 0: a disc without an axis would bound nothing."""
    length = np.sqrt(dot(vectors, vectors))
    unit = vectors / np.where(length > 0, length, 1)
    unit[2, length == 0] = 1
    return unit


def _from_disc(offsets: Floats, axis: Floats) -> tuple[Floats, Floats]:
    """Return the heights above a disc's plane, and the distances from its axis."""
    aside = cross(offsets, np.broadcast_to(axis, offsets.shape))
    return dot(offsets, axis), np.sqrt(dot(aside, aside))
