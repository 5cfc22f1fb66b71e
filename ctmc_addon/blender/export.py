# SPDX-License-Identifier: GPL-3.0-or-later
"""A surface out of Blender, in the patient's millimeters.

STL and PLY are written by `core/files/mesh_files.py`, the same bytes as without Blender; the others by Blender's own
exporters, from a copy in a scene of its own: neither the user's scene nor the selection matters, and the object stays
as it is. OBJ is in RAS or LPS millimeters; GLB in glTF's meters, Y up; a .blend opens with the live object, a camera
framed on it and a light.
"""

from __future__ import annotations

import atexit
import json
import os
import struct
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ..core import OutputError, TriangleMesh
from ..core.files import mesh_files
from ..core.files.atomic_write import whole_file
from .datablocks import remove_blocks
from .output_files import require_complete, require_room
from .studio import prepare_scene
from .surface import mesh_data as meshes
from .surface.evaluate import evaluated_copy
from .surface.objects import require_object_mode
from .surface.readback import evaluated_triangles, placement_of
from .timeline import shown_in_turn

MM_PER_M = 1000.0
PLACEHOLDER = "CTMC-export"  # and a number; the object's own name is taken while the object exists


def export(
    obj: bpy.types.Object,
    path: str | os.PathLike[str],
    space: str = "ras",
    scene: bpy.types.Scene | None = None,
) -> None:
    """Write the evaluated surface to `path`, whole or not at all; the suffix chooses the format.

    As `export_together` writes one object.
    """
    export_together([obj], path, space, scene)


def export_together(
    objects: Sequence[bpy.types.Object],
    path: str | os.PathLike[str],
    space: str = "ras",
    scene: bpy.types.Scene | None = None,
    collection: str = "",
    frames: Sequence[int] = (),
) -> None:
    """Write the evaluated surfaces of one or several objects to one file, whole or not at all.

    Parameters
    ----------
    path : path
        Its suffix chooses the format; an STL or PLY holds one surface.
    space : {"ras", "lps"}
        Axes of an STL, PLY or OBJ: x to the patient's right or left, y to the front or back, z to the head.
    scene : Scene or None
        Where the objects are evaluated; None takes the first scene that holds each.
    collection : str
        The name of a collection that holds the objects of a .blend; empty for none.
    frames : sequence of int
        At which each object of a .blend is shown, and the others are not; empty for all at once.

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
        evaluated_triangles(objects[0], scene).save(target, space)
        return
    with whole_file(target) as temporary:
        try:
            written, expected = WRITERS[suffix](objects, temporary, space, scene, collection, frames)
        except RuntimeError as error:  # how Blender's operators report what they could not do
            raise OutputError(f"{target.name} could not be written: {str(error).strip()}") from error
        require_complete(temporary, written, expected, target.name)


def write_obj(
    objects: Sequence[bpy.types.Object],
    path: Path,
    space: str,
    scene: bpy.types.Scene | None,
    collection: str,
    frames: Sequence[int],
) -> tuple[int, int]:
    """Write an OBJ without a material file; return its faces, and the faces it should have.

    Without normals, which Blender 4.2 keeps less exactly: the same surface gives the same lines in every version.
    """
    surfaces = [evaluated_triangles(obj, scene, space) for obj in objects]
    faces = sum(len(surface.faces) for surface in surfaces)
    # At most: a vertex in 45 letters, a face in 40.
    require_room(path, 1000 + 45 * sum(len(surface.vertices) for surface in surfaces) + 40 * faces)
    with meshes_in_context(objects, surfaces, scene) as names:
        bpy.ops.wm.obj_export(
            filepath=str(path),
            check_existing=False,
            apply_modifiers=True,
            forward_axis="Y",
            up_axis="Z",
            export_normals=False,
            export_uv=False,
            export_materials=False,
            export_triangulated_mesh=True,
        )
    line_ended, written = False, 0
    titles = {name.encode(): obj.name.replace(" ", "_").encode() for name, obj in zip(names, objects, strict=True)}
    renamed = path.with_name(f"{path.stem}-named{path.suffix}")
    try:
        with path.open("rb") as file, renamed.open("wb") as out:
            for line in file:
                line_ended = line.endswith(b"\n")
                written += line.startswith(b"f ") and line_ended
                out.write(b"o %s\n" % titles[line[2:].strip()] if line.startswith(b"o ") else line)
        renamed.replace(path)
    finally:
        renamed.unlink(missing_ok=True)
    return written, faces


def write_glb(
    objects: Sequence[bpy.types.Object],
    path: Path,
    space: str,
    scene: bpy.types.Scene | None,
    collection: str,
    frames: Sequence[int],
) -> tuple[int, int]:
    """A binary glTF; returns its bytes, and the bytes its header promises. Its axes are glTF's, whatever `space`."""
    if not hasattr(bpy.types, "EXPORT_SCENE_OT_gltf"):
        raise OutputError("a .glb needs Blender's glTF exporter; enable 'glTF 2.0 format' in the add-on preferences")
    if bpy.app.version < (4, 5, 0) and not bpy.app.binary_path:
        atexit.register(empty_gltf_modules)
    surfaces = [evaluated_triangles(obj, scene) for obj in objects]
    # At most: every corner with a position, a normal and a number of its own.
    require_room(path, 10_000 * len(objects) + 84 * sum(len(surface.faces) for surface in surfaces))
    with meshes_in_context(objects, surfaces, scene, unit_mm=MM_PER_M) as names:
        bpy.ops.export_scene.gltf(
            filepath=str(path),
            check_existing=False,
            export_format="GLB",
            export_apply=True,
            export_morph=False,
            export_animations=False,
            export_yup=True,
            use_active_scene=True,
        )
    content = path.read_bytes()
    promised = struct.unpack("<4sII", content[:12])[2] if len(content) >= 12 else -1
    if promised == len(content):
        content = named_glb(content, {name: obj.name for name, obj in zip(names, objects, strict=True)})
        path.write_bytes(content)
        return len(content), len(content)
    return len(content), promised


