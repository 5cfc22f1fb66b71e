# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure exact distances from the samples of a lattice to a closed mesh, only where a level passes.

Distances are in mm, positive inside. Between two points the distance changes by no more than they are apart, so one
sample decides on which side of the levels samples near it are: the middle one for a block of 8, 4 or 2 cells a side.
If the surface was extracted on the lattice, an inside sample with an outside one within 2 mm is closer than 2 mm to
the surface, so it is not above a level of 2 mm, without a measurement. Undecided blocks are halved along each axis. At
the end, samples are measured if they are corners of a cell with corners on both sides of a level.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...arrays import Bytes, Doubles, Flags, Floats, Indices
from ...errors import MeshError
from ...machine.budget import Budget
from ...machine.parallel import parts_of
from ...mesh.distance.signed_distance import SignedSurface
from ...mesh.distance.triangle_tree import TriangleTree
from ...progress import PAUSE, Steps, equal_part, timed_steps
from .lattice import Lattice
from .nearby import WORD, Words, nearby_steps, packed, unpacked, words_of

LARGEST = 8  # Begin with blocks of this many cells a side.
BLOCKS_AT_ONCE = 1 << 14  # Halve this many blocks at once.
POINTS_AT_ONCE = 1 << 19
SAMPLES_AT_ONCE = 1 << 23
SLACK = 1 + 2.0**-16  # Extend reaches by this factor, because distances are rounded to float32.
OPEN, DECIDED, REQUIRED, EXACT = np.arange(4, dtype=np.uint8)
"""State of a sample; the value of a decided one is on the right side of all levels."""
WORK_BYTES = 400 << 20  # Blocks in work take at most this many bytes.

Offset = tuple[int, int, int]
CORNERS: tuple[Offset, ...] = tuple((z, y, x) for z in (0, 1) for y in (0, 1) for x in (0, 1))
OFFSETS: tuple[Offset, ...] = tuple((z, y, x) for z in range(3) for y in range(3) for x in range(3))
# Measure the samples of a block of 2 cells a side in this order: its middle, its corners, its sides, its edges.
ORDER = [[offset for offset in OFFSETS if offset.count(1) == odd] for odd in (3, 0, 2, 1)]


def distances_bytes(lattice: Lattice) -> int:
    """Return the bytes that `distances_steps` needs for its work, its result and a mask of the inside."""
    depth, height, width = lattice.shape
    return 7 * depth * height * width + WORK_BYTES


def at_samples_steps(
    tree: TriangleTree | SignedSurface,
    lattice: Lattice,
    flat: Indices,
    inside: Flags | None,
    budget: Budget | None = None,
    limit: float = np.inf,
) -> Steps[Floats]:
    """Return the exact signed distance of samples.

    Parameters
    ----------
    tree : TriangleTree or SignedSurface
    lattice : Lattice
    flat : (n,) int64
        Flat indices of samples.
    inside : (z, y, x) bool, optional
        Whether each sample is inside; by default, a `SignedSurface` decides.
    budget : Budget, optional
    limit : float
        Distances above this many mm are infinite, unless a `SignedSurface` gives the sign.

    Returns
    -------
    (n,) float32
        mm, positive inside.

    Raises
    ------
    MeshError
        If nothing tells which side is inside.
    """
    threads = (budget or Budget()).thread_count
    out = np.empty(len(flat), np.float32)
    parts = parts_of(len(flat), POINTS_AT_ONCE)
    for number, part in enumerate(parts):
        z, y, x = np.unravel_index(flat[part], lattice.shape)
        points = lattice.points(x, y, z).T
        if inside is not None:
            unsigned = tree.tree if isinstance(tree, SignedSurface) else tree
            distances = yield from equal_part(unsigned.distances_steps(points, limit, threads), number, len(parts))
            out[part] = np.where(inside[z, y, x], distances, -distances)
            continue
        if not isinstance(tree, SignedSurface) or not tree.closed:
            raise MeshError("an open surface has no inside; close its border")
        distances, _ = yield from equal_part(tree.distances_steps(points, threads), number, len(parts))
        out[part] = -distances
    return out


