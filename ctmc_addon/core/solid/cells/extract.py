# SPDX-License-Identifier: GPL-3.0-or-later
"""Extract parts from several fields at once, with straight rims where two of their surfaces meet.

The signs of fields decide the part, such as "inside the structure and above the plane". Where only one field changes
sign in a cell, Marching Cubes makes the surface. A cell in which two or more matter is cut into six tetrahedra (Kuhn
1960), in which all fields are linear: there surfaces cut each other exactly (arrangement.py), rims are straight, and
walls thinner than a cell stay whole. Every piece lies in its own cell, and cells agree on their common faces, so parts
are closed and do not cross; parts that touch share their triangles.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...arrays import Doubles, Flags
from ...errors import MeshError
from ...extraction.case_table import FACES, NEAREST
from ...extraction.grid import Axis
from ...extraction.interfaces.bands import band_ranges, fill_band, find_band
from ...extraction.interfaces.owners import Owners
from ...machine.budget import Budget
from ...machine.parallel import map_steps
from ...mesh.intersections import self_intersections_steps
from ...mesh.labels.label_complex import ComplexMesh
from ...progress import PAUSE, Stages, Steps
from ...volume.affine import to_index, transform_faces, transform_points
from .chords import depths_steps, gradients_steps
from .recipe import MOST_FIELDS, Recipe
from .rims import CutRims, cut_rims_steps, straighten, touches_rims
from .stitch import stitched

STAGES = {
    "Assigning samples to parts": 2,
    "Finding rims": 1,
    "Triangulating cells": 3,
    "Cutting rims": 4,
    "Placing vertices": 3,
}
POINTS_AT_ONCE = 1 << 18
MOVES = (0.0, 1 / 64, 1 / 48, 1 / 40)  # Shares of the shortest step to move fields by, in order.


class Extracted(NamedTuple):
    """The surfaces of all parts.

    Parameters
    ----------
    mesh : ComplexMesh
        RAS+ mm; the sides of triangles are parts, 0 for none.
    crossings : (n, 2) int64
        Pairs of triangles that still cross after fields were moved; usually none.
    recipe : Recipe
        The recipe with its fields moved.
    """

    mesh: ComplexMesh
    crossings: NDArray[np.int64]
    recipe: Recipe


def extract_parts_steps(recipe: Recipe, budget: Budget) -> Steps[Extracted]:
    """Return the surfaces of all parts.

    If rounding makes triangles of rims cross, which is rare, shapes and the walls between structures are moved a little
    and cut again. The same is done if two surfaces coincide where a third one meets them, because no order of their
    zeros is right there.

    Raises
    ------
    MeshError
        For surfaces that still coincide.
    """
    stages = Stages({"Extracting": 9, "Looking for parts that cross": 1})
    extracting, looking = stages.shares
    best: Extracted | None = None
    moves = MOVES if recipe.movable else MOVES[:1]
    for share in moves:
        moved = recipe.moved(share)
        extraction = _Extraction(moved, budget)
        mesh = yield from stages.run(extracting, extraction.result_steps())
        if extraction.cut is None:
            return Extracted(mesh, np.empty((0, 2), np.int64), moved)
        if not _fits(mesh, extraction.may_cross):
            continue
        crossing = self_intersections_steps(mesh.vertices, mesh.faces, extraction.may_cross)
        pairs = yield from stages.run(looking, crossing)
        if best is None or len(pairs) < len(best.crossings):
            best = Extracted(mesh, pairs, moved)
        if not len(pairs):
            break
    if best is None:
        raise MeshError(
            "surfaces of a solid coincide, and its parts would be open; change its lengths or places by 0.1 mm or so"
        )
    return best


def _fits(mesh: ComplexMesh, of_rims: Flags) -> bool:
    """Return whether the triangles of rims leave parts closed: along each edge, triangles run in both directions."""
    at_rims = np.zeros(len(mesh.vertices), bool)
    at_rims[mesh.faces[of_rims]] = True
    near = np.count_nonzero(at_rims[mesh.faces], axis=1) > 1
    faces, sides = mesh.faces[near].astype(np.int64), mesh.sides[near].astype(np.int64)
    start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    up = np.where(start < end, 1, -1)
    edges = np.minimum(start, end) * len(mesh.vertices) + np.maximum(start, end)
    inner = at_rims[start] & at_rims[end]
    for part in np.unique(sides[sides > 0]).tolist():
        own = (sides[:, 0] == part).astype(np.int64) - (sides[:, 1] == part)
        turned = own.repeat(3) * up
        mine = np.flatnonzero(inner & (turned != 0))
        _, group = np.unique(edges[mine], return_inverse=True)
        if np.bincount(group.reshape(-1), turned[mine]).any():
            return False
    return True


def _inner(share: Doubles) -> Doubles:
    """Return shares of edges, moved away from the ends of the edges."""
    return np.clip(share, NEAREST, 1 - NEAREST)


class _Extraction:
    """Extract parts, stage by stage."""

    def __init__(self, recipe: Recipe, budget: Budget) -> None:
        self.recipe, self.lattice, self.fields = recipe, recipe.lattice, recipe.fields
        self.table, self.threads = recipe.table(), budget.thread_count
        self.shape = self.lattice.shape
        self.steps = (1, self.shape[2], self.shape[1] * self.shape[2])  # Steps of flat indices along x, y, z.
        self.corners = np.array([sum(self.steps[axis] * (c >> axis & 1) for axis in range(3)) for c in range(8)])
        self.stages = Stages(STAGES)

    def result_steps(self) -> Steps[ComplexMesh]:
        """Run all stages."""
        stages = self.stages
        yield from stages.run("Assigning samples to parts", self._words_steps())
        yield from stages.run("Finding rims", self._rims_steps())
        yield from stages.run("Triangulating cells", self._cells_steps())
        yield from stages.run("Cutting rims", self._cut_steps())
        return (yield from stages.run("Placing vertices", self._placed_steps()))

    def _words_steps(self) -> Steps[None]:
        """Find the signs of all fields at every sample, as bits, and the part that owns it."""
        kind = np.min_scalar_type((1 << len(self.fields)) - 1)
        self.words = np.zeros(self.shape, kind)
        self.owner = np.zeros(self.shape, self.table.dtype)

        def decide(layers: tuple[int, int]) -> None:
            words = self.words[slice(*layers)]
            for bit, field in enumerate(self.fields):
                words |= field.above(*layers).astype(kind) << kind.type(bit)
            self.owner[slice(*layers)] = self.table.take(words)

        step = max(1, (1 << 20) // (self.shape[1] * self.shape[2]))
        parts = [(low, min(low + step, self.shape[0])) for low in range(0, self.shape[0], step)]
        yield from map_steps(decide, parts, self.threads)

    def _rims_steps(self) -> Steps[None]:
        """Find the cells in which two fields or more decide, (n,) flat indices of their lowest samples."""
        counts = np.array([bin(word).count("1") for word in range(1 << min(len(self.fields), 16))], np.uint8)

        def several(layers: tuple[int, int]) -> tuple[NDArray[np.intp], ...]:
            words = self.words[layers[0] : layers[1] + 1]
            all_set, any_set = words, words
            for axis in range(3):
                low = [slice(None)] * 3
                high = [slice(None)] * 3
                low[axis], high[axis] = slice(None, -1), slice(1, None)
                all_set = all_set[tuple(low)] & all_set[tuple(high)]
                any_set = any_set[tuple(low)] | any_set[tuple(high)]
            active = any_set & ~all_set
            many = (
                (counts[active & 0xFFFF] + counts[active >> 16] > 1)
                if active.dtype.itemsize > 2
                else counts[active] > 1
            )
            z, y, x = np.nonzero(many)
            flat = ((z + layers[0]) * self.shape[1] + y) * self.shape[2] + x
            return flat, active[many].astype(np.intp), all_set[many].astype(np.intp)

        step = max(1, (1 << 20) // (self.shape[1] * self.shape[2]))
        last = self.shape[0] - 1
        parts = [(low, min(low + step, last)) for low in range(0, last, step)]
        cells_of_parts = yield from map_steps(several, parts, self.threads)
        flat, active, base = (np.concatenate(each) for each in zip(*cells_of_parts, strict=True))
        keys, group = np.unique(active << MOST_FIELDS | base, return_inverse=True)
        matters = np.array(
            [self._deciding(key >> MOST_FIELDS, key & (1 << MOST_FIELDS) - 1) for key in keys.tolist()] or [0]
        )
        self.rims = np.sort(flat[matters[group.reshape(-1)] > 1])
        yield from self._grown_steps()

    def _deciding(self, active: int, base: int) -> int:
        """Return how many of the active fields change the part if the rest are as in `base`."""
        bits = [bit for bit in range(len(self.fields)) if active >> bit & 1]
        words = [base]
        for bit in bits:
            words += [word | 1 << bit for word in words]
        return sum(any(self.table[word] != self.table[word ^ 1 << bit] for word in words) for bit in bits)

    def _grown_steps(self) -> Steps[None]:
        """Add neighbors across faces that Marching Cubes would cut in two ways."""
        self.is_rim = np.zeros(int(np.prod(self.shape)), bool)
        self.is_rim[self.rims] = True
        owner, fresh = self.owner.reshape(-1), self.rims
        while len(fresh):
            added = []
            for face, across in zip(
                FACES, (-1, 1, -self.steps[1], self.steps[1], -self.steps[2], self.steps[2]), strict=True
            ):
                a, b, c, d = (owner.take(fresh + self.corners[corner]) for corner in face)
                neighbor = fresh + across
                both = (a == c) & (b == d) & (a != b)
                neighbor = neighbor[both]
                added.append(neighbor[~self.is_rim[neighbor]])
            fresh = np.unique(np.concatenate(added))
            self.is_rim[fresh] = True
            yield PAUSE
        self.rims = np.flatnonzero(self.is_rim)

    def _cells_steps(self) -> Steps[None]:
        """Make the triangles of all other cells in the way of labels that touch."""
        axes = [
            Axis(along.astype(np.float32), np.arange(len(along)), 0, len(along), 1, False)
            for along in (self.lattice.x, self.lattice.y, self.lattice.z)
        ]
        owners = Owners(axes[0], axes[1], axes[2], self.owner)
        ranges = band_ranges(self.shape)
        rims = self.is_rim.reshape(self.shape)
        bands = yield from map_steps(lambda layers: find_band(owners, *layers, rims), ranges, self.threads)
        counts = np.array([band.counts for band in bands])
        ends = np.cumsum(counts.reshape(-1))
        starts = (ends - counts.reshape(-1)).reshape(counts.shape)

        def fill(at: int) -> tuple[NDArray[np.int32], NDArray[Any]]:
            above = (None, []) if at + 1 == len(bands) else (bands[at + 1], starts[at + 1].tolist())
            band = fill_band(owners, bands[at], starts[at].tolist(), *above)
            return band.faces, band.sides

        filled = yield from map_steps(fill, range(len(bands)), self.threads)
        self.faces = np.concatenate([faces for faces, _ in filled])
        self.sides = np.concatenate([sides for _, sides in filled])
        self.keys = np.concatenate(
            [
                3 * (band.edges[axis].astype(np.int64) + band.low * self.steps[2]) + axis
                for band in bands
                for axis in range(3)
            ]
        )
        self.in_use = np.zeros(len(self.keys), bool)
        self.in_use[self.faces] = True

    def _cut_steps(self) -> Steps[None]:
        """Cut the cells of rims into tetrahedra and these into pieces; join them to the other cells."""
        self.cut: CutRims | None = None
        self.chains: dict[tuple[int, int], list[int]] = {}
        if not len(self.rims):
            return
        words = self.words.reshape(-1)
        self.cut = yield from cut_rims_steps(self.fields, self.table, words, self.rims, self.corners, self.threads)
        self.faces, self.sides, self.chains = stitched(self.faces, self.sides, self.cut, self.keys, self.in_use)

    def _placed_steps(self) -> Steps[ComplexMesh]:
        """Place the vertices in use, and move them to RAS+ mm."""
        nodes = 0 if self.cut is None else len(self.cut.nodes.keys)
        used = np.zeros(len(self.keys) + nodes, bool)
        used[self.faces] = True
        places = np.zeros((len(used), 3))
        exact = np.full(len(used), -1, np.intp)  # Index of the exact position for the vertex's field.
        of_field = np.full(len(used), -1, np.intp)
        yield from self._place_edges_steps(places, used, exact, of_field)
        if self.cut is not None:
            self._place_nodes(self.cut, places)
        yield PAUSE
        vertices = np.empty((len(used), 3), np.float32)
        for start in range(0, len(used), POINTS_AT_ONCE):
            block = slice(start, start + POINTS_AT_ONCE)
            vertices[block] = transform_points(self.lattice.affine, places[block])
            yield PAUSE
        for field, (_, positions) in self.recipe.on_edges.items():
            own = np.flatnonzero((of_field == field) & (exact >= 0))
            vertices[own] = positions[exact[own]]
        number = np.cumsum(used, dtype=np.int32) - np.int32(1)
        faces = transform_faces(self.lattice.affine, number[self.faces])
        self.may_cross = (self.faces >= len(self.keys)).any(axis=1)
        return ComplexMesh(vertices[used], faces, self.sides.astype(np.int32))

    def _place_edges_steps(
        self, places: Doubles, used: Flags, exact: NDArray[np.intp], of_field: NDArray[np.intp]
    ) -> Steps[None]:
        """Place the vertices of cells where the deciding field is 0."""
        own = np.flatnonzero(used[: len(self.keys)])
        flat, axis = np.divmod(self.keys[own], 3)
        high = flat + np.array(self.steps).take(axis)
        words = self.words.reshape(-1)
        pairs = words.take(flat).astype(np.int64) << MOST_FIELDS | words.take(high)
        unique, group = np.unique(pairs, return_inverse=True)
        deciding = np.array(
            [self._field_between(key >> MOST_FIELDS, key & (1 << MOST_FIELDS) - 1) for key in unique.tolist()], np.intp
        )
        field_of = deciding[group.reshape(-1)]
        of_field[own] = field_of
        at_ends = np.tile([[1.0], [-1.0]], len(own))
        for field in np.unique(field_of).tolist():
            mine = np.flatnonzero(field_of == field)
            exact[own[mine]] = self._exact(field, self.keys[own[mine]])
            mine = mine[exact[own[mine]] < 0]
            ends = np.unique(np.concatenate([flat[mine], high[mine]]))
            values = yield from self.fields[field].values_steps(ends, self.threads)
            at_ends[:, mine] = [values[np.searchsorted(ends, at[mine])] for at in (flat, high)]
        yield from self._at_shares_steps(places, own, at_ends[0] / (at_ends[0] - at_ends[1]))
        moved = np.flatnonzero(exact[own] < 0)
        depth = yield from self._depths_steps(places, own[moved], field_of[moved], at_ends[:, moved])
        low, beyond = at_ends[:, moved]
        yield from self._at_shares_steps(places, own[moved], (low + depth) / (low - beyond))
        with_exact = np.flatnonzero(exact[own] >= 0)
        if len(with_exact):
            self._at_exact(places, own[with_exact], field_of[with_exact], exact)

    def _at_shares_steps(self, places: Doubles, vertices: NDArray[np.intp], share: Doubles) -> Steps[None]:
        """Place vertices at shares of their edges."""
        for start in range(0, len(vertices), POINTS_AT_ONCE):
            own = vertices[start : start + POINTS_AT_ONCE]
            flat, axis = np.divmod(self.keys[own], 3)
            begin, end = self._index(flat), self._index(flat + np.array(self.steps).take(axis))
            places[own] = begin + _inner(share[start : start + POINTS_AT_ONCE])[:, None] * (end - begin)
            yield PAUSE

    def _depths_steps(
        self, places: Doubles, vertices: NDArray[np.intp], field_of: NDArray[np.intp], at_ends: Doubles
    ) -> Steps[Doubles]:
        """Return how far vertices and the triangles around them lie below the surfaces of fields that keep volume."""
        keeps = np.array([field.keeps_volume for field in self.fields])
        free = keeps.take(field_of) & ~touches_rims(self.is_rim, self.keys[vertices], self.steps)
        gradients, depths = np.zeros((3, len(places))), np.zeros(len(places))
        for field in np.unique(field_of[free]).tolist():
            own = np.flatnonzero(free & (field_of == field))
            share = _inner(at_ends[0, own] / (at_ends[0, own] - at_ends[1, own]))
            asking = gradients_steps(self.fields[field], self.lattice, self.keys[vertices[own]], share, self.threads)
            gradients[:, vertices[own]], depths[vertices[own]] = yield from asking
        is_free = np.zeros(len(places), bool)
        is_free[vertices[free]] = True
        faces = self.faces[is_free[self.faces].all(axis=1)]
        points = np.ascontiguousarray(transform_points(self.lattice.affine, places).T)
        depths += yield from depths_steps(points, gradients, faces)
        return depths[vertices]

    def _at_exact(
        self, places: Doubles, vertices: NDArray[np.intp], fields: NDArray[np.intp], exact: NDArray[np.intp]
    ) -> None:
        """Place vertices with exact positions in mm in index space."""
        for field, (_, positions) in self.recipe.on_edges.items():
            own = vertices[fields == field]
            places[own] = to_index(self.lattice.affine, positions[exact[own]].astype(np.float64))

    def _exact(self, field: int, keys: NDArray[np.int64]) -> NDArray[np.intp]:
        """Return the index of the exact position on every edge, -1 for none."""
        edges, _ = self.recipe.on_edges.get(field, (np.empty(0, np.int64), None))
        if not len(edges):
            return np.full(len(keys), -1, np.intp)
        place = np.minimum(np.searchsorted(edges, keys), len(edges) - 1)
        return np.where(edges[place] == keys, place, -1)

    def _place_nodes(self, cut: CutRims, places: Doubles) -> None:
        """Place the nodes of rims; those on a segment between vertices of cells lie exactly on it."""
        first, nodes = len(self.keys), cut.nodes
        codes, lowest = nodes.codes, self._index(nodes.lowest)
        at = lowest.copy()
        sides = self._index(nodes.lowest + self.corners[7]) - lowest
        for corner in range(1, 4):
            for axis in range(3):
                at[:, axis] += cut.weights[:, corner] * (codes[:, corner - 1] >> axis & 1) * sides[:, axis]
        places[first:] = at
        if self.chains:
            straighten(places, nodes, self.chains, lowest, sides)

    def _index(self, flat: NDArray[np.intp]) -> Doubles:
        """Return the positions of samples in index space, (n, 3)."""
        z, rest = np.divmod(flat, self.steps[2])
        y, x = np.divmod(rest, self.steps[1])
        return np.stack([self.lattice.x.take(x), self.lattice.y.take(y), self.lattice.z.take(z)], axis=1)

    def _field_between(self, low: int, high: int) -> int:
        """Return the field that decides the part on an edge between two samples with these signs."""
        differ = [bit for bit in range(len(self.fields)) if (low ^ high) >> bit & 1]
        for bit in differ:
            if self.table[low ^ 1 << bit] != self.table[low]:
                return bit
        return differ[0]