def named_glb(content: bytes, names: Mapping[str, str]) -> bytes:
    """Write a GLB whose nodes and meshes are called by other `names`.

    glTF 2.0, 4.4: a header, a chunk of JSON in groups of 4 bytes, the rest.
    """
    (length,) = struct.unpack_from("<I", content, 12)
    tree: dict[str, Any] = json.loads(content[20 : 20 + length])
    for node in tree["nodes"]:
        node["name"] = names[node["name"]]
        if "mesh" in node:
            tree["meshes"][node["mesh"]]["name"] = node["name"]
    text = json.dumps(tree, separators=(",", ":"), ensure_ascii=False).encode()
    text += b" " * (-len(text) % 4)
    other_chunks = content[20 + length :]
    return (
        struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text) + len(other_chunks), len(text), b"JSON")
        + text
        + other_chunks
    )


def write_blend(
    objects: Sequence[bpy.types.Object],
    path: Path,
    space: str,
    scene: bpy.types.Scene | None,
    collection: str,
    frames: Sequence[int],
) -> tuple[int, int]:
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
        added += prepare_scene(own_scene, objects)
        own_scene.view_layers[0].objects.active = objects[0]
        # About: under and at the key, normals, edges, corners; and what every .blend holds.
        rows = sum(len(obj.data.vertices) + len(obj.data.polygons) for obj in objects)
        require_room(path, 500_000 + 40 * rows)
        # Not save_as_mainfile: that would write the whole file, and the path it lies at.
        with shown_in_turn(objects, frames, own_scene) if frames else nullcontext():
            bpy.data.libraries.write(str(path), {own_scene}, path_remap="RELATIVE_ALL")
    finally:
        remove_blocks(own_scene, *added)
    return 0, 0


def empty_gltf_modules() -> None:
    """Empty the glTF exporter's modules: in the bpy 4.2 module they keep Blender from closing, and Python crashes."""
    for name in [name for name in sys.modules if name.startswith("io_scene_gltf2.blender.exp")]:
        vars(sys.modules.pop(name)).clear()


@contextmanager
def meshes_in_context(
    objects: Sequence[bpy.types.Object],
    surfaces: Sequence[TriangleMesh],
    scene: bpy.types.Scene | None,
    unit_mm: float = 1.0,
) -> Iterator[list[str]]:
    """A scene of its own, in context, that holds only these surfaces, in units of `unit_mm`, in their materials.

    Yields the names of the objects in it.
    """
    own_scene = bpy.data.scenes.new("surface")
    blocks: list[bpy.types.ID] = []
    names = []
    try:
        for number, (obj, surface) in enumerate(zip(objects, surfaces, strict=True)):
            mesh, _ = evaluated_copy(obj, scene)  # for its materials, shading and attributes
            mesh.name = "surface"
            copy = bpy.data.objects.new(f"{PLACEHOLDER}-{number:04d}", mesh)
            blocks += [copy, mesh]
            names.append(copy.name)
            take_surface(mesh, surface, unit_mm)
            own_scene.collection.objects.link(copy)
        with bpy.context.temp_override(scene=own_scene, view_layer=own_scene.view_layers[0]):
            yield names
    finally:
        remove_blocks(own_scene, *blocks)


def take_surface(mesh: bpy.types.Mesh, surface: TriangleMesh, unit_mm: float) -> None:
    """Give a copy of an object's mesh the positions and normals of its surface, in units of `unit_mm`."""
    if (meshes.read_triangles(mesh) != surface.faces).any():  # mirrored
        mesh.flip_normals()
    positions = (surface.vertices / np.float64(unit_mm)).astype(np.float32)
    meshes.write_positions(mesh, positions)
    if surface.normals is not None:
        meshes.keep_normals(mesh, surface.normals)
        if not meshes.FREE_NORMALS:
            meshes.encode_normals(mesh, positions, surface.normals)
    mesh.update()


WRITERS: dict[str, Callable[..., tuple[int, int]]] = dict(
    zip(mesh_files.BLENDER_SUFFIXES, (write_obj, write_glb, write_blend), strict=True)
)
