# SPDX-License-Identifier: GPL-3.0-or-later
"""Second pass: the active voxels, whose corners are not all inside or all outside, and their cases, 64 at a time.

A voxel is named by its lowest corner and owns the three edges there. The samples are repeated once beyond the last
along every axis, so the edges in the high borders have an owner too: a ghost cell, which gives no triangles.

Most words of 64 samples are all inside or all outside, and so are their neighbors. The others are gathered into
lists, in which voxels are found by four numbers. Example: 70 samples along x, 4 along y, 3 along z. A row then has
two words, 16 bytes, 128 samples (the pitch); with the repeated row there are 5 rows in a layer. In the slab of the
layers 0 to 3, the voxel at x = 9, y = 2, z = 1:

    byte of the bits    (z * rows + y) * (pitch / 8) + x // 8  =  (1 * 5 + 2) * 16 + 1  =  113
    rank                place of 113 in `Slab.byte`, the sorted list of bytes with an active voxel: say 7
    slot                8 * rank + x % 8  =  57
    voxel               place of 57 in `Slab.slot`, the sorted list of the active voxels

Facts about a voxel are at its number in lists as long as `slot`. Its vertex numbers, which other voxels must find
without a search, are at its slot (see faces.py).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .case_table import CLASSIC, TriangleTables
from .grid import WORD, Grid

BYTE = 8  # A byte holds the bits of this many samples.
ALL_INSIDE = np.uint64(2**WORD - 1)


@dataclass(frozen=True, eq=False)
class Segments:
    """Runs of layers of a slab, each within one unit, and the contents of each.

    Parameters
    ----------
    unit : (s,) intp
    lowest : (s,) bool
        Whether it is the lowest layer of its unit.
    vertices : (4, s) intp
        On edges along x, y and z, and inside voxels.
    voxels : (kinds, s) intp
        Voxels of each kind; those of kind 0 have no triangle.
    """

    unit: NDArray[np.intp]
    lowest: NDArray[np.bool_]
    vertices: NDArray[np.intp]
    voxels: NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Slab:
    """The active voxels of the sample layers `low` to `high`, ghost cells among them.

    Parameters
    ----------
    low, high : int
    unit : int
        Layers that the order of vertices and triangles counts as one (order.py); layer 0 begins one.
    rows, pitch : int
        Rows of samples in a layer, and samples in a row, with what is repeated or left over beyond the last.
    byte : (m,) intp
        Bytes of the bits of (high - low, rows, pitch) samples that have an active voxel, ascending.
    slot : (n,) intp
        The active voxels, ascending: 8 times the rank of its byte in `byte`, and its place in the byte.
    configuration : (n,) int16
        Configuration number in `tables`: the case, or one of the surfaces that the trilinear interpolant may have
        in its stead.
    ghosts : (n_ghosts,) intp
        Voxels that are ghost cells, ascending.
    edge_slots : three (n_axis,) intp
        Slots of the voxels that own a crossed edge along x, y, z, ascending: one vertex each.
    with_interior : (n_interior,) intp
        Voxels that have vertices inside them; none in the classic topology.
    corner_values : (n_interior, 8) float64
        Gray values at the corners of those.
    tables : TriangleTables
    """

    low: int
    high: int
    unit: int
    rows: int
    pitch: int
    byte: NDArray[np.intp]
    slot: NDArray[np.intp]
    configuration: NDArray[np.int16]
    ghosts: NDArray[np.intp]
    edge_slots: tuple[NDArray[np.intp], ...]
    with_interior: NDArray[np.intp]
    corner_values: NDArray[np.float64]
    tables: TriangleTables

    @property
    def cell_count(self) -> int:
        """Number of active voxels that are no ghost cells."""
        return len(self.slot) - len(self.ghosts)

    @property
    def vertex_count(self) -> int:
        """Number of vertices on edges that the slab's voxels own, and inside the voxels."""
        return int(self.segments.vertices.sum())

    @property
    def face_count(self) -> int:
        """Number of triangles."""
        voxels_of_kind = self.segments.voxels.sum(axis=1).tolist()
        return sum((kind + 1) // 2 * voxels for kind, voxels in enumerate(voxels_of_kind))

    @cached_property
    def corner_list_kind(self) -> NDArray[np.uint8]:
        """(n,) the kind of every voxel's list of corners, as `CornerLists` has it; 0 for ghost cells."""
        kind = self.tables.corners.corner_list_kind.take(self.configuration)
        kind[self.ghosts] = 0
        return kind

    @cached_property
    def segments(self) -> Segments:
        """The layers, cut where units begin and above the lowest layer of each; and how much is in each of them."""
        starts = range(-(-self.low // self.unit) * self.unit, self.high, self.unit)
        layers = np.array(sorted({self.low, *starts, *(start + 1 for start in starts), self.high}))
        layer_bytes = self.rows * self.pitch // BYTE
        slots = np.searchsorted(self.byte, (layers - self.low) * layer_bytes) * BYTE
        voxels = np.searchsorted(self.slot, slots)
        inside = np.zeros(len(self.with_interior) + 1, np.intp)
        np.cumsum(self.interior_counts, out=inside[1:])
        ends = [np.searchsorted(of_axis, slots) for of_axis in self.edge_slots]
        ends.append(inside[np.searchsorted(self.with_interior, voxels)])
        kind = self.corner_list_kind
        kinds = int(kind.max(initial=0)) + 1
        faces = np.array([np.bincount(kind[a:b], minlength=kinds) for a, b in pairwise(voxels.tolist())]).T
        return Segments(layers[:-1] // self.unit, layers[:-1] % self.unit == 0, np.diff(np.array(ends)), faces)

    @property
    def interior_counts(self) -> NDArray[Any]:
        """Return the number of vertices inside each of the voxels `with_interior`."""
        return self.tables.interior_count.take(self.configuration.take(self.with_interior))

    def samples(self, voxels: NDArray[np.intp]) -> tuple[NDArray[np.intp], ...]:
        """Sample numbers along x, y and z of the lowest corners of voxels."""
        slot = self.slot.take(voxels)
        x, y, z = self.byte_samples(slot >> 3)
        return x + (slot & 7), y, z

    def byte_samples(self, ranks: NDArray[np.intp] | None = None) -> tuple[NDArray[np.intp], ...]:
        """Sample numbers along x, y and z of the first sample of every byte, or of those of some ranks."""
        byte = self.byte if ranks is None else self.byte.take(ranks)
        bytes_in_row = self.pitch // BYTE
        row = byte // bytes_in_row
        layer = row // self.rows
        return (byte - row * bytes_in_row) * BYTE, row - layer * self.rows, layer + self.low


def find_active(grid: Grid, bits: NDArray[np.uint64], low: int, high: int) -> Slab:
    """Find the active voxels of the sample layers `low` to `high`, and their cases."""
    rows, words = bits.shape[1:]
    layer = rows * words
    slab_words = bits[low : high + 1].reshape(-1)
    word_index = _mixed_words(slab_words, rows, words)
    layer_word_index = word_index % layer
    last_sample_bits, ghost_bits = (
        mask.reshape(-1).take(layer_word_index) for mask in _border_masks(grid, rows, words)
    )
    if high == grid.z.count:
        ghost_bits[np.searchsorted(word_index, (high - low - 1) * layer) :] = ALL_INSIDE

    row_end = np.flatnonzero(last_sample_bits)
    corners = []  # the bits of the voxels' eight corners: a word has those of 64 voxels
    for step in (0, words, layer, layer + words):
        word = slab_words.take(word_index + step)
        following = slab_words.take(word_index + (step + 1), mode="clip")
        # The corners one further along x: the word's bits moved down, and the next word's lowest bit on top. Beyond
        # a row's last sample comes that sample again.
        following <<= np.uint64(WORD - 1)
        following[row_end] = 0
        following |= word >> np.uint64(1)
        following |= word & last_sample_bits
        corners += [word, following]
    active, all_inside = corners[0].copy(), corners[0].copy()
    for corner in corners[1:]:
        active |= corner
        all_inside &= corner
    active ^= all_inside  # any corner inside, but not all

    mixed_byte = np.flatnonzero(active.view(np.uint8) != 0)  # of the gathered words
    byte = word_index.take(mixed_byte >> 3)
    byte *= BYTE
    byte += mixed_byte & 7
    slot = np.flatnonzero(_bits_of(active, mixed_byte).view(bool))
    ghost_bits &= active
    ghost_bytes = ghost_bits.view(np.uint8).take(mixed_byte)
    with_ghost = np.flatnonzero(ghost_bytes != 0)
    ghost = np.flatnonzero(np.unpackbits(ghost_bytes.take(with_ghost), bitorder="little"))  # of the bits of those
    ghost_slots = with_ghost.take(ghost >> 3) * BYTE + (ghost & 7)
    cases = np.zeros(BYTE * len(byte), np.uint8)  # by slot
    for corner in reversed(corners):
        cases += cases
        cases |= _bits_of(corner, mixed_byte)
    case = cases.take(slot)
    return Slab(
        low=low,
        high=high,
        unit=grid.unit,
        rows=rows,
        pitch=words * WORD,
        byte=byte,
        slot=slot,
        configuration=case.astype(np.int16),
        ghosts=np.searchsorted(slot, ghost_slots),
        edge_slots=tuple(slot.take(np.flatnonzero(((case ^ case >> (1 << axis)) & 1).view(bool))) for axis in range(3)),
        with_interior=np.zeros(0, np.intp),
        corner_values=np.zeros((0, 8)),
        tables=CLASSIC,
    )


def _mixed_words(slab_words: NDArray[np.uint64], rows: int, words: int) -> NDArray[np.intp]:
    """Return the words that may have an active voxel: not all samples of it and its neighbors are equal."""
    layer = rows * words
    mixed = _any_neighbor(slab_words != 0, words, layer)
    mixed &= _any_neighbor(slab_words != ALL_INSIDE, words, layer)
    for first in range(layer - words, len(mixed), layer):
        mixed[first : first + words] = False  # the repeated row has no voxels
    return np.flatnonzero(mixed)


def _any_neighbor(mask: NDArray[np.bool_], words: int, layer: int) -> NDArray[np.bool_]:
    """Return whether a word or a neighbor toward higher samples is marked; at the ends of rows, too many are."""
    mask[:-1] |= mask[1:]
    mask = mask[:-words] | mask[words:]
    return mask[:-layer] | mask[layer:]


def _border_masks(grid: Grid, rows: int, words: int) -> tuple[NDArray[np.uint64], NDArray[np.uint64]]:
    """Return two masks for the words of a layer (rows, words): the last sample of every row, and all ghost cells."""
    last_sample_bits = np.zeros((rows, words), np.uint64)
    last_sample_bits[:, -1] = np.uint64(1 << (grid.x.count - 1) % WORD)
    ghost_bits = last_sample_bits.copy()
    ghost_bits[grid.y.count - 1] = ALL_INSIDE
    return last_sample_bits, ghost_bits


def _bits_of(words: NDArray[np.uint64], byte_index: NDArray[np.intp]) -> NDArray[np.uint8]:
    """Return the bits of some bytes of the words, as one byte each."""
    return np.unpackbits(words.view(np.uint8).take(byte_index), bitorder="little")
