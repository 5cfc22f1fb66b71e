# SPDX-License-Identifier: GPL-3.0-or-later
"""Read triangles from mesh files with Blender's own importers."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np

from ..core import MeshError, ReadError, TriangleMesh
from ..core.volume import transform_points
from .surface import mesh_data
from .surface.evaluate import evaluated_object
from .surface.placement import matrix_of

MESH_SUFFIXES = (".stl", ".ply", ".obj", ".glb", ".blend")
# Every kind of data that an importer may leave in the file.
KINDS = (
    *("objects", "meshes", "collections", "materials", "images", "textures", "node_groups", "scenes", "worlds"),
    *("cameras", "lights", "curves", "armatures", "actions", "libraries"),
)


def read_mesh(path: Path) -> TriangleMesh:
    """Return all meshes of a file as one, in the file's own unit, without normals; the Blender file stays as it was.

    Raises
    ------
    ReadError
        If Blender cannot read the file.
    MeshError
        If there is not one triangle in it.
    """
    if not path.is_file():
        raise ReadError(f"there is no file {path}; check the path")
    with _added_data_removed():
        try:
            objects = _import_objects(path)
        except RuntimeError as error:  # Blender's operators report their failures so.
            raise ReadError(f"{path.name} cannot be read: {' '.join(str(error).split())}") from error
        scene = bpy.data.scenes.new("CTMC Import")
        for obj in objects:
            if obj.name not in scene.collection.objects:
                scene.collection.objects.link(obj)
        meshes = [_world_mesh(obj, scene) for obj in objects]
    if not sum(len(mesh.faces) for mesh in meshes):
        raise MeshError(f"{path.name} has no triangles; choose a file with a surface in it")
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [mesh.faces + np.int32(start) for mesh, start in zip(meshes, starts, strict=False)]
    return TriangleMesh(np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(faces).astype(np.int32))


def _import_objects(path: Path) -> list[bpy.types.Object]:
    """Return the mesh objects that the file adds to Blender's."""
    before = set(bpy.data.objects)
    suffix, name = path.suffix.lower(), str(path.resolve())
    if suffix == ".stl":
        bpy.ops.wm.stl_import(filepath=name)
    elif suffix == ".ply":
        bpy.ops.wm.ply_import(filepath=name)
    elif suffix == ".obj":
        bpy.ops.wm.obj_import(filepath=name, forward_axis="Y", up_axis="Z")
    elif suffix == ".glb":
        bpy.ops.import_scene.gltf(filepath=name)
    else:
        _append_objects(name, path.name)
    return [obj for obj in bpy.data.objects if obj not in before and obj.type == "MESH"]


def _append_objects(path: str, name: str) -> None:
    """Copy all objects of a .blend into this file."""
    try:
        with bpy.data.libraries.load(path) as (source, target):
            target.objects = list(source.objects)
    except OSError as error:
        raise ReadError(f"{name} cannot be read: it is not a .blend that this Blender can open") from error


def _world_mesh(obj: bpy.types.Object, scene: bpy.types.Scene) -> TriangleMesh:
    """Return an object's evaluated triangles in world space."""
    with evaluated_object(obj, scene) as (evaluated, _):
        vertices, faces = mesh_data.read_positions(evaluated.data), mesh_data.read_triangles(evaluated.data)
        matrix = matrix_of(evaluated.matrix_world)
    return TriangleMesh(transform_points(matrix, vertices).astype(np.float32), faces)


@contextmanager
def _added_data_removed() -> Iterator[None]:
    """Remove the data-blocks that the block adds."""
    before = {kind: set(getattr(bpy.data, kind)) for kind in KINDS}
    try:
        yield
    finally:
        added = [block for kind in KINDS for block in getattr(bpy.data, kind) if block not in before[kind]]
        bpy.data.batch_remove(added)
