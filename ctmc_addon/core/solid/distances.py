# SPDX-License-Identifier: GPL-3.0-or-later
"""Exact distances from a lattice's samples to a closed mesh, worked out only where a level passes.

Distances are in mm, positive inside. A distance changes by no more than the way does: a block of cells around a sample
is decided if the sample is farther from every level than from the corners of the block. Other blocks are halved along
each axis. Each block of 8, 4 and 2 cells a side has a sample in its middle, so every distance serves as a result too.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..arrays import Bytes, Doubles, Flags, Floats, Indices
from ..errors import MeshError
from ..machine.budget import Budget
from ..machine.parallel import parts_of
from ..mesh.distance.signed_distance import SignedSurface
from ..mesh.distance.triangle_tree import TriangleTree
from ..progress import PAUSE, Steps, equal_part, timed_steps
from .lattice import Lattice

LARGEST = 8  # Begin with blocks of this many cells a side.
BLOCKS_AT_ONCE = 1 << 14  # Halve this many of them at once.
POINTS_AT_ONCE = 1 << 19
SAMPLES_AT_ONCE = 1 << 23
SLACK = 1 + 2.0**-16  # Reach farther by this factor: distances are rounded to float32.
EXACT, REQUIRED = np.uint8(1), np.uint8(2)
WORK_BYTES = 400 << 20  # What blocks of work take at most.

CORNERS = tuple((z, y, x) for z in (0, 1) for y in (0, 1) for x in (0, 1))


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
        mm, positive inside. Exact at all eight corners of every cell that may hold a point at one of the levels;
        elsewhere on the right side of every level, and of 0 where `inside` is given.

    Raises
    ------
    MeshError
        If nothing tells which side is inside.
    """
    field = _Field(tree, lattice, levels, inside, budget)
    undecided, _ = yield from timed_steps(field.coarse_steps(), 0.0, 0.1)
    yield from timed_steps(field.fine_steps(undecided), 0.1, 0.5)
    yield from timed_steps(field.required_steps(), 0.5, 1.0)
    return field.values


