# SPDX-License-Identifier: GPL-3.0-or-later
"""A body: a structure with a closed surface, and its fields on a lattice."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ..arrays import Flags, Floats
from ..errors import MeshError
from ..machine.budget import Budget
from ..mesh.distance.signed_distance import SignedSurface
from ..mesh.distance.triangle_tree import TriangleTree
from ..mesh.face_normals import sphere_normals_steps
from ..mesh.triangle_mesh import TriangleMesh
from ..progress import Steps
from .cells.chords import depths_steps
from .fields.distances import distances_bytes, distances_steps
from .fields.lattice import Lattice
from .fields.lattice_edges import edge_vertices_steps, inside_steps
from .fields.lattice_fields import StructureField

REMEDY = "choose a region or a larger stride"
OnEdges = tuple[NDArray[np.int64], Floats]


@dataclass(eq=False)
class Body:
    """A structure with a closed surface.

    Parameters
    ----------
    mesh : TriangleMesh
        RAS+ mm.
    lattice : Lattice
        Samples at which its fields are taken.
    budget : Budget
    around : Lattice, optional
        The whole lattice of a group, if `lattice` is a part of one; by default the same.

    Attributes
    ----------
    inside : (z, y, x) bool or None
        Samples inside; None if the surface was not extracted on this very lattice.
    on_edges : (keys, positions) or None
        Vertices on edges of the lattice `around`, as `Recipe` expects them; None if most lie elsewhere.
    """

    mesh: TriangleMesh
    lattice: Lattice
    budget: Budget
    around: Lattice | None = None
    inside: Flags | None = None
    on_edges: OnEdges | None = None
    _tree: TriangleTree | None = None
    _signed: SignedSurface | None = None
    _distances: dict[float, Floats] = field(default_factory=dict)

    def prepare_steps(self) -> Steps[None]:
        """Find the samples inside, and the vertices on edges, if the surface was extracted on this lattice."""
        self.budget.require(distances_bytes(self.lattice), "a solid", REMEDY)
        keys, vertices = yield from edge_vertices_steps(self.mesh, self.around or self.lattice, self.budget)
        if 2 * len(keys) < len(self.mesh.vertices):
            return
        self.on_edges = keys, self.mesh.vertices[vertices]
        with suppress(MeshError):  # The lattice is finer than the one that it was extracted on.
            self.inside = yield from inside_steps(self.mesh, self.lattice, self.budget)

    def on_steps(self, lattice: Lattice, around: Lattice | None = None) -> Steps[Body]:
        """Return the same surface on another lattice, prepared."""
        body = replace(self, lattice=lattice, around=around, inside=None, on_edges=None, _distances={})
        yield from body.prepare_steps()
        return body

    def bulge_steps(self) -> Steps[None]:
        """Move the surface outward by the depth that its triangles cut off, so that distances start at the true one.

        A ball of 10 voxels thickened by 1.8 is then 0.14 % too small instead of 0.51 %.
        """
        normals = yield from sphere_normals_steps(self.mesh.vertices, self.mesh.faces)
        vertices, inward = (np.ascontiguousarray(each.T, np.float64) for each in (self.mesh.vertices, -normals))
        depths = yield from depths_steps(vertices, inward, self.mesh.faces)
        self.mesh = replace(self.mesh, vertices=(vertices - inward * depths).T.astype(np.float32))

    def signed_steps(self) -> Steps[SignedSurface]:
        """Return the surface, prepared for signed distances."""
        if self._signed is None:
            signed = SignedSurface()
            yield from signed.prepare_steps(self.mesh)
            self._signed, self._tree = signed, signed.tree
        return self._signed

    def field_steps(self, level: float) -> Steps[StructureField]:
        """Return the field that is 0 at a depth of `level` mm inside the surface."""
        if level == 0 and self.inside is not None:
            tree = yield from self._tree_steps()
            return StructureField(tree, self.lattice, self.inside)
        distance = yield from self.distances_steps(level)
        tree = yield from self._tree_steps()
        inside = distance > 0 if self.inside is None else self.inside
        return StructureField(tree, self.lattice, inside, distance, level)

    def distances_steps(self, level: float) -> Steps[Floats]:
        """Return signed distances, exact near the level: (z, y, x) float32, mm, positive inside."""
        if level not in self._distances:
            surface: SignedSurface | TriangleTree
            surface = yield from self.signed_steps() if self.inside is None else self._tree_steps()
            measuring = distances_steps(surface, self.lattice, [level], self.inside, self.budget)
            self._distances[level] = yield from measuring
        return self._distances[level]

    def forget_distances(self, level: float) -> None:
        """Free the distances of a level; `distances_steps` measures them again if needed."""
        self._distances.pop(level, None)

    def _tree_steps(self) -> Steps[TriangleTree]:
        if self._tree is None:
            tree = TriangleTree()
            yield from tree.prepare_steps(self.mesh)
            self._tree = tree
        return self._tree


def edges_of(bodies: Sequence[Body]) -> OnEdges | None:
    """Return the vertices of bodies on edges of the lattice, one for each edge; None if a body has no such vertices."""
    on_edges = [body.on_edges for body in bodies if body.on_edges is not None]
    if len(on_edges) < len(bodies):
        return None
    if len(on_edges) == 1:
        return on_edges[0]
    keys = np.concatenate([each for each, _ in on_edges])
    unique, first = np.unique(keys, return_index=True)
    return unique, np.concatenate([positions for _, positions in on_edges])[first]
