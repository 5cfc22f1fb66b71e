# SPDX-License-Identifier: GPL-3.0-or-later
"""Read a surface back from its object, in the patient's millimeters.

The mesh stores its positions in millimeters as well as in Blender units, so an unchanged surface comes back bit for
bit, and moved vertices come back to far below a micrometre.
"""

from __future__ import annotations

from dataclasses import replace

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core import SIMPLIFICATION, Reconstruction, ReconstructionSettings, Surface, TriangleMesh
from ...core.mesh import blend, vertex_normals
from . import mesh_data as meshes
from .alpha_key import KEY, alpha_key, mixed_positions, value_of
from .evaluate import evaluated_object
from .placement import Placement, is_close, moved_mesh, present_placement
from .provenance import Provenance, read_provenance, require_provenance

POSITIONS_MM = ".ctmc_positions_mm"
"""Attribute of the positions, or of the midpoints if the surface has the key `alpha`."""
LINEAR_MM = ".ctmc_linear_mm"


def keep_positions_mm(mesh: bpy.types.Mesh, vertices: NDArray[np.float32], surface: Surface | None = None) -> None:
    """Keep RAS+ mm on a mesh.

    Parameters
    ----------
    mesh : bpy.types.Mesh
    vertices : (V, 3) float32
        RAS+ mm, kept where alpha is settled.
    surface : Surface, optional
        Both ends of alpha, kept while it is open.
    """
    meshes.write_attribute(mesh, POSITIONS_MM, vertices if surface is None else surface.midpoints)
    if surface is not None:
        meshes.write_attribute(mesh, LINEAR_MM, surface.linear)
    elif LINEAR_MM in mesh.attributes:
        mesh.attributes.remove(mesh.attributes[LINEAR_MM])


