# SPDX-License-Identifier: GPL-3.0-or-later
"""Exact distances from a lattice's samples to a closed mesh, worked out only where a level passes.

Distances are in mm, positive inside. A distance changes by no more than the way does, so a sample tells on which side
of the levels others are: all samples of a block of 8, 4 or 2 cells a side, by the one in the middle, or its neighbors.
Where a surface was extracted on the lattice, an inside sample with an outside one within 2 mm is closer than 2 mm to
the surface, too: without a measurement it is not above a level of 2 mm. Blocks that are undecided are halved along
each axis. In the end those samples are measured that are corners of cells with corners on both sides of a level.
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
BLOCKS_AT_ONCE = 1 << 14  # Halve this many of them at once.
POINTS_AT_ONCE = 1 << 19
SAMPLES_AT_ONCE = 1 << 23
SLACK = 1 + 2.0**-16  # Reach farther by this factor: distances are rounded to float32.
OPEN, KNOWN, REQUIRED, EXACT = np.arange(4, dtype=np.uint8)  # KNOWN: the value is on the right side of all levels.
WORK_BYTES = 400 << 20  # Blocks of work take this much at most.

Offset = tuple[int, int, int]
CORNERS: tuple[Offset, ...] = tuple((z, y, x) for z in (0, 1) for y in (0, 1) for x in (0, 1))
OFFSETS: tuple[Offset, ...] = tuple((z, y, x) for z in range(3) for y in range(3) for x in range(3))
# Measure the samples of a block of 2 cells a side in this order: its middle, its corners, its sides, its edges.
ORDER = [[offset for offset in OFFSETS if offset.count(1) == odd] for odd in (3, 0, 2, 1)]


def distances_bytes(lattice: Lattice) -> int:
    """Return the bytes that `distances_steps` needs beside the surface, with its result and a mask of the inside."""
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
    """Return the exact signed distance of some samples.

    Parameters
    ----------
    tree : TriangleTree or SignedSurface
    lattice : Lattice
    flat : (n,) int64
        Flat indices of samples.
    inside : (z, y, x) bool, optional
        Which samples are inside; without it, a `SignedSurface` tells.
    budget : Budget, optional
    limit : float
        mm; distances above it are infinite, unless a `SignedSurface` gives the sign.

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
            found = yield from equal_part(unsigned.distances_steps(points, limit, threads), number, len(parts))
            out[part] = np.where(inside[z, y, x], found, -found)
            continue
        if not isinstance(tree, SignedSurface) or not tree.closed:
            raise MeshError("an open surface has no inside; close its border")
        found, _ = yield from equal_part(tree.distances_steps(points, threads), number, len(parts))
        out[part] = -found
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
        Which samples are inside a surface that was extracted on this lattice; without it, a `SignedSurface` tells.
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
    field = _Field(tree, lattice, levels, inside, budget)
    if inside is not None:
        yield from timed_steps(field.near_surface_steps(inside), 0.0, 0.1)
    undecided, _ = yield from timed_steps(field.blocks_steps(), 0.1, 0.2)
    yield from timed_steps(field.halve_steps(undecided), 0.2, 0.6)
    yield from timed_steps(field.required_steps(), 0.6, 1.0)
    return field.values


