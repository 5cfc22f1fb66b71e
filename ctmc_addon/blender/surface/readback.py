"""A surface read back from its object, where the object still holds all of it.

The inverse of `surfaces.add_reconstruction`, up to float32: vertices come back to far below a micrometre.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core import Reconstruction, ReconstructionSettings, Surface, TriangleMesh
from . import mesh_data as meshes
from .alpha_key import has_alpha
from .evaluate import evaluated_object
from .objects import KEY, mixed_positions, placement_of, remembered, settings_of
from .placement import Placement


def read_back(thing: bpy.types.Object) -> Reconstruction | None:
    """The full surface of an object, RAS+ mm; None where simplification or another hand has changed it."""
    known, mesh = remembered(thing), thing.data
    if not known or len(mesh.polygons) != known["full_faces"] or len(mesh.loops) != 3 * known["full_faces"]:
        return None
    placement, settings = placement_of(thing), settings_of(thing)
    faces, normals = meshes.read_triangles(mesh), meshes.remembered_normals(mesh)
    if has_alpha(thing):
        keys = mesh.shape_keys
        ends = [
            to_mm(placement, meshes.read_vectors(block.points, "co", len(mesh.vertices)))
            for block in (keys.reference_key, keys.key_blocks[KEY])
        ]
        surface = Surface(ends[0], ends[1], faces, normals)
        found = surface.at(settings.alpha)
    else:
        surface = None
        found = TriangleMesh(to_mm(placement, meshes.read_positions(mesh)), faces, normals)
    return _reconstruction(found, surface, settings, known)


def own_mesh(thing: bpy.types.Object) -> TriangleMesh:
    """The object's own triangles at its present alpha, before any modifier, RAS+ mm."""
    mesh = thing.data
    return TriangleMesh(to_mm(placement_of(thing), mixed_positions(mesh)), meshes.read_triangles(mesh))


def as_shown(thing: bpy.types.Object, scene: bpy.types.Scene | None = None) -> Reconstruction:
    """The surface as its object shows it, modifiers included, where the patient has it: RAS+ mm, however it was moved.

    Its settings have no goal of simplification: what that took away is gone.

    Raises
    ------
    MeshError
        If the object was not made here, or Blender does not evaluate it.
    """
    settings, placement, known = settings_of(thing), placement_of(thing), remembered(thing)
    shown = evaluated_object(thing, scene)[0].data
    goals: dict[str, Any] = {"simplifier": "builtin", "reduction": None, "target_faces": None, "max_error_mm": None}
    mesh = TriangleMesh(to_mm(placement, meshes.read_positions(shown)), meshes.read_triangles(shown))
    return _reconstruction(mesh, None, replace(settings, **goals), known)


def _reconstruction(
    mesh: TriangleMesh, surface: Surface | None, settings: ReconstructionSettings, known: dict[str, Any]
) -> Reconstruction:
    """What an object remembers of its reconstruction, with this mesh."""
    return Reconstruction(
        mesh=mesh,
        surface=surface,
        settings=settings,
        threshold=known["threshold"],
        full_faces=known["full_faces"],
        voxels_visited=known["voxels_visited"],
        stages=(),
        spacing_mm=tuple(known["spacing_mm"]),
        notes=tuple(known["notes"]),
        name=known["name"],
    )


def to_mm(placement: Placement, local: NDArray[np.float32]) -> NDArray[np.float32]:
    """RAS+ millimetres (n, 3) float32 of local positions."""
    out = local.astype(np.float64)
    out += placement.origin
    out /= placement.scale
    return out.astype(np.float32)
