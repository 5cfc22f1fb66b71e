# SPDX-License-Identifier: GPL-3.0-or-later
"""Quadric error metrics: time and error against VTK, Blender's Decimate, and the fast libraries in C++."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ctmc_addon.core import Budget, ReconstructionSettings, Volume, reconstruct
from ctmc_addon.core.extraction.marching_cubes import marching_cubes
from ctmc_addon.core.mesh.distance.triangle_tree import TriangleTree
from ctmc_addon.core.mesh.triangle_mesh import TriangleMesh
from ctmc_addon.core.simplification.simplify import simplify
from ctmc_addon.readers import read_volume

from . import peers, scenes
from .measuring import Row, Session

VTK = "vtkQuadricDecimation"
LEVELS = {0.5: 1.0, 0.9: 1.0, 0.95: 1.0}  # Target of the mean error against VTK's, by reduction.
SAMPLES = 20_000  # Samples each way.
PATIENT = "ircadb01_abdomen"  # Noisy, with thousands of components.
# name: HU, reductions, target of the time against VTK's; every other pixel and row, raw otherwise
PATIENT_SURFACES = {"bone": (280, (0.5, 0.9, 0.95), 0.5), "vessels": (140, (0.5, 0.9), 0.6)}
PATIENT_STRIDE = (2, 2, 1)
LARGE_BONE, LARGE_SECONDS, LARGE_SECOND_THREAD = 265, 9.0, 0.6  # HU, of all pixels; limits for 90 % removed


def measure(session: Session) -> None:
    """Measure all rows of this part."""
    mesh = marching_cubes(scenes.tumors(), scenes.EDGE, normals=False)
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
    if not (session.data / PATIENT).is_dir():
        session.say(f"No {PATIENT} in {session.data}: rows left out")
        return
    volume = read_volume(session.data / PATIENT)
    for name, (threshold, reductions, target) in PATIENT_SURFACES.items():
        against_vtk(session, name, raw_surface(volume, threshold, PATIENT_STRIDE), reductions, target)
    large_bone(session, raw_surface(volume, LARGE_BONE))


def raw_surface(volume: Volume, threshold: float, stride: tuple[int, int, int] = (1, 1, 1)) -> TriangleMesh:
    """Return a surface with all its components, in millimeters."""
    mesh = reconstruct(volume, ReconstructionSettings(threshold=threshold, stride=stride)).mesh
    return TriangleMesh(mesh.vertices, mesh.faces)


def against_vtk(
    session: Session, name: str, mesh: TriangleMesh, reductions: tuple[float, ...], target: float | None
) -> None:
    """Compare time and mean error for a patient's surface, one call each."""
    full, on_full = TriangleTree(mesh), on_surface(mesh, SAMPLES)
    for reduction in reductions:
        work = f"QEM, {name} of {PATIENT}, {len(mesh.faces) / 1e3:.0f}k triangles to {1 - reduction:.0%}"
        results = {}
        for maker, make in {"CTMC": ours, VTK: peers.quadric_decimation}.items():
            seconds, small = session.timed(make(mesh, reduction))
            there, back = TriangleTree(small).distances(on_full), full.distances(on_surface(small, SAMPLES))
            results[maker] = (seconds, float(there.mean() + back.mean()) / 2)
        (seconds, error), (vtk_seconds, vtk_error) = results.values()
        session.add(Row(session.part, work, VTK, seconds, vtk_seconds, target))
        session.add(Row(session.part, f"{work}: mean error", VTK, error, vtk_error, 1.0, unit="mm"))


def large_bone(session: Session, mesh: TriangleMesh) -> None:
    """Measure a surface that is simplified in batches, on one thread and on two."""
    work = f"QEM, bone of {PATIENT}, {len(mesh.faces) / 1e6:.2f}M triangles to 10%"
    taken = {}
    for threads in session.threads:
        taken[threads], _ = session.timed(lambda n=threads: simplify(mesh, reduction=0.9, budget=Budget(threads=n)))
    session.add(Row(session.part, f"{work}, 1 thread", f"{LARGE_SECONDS:g} s", taken[1], LARGE_SECONDS, 1.0))
    if 2 in taken:
        session.add(Row(session.part, f"{work}, 2 threads", "CTMC, 1 thread", taken[2], taken[1], LARGE_SECOND_THREAD))


def errors(session: Session, mesh: TriangleMesh, size: str) -> None:
    """Compare mean distances to the full surface, both ways, at the same samples for all methods."""
    full = TriangleTree(mesh)
    on_full = on_surface(mesh, SAMPLES)
    for reduction, target in LEVELS.items():
        results = {}
        for name, make in {"CTMC": ours, **PEERS}.items():
            small = make(mesh, reduction)()
            there, back = TriangleTree(small).distances(on_full), full.distances(on_surface(small, SAMPLES))
            used = small.vertices[np.unique(small.faces)]
            farthest = max(there.max(), back.max(), full.distances(used).max())
            results[name] = (float(there.mean() + back.mean()) / 2, float(farthest), len(small.faces), small.closed)
        mean, farthest, faces, closed = results["CTMC"]
        for name, (peer_mean, peer_farthest, peer_faces, peer_closed) in results.items():
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
    """Return a call of this project's simplifier."""
    return lambda: simplify(mesh, reduction=reduction)


def on_surface(mesh: TriangleMesh, count: int, seed: int = 0) -> NDArray[np.float64]:
    """Return points spread evenly over a mesh's area, (count, 3), the same for the same mesh."""
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
    """Return a call of Blender's Decimate (collapse) through the evaluated mesh."""
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