class _Field:
    """Distances in the making; blocks are the numbers of their lowest samples, (3, n) along z, y and x."""

    def __init__(
        self,
        tree: TriangleTree | SignedSurface,
        lattice: Lattice,
        levels: Sequence[float],
        inside: Flags | None,
        budget: Budget | None,
    ) -> None:
        self.tree, self.lattice, self.inside, self.budget = tree, lattice, inside, budget
        self.last = np.array(lattice.shape)[:, None] - 1
        axes = lattice.affine[:3, 2::-1]
        self.products = np.abs((axes[:, :, None] * axes[:, None, :]).sum(axis=0))
        given = np.array(levels, np.float64)
        # A surface that was extracted on this lattice passes the cells with corners on both sides: see `_mixed`.
        self.surface = inside is not None and bool((given == 0.0).any())
        self.levels = np.unique(given[given != 0.0] if inside is not None else given)
        whole = self._length(np.stack([abs(each[-1:] - each[0]) for each in self._positions]))
        self.far = float(whole[0] + np.abs(self.levels).max(initial=0.0) + 1.0)
        self.values: Floats = np.empty(lattice.shape, np.float32)
        self.state: Bytes = np.zeros(lattice.shape, np.uint8)

    @property
    def _positions(self) -> tuple[Doubles, Doubles, Doubles]:
        return self.lattice.z, self.lattice.y, self.lattice.x

    def coarse_steps(self) -> Steps[Indices]:
        """Write a value for every sample from the largest blocks; return those that are undecided."""
        self.sides = (yield from _sides_steps(self.inside)) if self.inside is not None else None
        counts = tuple(-(-size // LARGEST) for size in self.lattice.shape)
        low = np.stack(np.unravel_index(np.arange(counts[0] * counts[1] * counts[2]), counts)) * LARGEST
        fill, undecided = yield from self._decide_steps(low, LARGEST)
        of_blocks = fill.reshape(counts)
        for number, layer in enumerate(of_blocks):
            whole = np.repeat(np.repeat(layer, LARGEST, axis=0), LARGEST, axis=1)
            layers = slice(number * LARGEST, (number + 1) * LARGEST)
            _, height, width = self.lattice.shape
            np.copyto(self.values[layers], whole[:height, :width], where=self.state[layers] != EXACT)
            yield PAUSE
        return low[:, undecided]

    def fine_steps(self, undecided: Indices) -> Steps[None]:
        """Halve blocks until the samples are known whose distance is required."""
        parts = parts_of(undecided.shape[1], BLOCKS_AT_ONCE)
        for number, part in enumerate(parts):
            yield from equal_part(self._halve_steps(undecided[:, part]), number, len(parts))

    def _halve_steps(self, low: Indices) -> Steps[None]:
        edge = LARGEST
        while edge > 2:
            edge //= 2
            low = np.concatenate([low + np.array(corner)[:, None] * edge for corner in CORNERS], axis=1)
            low = low[:, (low <= self.last).all(axis=0)]
            fill, undecided = yield from self._decide_steps(low, edge)
            decided = ~undecided
            self._fill(low[:, decided], edge, fill[decided])
            low = low[:, undecided]
            yield PAUSE
        if low.size:
            yield from self._cells_steps(low)

    def _decide_steps(self, low: Indices, edge: int) -> Steps[tuple[Floats, Flags]]:
        """Return a value for the samples of every block, and which blocks it is not good for."""
        low_ends, high_ends = low, np.minimum(low + edge, self.last)
        center = np.minimum(low + edge // 2, self.last)
        reach = np.empty(low.shape)
        for axis, positions in enumerate(self._positions):
            middle = positions.take(center[axis])
            reach[axis] = np.maximum(middle - positions.take(low_ends[axis]), positions.take(high_ends[axis]) - middle)
        radius = self._length(reach)
        fill = np.full(low.shape[1], -self.far, np.float32)
        undecided = np.zeros(low.shape[1], bool)
        concerned = np.ones(low.shape[1], bool)
        if self.sides is not None:
            has_inside, has_outside = (flags[tuple(low // edge)] for flags in self.sides[edge])
            fill[has_inside] = self.far
            concerned = has_inside & bool((self.levels > 0).any()) | has_outside & bool((self.levels < 0).any())
        near = np.flatnonzero(concerned)
        if not len(near):
            return fill, undecided
        radius = radius[near]
        limit = float(radius.max() * SLACK + np.abs(self.levels).max(initial=0.0))
        distances = yield from self._measure_steps(self._flat(center[:, near]), limit)
        fill[near] = np.where(
            np.isfinite(distances), distances + np.copysign(radius, distances), np.copysign(self.far, distances)
        )
        undecided[near] = ~self._clear(distances, radius)
        return fill, undecided

    def _cells_steps(self, low: Indices) -> Steps[None]:
        """Require the corners of the cells, of blocks of 2 cells a side, that a level may pass."""
        middle = np.minimum(low + 1, self.last)
        center = self.values.take(self._flat(middle))
        self._fill(low, 2, center)
        outer = [np.minimum(low + 2 * np.array(corner)[:, None], self.last) for corner in CORNERS]
        for each in outer:
            self._require(self._flat(each))
        yield PAUSE
        yield from self._required_of_steps(int(low[0].min()), int(low[0].max()) + 3)
        passed = np.empty((8, low.shape[1]), bool)
        side = self._side(center)
        for number, corner in enumerate(outer):
            sides = np.stack(
                [
                    np.abs(along.take(corner[axis]) - along.take(middle[axis]))
                    for axis, along in enumerate(self._positions)
                ]
            )
            diagonal = self._length(sides)
            value = self.values.take(self._flat(corner))
            # Every point of a cell is within this of one or the other end of a diagonal: a sum of squares tells.
            between = diagonal * np.sqrt(0.5)
            clear = self._clear(center, between) & self._clear(value, between) & (self._side(value) == side)
            passed[number] = ~(clear | self._clear(value, diagonal))
            yield PAUSE
        for offset in np.ndindex(3, 3, 3):
            cells = [
                number
                for number, corner in enumerate(CORNERS)
                if all(of_cell <= along <= of_cell + 1 for of_cell, along in zip(corner, offset, strict=True))
            ]
            here = low[:, passed[cells].any(axis=0)] + np.array(offset)[:, None]
            self._require(self._flat(np.minimum(here, self.last)))
            yield PAUSE

    def required_steps(self) -> Steps[None]:
        """Measure all samples that are required; give others the sign of their side."""
        depth, height, width = self.lattice.shape
        layers = parts_of(depth, max(1, SAMPLES_AT_ONCE // (height * width)))
        for number, part in enumerate(layers):
            if self.inside is not None:
                if self.surface:
                    self._require_mixed(part)
                    yield PAUSE
                self._give_signs(part, self.inside)
                yield PAUSE
            yield from equal_part(self._required_of_steps(part.start, part.stop), number, len(layers))

    def _required_of_steps(self, start: int, stop: int) -> Steps[None]:
        """Measure the samples of some layers that are required."""
        area = self.lattice.shape[1] * self.lattice.shape[2]
        flat = np.flatnonzero(self.state[start:stop] == REQUIRED) + start * area
        yield from self._measure_steps(flat)

    def _measure_steps(self, flat: Indices, limit: float = np.inf) -> Steps[Floats]:
        """Return the distances of samples and keep those that are not above the limit."""
        distances = yield from at_samples_steps(self.tree, self.lattice, flat, self.inside, self.budget, limit)
        finite = np.isfinite(distances)
        self.values.reshape(-1)[flat[finite]] = distances[finite]
        self.state.reshape(-1)[flat[finite]] = EXACT
        return distances

    def _require(self, flat: Indices) -> None:
        state = self.state.reshape(-1)
        state[flat[state.take(flat) == 0]] = REQUIRED

    def _require_mixed(self, layers: slice) -> None:
        """Require the corners of cells with corners on both sides, in some layers."""
        assert self.inside is not None
        first, end = max(0, layers.start - 1), layers.stop + 1
        any_inside = all_inside = self.inside[first:end]
        for axis in range(3):
            any_inside, all_inside = _pairs(any_inside, axis, np.logical_or), _pairs(all_inside, axis, np.logical_and)
        passed = any_inside & ~all_inside  # (layers of cells)
        for axis in range(3):
            edge = [(int(each == axis),) * 2 for each in range(3)]
            passed = _pairs(np.pad(passed, edge), axis, np.logical_or)
        here = passed[layers.start - first :][: layers.stop - layers.start]
        state = self.state[layers]
        np.copyto(state, REQUIRED, where=here & (state == 0))

    def _give_signs(self, layers: slice, inside: Flags) -> None:
        """Put samples that are not exact, of blocks on both sides of the surface, on their own side of it."""
        values, inside = self.values[layers], inside[layers]
        wrong = np.flatnonzero(((values > 0) != inside) & (self.state[layers] != EXACT))
        positive = self.levels[self.levels > 0].min(initial=2 * self.far) / 2
        negative = self.levels[self.levels < 0].max(initial=-2 * self.far) / 2
        values.reshape(-1)[wrong] = np.where(inside.reshape(-1)[wrong], positive, negative)

    def _fill(self, low: Indices, edge: int, fill: Floats) -> None:
        """Write a value for the samples of every block that are not exact."""
        values, state = self.values.reshape(-1), self.state.reshape(-1)
        for offset in np.ndindex(edge, edge, edge):
            each = low + np.array(offset)[:, None]
            within = (each <= self.last).all(axis=0)
            flat = self._flat(each)
            within[within] = state.take(flat[within]) != EXACT
            values[flat[within]] = fill[within]

    def _clear(self, distances: Floats, reach: Doubles) -> Flags:
        """Return which distances are farther from every level than `reach`."""
        reach = reach * SLACK
        clear = np.ones(len(distances), bool)
        for level in self.levels:
            clear &= np.abs(distances - level) > reach
        return clear

    def _side(self, distances: Floats) -> NDArray[np.intp]:
        """Return how many levels are below every distance."""
        return np.searchsorted(self.levels, distances)

    def _length(self, along: Doubles) -> Doubles:
        """Return the length of the longest diagonal of blocks with sides (3, n) in index space, mm."""
        squared = np.zeros(along.shape[1])
        for first, second in np.ndindex(3, 3):
            squared += self.products[first, second] * along[first] * along[second]
        return np.sqrt(squared)

    def _flat(self, sample: Indices) -> Indices:
        _, height, width = self.lattice.shape
        return np.asarray((sample[0] * height + sample[1]) * width + sample[2])


def _sides_steps(inside: Flags) -> Steps[dict[int, tuple[Flags, Flags]]]:
    """For blocks of 2, 4 and 8 cells a side, tell which have corners inside and which have corners outside."""
    any_parts: list[Flags] = []
    all_parts: list[Flags] = []
    layers = max(2, SAMPLES_AT_ONCE // inside[0].size // 2 * 2)
    for start in range(0, len(inside), layers):
        part = inside[start : start + layers + 1]
        last = start + layers >= len(inside)
        for parts, of_two in ((any_parts, np.logical_or), (all_parts, np.logical_and)):
            reduced = part
            for axis in range(3):
                reduced = _halved(reduced, axis, of_two)
                yield PAUSE
            parts.append(reduced if last else reduced[: layers // 2])
    has_inside, has_outside = np.concatenate(any_parts), ~np.concatenate(all_parts)
    sides = {2: (has_inside, has_outside)}
    for edge in (4, 8):
        for axis in range(3):
            has_inside, has_outside = (
                np.logical_or.reduceat(flags, np.arange(0, flags.shape[axis], 2), axis=axis)
                for flags in (has_inside, has_outside)
            )
            yield PAUSE
        sides[edge] = has_inside, has_outside
    return sides


def _halved(flags: Flags, axis: int, of_two: np.ufunc) -> Flags:
    """Combine samples 0 to 2, 2 to 4 and so on along an axis; the last ones are cut short."""
    turned = np.moveaxis(flags, axis, 0)
    out = turned[::2].copy()
    for shift in (1, 2):
        others = turned[shift::2]
        of_two(out[: len(others)], others, out=out[: len(others)])
    return np.moveaxis(out, 0, axis)


def _pairs(flags: Flags, axis: int, of_two: np.ufunc) -> Flags:
    """Combine every two neighbors along an axis."""
    turned = np.moveaxis(flags, axis, 0)
    return np.moveaxis(np.asarray(of_two(turned[:-1], turned[1:])), 0, axis)
