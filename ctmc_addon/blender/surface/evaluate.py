"""What Blender makes of an object: keys mixed, modifiers applied."""

from __future__ import annotations

import bpy

from ...core import MeshError, TriangleMesh
from . import mesh_data as meshes
from .placement import SCALE, moved, to_patient


def evaluated_object(
    thing: bpy.types.Object, scene: bpy.types.Scene | None = None
) -> tuple[bpy.types.Object, bpy.types.Depsgraph]:
    """The object as evaluated in `scene`, by default in the first that holds it, and its depsgraph.

    Raises
    ------
    MeshError
        If the object is no mesh, is in no scene, or is switched off in viewports, so that Blender does not
        evaluate it.
    """
    if thing.type != "MESH":
        raise MeshError(f"{thing.name} is no mesh; choose a reconstructed object")
    holders = thing.users_scene if scene is None else [scene]
    layer = next((layer for holder in holders for layer in holder.view_layers if holds(layer, thing)), None)
    if layer is None:
        raise MeshError(f"{thing.name} is in no scene; link it to a collection first")
    evaluated = thing.evaluated_get(layer.depsgraph)
    if not evaluated.is_evaluated:
        raise MeshError(f"{thing.name} is disabled in viewports; switch its monitor icon on first")
    return evaluated, layer.depsgraph


def holds(layer: bpy.types.ViewLayer, thing: bpy.types.Object) -> bool:
    """Whether an object is in a view layer, once both are up to date."""
    layer.update()
    return bool(layer.objects.get(thing.name) == thing)


def evaluated_copy(
    thing: bpy.types.Object, scene: bpy.types.Scene | None = None
) -> tuple[bpy.types.Mesh, bpy.types.Object]:
    """A new plain mesh of the evaluated object, in its local space, and that evaluated object."""
    evaluated, depsgraph = evaluated_object(thing, scene)
    mesh = bpy.data.meshes.new_from_object(evaluated, preserve_all_data_layers=True, depsgraph=depsgraph)
    return mesh, evaluated


def evaluated_triangles(
    thing: bpy.types.Object, scene: bpy.types.Scene | None = None, space: str = "ras"
) -> TriangleMesh:
    """The evaluated surface in millimetres of `space`, "ras" or "lps", without normals."""
    evaluated, _ = evaluated_object(thing, scene)
    mesh = evaluated.data
    matrix = to_patient(evaluated.matrix_world, scale_of(thing), space)
    vertices = moved(matrix, meshes.read_positions(mesh)).astype("float32")
    return TriangleMesh(vertices, meshes.read_triangles(mesh))


def scale_of(thing: bpy.types.Object) -> float:
    """Blender units of 1 mm for this object: as remembered on it, else the default."""
    memory = thing.get("ctmc")
    return SCALE if memory is None else memory["scale"]