def _unmoved_mm(
    local: NDArray[np.float32], expected: NDArray[np.float32], stored_mm: NDArray[np.float32], placement: Placement
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return RAS+ mm of vertices, (V, 3) float32, and which are unmoved, (V,): those have their `stored_mm`."""
    unmoved = is_close(local, expected, stored_mm, placement)
    return (stored_mm if unmoved.all() else np.where(unmoved[:, None], stored_mm, placement.to_mm(local))), unmoved


def positions_mm(
    mesh: bpy.types.Mesh, local: NDArray[np.float32], placement: Placement, alpha: float
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return RAS+ mm of a mesh's vertices, (V, 3) float32, and which are where the reconstruction put them, (V,).

    Parameters
    ----------
    local : (V, 3) float32
        Positions of the vertices now.
    alpha : float
        Value of the key `alpha`, if the mesh has one.
    """
    stored_mm, linear = meshes.read_attribute(mesh, POSITIONS_MM), meshes.read_attribute(mesh, LINEAR_MM)
    if stored_mm is None:
        return placement.to_mm(local), np.ones(len(local), bool)  # Made by an older version, or another add-on.
    expected = placement.to_local(stored_mm)
    if linear is not None:
        expected = blend(expected, placement.to_local(linear), alpha)
        stored_mm = blend(stored_mm, linear, alpha)
    return _unmoved_mm(local, expected, stored_mm, placement)


def evaluated_triangles(
    obj: bpy.types.Object, scene: bpy.types.Scene | None = None, space: str = "ras"
) -> TriangleMesh:
    """Return the surface as shown in the scene, with modifiers, in millimeters of `space`, "ras" or "lps".

    Raises
    ------
    MeshError
        If Blender does not evaluate the object.
    """
    placement = placement_of(obj)
    with evaluated_object(obj, scene) as (evaluated, depsgraph):
        mesh = _triangles_mm(evaluated.data, placement, evaluated_alpha(obj, depsgraph))
        matrix = placement.transform_mm(evaluated.matrix_world)
    return moved_mesh(matrix, mesh).in_space(space)


def evaluated_alpha(obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> float:
    """Return the value of the key `alpha` of the evaluated object, which an animation may set."""
    if alpha_key(obj.data) is None:
        return 0.0
    return value_of(obj.data.shape_keys.evaluated_get(depsgraph).key_blocks[KEY])


def _triangles_mm(mesh: bpy.types.Mesh, placement: Placement, alpha: float) -> TriangleMesh:
    """Return a mesh without keys as triangles, RAS+ mm as placed; moved vertices have the normals of their faces."""
    vertices, unmoved = positions_mm(mesh, meshes.read_positions(mesh), placement, alpha)
    faces, normals = meshes.read_triangles(mesh), meshes.kept_normals(mesh)
    if normals is not None and placement.applied is not None:
        normals = vertex_normals(vertices, faces)  # Only some Blender versions rotate kept ones on Apply.
    elif normals is not None and not unmoved.all():
        normals = np.where(unmoved[:, None], normals, vertex_normals(vertices, faces))
    return TriangleMesh(vertices, faces, normals)


def placement_of(obj: bpy.types.Object) -> Placement:
    """Return the present placement of an object; for a foreign object, the usual one.

    The millimeters stored on the mesh are the reference: Apply and Set Origin change only the vertices. In edit mode
    they cannot be read, and the placement is that of the reconstruction.
    """
    provenance = read_provenance(obj)
    if provenance is None:
        return Placement()
    mesh = obj.data
    stored_mm = meshes.read_attribute(mesh, POSITIONS_MM)
    if stored_mm is None:
        return provenance.placement
    if mesh.shape_keys is None:
        local = meshes.read_positions(mesh)
    else:
        local = meshes.read_vectors(mesh.shape_keys.reference_key.points, "co", len(mesh.vertices))
    x, y, z = obj.matrix_world.translation
    return present_placement(provenance.placement, stored_mm, local, (x, y, z))


def read_back(obj: bpy.types.Object) -> Reconstruction | None:
    """Return the full surface of an object, RAS+ mm; None if simplification or a user has changed it."""
    provenance, mesh = read_provenance(obj), obj.data
    if (
        provenance is None
        or len(mesh.polygons) != provenance.full_faces
        or len(mesh.loops) != 3 * provenance.full_faces
    ):
        return None
    placement = placement_of(obj)
    key, faces, normals = alpha_key(mesh), meshes.read_triangles(mesh), meshes.kept_normals(mesh)
    if placement.applied is not None:
        normals = None
    if key is None:
        vertices, _ = positions_mm(mesh, meshes.read_positions(mesh), placement, 0.0)
        return reconstruction_of(TriangleMesh(vertices, faces, normals), None, provenance.settings, provenance)
    ends = []
    for name, block in ((POSITIONS_MM, mesh.shape_keys.reference_key), (LINEAR_MM, key)):
        local, stored_mm = (
            meshes.read_vectors(block.points, "co", len(mesh.vertices)),
            meshes.read_attribute(mesh, name),
        )
        if stored_mm is None:  # The file is from an older version.
            ends.append(placement.to_mm(local))
        else:
            ends.append(_unmoved_mm(local, placement.to_local(stored_mm), stored_mm, placement)[0])
    surface = Surface(ends[0], ends[1], faces, normals)
    return reconstruction_of(surface.at(provenance.settings.alpha_number), surface, provenance.settings, provenance)


def own_mesh(obj: bpy.types.Object) -> TriangleMesh:
    """Return the object's own triangles at its present alpha, before any modifier, RAS+ mm."""
    mesh, key = obj.data, alpha_key(obj.data)
    alpha = 0.0 if key is None else value_of(key)
    vertices, _ = positions_mm(mesh, mixed_positions(mesh), placement_of(obj), alpha)
    return TriangleMesh(vertices, meshes.read_triangles(mesh))


def as_shown(obj: bpy.types.Object, scene: bpy.types.Scene | None = None) -> Reconstruction:
    """Return the surface as shown, with modifiers, at its position in the patient, RAS+ mm, wherever it was moved.

    Its settings have no goal of simplification, because the removed triangles are lost.

    Raises
    ------
    MeshError
        If the object was not made here, or Blender does not evaluate it.
    """
    provenance = require_provenance(obj)
    with evaluated_object(obj, scene) as (evaluated, depsgraph):
        mesh = _triangles_mm(evaluated.data, placement_of(obj), evaluated_alpha(obj, depsgraph))
    return reconstruction_of(replace(mesh, normals=None), None, provenance.settings.without(SIMPLIFICATION), provenance)


def reconstruction_of(
    mesh: TriangleMesh, surface: Surface | None, settings: ReconstructionSettings, provenance: Provenance
) -> Reconstruction:
    """Return the reconstruction that an object was made from, with this mesh."""
    return Reconstruction(
        mesh=mesh,
        surface=surface,
        settings=settings,
        threshold=provenance.threshold,
        full_faces=provenance.full_faces,
        voxels_visited=provenance.voxels_visited,
        stages=(),
        spacing_mm=provenance.spacing_mm,
        notes=provenance.notes,
        name=provenance.name,
        sharing_labels=provenance.sharing_labels,
    )