def distances_steps(
    tree: TriangleTree | SignedSurface,
    lattice: Lattice,
    levels: Sequence[float],
    inside: Flags | None,
    budget: Budget | None = None,
) -> Steps[Floats]:
    """Return signed distances that are exact wherever a level passes.

    Parameters
    ----------
    tree : TriangleTree or SignedSurface
        The surface.
    lattice : Lattice
    levels : sequence of float
        mm, positive inside.
    inside : (z, y, x) bool, optional
        Whether each sample is inside a surface extracted on this lattice; by default, a `SignedSurface` decides.
    budget : Budget, optional

    Returns
    -------
    (z, y, x) float32
        mm, positive inside. Exact at all eight corners of every cell with corners on both sides of a level, or at it;
        elsewhere on the right side of every level, and of 0 where `inside` is given.

    Raises
    ------
    MeshError
        If nothing tells which side is inside.
    """
    field = _LevelDistances(tree, lattice, levels, inside, budget)
    if inside is not None:
        yield from timed_steps(field.near_surface_steps(inside), 0.0, 0.1)
    undecided, _ = yield from timed_steps(field.blocks_steps(), 0.1, 0.2)
    yield from timed_steps(field.halve_steps(undecided), 0.2, 0.6)
    yield from timed_steps(field.required_steps(), 0.6, 1.0)
    return field.values


