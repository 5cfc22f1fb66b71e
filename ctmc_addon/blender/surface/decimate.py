# SPDX-License-Identifier: GPL-3.0-or-later
"""Run Blender's Decimate modifier on triangles, timed, in a separate scene."""

from __future__ import annotations

import time

import bpy

from ...core import TriangleMesh
from ..datablocks import remove_blocks
from . import mesh_data as meshes
from .evaluate import evaluated_object
from .placement import placed_at_center
from .readback import evaluated_triangles


def decimated(mesh: TriangleMesh, target_faces: int) -> tuple[TriangleMesh, float]:
    """Return the surface with about `target_faces` triangles, and the seconds that the modifier took.

    Parameters
    ----------
    mesh : TriangleMesh
        In RAS+ mm.

    Returns
    -------
    mesh : TriangleMesh
        In RAS+ mm, without normals; Decimate meets the number within one or two triangles.
    seconds : float
        From the mesh in Blender to its evaluated mesh, without building and reading them.
    """
    placement = placed_at_center(mesh.vertices)
    scene = bpy.data.scenes.new("CTMC Decimate")
    plain = meshes.new_mesh("CTMC Decimate", placement.to_local(mesh.vertices), mesh.faces)
    obj = bpy.data.objects.new("CTMC Decimate", plain)
    try:
        obj.location = placement.origin
        scene.collection.objects.link(obj)
        with evaluated_object(obj, scene):
            pass  # Blender evaluates all but the modifier before the clock starts.
        modifier = obj.modifiers.new("CTMC Decimate", "DECIMATE")
        modifier.ratio = min(1.0, target_faces / len(mesh.faces))
        start = time.perf_counter()
        with evaluated_object(obj, scene):
            pass
        seconds = time.perf_counter() - start
        return evaluated_triangles(obj, scene), seconds
    finally:
        remove_blocks(scene, obj, plain)
