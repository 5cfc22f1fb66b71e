# SPDX-License-Identifier: GPL-3.0-or-later
"""Convert arrays to Blender meshes and back, without a Python loop over vertices.

Positions here are in an object's local space; placement.py knows how that lies in the patient.
The fastest paths differ little between Blender 4.2 and 5.2: attributes written whole as float32 and int32.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core import MeshError, Step, Steps, finish
from ...core.mesh import Edges, edges_steps as topology_edges_steps

# From 4.5 a free vector on every vertex may be the normal; before, Blender stores angles against its own.
FREE_NORMALS = bpy.app.version >= (4, 5, 0)
NORMALS = "custom_normal" if FREE_NORMALS else "gradient_normal"


def new_mesh(name: str, positions: NDArray[np.float32], faces: NDArray[np.int32]) -> bpy.types.Mesh:
    """Return a mesh, as `new_mesh_steps` does.

    Parameters
    ----------
    name : str
    positions : (V, 3) float32
        In the object's space.
    faces : (F, 3) int32
    """
    return finish(new_mesh_steps(name, positions, faces, finish(edges_steps(faces, len(positions)))))


def new_mesh_steps(
    name: str, positions: NDArray[np.float32], faces: NDArray[np.int32], edges: Edges
) -> Steps[bpy.types.Mesh]:
    """Make a smooth-shaded mesh and add its faces after a step, because millions of faces take Blender long.

    The mesh is removed if the steps are closed early. Its edges are passed in: Blender would find them in one long
    call, in an order that depends on its number of threads, and so would the triangles that Decimate leaves.

    Parameters
    ----------
    positions : (V, 3) float32
    faces : (F, 3) int32
        Counter-clockwise seen from outside.
    edges : (2, E) and (3, F) int32
        Result of `core.mesh.edges_steps`.
    """
    ends, edge_of_corner = edges
    mesh = bpy.data.meshes.new(name)
    uid, complete = mesh.session_uid, False
    try:
        mesh.vertices.add(len(positions))
        mesh.edges.add(ends.shape[1])
        if len(faces):
            _write_positions(mesh, positions)
            _write_numbers(mesh, ".edge_verts", ends.T)
            yield Step(0.3, "Adding the surface")  # Until here it is a valid mesh of edges.
            mesh = mesh_of(uid)
            # Blender crashes on a mesh that has corners but no faces, so both come in one step.
            mesh.loops.add(faces.size)
            mesh.polygons.add(len(faces))
            _write_numbers(mesh, ".corner_vert", faces)
            _write_numbers(mesh, ".corner_edge", edge_of_corner.T)
            mesh.polygons.foreach_set("loop_start", np.arange(0, faces.size, 3, dtype=np.int32))
        mesh.update()
        complete = True
        return mesh
    finally:
        if not complete:
            bpy.data.batch_remove([mesh_block for mesh_block in bpy.data.meshes if mesh_block.session_uid == uid])


def mesh_of(uid: int) -> bpy.types.Mesh:
    """Return the mesh of this `session_uid`.

    Raises
    ------
    MeshError
        If it no longer exists, for example after undo.
    """
    mesh = next((mesh for mesh in bpy.data.meshes if mesh.session_uid == uid), None)
    if mesh is None:
        raise MeshError("undo removed the surface while it was being made; make it again")
    return mesh


def _write_numbers(mesh: bpy.types.Mesh, name: str, values: NDArray[np.int32]) -> None:
    """Fill one of the mesh's own attributes of numbers or pairs with int32."""
    mesh.attributes[name].data.foreach_set("value", np.ascontiguousarray(values, np.int32).ravel())


def add_face_numbers(mesh: bpy.types.Mesh, name: str, values: NDArray[np.int32]) -> None:
    """Add an attribute with a whole number for every face, (F,) int32."""
    attribute = mesh.attributes.new(name, "INT", "FACE")
    attribute.data.foreach_set("value", np.ascontiguousarray(values, np.int32))


def edges_steps(faces: NDArray[np.int32], vertex_count: int) -> Steps[Edges]:
    """Return the edges of faces for `new_mesh_steps`.

    Parameters
    ----------
    faces : (F, 3) int32
    vertex_count : int
    """
    columns = np.ascontiguousarray(faces.T)
    return (yield from topology_edges_steps(columns, vertex_count))