class _LevelDistances:
    """Distances while they are measured. A block is given by its lowest sample, (3, n) along z, y and x."""

    def __init__(
        self,
        tree: TriangleTree | SignedSurface,
        lattice: Lattice,
        levels: Sequence[float],
        inside: Flags | None,
        budget: Budget | None,
    ) -> None:
        self.tree, self.lattice, self.inside, self.budget = tree, lattice, inside, budget
        self.positions = lattice.z, lattice.y, lattice.x
        self.last = np.array(lattice.shape)[:, None] - 1
        axes = lattice.affine[:3, 2::-1]
        self.products = np.abs((axes[:, :, None] * axes[:, None, :]).sum(axis=0))
        given = np.array(levels, np.float64)
        # `inside` shows where a surface extracted on this lattice passes.
        self.at_surface = inside is not None and bool((given == 0.0).any())
        self.levels = np.unique(given[given != 0.0] if inside is not None else given)
        self.most = float(np.abs(self.levels).max(initial=0.0))
        self.far = float(self._between(np.zeros((3, 1), np.int64), self.last)[0]) + self.most + 1.0
        self.lowest = float(self.levels[self.levels > 0].min(initial=2 * self.far))
        self.highest = float(self.levels[self.levels < 0].max(initial=-2 * self.far))
        self.values: Floats = np.empty(lattice.shape, np.float32)
        self.state: Bytes = np.zeros(lattice.shape, np.uint8)
        self.layers = parts_of(lattice.shape[0], max(1, SAMPLES_AT_ONCE // (lattice.shape[1] * lattice.shape[2])))

    def near_surface_steps(self, inside: Flags) -> Steps[None]:
        """Give a value to samples that certainly lie between the surface and the levels next to it."""
        depth, height, width = self.lattice.shape
        words: Words = np.empty((depth, height, words_of(width)), WORD)
        for part in self.layers:
            words[part] = packed(inside[part])
            yield PAUSE
        near_outside: Words | None = None  # None if all are near enough.
        near_inside: Words | None = None
        if self.lowest < self.far:
            near_outside = yield from equal_part(
                nearby_steps(np.invert(words), self.lattice, self.lowest, self.budget), 0, 2
            )
        if self.highest > -self.far:
            near_inside = yield from equal_part(nearby_steps(words, self.lattice, -self.highest, self.budget), 1, 2)
        for part in self.layers:
            here, values, state = inside[part], self.values[part], self.state[part]
            values[:] = np.where(here, np.float32(self.lowest / 2), np.float32(self.highest / 2))
            state[:] = DECIDED
            if near_outside is not None:
                state[here & ~unpacked(near_outside[part], width)] = OPEN
            if near_inside is not None:
                state[~here & ~unpacked(near_inside[part], width)] = OPEN
            yield PAUSE

    def blocks_steps(self) -> Steps[Indices]:
        """Give a value to the samples of the largest blocks that are decided; return the undecided blocks."""
        self.has_open = (yield from _has_open_steps(self.state)) if self.inside is not None else None
        counts = tuple(-(-size // LARGEST) for size in self.lattice.shape)
        low = np.stack(np.unravel_index(np.arange(counts[0] * counts[1] * counts[2]), counts)) * LARGEST
        fill, undecided = yield from self._decide_steps(low, LARGEST)
        _, height, width = self.lattice.shape
        for number, (row, open_row) in enumerate(zip(fill.reshape(counts), undecided.reshape(counts), strict=True)):
            layers = slice(number * LARGEST, (number + 1) * LARGEST)
            of_samples, open_ = (
                np.repeat(np.repeat(each, LARGEST, axis=0), LARGEST, axis=1)[:height, :width]
                for each in (row, open_row)
            )
            here = (self.state[layers] == OPEN) & ~open_
            np.copyto(self.values[layers], of_samples, where=here)
            np.copyto(self.state[layers], DECIDED, where=here)
            yield PAUSE
        return low[:, undecided]

    def halve_steps(self, undecided: Indices) -> Steps[None]:
        """Halve blocks until it is clear which distances are required."""
        parts = parts_of(undecided.shape[1], BLOCKS_AT_ONCE)
        for number, part in enumerate(parts):
            low, edge = undecided[:, part], LARGEST
            while edge > 2:
                edge //= 2
                low = np.concatenate([low + np.array(corner)[:, None] * edge for corner in CORNERS], axis=1)
                low = low[:, (low <= self.last).all(axis=0)]
                fill, still = yield from equal_part(self._decide_steps(low, edge), number, len(parts))
                self._fill(low[:, ~still], edge, fill[~still])
                low = low[:, still]
                yield PAUSE
            yield from equal_part(self._samples_steps(low), number, len(parts))

    def _decide_steps(self, low: Indices, edge: int) -> Steps[tuple[Floats, Flags]]:
        """Return a value for the samples of every block, and the blocks that stay undecided.

        Blocks with only some open samples are certainly near a level, so they are not measured.
        """
        fill = np.zeros(low.shape[1], np.float32)
        undecided, asked = np.zeros(low.shape[1], bool), np.arange(low.shape[1])
        if self.has_open is not None:
            any_open, all_open = (flags[tuple(low // edge)] for flags in self.has_open[edge])
            undecided[:] = any_open & ~all_open
            asked = np.flatnonzero(all_open)
        if not len(asked):
            return fill, undecided
        low = low[:, asked]
        center, high = np.minimum(low + edge // 2, self.last), np.minimum(low + edge, self.last)
        radius = self._between(center, low, high)
        limit = float(radius.max() * SLACK + self.most)
        distances = yield from self._measure_steps(self._flat(center), limit)
        finite = np.isfinite(distances)
        fill[asked] = np.copysign(np.where(finite, np.abs(distances) + radius, self.far), distances)
        undecided[asked] = ~self._clear(distances, radius)
        return fill, undecided

    def _samples_steps(self, low: Indices) -> Steps[None]:
        """Decide the side of every sample in blocks of 2 cells a side; require the corners of cells on both sides."""
        measured: list[Offset] = []
        for offsets in ORDER:
            required_flat = []
            for offset in offsets:
                self._infer(low, offset, [earlier for earlier in measured if _touch(earlier, offset)])
                yield PAUSE
            for offset in offsets:
                flat = self._flat(np.minimum(low + np.array(offset)[:, None], self.last))
                flat = np.unique(flat[self.state.take(flat) == OPEN])
                self.state.reshape(-1)[flat] = REQUIRED
                required_flat.append(flat)
                yield PAUSE
            yield from self._measure_steps(np.concatenate(required_flat))
            measured += offsets
        sides = {}
        for offset in OFFSETS:
            sides[offset] = self._sides(
                self.values.take(self._flat(np.minimum(low + np.array(offset)[:, None], self.last)))
            )
        yield PAUSE
        passed = {}
        for cell in CORNERS:
            around = [sides[(cell[0] + z, cell[1] + y, cell[2] + x)] for z, y, x in CORNERS]
            passed[cell] = np.zeros(low.shape[1], bool)
            for each in around[1:]:
                passed[cell] |= each != around[0]
            yield PAUSE
        for offset in OFFSETS:
            required = np.zeros(low.shape[1], bool)
            for cell in CORNERS:
                if all(first <= along <= first + 1 for first, along in zip(cell, offset, strict=True)):
                    required |= passed[cell]
            flat = self._flat(np.minimum(low[:, required] + np.array(offset)[:, None], self.last))
            self.state.reshape(-1)[flat[self.state.take(flat) != EXACT]] = REQUIRED
            yield PAUSE

    def _infer(self, low: Indices, offset: Offset, neighbors: Sequence[Offset]) -> None:
        """Give a value to the open samples at an offset in blocks if an exact one at another offset decides it."""
        values, state = self.values.reshape(-1), self.state.reshape(-1)
        for neighbor in neighbors:
            here = np.minimum(low + np.array(offset)[:, None], self.last)
            low = low[:, state.take(self._flat(here)) == OPEN]
            here, there = (np.minimum(low + np.array(each)[:, None], self.last) for each in (offset, neighbor))
            flat, flat_neighbor = self._flat(here), self._flat(there)
            distances = values.take(flat_neighbor)
            tells = (state.take(flat_neighbor) == EXACT) & self._clear(distances, self._between(here, there))
            values[flat[tells]] = distances[tells]
            state[flat[tells]] = DECIDED

    def required_steps(self) -> Steps[None]:
        """Measure all required samples; give the rest the sign of their own side."""
        area = self.lattice.shape[1] * self.lattice.shape[2]
        for number, part in enumerate(self.layers):
            values, state = self.values[part], self.state[part]
            if self.inside is not None:
                here = self.inside[part]
                # In a block on both sides of the surface, no level lies between a sample and the surface.
                wrong = ((values > 0) != here) & (state != EXACT)
                values[wrong] = np.where(here[wrong], self.lowest / 2, self.highest / 2)
                yield PAUSE
                if self.at_surface:
                    state[_on_both_sides(self.inside, part) & (state != EXACT)] = REQUIRED
                    yield PAUSE
            flat = np.flatnonzero(state == REQUIRED) + part.start * area
            yield PAUSE
            yield from equal_part(self._measure_steps(flat), number, len(self.layers))

    def _measure_steps(self, flat: Indices, limit: float = np.inf) -> Steps[Floats]:
        """Measure samples, and keep the distances up to the limit."""
        distances = yield from at_samples_steps(self.tree, self.lattice, flat, self.inside, self.budget, limit)
        finite = np.isfinite(distances)
        self.values.reshape(-1)[flat[finite]] = distances[finite]
        self.state.reshape(-1)[flat[finite]] = EXACT
        return distances

    def _fill(self, low: Indices, edge: int, fill: Floats) -> None:
        """Give a value to the open samples of decided blocks."""
        values, state = self.values.reshape(-1), self.state.reshape(-1)
        for offset in np.ndindex(edge, edge, edge):
            each = low + np.array(offset)[:, None]
            number = np.flatnonzero((each <= self.last).all(axis=0))
            flat = self._flat(each[:, number])
            is_open = state.take(flat) == OPEN
            flat, number = flat[is_open], number[is_open]
            values[flat], state[flat] = fill[number], DECIDED

    def _clear(self, distances: Floats, reach: Doubles) -> Flags:
        """Return whether each distance is farther than `reach` from every level."""
        reach = reach * SLACK
        clear = np.ones(len(distances), bool)
        for level in self.levels:
            clear &= np.abs(distances - level) > reach
        return clear

    def _sides(self, distances: Floats) -> NDArray[np.int16]:
        """Return a number for every distance: equal if the same levels are below and equal to it."""
        sides = np.zeros(len(distances), np.int16)
        for level in self.levels:
            sides += distances > level
            sides += distances >= level
        return sides

    def _between(self, sample: Indices, *corners: Indices) -> Doubles:
        """Return the largest distance of samples (3, n) to any corner of a block, (n,) mm."""
        squared = np.zeros(sample.shape[1])
        along = []
        for axis, positions in enumerate(self.positions):
            here = positions.take(sample[axis])
            ways = [np.abs(positions.take(corner[axis]) - here) for corner in corners]
            along.append(np.maximum.reduce(ways))
        for first, second in np.ndindex(3, 3):
            if self.products[first, second]:
                squared += self.products[first, second] * along[first] * along[second]
        return np.sqrt(squared)

    def _flat(self, sample: Indices) -> Indices:
        _, height, width = self.lattice.shape
        return np.asarray((sample[0] * height + sample[1]) * width + sample[2])


def _touch(offset: Offset, neighbor: Offset) -> bool:
    return all(abs(first - second) <= 1 for first, second in zip(offset, neighbor, strict=True))


def _has_open_steps(state: Bytes) -> Steps[dict[int, tuple[Flags, Flags]]]:
    """Return whether blocks of 2, 4 and 8 cells a side have any open samples, and whether all are open."""
    any_parts: list[Flags] = []
    all_parts: list[Flags] = []
    layers = max(2, SAMPLES_AT_ONCE // state[0].size // 2 * 2)
    for start in range(0, len(state), layers):
        part = state[start : start + layers + 1] == OPEN
        last = start + layers >= len(state)
        for parts, of_two in ((any_parts, np.logical_or), (all_parts, np.logical_and)):
            reduced = part
            for axis in range(3):
                reduced = _halved(reduced, axis, of_two)
            parts.append(reduced if last else reduced[: layers // 2])
            yield PAUSE
    any_open, all_open = np.concatenate(any_parts), np.concatenate(all_parts)
    flags_by_edge = {2: (any_open, all_open)}
    for edge in (4, 8):
        for axis in range(3):
            starts = np.arange(0, any_open.shape[axis], 2)
            any_open = np.logical_or.reduceat(any_open, starts, axis=axis)
            all_open = np.logical_and.reduceat(all_open, starts, axis=axis)
            yield PAUSE
        flags_by_edge[edge] = any_open, all_open
    return flags_by_edge


def _halved(flags: Flags, axis: int, of_two: np.ufunc) -> Flags:
    """Combine samples 0 to 2, 2 to 4 and so on along an axis; the last group may have fewer."""
    turned = np.moveaxis(flags, axis, 0)
    out = turned[::2].copy()
    for shift in (1, 2):
        seconds = turned[shift::2]
        of_two(out[: len(seconds)], seconds, out=out[: len(seconds)])
    return np.moveaxis(out, 0, axis)


def _on_both_sides(inside: Flags, layers: slice) -> Flags:
    """Return whether each sample of some layers is a corner of a cell with corners on both sides."""
    first = max(0, layers.start - 1)
    any_inside = all_inside = inside[first : layers.stop + 1]
    for axis in range(3):
        any_inside, all_inside = _pairs(any_inside, axis, np.logical_or), _pairs(all_inside, axis, np.logical_and)
    passed = any_inside & ~all_inside  # One value for each cell.
    for axis in range(3):
        passed = _pairs(np.pad(passed, [(int(each == axis),) * 2 for each in range(3)]), axis, np.logical_or)
    return passed[layers.start - first :][: layers.stop - layers.start]


def _pairs(flags: Flags, axis: int, of_two: np.ufunc) -> Flags:
    """Combine each two neighbors along an axis."""
    turned = np.moveaxis(flags, axis, 0)
    return np.moveaxis(np.asarray(of_two(turned[:-1], turned[1:])), 0, axis)
