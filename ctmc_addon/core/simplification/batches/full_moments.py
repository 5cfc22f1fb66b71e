# SPDX-License-Identifier: GPL-3.0-or-later
"""Carry the volume that a component encloses in the full surface from pass to pass.

Passes shrink a component before it goes, and seams cut it. So each batch hangs the moments of its part of every
component at one vertex, and the rows of a component add up to those of the whole, wherever it goes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Doubles, Flags, Indices, Ints
from ...mesh.measures import component_moments_steps
from ...mesh.triangle_mesh import TriangleMesh
from ...progress import Steps


@dataclass(frozen=True, eq=False)
class FullMoments:
    """Moments of parts of components in the full surface; see `component_moments_steps`.

    vertices : (n,) int64
        A vertex of each component: its number in the whole surface, or its index in a batch.
    rows : (n, 8) float64
    """

    vertices: Indices
    rows: Doubles

    def select(self, selected: Flags | Indices) -> FullMoments:
        """Return these of the rows."""
        return FullMoments(self.vertices[selected], self.rows[selected])

    def at(self, vertices: Indices) -> FullMoments:
        """Return the same rows at other vertices."""
        return FullMoments(vertices, self.rows)

    def with_others(self, other: FullMoments) -> FullMoments:
        """Return the rows of both."""
        return FullMoments(np.concatenate([self.vertices, other.vertices]), np.concatenate([self.rows, other.rows]))

    def within(self, numbers: Indices) -> FullMoments:
        """Return the rows at vertices of a batch, (V,) numbers, by their index in it."""
        order = np.argsort(numbers, kind="stable")
        at = np.minimum(np.searchsorted(numbers, self.vertices, sorter=order), len(numbers) - 1)
        index = order[at]
        selected = np.flatnonzero(numbers[index] == self.vertices)
        return FullMoments(index[selected], self.rows[selected])

    def scaled(self, factor: float) -> Doubles:
        """Return the rows with lengths multiplied."""
        area = factor * factor
        return self.rows * np.array([area * factor, *3 * (area,), *3 * (factor,), 1.0])


NOTHING = FullMoments(np.empty(0, np.int64), np.empty((0, 8)))


def full_moments_steps(mesh: TriangleMesh, component: Ints) -> Steps[FullMoments]:
    """Return the moments of every component of a batch of the full surface, by the component of every face, (F,)."""
    rows = yield from component_moments_steps(mesh.vertices, mesh.faces, component)
    return FullMoments(first_indices(component, len(rows), mesh.faces[:, 0]), rows)


def first_indices(component: Ints, count: int, values: Ints | None = None) -> Indices:
    """Return the first index of each of `count` components, or the value there, (count,); -1 for absent ones."""
    first = np.full(count, -1, np.int64)
    first[component[::-1]] = np.arange(len(component))[::-1] if values is None else values[::-1]
    return first
