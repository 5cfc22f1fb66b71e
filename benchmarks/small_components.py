# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces with thousands of small components, as noise makes them: error and time against VTK, Blender and others.

    make bench ARGS="--only small_components --ct FOLDER"

The error is the mean of both directions at points spread evenly over the surfaces.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any
from unittest.mock import patch

import numpy as np
from meshes import non_manifold_edges

from ctmc_addon.core import ReconstructionSettings, Volume, reconstruct
from ctmc_addon.core.mesh.distance.triangle_tree import TriangleTree
from ctmc_addon.core.mesh.triangle_mesh import TriangleMesh
from ctmc_addon.core.progress import Steps
from ctmc_addon.core.simplification import whole
from ctmc_addon.core.simplification.merged_clusters import Merged
from ctmc_addon.readers import read_volume

from . import peers, scenes
from .measuring import Row, Session
from .simplify import VTK, on_surface, ours

LEVELS = {0.5: 0.9, 0.8: 0.85, 0.9: None, 0.95: None}  # Target of the mean error against VTK's, by reduction.
NOISE, VESSELS = 142, 130  # HU; of the phantom, and of contrast in a CT
STRIDE = (2, 2, 1)
SAMPLES = 30_000  # Samples each way.
CROSSINGS = 0.15  # Finding and reverting crossings takes at most this share of the time.


def measure(session: Session) -> None:
    """Measure all rows of this part."""
    for name, mesh in surfaces(session):
        tree, points = TriangleTree(mesh), on_surface(mesh, SAMPLES)
        for level, target in LEVELS.items():
            work = f"{name}, {len(mesh.faces) / 1e3:.0f}k triangles in {mesh.components} components to {1 - level:.0%}"
            results = {}
            for peer, call in calls(mesh, level).items():
                seconds, small = session.timed(call)
                there, back = TriangleTree(small).distances(points), tree.distances(on_surface(small, SAMPLES))
                results[peer] = (float(there.mean() + back.mean()) / 2, seconds, small)
            shares = crossing_seconds(session, mesh, level)
            session.add(Row(session.part, f"{work}: tests for crossings and undoing", "all of it", *shares, CROSSINGS))
            error, seconds, small = results.pop("CTMC")
            for peer, (peer_error, peer_seconds, other) in results.items():
                note = (
                    f"{len(small.faces)} against {len(other.faces)} triangles, {small.components} against "
                    f"{other.components} components, {len(non_manifold_edges(other))} non-manifold edges of the peer"
                )
                limit = target if peer == VTK else None
                session.add(Row(session.part, f"{work}: mean error", peer, error, peer_error, limit, "mm", note))
                limit = 0.5 if peer == VTK else None
                session.add(Row(session.part, work, peer, seconds, peer_seconds, limit))


def crossing_seconds(session: Session, mesh: TriangleMesh, level: float) -> tuple[float, float]:
    """Return the seconds of finding and reverting crossings, and of the whole simplification."""
    spent = 0.0

    def timed(begin_steps: Callable[..., Steps[Any]]) -> Callable[..., Steps[Any]]:
        def timed_steps(*args: Any, **named: Any) -> Steps[Any]:
            nonlocal spent
            steps = begin_steps(*args, **named)
            while True:
                start = session.clock()
                try:
                    step = next(steps)
                except StopIteration as end:
                    return end.value
                finally:
                    spent += session.clock() - start
                yield step

        return timed_steps

    clusters = patch.object(Merged, "uncross_steps", timed(Merged.uncross_steps))
    with clusters, patch.object(whole, "uncross_steps", timed(whole.uncross_steps)):
        seconds, _ = session.timed(ours(mesh, level))
    return spent, seconds


def surfaces(session: Session) -> Iterator[tuple[str, TriangleMesh]]:
    """Return noise and bone of the phantom; bone and vessels of the given CT."""
    volumes = {"phantom": (Volume(scenes.abdomen(session.scratch), np.diag([*scenes.LIVER_MM, 1.0])), (NOISE,))}
    for path in session.also:
        volumes[path.name] = (read_volume(path), (scenes.BONE, VESSELS))
    for name, (volume, thresholds) in volumes.items():
        for threshold in thresholds:
            settings = ReconstructionSettings(threshold=threshold, stride=STRIDE)
            mesh = reconstruct(volume, settings).mesh
            yield f"{name} at {threshold} HU", TriangleMesh(mesh.vertices, mesh.faces)


def calls(mesh: TriangleMesh, level: float) -> dict[str, Callable[[], TriangleMesh]]:
    """Return all simplifiers by name."""
    return {
        "CTMC": ours(mesh, level),
        VTK: peers.quadric_decimation(mesh, level),
        "fast-simplification": peers.fast_simplification(mesh, level),
        "Blender's Decimate": decimate(mesh, level),
    }


def decimate(mesh: TriangleMesh, level: float) -> Callable[[], TriangleMesh]:
    """Return a call of Blender's Decimate (collapse), evaluated and read back."""
    import bpy

    full = bpy.data.meshes.new("full")
    full.from_pydata(mesh.vertices.tolist(), [], mesh.faces.tolist())
    obj = bpy.data.objects.new("full", full)
    bpy.context.scene.collection.objects.link(obj)
    obj.modifiers.new("Decimate", "DECIMATE").ratio = 1 - level

    def call() -> TriangleMesh:
        obj.update_tag(refresh={"DATA"})
        small = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
        small.calc_loop_triangles()
        vertices = np.empty(3 * len(small.vertices), np.float32)
        faces = np.empty(3 * len(small.loop_triangles), np.int32)
        small.vertices.foreach_get("co", vertices)
        small.loop_triangles.foreach_get("vertices", faces)
        return TriangleMesh(vertices.reshape(-1, 3), faces.reshape(-1, 3))

    return call