def _write_positions(mesh: bpy.types.Mesh, positions: NDArray[np.float32]) -> None:
    """Move the mesh's vertices; if the mesh has keys, only the positions under the keys.

    Parameters
    ----------
    mesh : bpy.types.Mesh
    positions : (V, 3) float32
    """
    mesh.attributes["position"].data.foreach_set("vector", np.ascontiguousarray(positions, np.float32).ravel())


def read_positions(mesh: bpy.types.Mesh) -> NDArray[np.float32]:
    """Return the mesh's vertices, (V, 3) float32."""
    return read_vectors(mesh.attributes["position"].data, "vector", len(mesh.vertices))


def read_vectors(collection: Any, name: str, count: int) -> NDArray[np.float32]:
    """Return the vectors of a Blender collection, (count, 3) float32.

    Parameters
    ----------
    collection : bpy_prop_collection
    name : str
        Name of the vector property, such as 'co'.
    count : int
        Length of the collection.
    """
    out = np.empty(3 * count, np.float32)
    collection.foreach_get(name, out)
    return out.reshape(-1, 3)


def read_triangles(mesh: bpy.types.Mesh) -> NDArray[np.int32]:
    """Return the mesh's triangles, (F, 3) int32; larger polygons are cut into triangles."""
    if len(mesh.loops) == 3 * len(mesh.polygons) > 0:
        out = np.empty(len(mesh.loops), np.int32)
        mesh.attributes[".corner_vert"].data.foreach_get("value", out)
        return out.reshape(-1, 3)
    mesh.calc_loop_triangles()
    out = np.empty(3 * len(mesh.loop_triangles), np.int32)
    mesh.loop_triangles.foreach_get("vertices", out)
    return out.reshape(-1, 3)


def corner_normals(mesh: bpy.types.Mesh) -> NDArray[np.float32]:
    """Return the normal with which Blender shades every corner, (corners, 3) float32."""
    return read_vectors(mesh.corner_normals, "vector", len(mesh.loops))


def write_attribute(mesh: bpy.types.Mesh, name: str, vectors: NDArray[np.float32]) -> None:
    """Keep a vector for every vertex as an attribute.

    Parameters
    ----------
    mesh : bpy.types.Mesh
    name : str
    vectors : (V, 3) float32
    """
    attribute = mesh.attributes.get(name) or mesh.attributes.new(name, "FLOAT_VECTOR", "POINT")
    attribute.data.foreach_set("vector", np.ascontiguousarray(vectors, np.float32).ravel())


def read_attribute(mesh: bpy.types.Mesh, name: str) -> NDArray[np.float32] | None:
    """Return the attribute that `write_attribute` stored, (V, 3) float32, or None; in edit mode they are empty."""
    attribute = mesh.attributes.get(name)
    if attribute is None or attribute.data_type != "FLOAT_VECTOR" or attribute.domain != "POINT":
        return None
    if len(attribute.data) != len(mesh.vertices):
        return None
    return read_vectors(attribute.data, "vector", len(mesh.vertices))


def keep_normals(mesh: bpy.types.Mesh, normals: NDArray[np.float32]) -> None:
    """Store normals on the mesh; from Blender 4.5 they also shade it.

    Parameters
    ----------
    mesh : bpy.types.Mesh
    normals : (V, 3) float32
    """
    write_attribute(mesh, NORMALS, normals)


def kept_normals(mesh: bpy.types.Mesh) -> NDArray[np.float32] | None:
    """Return the normals kept by `keep_normals`, (V, 3) float32, or None."""
    return read_attribute(mesh, NORMALS)


def encode_normals(mesh: bpy.types.Mesh, positions: NDArray[np.float32], normals: NDArray[np.float32]) -> None:
    """Shade with (V, 3) normals before Blender 4.5, correct when the vertices are at `positions`.

    Blender stores them against the normals the mesh has while they are set, so the vertices are moved
    there and back. A normal of zero means Blender's own.
    """
    under_keys = read_positions(mesh)
    _write_positions(mesh, positions)
    mesh.update()
    mesh.normals_split_custom_set_from_vertices(normals)
    _write_positions(mesh, under_keys)
    mesh.update()