class _Field:
    """Distances in the making; blocks are the indices of their lowest samples, (3, n) along z, y and x."""

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
        # `inside` tells where a surface that was extracted on this lattice passes.
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
        """Give a value to samples that are surely between the surface and the levels next to it."""
        depth, height, width = self.lattice.shape
        words: Words = np.empty((depth, height, words_of(width)), WORD)
        for part in self.layers:
            words[part] = packed(inside[part])
            yield PAUSE
        near_outside: Words | None = None  # None: all are near enough.
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
            state[:] = KNOWN
            if near_outside is not None:
                state[here & ~unpacked(near_outside[part], width)] = OPEN
            if near_inside is not None:
                state[~here & ~unpacked(near_inside[part], width)] = OPEN
            yield PAUSE

    def blocks_steps(self) -> Steps[Indices]:
        """Give a value to the samples of the largest blocks that are decided; return the others."""
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
            np.copyto(self.state[layers], KNOWN, where=here)
            yield PAUSE
        return low[:, undecided]

    def halve_steps(self, undecided: Indices) -> Steps[None]:
        """Halve blocks until the samples are known whose distance is required."""
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
        """Return a value for the samples of every block, and which blocks it is not good for.

        Blocks with open samples and others are near a level for sure: they are not measured.
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
        """Learn the side of every sample of blocks of 2 cells a side; require the corners of cells on both sides."""
        measured: list[Offset] = []
        for offsets in ORDER:
            found = []
            for offset in offsets:
                self._infer(low, offset, [other for other in measured if _touch(other, offset)])
                yield PAUSE
            for offset in offsets:
                flat = self._flat(np.minimum(low + np.array(offset)[:, None], self.last))
                flat = np.unique(flat[self.state.take(flat) == OPEN])
                self.state.reshape(-1)[flat] = REQUIRED
                found.append(flat)
                yield PAUSE
            yield from self._measure_steps(np.concatenate(found))
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

    def _infer(self, low: Indices, offset: Offset, others: Sequence[Offset]) -> None:
        """Give a value to the open samples at an offset from blocks if an exact one at another tells their side."""
        values, state = self.values.reshape(-1), self.state.reshape(-1)
        for other in others:
            here = np.minimum(low + np.array(offset)[:, None], self.last)
            low = low[:, state.take(self._flat(here)) == OPEN]
            here, there = (np.minimum(low + np.array(each)[:, None], self.last) for each in (offset, other))
            flat, known = self._flat(here), self._flat(there)
            distances = values.take(known)
            tells = (state.take(known) == EXACT) & self._clear(distances, self._between(here, there))
            values[flat[tells]] = distances[tells]
            state[flat[tells]] = KNOWN

    def required_steps(self) -> Steps[None]:
        """Measure all samples that are required; give others the sign of their own side."""
        area = self.lattice.shape[1] * self.lattice.shape[2]
        for number, part in enumerate(self.layers):
            values, state = self.values[part], self.state[part]
            if self.inside is not None:
                here = self.inside[part]
                # In a block on both sides of the surface no level is between it and the surface.
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
        """Return the distances of samples and keep those that are not above the limit."""
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
            values[flat], state[flat] = fill[number], KNOWN

    def _clear(self, distances: Floats, reach: Doubles) -> Flags:
        """Return which distances are farther from every level than `reach`."""
        reach = reach * SLACK
        clear = np.ones(len(distances), bool)
        for level in self.levels:
            clear &= np.abs(distances - level) > reach
        return clear

    def _sides(self, distances: Floats) -> NDArray[np.int16]:
        """Return a number for every distance that tells which levels are below and which are equal."""
        sides = np.zeros(len(distances), np.int16)
        for level in self.levels:
            sides += distances > level
            sides += distances >= level
        return sides

    def _between(self, sample: Indices, *others: Indices) -> Doubles:
        """Return the largest distance of samples (3, n) to a block up to other samples, (n,) mm."""
        squared = np.zeros(sample.shape[1])
        along = []
        for axis, positions in enumerate(self.positions):
            here = positions.take(sample[axis])
            ways = [np.abs(positions.take(other[axis]) - here) for other in others]
            along.append(np.maximum.reduce(ways))
        for first, second in np.ndindex(3, 3):
            if self.products[first, second]:
                squared += self.products[first, second] * along[first] * along[second]
        return np.sqrt(squared)

    def _flat(self, sample: Indices) -> Indices:
        _, height, width = self.lattice.shape
        return np.asarray((sample[0] * height + sample[1]) * width + sample[2])


def _touch(offset: Offset, other: Offset) -> bool:
    return all(abs(first - second) <= 1 for first, second in zip(offset, other, strict=True))


def _has_open_steps(state: Bytes) -> Steps[dict[int, tuple[Flags, Flags]]]:
    """For blocks of 2, 4 and 8 cells a side, tell which have open samples, and which have no other."""
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
    found = {2: (any_open, all_open)}
    for edge in (4, 8):
        for axis in range(3):
            starts = np.arange(0, any_open.shape[axis], 2)
            any_open = np.logical_or.reduceat(any_open, starts, axis=axis)
            all_open = np.logical_and.reduceat(all_open, starts, axis=axis)
            yield PAUSE
        found[edge] = any_open, all_open
    return found


def _halved(flags: Flags, axis: int, of_two: np.ufunc) -> Flags:
    """Combine samples 0 to 2, 2 to 4 and so on along an axis; the last ones are cut short."""
    turned = np.moveaxis(flags, axis, 0)
    out = turned[::2].copy()
    for shift in (1, 2):
        others = turned[shift::2]
        of_two(out[: len(others)], others, out=out[: len(others)])
    return np.moveaxis(out, 0, axis)


def _on_both_sides(inside: Flags, layers: slice) -> Flags:
    """Return which samples of some layers are corners of cells with corners on both sides."""
    first = max(0, layers.start - 1)
    any_inside = all_inside = inside[first : layers.stop + 1]
    for axis in range(3):
        any_inside, all_inside = _pairs(any_inside, axis, np.logical_or), _pairs(all_inside, axis, np.logical_and)
    passed = any_inside & ~all_inside  # a cell each
    for axis in range(3):
        passed = _pairs(np.pad(passed, [(int(each == axis),) * 2 for each in range(3)]), axis, np.logical_or)
    return passed[layers.start - first :][: layers.stop - layers.start]


def _pairs(flags: Flags, axis: int, of_two: np.ufunc) -> Flags:
    """Combine every two neighbors along an axis."""
    turned = np.moveaxis(flags, axis, 0)
    return np.moveaxis(np.asarray(of_two(turned[:-1], turned[1:])), 0, axis)
