"""A surface out of Blender, in the patient's millimetres, by Blender's own exporters.

STL, PLY and OBJ are in RAS or LPS millimetres; GLB in glTF's metres, Y up; a .blend opens with the live object,
a camera framed on it and a light. Every exporter writes a baked copy in a scene of its own, so neither the
user's scene nor the selection matters, and nothing else gets into the file.
"""

from __future__ import annotations

import atexit
import os
import struct
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import OutputError
from .datablocks import remove_blocks
from .output_files import require_complete, require_room, written_whole
from .studio import prepare_scene
from .surface import mesh_data as meshes
from .surface.evaluate import evaluated_copy, scale_of
from .surface.objects import refresh_normals, require_left_alone
from .surface.placement import moved, to_patient

MM_PER_M = 1000.0


def export(
    thing: bpy.types.Object,
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
    writer = writer_of(target)
    require_left_alone(thing)
    refresh_normals(thing)
    with written_whole(target) as beside:
        try:
            written, expected = writer(thing, beside, space, scene)
        except RuntimeError as error:  # how Blender's operators report what they could not do
            raise OutputError(f"{target.name} could not be written: {str(error).strip()}") from error
        require_complete(beside, written, expected, target.name)


def writer_of(path: Path) -> Callable[..., tuple[int, int]]:
    """The function that writes a file with this suffix, or an `OutputError`."""
    writer = WRITERS.get(path.suffix.lower())
    if writer is None:
        suffixes = ", ".join(WRITERS)
        raise OutputError(f"{path.name or 'an empty name'} has no known suffix; the formats are {suffixes}")
    return writer


def write_stl(thing: bpy.types.Object, path: Path, space: str, scene: bpy.types.Scene | None) -> tuple[int, int]:
    """A binary STL; returns its bytes, and the bytes it should have."""
    with baked(thing, scene, space) as mesh:
        require_room(path, 84 + 50 * triangles(mesh))
        bpy.ops.wm.stl_export(
            filepath=str(path), check_existing=False, apply_modifiers=True, forward_axis="Y", up_axis="Z"
        )
        return path.stat().st_size, 84 + 50 * triangles(mesh)


def write_ply(thing: bpy.types.Object, path: Path, space: str, scene: bpy.types.Scene | None) -> tuple[int, int]:
    """A binary PLY; returns its bytes, and the bytes it should have. Normals would part vertices."""
    with baked(thing, scene, space) as mesh:
        require_room(path, 1000 + 12 * len(mesh.vertices) + 13 * triangles(mesh))
        bpy.ops.wm.ply_export(
            filepath=str(path),
            check_existing=False,
            apply_modifiers=True,
            forward_axis="Y",
            up_axis="Z",
            export_normals=False,
            export_uv=False,
            export_colors="NONE",
            export_attributes=False,
            export_triangulated_mesh=True,
        )
        with path.open("rb") as file:
            header = file.read(4096).partition(b"end_header\n")
        head = len(header[0]) + len(header[1])
        return path.stat().st_size, head + 12 * len(mesh.vertices) + 13 * triangles(mesh)


def write_obj(thing: bpy.types.Object, path: Path, space: str, scene: bpy.types.Scene | None) -> tuple[int, int]:
    """An OBJ without a material file; returns its faces, and the faces it should have.

    Without normals, which Blender 4.2 keeps less exactly: the same surface gives the same lines in every version.
    """
    with baked(thing, scene, space) as mesh:
        # At most: a vertex in 45 letters, a face in 40.
        require_room(path, 1000 + 45 * len(mesh.vertices) + 40 * triangles(mesh))
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
        whole = written = 0
        with path.open("rb") as file:
            for line in file:
                whole = line.endswith(b"\n")
                written += line.startswith(b"f ") and whole
        return written, triangles(mesh)


def write_glb(thing: bpy.types.Object, path: Path, space: str, scene: bpy.types.Scene | None) -> tuple[int, int]:
    """A binary glTF; returns its bytes, and the bytes its header promises. Its axes are glTF's, whatever `space`."""
    if not hasattr(bpy.types, "EXPORT_SCENE_OT_gltf"):
        raise OutputError("a .glb needs Blender's glTF exporter; enable 'glTF 2.0 format' in the add-on preferences")
    if bpy.app.version < (4, 5, 0) and not bpy.app.binary_path:
        atexit.register(forget_gltf)
    with baked(thing, scene, "ras", unit_mm=MM_PER_M) as mesh:
        # At most: every corner with a position, a normal and a number of its own.
        require_room(path, 10_000 + 84 * triangles(mesh))
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
        with path.open("rb") as file:
            header = file.read(12)
        promised = struct.unpack("<4sII", header)[2] if len(header) == 12 else -1
        return path.stat().st_size, promised


def write_blend(thing: bpy.types.Object, path: Path, space: str, scene: bpy.types.Scene | None) -> tuple[int, int]:
    """A .blend with the live object, framed; nothing else of the present file goes in.

    It has no windows of its own, so whoever opens it keeps theirs, and Blender warns of a "Library file, loading
    empty scene", which it is not: the scene in the file becomes the present one.
    """
    home = bpy.data.scenes.new("CTMC")
    home.frame_current = next(iter([scene] if scene else thing.users_scene), home).frame_current
    # So that Blender's own rulers and sidebar tell the patient's millimetres.
    home.unit_settings.scale_length = 1 / (scale_of(thing) * MM_PER_M)
    home.unit_settings.length_unit = "MILLIMETERS"
    made: tuple[bpy.types.ID, ...] = ()
    try:
        home.collection.objects.link(thing)
        made = prepare_scene(home, thing)
        home.view_layers[0].objects.active = thing
        # About: under and at the key, normals, edges, corners; and what every .blend holds.
        require_room(path, 500_000 + 40 * len(thing.data.vertices) + 40 * triangles(thing.data))
        # Not save_as_mainfile: that would write the whole file, and the path it lies at.
        bpy.data.libraries.write(str(path), {home}, path_remap="RELATIVE_ALL")
    finally:
        remove_blocks(home, *made)
    return 0, 0


def forget_gltf() -> None:
    """Empty the glTF exporter's modules: in the bpy 4.2 module they keep Blender from closing, and Python crashes."""
    for name in [name for name in sys.modules if name.startswith("io_scene_gltf2.blender.exp")]:
        vars(sys.modules.pop(name)).clear()


def triangles(mesh: bpy.types.Mesh) -> int:
    """Number of triangles once larger polygons are cut."""
    return len(mesh.loops) - 2 * len(mesh.polygons)


@contextmanager
def baked(
    thing: bpy.types.Object, scene: bpy.types.Scene | None, space: str, unit_mm: float = 1.0
) -> Iterator[bpy.types.Mesh]:
    """A scene of its own, in context, that holds only the evaluated surface in patient space.

    Positions are worked out in float64 and rounded once, in units of `unit_mm`.
    """
    mesh, evaluated = evaluated_copy(thing, scene)
    mesh.name = "surface"
    name = thing.name
    stage = bpy.data.scenes.new("surface")
    copy = bpy.data.objects.new("surface", mesh)
    try:
        move_mesh(mesh, to_patient(evaluated.matrix_world, scale_of(thing) * unit_mm, space))
        stage.collection.objects.link(copy)
        lend_name(thing, copy)
        with bpy.context.temp_override(scene=stage, view_layer=stage.view_layers[0]):
            yield mesh
    finally:
        remove_blocks(stage, copy, mesh)
        if thing.name != name:
            thing.name = name


def lend_name(thing: bpy.types.Object, copy: bpy.types.Object) -> None:
    """Give the copy the object's own name, which Blender allows once, until the object takes it back."""
    name = thing.name
    if thing.library is None:
        thing.name = "CTMC exported"
        copy.name = name


def move_mesh(mesh: bpy.types.Mesh, matrix: NDArray[np.float64]) -> None:
    """Move a mesh's vertices and normals by a (4, 4) float64 matrix; a mirrored one turns the winding too."""
    meshes.write_positions(mesh, moved(matrix, meshes.read_positions(mesh)).astype(np.float32))
    normals = meshes.remembered_normals(mesh)
    if normals is not None:
        carrier = np.eye(4)
        carrier[:3, :3] = np.linalg.inv(matrix[:3, :3]).T
        turned = moved(carrier, normals)
        length = np.sqrt(turned[:, 0] ** 2 + turned[:, 1] ** 2 + turned[:, 2] ** 2)
        length[length == 0] = 1.0
        meshes.remember_normals(mesh, (turned / length[:, None]).astype(np.float32))
    if np.linalg.det(matrix[:3, :3]) < 0:
        mesh.flip_normals()
    mesh.update()


WRITERS: dict[str, Callable[..., tuple[int, int]]] = {
    ".stl": write_stl,
    ".ply": write_ply,
    ".obj": write_obj,
    ".glb": write_glb,
    ".blend": write_blend,
}
SUFFIXES = tuple(WRITERS)
