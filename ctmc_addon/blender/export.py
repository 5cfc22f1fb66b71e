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
from collections.abc import Callable, Iterator
from contextlib import contextmanager
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

MM_PER_M = 1000.0
PLACEHOLDER = "CTMC export"  # the object's own name is taken while the object exists


def export(
    obj: bpy.types.Object,
    path: str | os.PathLike[str],
    space: str = "ras",
    scene: bpy.types.Scene | None = None,
) -> None:
    """Write the evaluated surface to `path`, whole or not at all; the suffix chooses the format.

    Parameters
    ----------
    space : {"ras", "lps"}
        Axes of an STL, PLY or OBJ: x to the patient's right or left, y to the front or back, z to the head.
    scene : Scene or None
        Where the object is evaluated; None takes the first scene that holds it.

    Raises
    ------
    OutputError
        For an unknown suffix, or a place that cannot be written to.
    MeshError
        If Blender does not evaluate the object, or it is in edit mode.
    """
    target = Path(path)
    suffix = target.suffix.lower()
    if suffix not in mesh_files.SURFACE_SUFFIXES:
        formats = ", ".join(mesh_files.SURFACE_SUFFIXES)
        raise OutputError(f"{target.name or 'an empty name'} has no known suffix; the formats are {formats}")
    require_object_mode(obj)
    if suffix in mesh_files.SUFFIXES:
        evaluated_triangles(obj, scene).save(target, space)
        return
    with whole_file(target) as beside:
        try:
            written, expected = WRITERS[suffix](obj, beside, space, scene)
        except RuntimeError as error:  # how Blender's operators report what they could not do
            raise OutputError(f"{target.name} could not be written: {str(error).strip()}") from error
        require_complete(beside, written, expected, target.name)


def write_obj(obj: bpy.types.Object, path: Path, space: str, scene: bpy.types.Scene | None) -> tuple[int, int]:
    """An OBJ without a material file; returns its faces, and the faces it should have.

    Without normals, which Blender 4.2 keeps less exactly: the same surface gives the same lines in every version.
    """
    surface = evaluated_triangles(obj, scene, space)
    # At most: a vertex in 45 letters, a face in 40.
    require_room(path, 1000 + 45 * len(surface.vertices) + 40 * len(surface.faces))
    with mesh_in_context(obj, surface, scene):
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
    renamed = path.with_name(f"{path.stem}-named{path.suffix}")
    try:
        with path.open("rb") as file, renamed.open("wb") as out:
            for line in file:
                line_ended = line.endswith(b"\n")
                written += line.startswith(b"f ") and line_ended
                out.write(f"o {obj.name.replace(' ', '_')}\n".encode() if line.startswith(b"o ") else line)
        renamed.replace(path)
    finally:
        renamed.unlink(missing_ok=True)
    return written, len(surface.faces)


def write_glb(obj: bpy.types.Object, path: Path, space: str, scene: bpy.types.Scene | None) -> tuple[int, int]:
    """A binary glTF; returns its bytes, and the bytes its header promises. Its axes are glTF's, whatever `space`."""
    if not hasattr(bpy.types, "EXPORT_SCENE_OT_gltf"):
        raise OutputError("a .glb needs Blender's glTF exporter; enable 'glTF 2.0 format' in the add-on preferences")
    if bpy.app.version < (4, 5, 0) and not bpy.app.binary_path:
        atexit.register(empty_gltf_modules)
    surface = evaluated_triangles(obj, scene)
    # At most: every corner with a position, a normal and a number of its own.
    require_room(path, 10_000 + 84 * len(surface.faces))
    with mesh_in_context(obj, surface, scene, unit_mm=MM_PER_M):
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
        content = named_glb(content, obj.name)
        path.write_bytes(content)
        return len(content), len(content)
    return len(content), promised


def named_glb(content: bytes, name: str) -> bytes:
    """A GLB whose node is called `name` (glTF 2.0, 4.4: a header, a chunk of JSON in groups of 4 bytes, the rest)."""
    (length,) = struct.unpack_from("<I", content, 12)
    tree: dict[str, Any] = json.loads(content[20 : 20 + length])
    for node in tree["nodes"]:
        node["name"] = name
    text = json.dumps(tree, separators=(",", ":"), ensure_ascii=False).encode()
    text += b" " * (-len(text) % 4)
    other_chunks = content[20 + length :]
    return (
        struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text) + len(other_chunks), len(text), b"JSON")
        + text
        + other_chunks
    )


def write_blend(obj: bpy.types.Object, path: Path, space: str, scene: bpy.types.Scene | None) -> tuple[int, int]:
    """A .blend with the live object, framed; nothing else of the present file goes in.

    It has no windows of its own, so whoever opens it keeps theirs, and Blender warns of a "Library file, loading
    empty scene", which it is not: the scene in the file becomes the present one.
    """
    own_scene = bpy.data.scenes.new("CTMC")
    own_scene.frame_current = next(iter([scene] if scene else obj.users_scene), own_scene).frame_current
    # So that Blender's own rulers and sidebar tell the patient's millimeters.
    own_scene.unit_settings.scale_length = 1 / (placement_of(obj).scale * MM_PER_M)
    own_scene.unit_settings.length_unit = "MILLIMETERS"
    added: tuple[bpy.types.ID, ...] = ()
    try:
        own_scene.collection.objects.link(obj)
        added = prepare_scene(own_scene, obj)
        own_scene.view_layers[0].objects.active = obj
        # About: under and at the key, normals, edges, corners; and what every .blend holds.
        require_room(path, 500_000 + 40 * len(obj.data.vertices) + 40 * len(obj.data.polygons))
        # Not save_as_mainfile: that would write the whole file, and the path it lies at.
        bpy.data.libraries.write(str(path), {own_scene}, path_remap="RELATIVE_ALL")
    finally:
        remove_blocks(own_scene, *added)
    return 0, 0


def empty_gltf_modules() -> None:
    """Empty the glTF exporter's modules: in the bpy 4.2 module they keep Blender from closing, and Python crashes."""
    for name in [name for name in sys.modules if name.startswith("io_scene_gltf2.blender.exp")]:
        vars(sys.modules.pop(name)).clear()


@contextmanager
def mesh_in_context(
    obj: bpy.types.Object, surface: TriangleMesh, scene: bpy.types.Scene | None, unit_mm: float = 1.0
) -> Iterator[None]:
    """A scene of its own, in context, that holds only this surface, in units of `unit_mm`, in the object's material."""
    mesh, _ = evaluated_copy(obj, scene)  # for its materials, shading and attributes
    mesh.name = "surface"
    own_scene = bpy.data.scenes.new("surface")
    copy = bpy.data.objects.new(PLACEHOLDER, mesh)
    try:
        if (meshes.read_triangles(mesh) != surface.faces).any():  # mirrored
            mesh.flip_normals()
        positions = (surface.vertices / np.float64(unit_mm)).astype(np.float32)
        meshes.write_positions(mesh, positions)
        if surface.normals is not None:
            meshes.keep_normals(mesh, surface.normals)
            if not meshes.FREE_NORMALS:
                meshes.encode_normals(mesh, positions, surface.normals)
        mesh.update()
        own_scene.collection.objects.link(copy)
        with bpy.context.temp_override(scene=own_scene, view_layer=own_scene.view_layers[0]):
            yield
    finally:
        remove_blocks(own_scene, copy, mesh)


WRITERS: dict[str, Callable[..., tuple[int, int]]] = dict(
    zip(mesh_files.BLENDER_SUFFIXES, (write_obj, write_glb, write_blend), strict=True)
)
