"""A reconstruction as an object: made, updated, and made final.

Alpha is the shape key `alpha` over the midpoints (Su and Ma, eq. 5 to 7), Decimate a live modifier after it.
What made the object is remembered in its custom property `ctmc`, which any Blender shows without this extension.
"""

from __future__ import annotations

import json
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core import VERSION, MeshError, Reconstruction, ReconstructionSettings
from ..materials import Colour, colour_of, surface_material
from . import mesh_data as meshes
from .evaluate import evaluated_copy
from .placement import SCALE, Placement, centred

MEMORY = "ctmc"
KEY = "alpha"
DECIMATE = "CTMC Decimate"
NAME_BYTES = 63  # Blender 4 cuts longer names
STRUCTURE_BYTES = 40  # of them for a label's name at most


def add_reconstruction(
    result: Reconstruction,
    scene: bpy.types.Scene,
    scale: float = SCALE,
    color: Colour | None = None,
    mesh: bpy.types.Mesh | None = None,
    structure: str = "",
) -> bpy.types.Object:
    """A new object in `scene` for a surface, at its place in the patient.

    Parameters
    ----------
    scale : float
        Blender units of 1 mm.
    color : (red, green, blue) or None
        Linear; None takes the colour of the label.
    mesh : Mesh or None
        What `surface_mesh` has made of it at this scale; None makes it now.
    structure : str
        What the label is called, for the object's name; empty where the CT does not say.

    Raises
    ------
    MeshError
        If the surface has no triangles.
    """
    name = object_name(result, structure)
    mesh = surface_mesh(result, None, scale) if mesh is None else mesh
    mesh.name = name
    placement = centred(result.mesh.vertices, scale)
    mesh.materials.append(surface_material(name, color or colour_of(result.settings.label)))
    thing = bpy.data.objects.new(name, mesh)
    thing.location = placement.origin
    scene.collection.objects.link(thing)
    add_alpha(thing, result, placement)
    follow_decimate(thing, result)
    shade(thing, result)
    remember(thing, result, placement)
    return thing


def update_reconstruction(thing: bpy.types.Object, result: Reconstruction, mesh: bpy.types.Mesh | None = None) -> None:
    """Give an object another surface; its transform, materials, modifiers and animation stay.

    The mesh is what `surface_mesh` has made of it for this object; None makes it now.

    The key's value and Decimate's ratio follow the new settings if nobody has moved them since the old
    ones were applied, and stay where a hand or an animation has put them otherwise.

    Raises
    ------
    MeshError
        If the object was not made here or cannot be changed, or the surface has no triangles.
    """
    require_changeable(thing)
    mesh = surface_mesh(result, thing) if mesh is None else mesh
    placement, before = placement_of(thing), settings_of(thing)
    old, old_keys = thing.data, thing.data.shape_keys
    for material in old.materials:
        mesh.materials.append(material)
    thing.data = mesh
    add_alpha(thing, result, placement)
    if old_keys is not None and mesh.shape_keys is not None:
        keep_key(old_keys, mesh.shape_keys, before.alpha)
    follow_decimate(thing, result, before)
    shade(thing, result)
    remember(thing, result, placement)
    discard(old, mesh)


def make_final(thing: bpy.types.Object) -> None:
    """Bake alpha and every modifier that shows in the viewport into a plain mesh.

    Raises
    ------
    MeshError
        If the object cannot be changed.
    """
    require_changeable(thing)
    old = thing.data
    refresh_normals(thing)
    mesh, _ = evaluated_copy(thing)
    thing.data = mesh
    for modifier in [one for one in thing.modifiers if one.show_viewport]:
        thing.modifiers.remove(modifier)
    discard(old, mesh)


