# SPDX-License-Identifier: GPL-3.0-or-later
"""Add, update, simplify and remove the object of a reconstruction.

Alpha is the shape key `alpha` over the midpoints (Su and Ma, eq. 5 to 7), Decimate a live modifier after it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

import bpy
import numpy as np

from ...core import MeshError, Reconstruction, ReconstructionSettings, Step, Steps, finish
from ...core.volume import finish_of, transform_normals
from ..colors import Color, color_of, part_color
from ..maps import drop_missing, forget_maps, write_map
from ..scene.ct_box import link_beside_ct
from ..tissue import tissue_material
from . import mesh_data as meshes
from .alpha_key import add_alpha, keep_key, mixed_positions, require_no_other_keys
from .evaluate import evaluated_copy, evaluated_object, require_object_mode
from .light import choice_steps, fit_modifier, is_large, light_modifier, other_modifiers, write
from .placement import SCALE, Placement, placed_at_center
from .provenance import Provenance, provenance_of_result, require_provenance, write_provenance
from .readback import evaluated_alpha, keep_positions_mm, placement_of, positions_mm

DECIMATE = "CTMC Decimate"
NAMED = "ctmc_name"
"""The object's custom property with the name that we gave it."""
NEIGHBOR = "neighbor_label"
"""The attribute of a label's triangles with the label in front of each, 0 for none."""
NAME_BYTES = 63  # Blender 4 cuts longer names.
SHARP_DEG = 50.0  # Edges of parts of solids are sharp from this angle between their faces on.


def add_reconstruction(
    result: Reconstruction,
    scene: bpy.types.Scene,
    scale: float = SCALE,
    color: Color | None = None,
    mesh: bpy.types.Mesh | None = None,
    structure: str = "",
    fingerprint: str = "",
    opacity: float | None = None,
) -> bpy.types.Object:
    """Return a new object in `scene` for a surface, at its place in the patient.

    Parameters
    ----------
    scale : float
        Blender units of 1 mm.
    color : (red, green, blue) or None
        Linear, of the structure; None takes the label's own color, else that of its name or number.
    mesh : Mesh or None
        Result of `surface_mesh_steps` at this scale; None makes it now.
    structure : str
        Name of the structure, for the object's name; empty takes the volume's name of the label.
    fingerprint : str
        Fingerprint of the volume's values.
    opacity : float, optional
        Opacity from 0 to 1; None for an opaque surface without a choice.

    Raises
    ------
    MeshError
        If the surface has no triangles.
    """
    name = _object_name(result, structure or result.label_name)
    mesh = finish(surface_mesh_steps(result, None, scale)) if mesh is None else mesh
    mesh.name = name
    placement = placed_at_center(result.mesh.vertices, scale)
    color = color or color_of(result.settings.label, result.label_color, structure or result.label_name)
    color = part_color(color, result.part_number)
    look = finish_of(result.settings.label, result.label_name or structure)
    mesh.materials.append(tissue_material(name, color, look, scale, opacity))
    obj = bpy.data.objects.new(name, mesh)
    obj[NAMED] = obj.name
    obj.location = placement.origin
    link_beside_ct(scene, obj, fingerprint)
    if result.surface is not None:
        add_alpha(obj, result.surface, result.settings.alpha_number, placement)
    _update_decimate(obj, result)
    fit_modifier(obj)
    shade(obj, result, placement)
    write_provenance(obj, provenance_of_result(result, placement, fingerprint))
    for surface_map in result.maps:
        write_map(mesh, surface_map)
    return obj


def update_reconstruction(
    obj: bpy.types.Object, result: Reconstruction, mesh: bpy.types.Mesh | None = None, fingerprint: str = ""
) -> None:
    """Replace an object's surface; its transform, materials, modifiers and animation stay.

    The mesh is the result of `surface_mesh_steps` for this object; None makes it now.

    The key's value and Decimate's ratio follow the new settings unless a user or an
    animation has moved them since the old ones were applied.

    Raises
    ------
    MeshError
        If the object was not made here or cannot be changed, has further shape keys, or the surface has no triangles.
    """
    require_updatable(obj)
    before, placement = require_provenance(obj), placement_of(obj)
    if mesh is None:
        mesh = finish(surface_mesh_steps(result, obj, light=light_modifier(obj) is not None))
    old, old_keys = obj.data, obj.data.shape_keys
    for material in old.materials:
        mesh.materials.append(material)
    obj.data = mesh
    drop_missing(obj)
    if result.surface is not None:
        add_alpha(obj, result.surface, result.settings.alpha_number, placement)
    if old_keys is not None and mesh.shape_keys is not None:
        keep_key(old_keys, mesh.shape_keys, before.settings.alpha_number)
    _update_decimate(obj, result, before)
    fit_modifier(obj)
    shade(obj, result, placement)
    for surface_map in result.maps:
        write_map(mesh, surface_map)
    # What was applied is found again by the vertices; the origin alone is exact only where it is kept.
    kept = placement if placement.applied is None else before.placement
    write_provenance(
        obj,
        replace(
            provenance_of_result(result, kept, fingerprint),
            drawn=before.drawn,
            part=before.part,
            part_number=before.part_number,
        ),
    )
    discard(old, mesh)


