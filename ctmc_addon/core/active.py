"""Find the active voxels, 64 at a time: those whose corners are not all inside or all outside.

A voxel owns the three edges at its lowest corner. The samples are repeated once beyond the last
along every axis, so the edges in the high borders have an owner too: a half voxel, which gives no triangles.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .cases import CLASSIC, TriangleTables
from .sampling import WORD, Grid

CROSSES = np.array([[(case ^ case >> (1 << axis)) & 1 for case in range(256)] for axis in range(3)], bool)
"""(3, 256) whether a case crosses the edge along an axis that its voxel owns."""


@dataclass(frozen=True, eq=False)
class Slab:
    """The active voxels of the sample layers `low` to `high`, half voxels among them.

    Parameters
    ----------
    low, high : int
    x, y : int
        First column and row of samples of the slab's window: outside it no sample is inside.
    rows, pitch : int
        Rows of samples in the window, and samples in a row.
    place : (n,) int32
        Place in the window's samples (layers, rows, pitch), ascending.
    row : (n,) int16
        Row of `tables`: the case, or one of the surfaces that the trilinear interpolant may have in its stead.
    whole : (n,) bool
        False for half voxels.
    owned : three (n_axis,) intp
        Which of the voxels own a crossed edge along x, y, z: one vertex each.
    inner : (n_inner,) intp
        Which of the voxels have vertices of their own inside them; none in the classic topology.
    tables : TriangleTables
    """

    low: int
    high: int
    x: int
    y: int
    rows: int
    pitch: int
    place: NDArray[np.int32]
    row: NDArray[np.int16]
    whole: NDArray[np.bool_]
    owned: tuple[NDArray[np.intp], ...]
    inner: NDArray[np.intp]
    tables: TriangleTables

    @property
    def vertices(self) -> int:
        """Number of vertices on edges that the slab's voxels own, and inside the voxels."""
        inside = self.tables.own_count[self.row[self.inner]].sum(dtype=np.int64)
        return sum(len(voxels) for voxels in self.owned) + int(inside)

    @property
    def faces(self) -> int:
        """Number of triangles."""
        return int(self.tables.triangle_count[self.row[self.whole]].sum(dtype=np.int64))

    def samples(self, place: NDArray[np.int32]) -> tuple[NDArray[np.int32], ...]:
        """Sample numbers along x, y and z of places in the window."""
        row = place // np.int32(self.pitch)
        layer = row // np.int32(self.rows)
        x = place - row * np.int32(self.pitch)
        y = row - layer * np.int32(self.rows)
        return x + np.int32(self.x), y + np.int32(self.y), layer + np.int32(self.low)


def find_active(grid: Grid, bits: NDArray[np.uint64], low: int, high: int) -> Slab:
    """Find the active voxels of the sample layers `low` to `high`, and their cases."""
    window = _window(bits[low : high + 1])
    here = bits[low : high + 1, window[0], window[1]]  # (layers + 1, rows, words)
    rows, words = here.shape[1:]
    at_border = [window[1].stop == bits.shape[2], window[0].stop == bits.shape[1], high == grid.z.count]
    last_bit = np.uint64(1 << (grid.x.count - 1) % WORD)

    next_x = here >> np.uint64(1)
    next_x[..., :-1] |= here[..., 1:] << np.uint64(WORD - 1)
    if at_border[0]:
        next_x[..., -1] |= here[..., -1] & last_bit
    some, every = here | next_x, here & next_x
    some, every = some[:, :-1] | some[:, 1:], every[:, :-1] & every[:, 1:]
    active = (some[:-1] | some[1:]) ^ (every[:-1] & every[1:])  # (layers, rows - 1, words)

    at_word = np.flatnonzero(active)
    eights = active.reshape(-1)[at_word].view(np.uint8)  # eight voxels a byte
    at_eight = np.flatnonzero(eights != 0)
    at_voxel = np.flatnonzero(_bits_of(eights[at_eight]))
    if at_border[0]:
        active[..., -1] &= ~last_bit
    if at_border[1]:
        active[:, -1] = 0
    if at_border[2]:
        active[-1] = 0
    whole = _bits_of(active.reshape(-1)[at_word].view(np.uint8)[at_eight])[at_voxel].view(bool)

    at_word += at_word // ((rows - 1) * words) * words  # every layer of `here` has a row more than `active`
    byte = at_word[at_eight >> 3] * 8 + (at_eight & 7)
    cases = np.zeros(8 * len(byte), np.uint8)
    sides = (np.ascontiguousarray(here).reshape(-1).view(np.uint8), next_x.reshape(-1).view(np.uint8))
    for corner in range(8):
        shift = ((corner >> 1 & 1) + (corner >> 2) * rows) * words * 8
        cases |= _bits_of(sides[corner & 1].take(byte + shift)) << np.uint8(corner)
    case = cases[at_voxel]
    place = ((byte * 8)[at_voxel >> 3] + (at_voxel & 7)).astype(np.int32)
    owned = tuple(np.flatnonzero(CROSSES[axis].take(case)) for axis in range(3))
    return Slab(
        low=low,
        high=high,
        x=window[1].start * WORD,
        y=window[0].start,
        rows=rows,
        pitch=words * WORD,
        place=place,
        row=case.astype(np.int16),
        whole=whole,
        owned=owned,
        inner=np.zeros(0, np.intp),
        tables=CLASSIC,
    )


def _window(bits: NDArray[np.uint64]) -> tuple[slice, slice]:
    """Rows and words that can hold an active voxel: those with a sample inside, and one more on either side."""
    inside = np.bitwise_or.reduce(bits, axis=0) != 0  # (rows, words)
    rows, words = np.flatnonzero(inside.any(axis=1)), np.flatnonzero(inside.any(axis=0))
    if not len(rows):
        return slice(0, 1), slice(0, 1)
    return (
        slice(max(0, int(rows[0]) - 1), min(bits.shape[1], int(rows[-1]) + 2)),
        slice(max(0, int(words[0]) - 1), int(words[-1]) + 1),
    )


def _bits_of(eights: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.unpackbits(eights, bitorder="little")