def refresh_normals(thing: bpy.types.Object) -> None:
    """Before Blender 4.5: shade with the gradient at the key's present value; later versions need no such thing.

    Call it when alpha has come to rest. Under a Decimate modifier such normals would be wrong, and are left out.
    """
    mesh = thing.data
    normals = meshes.remembered_normals(mesh)
    if meshes.FREE_NORMALS or normals is None:
        return
    if any(modifier.type == "DECIMATE" and modifier.show_viewport for modifier in thing.modifiers):
        normals = np.zeros_like(normals)
    meshes.encode_normals(mesh, mixed_positions(mesh), normals)


def remembered(thing: bpy.types.Object) -> dict[str, Any]:
    """What is known of how an object was made: version, name, settings, counts, notes; empty for others."""
    memory = thing.get(MEMORY)
    return json.loads(memory["report"]) if memory is not None else {}


def settings_of(thing: bpy.types.Object) -> ReconstructionSettings:
    """The settings an object was made with."""
    return ReconstructionSettings.from_dict(json.loads(memory_of(thing)["settings"]))


def placement_of(thing: bpy.types.Object) -> Placement:
    """How the patient's millimetres became the object's local space."""
    memory = memory_of(thing)
    x, y, z = memory["origin"]
    return Placement((x, y, z), memory["scale"])


def memory_of(thing: bpy.types.Object) -> Any:
    """The custom property that `remember` wrote, or a `MeshError`."""
    memory = thing.get(MEMORY)
    if memory is None:
        raise MeshError(f"{thing.name} was not made by CTMC; choose a reconstructed object")
    return memory


def object_name(result: Reconstruction, structure: str = "") -> str:
    """The file's stem and the label or what it is called, short enough for every Blender to keep the label."""
    label = "" if result.settings.label is None else f" {structure or f'label {result.settings.label}'}"
    label = cut(label, STRUCTURE_BYTES)
    return cut(result.name, NAME_BYTES - 4 - len(label.encode())) + label  # 4 for the .001 of a second one


def cut(text: str, size: int) -> str:
    """The beginning of a text, of so many bytes at most."""
    return text.encode("utf-8", "replace")[:size].decode("utf-8", "ignore")


def surface_mesh(
    result: Reconstruction,
    thing: bpy.types.Object | None = None,
    scale: float = SCALE,
    edges: meshes.Edges | None = None,
) -> bpy.types.Mesh:
    """The surface at alpha 0 where alpha is still open, else as it is: a mesh for `thing` or a new object to take.

    This is nearly all of the time that a surface takes to get into Blender, and no scene has seen it yet. Its edges
    may have been found before, by `meshes.edges_steps`.

    Raises
    ------
    MeshError
        If the surface has no triangles.
    """
    if not len(result.mesh.faces):
        raise MeshError(
            f"the surface of {result.name} has no triangles; choose another threshold or label"
            if thing is None
            else f"the new surface has no triangles, so {thing.name} keeps its old one; choose another threshold"
        )
    name = object_name(result) if thing is None else thing.data.name
    placement = centred(result.mesh.vertices, scale) if thing is None else placement_of(thing)
    surface = result.surface
    points, faces = (result.mesh.vertices, result.mesh.faces) if surface is None else (surface.midpoints, surface.faces)
    return meshes.new_mesh(name, placement.to_local(points), faces, edges)


def add_alpha(thing: bpy.types.Object, result: Reconstruction, placement: Placement) -> None:
    """The shape key `alpha`: linear crossings over midpoints, at the value of the settings."""
    if result.surface is None:
        return
    thing.shape_key_add(name="Basis", from_mix=False)
    key = thing.shape_key_add(name=KEY, from_mix=False)
    key.points.foreach_set("co", placement.to_local(result.surface.linear).ravel())
    key.value = result.settings.alpha


def keep_key(old: bpy.types.Key, new: bpy.types.Key, set_alpha: float) -> None:
    """Carry the value and animation of the key `alpha` over to a new mesh's keys."""
    before = old.key_blocks.get(KEY)
    if before is not None and before.value != np.float32(set_alpha):
        new.key_blocks[KEY].value = before.value
    animation = old.animation_data
    if animation is None:
        return
    target = new.animation_data_create()
    target.action = animation.action
    if getattr(animation, "action_slot", None) is not None:
        target.action_slot = animation.action_slot
    for driver in animation.drivers:
        target.drivers.from_existing(src_driver=driver)