def apply_shape_and_modifiers(obj: bpy.types.Object) -> None:
    """Make a plain mesh from alpha and every modifier that is enabled in the viewport.

    Raises
    ------
    MeshError
        If the object cannot be changed.
    """
    require_editable(obj)
    old = obj.data
    refresh_normals(obj)
    with evaluated_object(obj) as (evaluated, depsgraph):
        local, alpha = meshes.read_positions(evaluated.data), evaluated_alpha(obj, depsgraph)
        vertices, _ = positions_mm(evaluated.data, local, placement_of(obj), alpha)
    mesh, _ = evaluated_copy(obj)
    keep_positions_mm(mesh, vertices)
    obj.data = mesh
    forget_maps(obj)
    for modifier in [modifier for modifier in other_modifiers(obj) if modifier.show_viewport]:
        obj.modifiers.remove(modifier)
    if light_modifier(obj) is not None and is_large(len(mesh.polygons)):
        write(mesh, finish(choice_steps(vertices, meshes.read_triangles(mesh))))
    fit_modifier(obj)
    discard(old, mesh)


@contextmanager
def temporary_surfaces(
    results: Sequence[Reconstruction],
    name: str = "CTMC",
    names: Sequence[str] = (),
    opacities: Sequence[float | None] = (),
) -> Iterator[tuple[bpy.types.Scene, list[bpy.types.Object]]]:
    """Make a separate scene with an object for every surface; remove everything after the block.

    The objects may be given `names` and `opacities`, one each.
    """
    scene = bpy.data.scenes.new(name)
    objects: list[bpy.types.Object] = []
    try:
        for at, result in enumerate(results):
            called, opacity = names[at] if names else "", opacities[at] if opacities else None
            objects.append(add_reconstruction(result, scene, structure=called, opacity=opacity))
        yield scene, objects
    finally:
        blocks = [block for obj in objects for block in (*obj.data.materials, obj.data, obj)]
        bpy.data.batch_remove([*blocks, scene])


def refresh_normals(obj: bpy.types.Object) -> None:
    """Shade with the gradient at the key's present value, which only Blender before 4.5 needs.

    Call it once alpha is idle. Under a Decimate modifier such normals would be wrong and are left out.
    """
    mesh = obj.data
    normals = meshes.kept_normals(mesh)
    if meshes.FREE_NORMALS or normals is None:
        return
    if any(modifier.type == "DECIMATE" and modifier.show_viewport for modifier in obj.modifiers):
        normals = np.zeros_like(normals)
    meshes.encode_normals(mesh, mixed_positions(mesh), normals)


def _object_name(result: Reconstruction, structure: str = "") -> str:
    """Return the structure's name, else the file's stem and label, short enough that Blender keeps the label."""
    room = NAME_BYTES - 4  # Leave room for the .001 of a second one.
    if structure:
        return shortened(structure, room)
    label = "" if result.settings.label is None else f" label {result.settings.label}"
    return shortened(result.name, room - len(label)) + label


def call(obj: bpy.types.Object, name: str) -> None:
    """Rename a surface, with the mesh and materials of the same name; a user's own name stays."""
    before, name = obj.name, shortened(name, NAME_BYTES - 4)
    if obj.get(NAMED) != before or before.rpartition(".")[0] == name or before == name:
        return
    for block in (obj, obj.data, *[material for material in obj.data.materials if material is not None]):
        if block.name == before and block.library is None:
            block.name = name
    obj[NAMED] = obj.name


def shortened(text: str, size: int) -> str:
    """Return the beginning of a text, at most `size` bytes."""
    return text.encode("utf-8", "replace")[:size].decode("utf-8", "ignore")


