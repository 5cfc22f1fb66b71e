# SPDX-License-Identifier: GPL-3.0-or-later
"""Quadric error metrics: time and error against VTK, Blender's Decimate, and the fast libraries in C++."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ctmc_addon.core.extraction.marching_cubes import marching_cubes
from ctmc_addon.core.mesh.distance.triangle_tree import TriangleTree
from ctmc_addon.core.mesh.triangle_mesh import TriangleMesh
from ctmc_addon.core.simplification.simplify import simplify

from . import peers, scenes
from .measuring import Row, Session

VTK = "vtkQuadricDecimation"
LEVELS = {0.5: 1.0, 0.9: 1.0, 0.95: 1.0}  # reduction: target of the mean error against VTK's
SAMPLES = 20_000  # each way


def measure(session: Session) -> None:
    """All rows of this part."""
    mesh = marching_cubes(scenes.tumours(), scenes.EDGE, normals=False)
    size = f"{len(mesh.faces) / 1e3:.0f}k triangles"
    repeats = max(1, session.repeats // 3)
    for reduction, target in ((0.9, 0.5), (0.5, None)):
        session.compare(
            f"QEM, {size} to {1 - reduction:.0%}",
            lambda reduction=reduction: simplify(mesh, reduction=reduction),
            {name: (make(mesh, reduction), target if name == VTK else None) for name, make in PEERS.items()},
            repeats=repeats,
        )
    errors(session, mesh, size)
    large = marching_cubes(scenes.whole_liver(), scenes.EDGE, normals=False)
    session.compare(
        f"QEM, {len(large.faces) / 1e3:.0f}k triangles to 10%",
        lambda: simplify(large, reduction=0.9),
        {"Blender's Decimate": (decimate(large, 0.1), 0.6)},
        repeats=repeats,
    )


def errors(session: Session, mesh: TriangleMesh, size: str) -> None:
    """Mean distance to the full surface, both ways, at the same samples of it for everyone."""
    full = TriangleTree(mesh)
    on_full = on_surface(mesh, SAMPLES)
    for reduction, target in LEVELS.items():
        known = {}
        for name, make in {"CTMC": ours, **PEERS}.items():
            small = make(mesh, reduction)()
            there, back = TriangleTree(small).distances(on_full), full.distances(on_surface(small, SAMPLES))
            used = small.vertices[np.unique(small.faces)]
            farthest = max(there.max(), back.max(), full.distances(used).max())
            known[name] = (float(there.mean() + back.mean()) / 2, float(farthest), len(small.faces), small.closed)
        mean, farthest, faces, closed = known["CTMC"]
        for name, (peer_mean, peer_farthest, peer_faces, peer_closed) in known.items():
            if name == "CTMC":
                continue
            note = (
                f"greatest {farthest:.3f} against {peer_farthest:.3f}, {faces} against {peer_faces} triangles, "
                f"{'closed' if closed else 'OPEN'} against {'closed' if peer_closed else 'open'}"
            )
            work = f"QEM, {size} to {1 - reduction:.0%}: mean error"
            limit = target if name == VTK else None
            session.add(Row(session.part, work, name, mean, peer_mean, limit, unit="voxels", note=note))


def ours(mesh: TriangleMesh, reduction: float) -> Callable[[], TriangleMesh]:
    """A call of this project's own."""
    return lambda: simplify(mesh, reduction=reduction)


def on_surface(mesh: TriangleMesh, count: int, seed: int = 0) -> NDArray[np.float64]:
    """Points spread evenly over a mesh's area, (count, 3), the same for the same mesh."""
    chance = np.random.Generator(np.random.PCG64(seed))
    corners = mesh.vertices[mesh.faces].astype(np.float64)  # (F, 3, 3)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.sqrt((cross**2).sum(axis=1)).cumsum()
    # One point in each of `count` equal shares of the area: steadier than points at random.
    face = np.searchsorted(area, (np.arange(count) + chance.random(count)) / count * area[-1])
    u, v = chance.random((2, count))
    over = u + v > 1
    u[over], v[over] = 1 - u[over], 1 - v[over]
    a, b, c = corners[np.minimum(face, len(corners) - 1)].transpose(1, 0, 2)
    return a + u[:, None] * (b - a) + v[:, None] * (c - a)


def decimate(mesh: TriangleMesh, ratio: float) -> Callable[[], Any]:
    """A call of Blender's Decimate (collapse) through the evaluated mesh."""
    import bpy

    data = bpy.data.meshes.new("full")
    data.from_pydata(mesh.vertices.tolist(), [], mesh.faces.tolist())
    thing = bpy.data.objects.new("full", data)
    bpy.context.scene.collection.objects.link(thing)
    modifier = thing.modifiers.new("Decimate", "DECIMATE")

    def call() -> int:
        modifier.ratio = ratio
        thing.update_tag(refresh={"DATA"})
        depsgraph = bpy.context.evaluated_depsgraph_get()
        return len(thing.evaluated_get(depsgraph).data.polygons)

    assert abs(call() - ratio * len(mesh.faces)) < 10
    return call


PEERS: dict[str, Callable[[TriangleMesh, float], Callable[[], TriangleMesh]]] = {
    VTK: peers.quadric_decimation,
    "fast-simplification": peers.fast_simplification,
    "pyfqmr": peers.pyfqmr,
    "meshoptimizer": peers.meshoptimizer,
}
