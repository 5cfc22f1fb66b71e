# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the outer surfaces of a structure: its components except cavities, each with its own distances."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...arrays import Doubles
from ...mesh.distance.signed_distance import SignedSurface
from ...mesh.measures import component_volumes_steps
from ...mesh.topology import compacted, component_numbers_steps, components_of_vertices
from ...mesh.triangle_mesh import TriangleMesh
from ...progress import PAUSE, Steps


class OuterSurfaces:
    """The outer surfaces of a closed mesh, prepared to find the one around a point."""

    def prepare_steps(self, surface: SignedSurface) -> Steps[None]:
        """Read the components of a structure."""
        mesh = surface.mesh
        self._whole = surface
        self._component = yield from component_numbers_steps(mesh.faces, len(mesh.vertices))
        volumes = yield from component_volumes_steps(mesh.vertices, mesh.faces, self._component)
        of_vertex = components_of_vertices(mesh.faces, self._component, len(mesh.vertices))
        order = np.argsort(of_vertex, kind="stable")
        order = order[np.searchsorted(of_vertex[order], 0) :]
        yield PAUSE
        starts = np.flatnonzero(np.diff(of_vertex[order], prepend=-1))
        positions = mesh.vertices[order].astype(np.float64)
        self._low = np.minimum.reduceat(positions, starts, axis=0)  # (components, 3)
        self._high = np.maximum.reduceat(positions, starts, axis=0)
        outer = np.flatnonzero(volumes > 0)
        self._largest_first: NDArray[np.intp] = outer[np.argsort(-volumes[outer], kind="stable")]
        self._prepared: dict[int, SignedSurface] = {}

    def around_steps(self, point: Doubles, beyond: float = 0.0) -> Steps[SignedSurface | None]:
        """Return the largest outer surface that, grown by `beyond` mm, holds a point (3,); None if none does."""
        within = (self._low - beyond < point) & (point < self._high + beyond)
        for number in self._largest_first.tolist():
            if within[number].all():
                surface = yield from self._surface_steps(number)
                distance, _ = yield from surface.distances_steps(point[None], 1)
                if distance[0] < beyond:
                    return surface
        return None

    def _surface_steps(self, number: int) -> Steps[SignedSurface]:
        if number not in self._prepared:
            mesh = self._whole.mesh
            faces = np.flatnonzero(self._component == number)
            if len(faces) == len(mesh.faces):
                self._prepared[number] = self._whole
            else:
                used, renumbered = compacted(mesh.faces[faces], len(mesh.vertices))
                surface = SignedSurface()
                yield from surface.prepare_steps(TriangleMesh(mesh.vertices[used], renumbered))
                self._prepared[number] = surface
        return self._prepared[number]