def surface_mesh_steps(
    result: Reconstruction,
    obj: bpy.types.Object | None = None,
    scale: float = SCALE,
    edges: meshes.Edges | None = None,
    *,
    light: bool = False,
) -> Steps[bpy.types.Mesh]:
    """Return a mesh for `obj` or a new object: the surface at alpha 0 while alpha is open, else as it is.

    This takes nearly all of the time to add a surface to Blender, and no scene uses the mesh yet. Its edges may have
    been computed before, by `mesh_data.edges_steps`. With `light` a large surface is prepared for the display Light,
    unless Decimate is live.

    Raises
    ------
    MeshError
        If the surface has no triangles.
    """
    if not len(result.mesh.faces):
        raise MeshError(
            f"the surface of {result.name} has no triangles; choose another threshold or label"
            if obj is None
            else f"the new surface has no triangles, so {obj.name} keeps its old one; choose another threshold"
        )
    if obj is not None:
        require_provenance(obj)
    name = _object_name(result) if obj is None else obj.data.name
    placement = placed_at_center(result.mesh.vertices, scale) if obj is None else placement_of(obj)
    surface = result.surface
    vertices, faces = (
        (result.mesh.vertices, result.mesh.faces) if surface is None else (surface.midpoints, surface.faces)
    )
    choice = None  # Before the mesh, which nothing would remove if the steps were closed later.
    if light and is_large(len(faces)) and not _is_decimated(result.settings):
        choice = yield from choice_steps(result.mesh.vertices, faces, result.mesh.normals)
    if edges is None:
        edges = yield from meshes.edges_steps(faces, len(vertices))
    local = placement.to_local(vertices)
    yield Step(0.1, "Adding the surface")
    mesh = yield from meshes.new_mesh_steps(name, local, faces, edges)
    keep_positions_mm(mesh, vertices, surface)
    if result.beyond is not None:
        meshes.add_face_numbers(mesh, NEIGHBOR, result.beyond)
    if choice is not None:
        write(mesh, choice)
    return mesh


def _update_decimate(obj: bpy.types.Object, result: Reconstruction, before: Provenance | None = None) -> None:
    """Add or remove our own Decimate modifier as the settings ask; other modifiers stay."""
    settings, modifier = result.settings, obj.modifiers.get(DECIMATE)
    if not _is_decimated(settings):
        if modifier is not None:
            obj.modifiers.remove(modifier)
        return
    ratio = _decimate_ratio(settings, len(result.mesh.faces))
    if modifier is None:
        modifier = obj.modifiers.new(DECIMATE, "DECIMATE")
        modifier.ratio = ratio
    elif before is not None and modifier.ratio == np.float32(_decimate_ratio(before.settings, before.full_faces)):
        modifier.ratio = ratio


def _is_decimated(settings: ReconstructionSettings) -> bool:
    """Return whether a live Decimate simplifies a surface."""
    return settings.simplifier == "decimate" and settings.simplifies


def _decimate_ratio(settings: ReconstructionSettings, faces: int) -> float:
    """Return the share of the triangles that Decimate is to leave."""
    if settings.target_faces is not None:
        return min(1.0, settings.target_faces / faces)
    return 1.0 if settings.reduction is None else 1.0 - settings.reduction


def shade(obj: bpy.types.Object, result: Reconstruction, placement: Placement) -> None:
    """Shade with the surface's own normals, where it has any; parts of solids with sharp rims of cuts and holes."""
    if result.solid:  # Normals of the vertices at a rim are averages, with which a flat cut looks dished.
        obj.data.set_sharp_from_angle(angle=math.radians(SHARP_DEG))
        return
    normals = result.mesh.normals if result.surface is None else result.surface.normals
    if normals is not None:
        if placement.applied is not None:
            matrix = np.eye(4)
            matrix[:3, :3] = placement.applied
            normals = transform_normals(matrix, normals)
        meshes.keep_normals(obj.data, normals)
        refresh_normals(obj)


def require_editable(obj: bpy.types.Object) -> None:
    """Raise `MeshError` with a remedy for an object whose mesh cannot be replaced."""
    if obj.type != "MESH":
        raise MeshError(f"{obj.name} is not a mesh; choose a reconstructed object")
    if obj.library is not None or obj.override_library is not None or obj.data.library is not None:
        raise MeshError(f"{obj.name} is linked from another file; make it local first")
    require_object_mode(obj)


def require_updatable(obj: bpy.types.Object) -> None:
    """Raise `MeshError` with a remedy for an object that cannot take another surface."""
    require_editable(obj)
    require_no_other_keys(obj)


def discard(old: bpy.types.Mesh, new: bpy.types.Mesh) -> None:
    """Remove a replaced mesh with its keys, unless it is still used; the new one takes its name."""
    if old.users == 0:
        name = old.name
        bpy.data.meshes.remove(old)
        new.name = name
