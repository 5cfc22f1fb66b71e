# SPDX-License-Identifier: GPL-3.0-or-later
"""Separate or remove walls that two surfaces share, which would flicker."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core import Step, Steps
from ...core.volume import transform_points
from ..surface import mesh_data as meshes
from ..surface.objects import NEIGHBOR
from ..surface.placement import matrix_of
from .spec import Cell
from .styles import mean_edge

WALL_GAP_MM = 0.02  # Gap in the patient.
POINTS = 10_000  # Points looked up in a step.
SETTING_UP = Step(0.0, "Setting up the figure")


def open_shared_walls_steps(cell: Cell, copies: Sequence[bpy.types.Object]) -> Steps[None]:
    """Remove the triangles of a transparent surface that lie on an opaque one: they would flicker."""
    solid = [copy for surface, copy in zip(cell.surfaces, copies, strict=True) if surface.opacity == 1.0]
    if not solid or len(solid) == len(copies):
        return
    from mathutils.bvhtree import BVHTree

    points, faces, count = [], [], 0
    for copy in solid:
        points.append(world_positions(copy))
        faces.append(meshes.read_triangles(copy.data) + count)
        count += len(points[-1])
    tree = BVHTree.FromPolygons(np.concatenate(points).tolist(), np.concatenate(faces).tolist(), all_triangles=True)
    for surface, copy in zip(cell.surfaces, copies, strict=True):
        if surface.opacity == 1.0:
            continue
        near, positions = 0.5 * mean_edge(copy), world_positions(copy)
        on_wall = np.zeros(len(positions), bool)
        for first in range(0, len(positions), POINTS):
            yield SETTING_UP
            block = positions[first : first + POINTS].tolist()
            on_wall[first : first + POINTS] = [tree.find_nearest(point, near)[0] is not None for point in block]
        triangles = meshes.read_triangles(copy.data)
        _delete_faces(copy.data, np.flatnonzero(on_wall[triangles].all(axis=1)))


def part_shared_walls(copy: bpy.types.Object, gap: float) -> None:
    """Move shared walls of labels inwards: two triangles in one place, seen through an opening, would flicker.

    Each wall is then visible only from its own side.

    Parameters
    ----------
    gap : float
        In the units of the mesh; a small part of a pixel.
    """
    mesh = copy.data
    beyond = mesh.attributes.get(NEIGHBOR)
    if beyond is None or beyond.domain != "FACE" or len(mesh.loops) != 3 * len(mesh.polygons):
        return
    labels = np.empty(len(mesh.polygons), np.int32)
    beyond.data.foreach_get("value", labels)
    on_wall = np.unique(meshes.read_triangles(mesh)[labels != 0])
    normals = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertex_normals.foreach_get("vector", normals)
    positions = meshes.read_positions(mesh)
    positions[on_wall] -= gap * normals.reshape(-1, 3)[on_wall]
    mesh.attributes["position"].data.foreach_set("vector", positions.ravel())
    mesh.update()


def _delete_faces(mesh: bpy.types.Mesh, which: NDArray[np.int64]) -> None:
    """Delete triangles of a mesh; vertex attributes stay."""
    import bmesh

    work = bmesh.new()
    try:
        work.from_mesh(mesh)
        work.faces.ensure_lookup_table()
        bmesh.ops.delete(work, geom=[work.faces[at] for at in which.tolist()], context="FACES")
        work.to_mesh(mesh)
    finally:
        work.free()


def world_positions(obj: bpy.types.Object) -> NDArray[np.float64]:
    """Return an object's vertices in Blender units, (V, 3)."""
    return transform_points(matrix_of(obj.matrix_world), meshes.read_positions(obj.data))
