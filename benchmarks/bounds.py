# SPDX-License-Identifier: GPL-3.0-or-later
"""Simplification to a greatest error in millimeters: whether it holds, and what others need for the same.

The others cannot be asked for an error. So each is asked for a quarter, an eighth... of the triangles, the
greatest distance is measured, and how many triangles it needs for a distance is read off between these points.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ctmc_addon.core.extraction.marching_cubes import marching_cubes
from ctmc_addon.core.mesh.distance.triangle_tree import TriangleTree
from ctmc_addon.core.mesh.triangle_mesh import TriangleMesh
from ctmc_addon.core.simplification.simplify import simplify

from . import peers, scenes
from .measuring import Row, Session
from .simplify import SAMPLES, on_surface

BOUNDS_MM = (0.1, 0.5, 1.0)
SHARES = [0.5**halvings for halvings in range(2, 10)]
PEERS = {
    "vtkQuadricDecimation": peers.quadric_decimation,
    "fast-simplification": peers.fast_simplification,  # pyfqmr has the same method and surfaces.
}


def measure(session: Session) -> None:
    """Measure two rows for every bound: greatest distance against the bound, triangles against the best peer."""
    mesh = marching_cubes(scenes.tumors(), scenes.EDGE, (2, 2, 2), normals=False)
    mesh = replace(mesh, vertices=mesh.vertices * np.array(scenes.FINE_MM, np.float32))
    tree, on_full = TriangleTree(mesh), np.concatenate([on_surface(mesh, SAMPLES), mesh.vertices])
    ladders = {name: [] for name in PEERS}
    for name, make in PEERS.items():
        for share in SHARES:
            small = make(mesh, 1 - share)()
            if small.closed:  # a torn surface is no answer
                ladders[name].append((greatest(small, tree, on_full), len(small.faces)))
        session.say(f"{name} measured at {len(ladders[name])} sizes")
    for bound in BOUNDS_MM:
        seconds, small = session.timed(lambda bound=bound: simplify(mesh, max_error=bound))
        reached = greatest(small, tree, on_full)
        work = f"QEM, {len(mesh.faces) / 1e3:.0f}k triangles, max_error {bound:g} mm"
        note = f"{seconds:.1f} s; {'closed' if small.closed else 'OPEN'}"
        session.add(
            Row(session.part, f"{work}: greatest distance", "the bound", reached, bound, 1.0, unit="mm", note=note)
        )
        needed = {name: triangles_for(reached, ladder) for name, ladder in ladders.items()}
        best = min(needed, key=lambda name: needed[name])
        session.add(
            Row(
                session.part,
                f"{work}: triangles left",
                f"{best}, the best for the same distance",
                len(small.faces),
                needed[best],
                1.3,
                unit="triangles",
            )
        )


def greatest(small: TriangleMesh, full: TriangleTree, on_full: NDArray[np.float64]) -> float:
    """Return the greatest distance both ways, from samples over the area and all vertices."""
    on_small = np.concatenate([on_surface(small, SAMPLES), small.vertices[np.unique(small.faces)]])
    return float(max(TriangleTree(small).distances(on_full).max(), full.distances(on_small).max()))


def triangles_for(distance: float, ladder: list[tuple[float, int]]) -> float:
    """Return the triangles at which a peer reaches `distance`, interpolated; infinite outside its measured points."""
    ordered = sorted(ladder)
    if not ordered or not ordered[0][0] <= distance:
        return float("inf")
    far, faces = (np.log([point[at] for point in ordered]) for at in range(2))
    return float(np.exp(np.interp(np.log(distance), far, faces)))
