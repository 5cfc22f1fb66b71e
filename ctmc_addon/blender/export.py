# SPDX-License-Identifier: GPL-3.0-or-later
"""Export surfaces from Blender in the patient's millimeters.

STL and PLY are written by `core/files/mesh_files.py` and OBJ, GLB, 3MF and HTML by `core/files/structures`, the same
bytes as without Blender; a .blend opens with the live object, a camera framed on it and lights. Neither the user's
scene nor the selection matters, and the object stays as it is.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import bpy

from ..core import OutputError, Structure, write_structures
from ..core.files import mesh_files
from ..core.files.atomic_write import whole_file
from ..core.maps import SurfaceMap
from .colors import srgb
from .datablocks import remove_blocks
from .maps import map_values, read_map, shown_name, stored_maps
from .materials import material_color, material_opacity
from .output_files import require_room
from .scene.engine import set_render_engine
from .scene.lighting import set_up_studio
from .scene.studio import SIZE, set_render
from .scene.timeline import shown_in_turn
from .surface.evaluate import evaluated_object, require_object_mode
from .surface.readback import evaluated_triangles, placement_of

MM_PER_M = 1000.0


def export(
    obj: bpy.types.Object, path: str | os.PathLike[str], space: str = "ras", scene: bpy.types.Scene | None = None
) -> None:
    """Write the evaluated surface of one object to `path`, as `export_together` does for several."""
    export_together([obj], path, space, scene)


def export_together(
    objects: Sequence[bpy.types.Object],
    path: str | os.PathLike[str],
    space: str = "ras",
    scene: bpy.types.Scene | None = None,
    collection: str = "",
    frames: Sequence[int] = (),
) -> int:
    """Write the evaluated surfaces of one or several objects to one file, whole or not at all; return their triangles.

    Parameters
    ----------
    path : path
        Its suffix chooses the format; an STL or PLY holds one surface.
    space : {"ras", "lps"}
        Axes of an STL, PLY, OBJ or 3MF: x to the patient's right or left, y to the front or back, z to the head.
    scene : Scene or None
        Scene in which the objects are evaluated; None takes the first scene that holds each.
    collection : str
        The name of a collection that holds the objects of a .blend; empty for none.
    frames : sequence of int
        Frames at which only one object of a .blend is shown, in order; empty shows all at once.

    Raises
    ------
    OutputError
        For an unknown suffix, several surfaces in an STL or PLY, or a place that cannot be written to.
    MeshError
        If Blender does not evaluate an object, or it is in edit mode.
    """
    target = Path(path)
    suffix = target.suffix.lower()
    if suffix not in mesh_files.SURFACE_SUFFIXES:
        formats = ", ".join(mesh_files.SURFACE_SUFFIXES)
        raise OutputError(f"{target.name or 'an empty name'} has no known suffix; the formats are {formats}")
    for obj in objects:
        require_object_mode(obj)
    if suffix in mesh_files.SUFFIXES:
        mesh_files.require_one_surface(target, len(objects))
        mesh = evaluated_triangles(objects[0], scene)
        mesh.save(target, space, _evaluated_maps(objects[0], scene))
        return len(mesh.faces)
    if suffix in mesh_files.STRUCTURE_SUFFIXES:
        structures = [structure_of(obj, scene) for obj in objects]
        write_structures(target, structures, space)
        return sum(len(structure.faces) for structure in structures)
    with whole_file(target) as temporary:
        try:
            write_blend(objects, temporary, scene, collection, frames)
        except RuntimeError as error:  # Blender's operators report their failures so.
            raise OutputError(f"{target.name} could not be written: {str(error).strip()}") from error
    return sum(len(obj.data.polygons) for obj in objects)


def structure_of(obj: bpy.types.Object, scene: bpy.types.Scene | None = None) -> Structure:
    """Return the evaluated surface of an object, with its name and the color and opacity of its material."""
    mesh = evaluated_triangles(obj, scene)
    color, opacity = srgb(material_color(obj)), material_opacity(obj)
    volume, maps = mesh.measures.enclosed_volume, _evaluated_maps(obj, scene)
    return Structure(obj.name, mesh.vertices, mesh.faces, color, opacity, mesh.normals, volume, maps, shown_name(obj))


def _evaluated_maps(obj: bpy.types.Object, scene: bpy.types.Scene | None = None) -> tuple[SurfaceMap, ...]:
    """Return the maps of an object on the vertices that it has with its modifiers, which interpolate the values."""
    maps = [read_map(obj.data, stored.name) for stored in stored_maps(obj.data)]
    if not maps:
        return ()
    with evaluated_object(obj, scene) as (evaluated, _):
        mesh = evaluated.data
        return tuple(
            replace(each, values=map_values(mesh, each.name))
            for each in maps
            if each is not None and each.name in mesh.attributes
        )


def write_blend(
    objects: Sequence[bpy.types.Object],
    path: Path,
    scene: bpy.types.Scene | None,
    collection: str,
    frames: Sequence[int],
) -> None:
    """Write a .blend with the live objects, framed; nothing else of the present file goes in.

    It has no windows of its own, so whoever opens it keeps theirs, and Blender warns of a "Library file, loading
    empty scene", which it is not: the scene in the file becomes the present one.
    """
    own_scene = bpy.data.scenes.new("CTMC")
    own_scene.frame_current = next(iter([scene] if scene else objects[0].users_scene), own_scene).frame_current
    # So that Blender's own rulers and sidebar tell the patient's millimeters.
    own_scene.unit_settings.scale_length = 1 / (placement_of(objects[0]).scale * MM_PER_M)
    own_scene.unit_settings.length_unit = "MILLIMETERS"
    added: tuple[bpy.types.ID, ...] = ()
    try:
        parent = own_scene.collection
        if collection:
            parent = bpy.data.collections.new(collection)
            own_scene.collection.children.link(parent)
            added = (parent,)
        for obj in objects:
            parent.objects.link(obj)
        set_render(own_scene, SIZE)
        set_render_engine(own_scene, "cycles")
        added += set_up_studio(own_scene, objects)
        own_scene.view_layers[0].objects.active = objects[0]
        # About: under and at the key, normals, edges, corners; and what every .blend holds.
        rows = sum(len(obj.data.vertices) + len(obj.data.polygons) for obj in objects)
        require_room(path, 500_000 + 40 * rows)
        # Not save_as_mainfile: that would write the whole file, and the path it lies at.
        with shown_in_turn(objects, frames, own_scene) if frames else nullcontext():
            bpy.data.libraries.write(str(path), {own_scene}, path_remap="RELATIVE_ALL")
    finally:
        remove_blocks(own_scene, *added)
