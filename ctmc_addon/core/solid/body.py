# SPDX-License-Identifier: GPL-3.0-or-later
"""A body: a structure with a closed surface, and its fields on a lattice."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..arrays import Flags, Floats
from ..errors import MeshError
from ..machine.budget import Budget
from ..mesh.distance.signed_distance import SignedSurface
from ..mesh.distance.triangle_tree import TriangleTree
from ..mesh.triangle_mesh import TriangleMesh
from ..progress import Steps
from .distances import distances_bytes, distances_steps
from .fields import StructureField
from .lattice import Lattice
from .lattice_edges import edge_vertices_steps, inside_steps

OnEdges = tuple[NDArray[np.int64], Floats]


@dataclass(eq=False)
class Body:
    """A structure with a closed surface.

    Parameters
    ----------
    mesh : TriangleMesh
        RAS+ mm.
    lattice : Lattice
    budget : Budget
    """

    mesh: TriangleMesh
    lattice: Lattice
    budget: Budget
    inside: Flags | None = None
    on_edges: OnEdges | None = None
    _tree: TriangleTree | None = None
    _signed: SignedSurface | None = None
    _distances: dict[tuple[float, ...], Floats] = field(default_factory=dict)

    def prepare_steps(self) -> Steps[None]:
        """Find the samples inside, and the vertices on edges, if the surface was extracted on this lattice."""
        self.budget.require(distances_bytes(self.lattice), "the fields of a solid", "use a larger stride or a region")
        try:
            self.inside = yield from inside_steps(self.mesh, self.lattice, self.budget)
        except MeshError:
            return
        keys, vertices = yield from edge_vertices_steps(self.mesh, self.lattice, self.budget)
        self.on_edges = keys, self.mesh.vertices[vertices]

    def signed_steps(self) -> Steps[SignedSurface]:
        """Return the surface, ready for signed distances."""
        if self._signed is None:
            signed = SignedSurface()
            yield from signed.prepare_steps(self.mesh)
            self._signed, self._tree = signed, signed.tree
        return self._signed

    def fields_steps(self, levels: Sequence[float]) -> Steps[list[StructureField]]:
        """Return the field of every level, mm inside the surface."""
        if self.inside is None:
            signed = yield from self.signed_steps()
            distance = yield from distances_steps(signed, self.lattice, levels, None, self.budget)
            inside = distance > 0
            return [StructureField(signed.tree, self.lattice, inside, distance, level) for level in levels]
        if self._tree is None:
            tree = TriangleTree()
            yield from tree.prepare_steps(self.mesh)
            self._tree = tree
        others = [level for level in levels if level]
        distance = None
        if others:
            distance = yield from distances_steps(self._tree, self.lattice, others, self.inside, self.budget)
        return [
            StructureField(self._tree, self.lattice, self.inside, distance if level else None, level)
            for level in levels
        ]
