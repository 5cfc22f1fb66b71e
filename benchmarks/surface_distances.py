# SPDX-License-Identifier: GPL-3.0-or-later
"""Signed distance from a million vertices to a surface of a million triangles, against libraries in C++."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from ctmc_addon.core import finish
from ctmc_addon.core.extraction.marching_cubes import marching_cubes
from ctmc_addon.core.mesh.distance.signed_distance import SignedSurface
from ctmc_addon.core.mesh.triangle_mesh import TriangleMesh

from . import peers
from .measuring import Row, Session

SIDE = 400  # Samples along a side of the field: about a million triangles.
SLOW = 1000  # VTK and trimesh are given so many of the points, and their time is taken times the rest.
TARGET = 1.2  # Against the fastest peer.
APART = {"8 samples": 8.0, "half of its size": 200.0}  # The points are vertices moved so far, both ways.


def measure(session: Session) -> None:
    """Measure all rows of this part."""
    mesh = wavy(SIDE)
    for name, offset in APART.items():
        points = moved_vertices(mesh, offset)
        work = (
            f"signed distance, {len(points) / 1e6:.1f}M points to {len(mesh.faces) / 1e6:.1f}M triangles, {name} away"
        )
        ours, distances = session.timed(partial(signed_distances, mesh, points))
        rows = []
        for peer, (prepare, count) in COMPETITORS.items():
            every = max(1, len(points) // count)
            preparing, query = session.timed(partial(prepare, mesh))
            asking, theirs = session.timed(partial(query, points[::every]))
            seconds = preparing + asking * len(points) / len(theirs)
            wrong = float(np.abs(np.abs(theirs) - np.abs(distances[::every])).max())
            rows.append((seconds, peer, f"one thread, from the mesh on; distances differ by {wrong:.1g} at most"))
        best = min(seconds for seconds, _, _ in rows)
        for seconds, peer, note in rows:
            target = TARGET if seconds == best else None
            session.add(Row(session.part, work, peer, ours, seconds, target, note=note))


def wavy(side: int) -> TriangleMesh:
    """Return a closed surface with waves that nearly fills a cube of this side, in samples."""
    axis = np.linspace(-1, 1, side, dtype=np.float32)
    z, y, x = axis[:, None, None], axis[None, :, None], axis[None, None, :]
    waves = np.sin(9 * x) * np.sin(8 * y) * np.sin(10 * z + 1)
    field = np.float32(0.8) + np.float32(0.1) * waves - np.sqrt(x * x + y * y + z * z)
    return marching_cubes(field, 0.0, normals=False)


def moved_vertices(mesh: TriangleMesh, offset: float) -> NDArray[np.float64]:
    """Return the vertices moved along x, in both directions, as (n, 3)."""
    ways = [mesh.vertices + np.float32([way * offset, 0, 0]) for way in (1, -1)]
    return np.concatenate(ways).astype(np.float64)


def signed_distances(mesh: TriangleMesh, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return our distances, with the tree that they need, by one thread."""
    surface = SignedSurface()
    finish(surface.prepare_steps(mesh))
    return finish(surface.distances_steps(points, threads=1))[0]


COMPETITORS = {  # Calls that prepare, and how many points each is given.
    "libigl, AABB and pseudonormals": (peers.libigl_distance, 1 << 40),
    "VTK and PyVista, vtkImplicitPolyDataDistance": (peers.vtk_distance, SLOW),
    "trimesh, closest_point (without sign)": (peers.trimesh_distance, SLOW),
}