def follow_decimate(
    thing: bpy.types.Object, result: Reconstruction, before: ReconstructionSettings | None = None
) -> None:
    """Our own Decimate modifier, there where the settings ask for it; others are left alone."""
    settings, modifier = result.settings, thing.modifiers.get(DECIMATE)
    if settings.simplifier != "decimate" or not settings.simplifies:
        if modifier is not None:
            thing.modifiers.remove(modifier)
        return
    ratio = decimate_ratio(settings, len(result.mesh.faces))
    if modifier is None:
        modifier = thing.modifiers.new(DECIMATE, "DECIMATE")
        modifier.ratio = ratio
    elif before is not None and modifier.ratio == np.float32(decimate_ratio(before, remembered(thing)["full_faces"])):
        modifier.ratio = ratio


def decimate_ratio(settings: ReconstructionSettings, faces: int) -> float:
    """The share of the triangles that Decimate is to leave."""
    if settings.target_faces is not None:
        return min(1.0, settings.target_faces / faces)
    return 1.0 if settings.reduction is None else 1.0 - settings.reduction


def shade(thing: bpy.types.Object, result: Reconstruction) -> None:
    """Shade with the surface's own normals, where it has any."""
    normals = result.mesh.normals if result.surface is None else result.surface.normals
    if normals is not None:
        meshes.remember_normals(thing.data, normals)
        refresh_normals(thing)


def remember(thing: bpy.types.Object, result: Reconstruction, placement: Placement) -> None:
    """Note on the object how it was made. JSON, as voxel counts outgrow Blender's whole numbers."""
    settings = result.settings.to_dict()
    report = {
        "version": VERSION,
        "name": result.name,
        "settings": settings,
        "threshold": result.threshold,
        "faces": len(result.mesh.faces),
        "vertices": len(result.mesh.vertices),
        "full_faces": result.full_faces,
        "voxels_visited": result.voxels_visited,
        "spacing_mm": list(result.spacing_mm),
        "notes": list(result.notes),
    }
    thing[MEMORY] = {
        "version": VERSION,
        "scale": placement.scale,
        "origin": placement.origin,
        "settings": json.dumps(settings),
        "report": json.dumps(report, ensure_ascii=False),
    }


def require_changeable(thing: bpy.types.Object) -> None:
    """Raise `MeshError` with a remedy for an object whose mesh cannot be replaced."""
    if thing.type != "MESH":
        raise MeshError(f"{thing.name} is no mesh; choose a reconstructed object")
    if thing.library is not None or thing.override_library is not None or thing.data.library is not None:
        raise MeshError(f"{thing.name} is linked from another file; make it local first")
    require_left_alone(thing)


def require_left_alone(thing: bpy.types.Object) -> None:
    """Raise `MeshError` for an object in edit mode: until that is left, its mesh is not the one that is shown."""
    if thing.mode == "EDIT":
        raise MeshError(f"{thing.name} is in edit mode; leave it first")


def mixed_positions(mesh: bpy.types.Mesh) -> NDArray[np.float32]:
    """The vertices where the key `alpha` puts them, (V, 3) float32, before any modifier."""
    keys = mesh.shape_keys
    if keys is None or KEY not in keys.key_blocks:
        return meshes.read_positions(mesh)
    key = keys.key_blocks[KEY]
    basis, linear = (meshes.read_vectors(block.points, "co", len(mesh.vertices)) for block in (keys.reference_key, key))
    return basis + (linear - basis) * np.float32(0.0 if key.mute else key.value)


def discard(old: bpy.types.Mesh, new: bpy.types.Mesh) -> None:
    """Remove a replaced mesh, with its keys, unless someone else uses it; the new one takes its name."""
    if old.users == 0:
        name = old.name
        bpy.data.meshes.remove(old)
        new.name = name
