"""Find the active voxels, 64 at a time: those whose corners are not all inside or all outside.

A voxel owns the three edges at its lowest corner. The samples are repeated once beyond the last
along every axis, so the edges in the high borders have an owner too: a half voxel, which gives no triangles.

Most words of 64 samples are all zero or all one, as are their neighbours. The others are gathered into lists;
of these the eights (bytes) with an active voxel are kept, and voxels are numbered by `cell`: 8 times the number
of their eight, and their place in it. So what is stored for them lies close together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .case_table import CLASSIC, TriangleTables
from .grid import WORD, Grid

EIGHT = 8
ALL_INSIDE = np.uint64(2**WORD - 1)


@dataclass(frozen=True, eq=False)
class Slab:
    """The active voxels of the sample layers `low` to `high`, half voxels among them.

    Parameters
    ----------
    low, high : int
    rows, pitch : int
        Rows of samples in a layer, and samples in a row, with what is repeated or left over beyond the last.
    eight : (m,) intp
        Which eights of the samples (high - low, rows, pitch) have an active voxel, ascending.
    cell : (n,) intp
        The active voxels, ascending: 8 times the number of its eight, and the voxel's place in it.
    row : (n,) int16
        Row of `tables`: the case, or one of the surfaces that the trilinear interpolant may have in its stead.
    whole : (n,) bool
        False for half voxels.
    owned : three (n_axis,) intp
        Which of the voxels own a crossed edge along x, y, z: one vertex each.
    inner : (n_inner,) intp
        Which of the voxels have vertices of their own inside them; none in the classic topology.
    inner_values : (n_inner, 8) float64
        Grey values at their corners.
    tables : TriangleTables
    """

    low: int
    high: int
    rows: int
    pitch: int
    eight: NDArray[np.intp]
    cell: NDArray[np.intp]
    row: NDArray[np.int16]
    whole: NDArray[np.bool_]
    owned: tuple[NDArray[np.intp], ...]
    inner: NDArray[np.intp]
    inner_values: NDArray[np.float64]
    tables: TriangleTables

    @property
    def vertices(self) -> int:
        """Number of vertices on edges that the slab's voxels own, and inside the voxels."""
        inside = self.tables.own_count.take(self.row.take(self.inner)).sum(dtype=np.int64)
        return sum(len(voxels) for voxels in self.owned) + int(inside)

    @property
    def faces(self) -> int:
        """Number of triangles."""
        return int((self.tables.triangle_count.take(self.row) * self.whole).sum(dtype=np.int64))

    def samples(self, voxels: NDArray[np.intp]) -> tuple[NDArray[np.intp], ...]:
        """Sample numbers along x, y and z of the lowest corners of some of the voxels."""
        cell = self.cell.take(voxels)
        x, y, z = self.eight_samples(cell >> 3)
        return x + (cell & 7), y, z

    def eight_samples(self, some: NDArray[np.intp] | None = None) -> tuple[NDArray[np.intp], ...]:
        """Sample numbers along x, y and z of the first sample of every eight, or of some of them."""
        eight = self.eight if some is None else self.eight.take(some)
        in_row = self.pitch // EIGHT
        row = eight // in_row
        layer = row // self.rows
        return (eight - row * in_row) * EIGHT, row - layer * self.rows, layer + self.low


def find_active(grid: Grid, bits: NDArray[np.uint64], low: int, high: int) -> Slab:
    """Find the active voxels of the sample layers `low` to `high`, and their cases."""
    rows, words = bits.shape[1:]
    layer = rows * words
    here = bits[low : high + 1].reshape(-1)
    at = _mixed(here, rows, words)
    at_layer = at % layer
    repeated, half = (mask.reshape(-1).take(at_layer) for mask in _borders(grid, rows, words))
    if high == grid.z.count:
        half[np.searchsorted(at, (high - low - 1) * layer) :] = ALL_INSIDE

    corners = []  # words of the voxels' corners in turn
    for step in (0, words, layer, layer + words):
        word = here.take(at + step)
        following = here.take(at + (step + 1), mode="clip")
        following <<= np.uint64(WORD - 1)
        following[repeated != 0] = 0
        following |= word >> np.uint64(1)
        following |= word & repeated
        corners += [word, following]
    some, every = corners[0].copy(), corners[0].copy()
    for corner in corners[1:]:
        some |= corner
        every &= corner
    some ^= every  # now the active voxels

    at_eight = np.flatnonzero(some.view(np.uint8) != 0)
    eight = at.take(at_eight >> 3)
    eight *= EIGHT
    eight += at_eight & 7
    cell = np.flatnonzero(_bits_of(some, at_eight).view(bool))
    cases = np.zeros(EIGHT * len(eight), np.uint8)
    for corner in reversed(corners):
        cases += cases
        cases |= _bits_of(corner, at_eight)
    case = cases.take(cell)
    return Slab(
        low=low,
        high=high,
        rows=rows,
        pitch=words * WORD,
        eight=eight,
        cell=cell,
        row=case.astype(np.int16),
        whole=_bits_of(~half, at_eight).take(cell).view(bool),
        owned=tuple(np.flatnonzero(((case ^ case >> (1 << axis)) & 1).view(bool)) for axis in range(3)),
        inner=np.zeros(0, np.intp),
        inner_values=np.zeros((0, 8)),
        tables=CLASSIC,
    )


def _mixed(here: NDArray[np.uint64], rows: int, words: int) -> NDArray[np.intp]:
    """Which words may have an active voxel: not all samples of it and of its neighbours are equal."""
    layer = rows * words
    may = _spread(here != 0, words, layer)
    may &= _spread(here != ALL_INSIDE, words, layer)
    for first in range(layer - words, len(may), layer):
        may[first : first + words] = False  # the repeated row has no voxels
    return np.flatnonzero(may)


def _spread(mask: NDArray[np.bool_], words: int, layer: int) -> NDArray[np.bool_]:
    """Whether a word or one of its neighbours towards the higher samples is marked; too many at the rows' ends."""
    mask[:-1] |= mask[1:]
    mask = mask[:-words] | mask[words:]
    return mask[:-layer] | mask[layer:]


def _borders(grid: Grid, rows: int, words: int) -> tuple[NDArray[np.uint64], NDArray[np.uint64]]:
    """For the words of a layer (rows, words): the last sample of every row, and all the half voxels."""
    repeated = np.zeros((rows, words), np.uint64)
    repeated[:, -1] = np.uint64(1 << (grid.x.count - 1) % WORD)
    half = repeated.copy()
    half[grid.y.count - 1] = ALL_INSIDE
    return repeated, half


def _bits_of(words: NDArray[np.uint64], at_eight: NDArray[np.intp]) -> NDArray[np.uint8]:
    """The bits of some bytes of the words, one a byte."""
    return np.unpackbits(words.view(np.uint8).take(at_eight), bitorder="little")
