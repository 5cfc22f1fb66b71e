# SPDX-License-Identifier: GPL-3.0-or-later
"""Find our surfaces in the scene, the selected ones, and the CT of each; keep them as the list of structures looks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import bpy

from ....blender.colors import BONE, Color, part_color
from ....blender.materials import material_color, material_opacity, recolor
from ....blender.shape_change import ShapeChange
from ....blender.surface import (
    PICKED,
    Provenance,
    call,
    is_large,
    is_prepared,
    light_modifier,
    own_mesh,
    prepare,
    read_back,
    read_provenance,
    require_editable,
    require_provenance,
    require_updatable,
    settings_of,
    shown_faces,
)
from ....blender.tissue import set_opacity
from ....core import MeshError, Reconstruction, ReconstructionSettings
from ...properties.surface.structures import called, is_made_of
from ...translations import translate, translate_sentence
from .. import change_events, session
from ..change_events import COLOR, NAME, OPACITY
from ..ct import volumes

DEFAULTS = ReconstructionSettings()


def is_surface(obj: bpy.types.Object | None) -> bool:
    """Return whether an object was reconstructed by us."""
    return read_provenance(obj) is not None


def active_surface(context: bpy.types.Context) -> bpy.types.Object | None:
    """Return the active object, if it is selected and was reconstructed by us."""
    obj = context.view_layer.objects.active
    return obj if is_surface(obj) and obj.select_get() else None


def selected_surfaces(context: bpy.types.Context) -> list[bpy.types.Object]:
    """Return every selected object that was reconstructed by us."""
    return [obj for obj in context.view_layer.objects.selected if is_surface(obj)]


def label_and_name(obj: bpy.types.Object) -> tuple[int, str]:
    """Return the sort key of an object in a file of several: its label, then its name, as on the command line."""
    provenance = read_provenance(obj)
    label = None if provenance is None else provenance.settings.label
    return (-1 if label is None else label, obj.name)


def shown_in(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Return the scene's surfaces that are enabled in viewports."""
    return [obj for obj in scene.objects if is_surface(obj) and not obj.hide_viewport]


def _surfaces_of_ct(context: bpy.types.Context) -> list[bpy.types.Object]:
    """Return the selected surfaces of the CT in memory, the active one first."""
    active = context.view_layer.objects.active
    selected = [obj for obj in context.selected_objects if is_of_ct(obj, context.scene)]
    return sorted(selected, key=lambda obj: obj != active)


def surface_of_results(context: bpy.types.Context) -> bpy.types.Object | None:
    """Return the active surface; while another object is active, such as a slice, the last active surface."""
    obj, scene_session = context.view_layer.objects.active, session.of(context.scene)
    if is_surface(obj):
        scene_session.last_surface = obj.session_uid
        return obj
    last = session.object_of(scene_session.last_surface)
    return last if last is not None and is_surface(last) and last.name in context.view_layer.objects else None


def _of_scene(scene: bpy.types.Scene) -> bpy.types.Object | None:
    """Return the scene's active object, if we reconstructed it and it is not linked from another file."""
    layer = bpy.context.view_layer if bpy.context.scene == scene else scene.view_layers[0]
    obj = layer.objects.active
    return obj if is_surface(obj) and obj.library is None else None


def of_results(scene: bpy.types.Scene) -> bpy.types.Object | None:
    """Return the surface that Results shows: the active one, else the last one."""
    return _of_scene(scene) or session.object_of(session.of(scene).last_surface)


def active_color(scene: bpy.types.Scene) -> Color:
    """Return the color of the surface that Results shows; bone without one."""
    obj = of_results(scene)
    return BONE if obj is None else material_color(obj)


def recolor_active(scene: bpy.types.Scene, color: Color) -> None:
    """Change the color of the scene's active surface."""
    obj = _of_scene(scene)
    if obj is not None:
        recolor(obj, color)


def active_opacity(scene: bpy.types.Scene) -> float:
    """Return the opacity of the surface that Results shows; 1 without one."""
    obj = of_results(scene)
    return 1.0 if obj is None else material_opacity(obj)


def fade_active(scene: bpy.types.Scene, opacity: float) -> None:
    """Change the opacity of the scene's active surface."""
    obj = _of_scene(scene)
    if obj is not None:
        set_opacity(obj, round(opacity, 3))


def can_be_light(obj: bpy.types.Object) -> bool:
    """Return whether a surface is shown with a share of its triangles, or could be."""
    return light_modifier(obj) is not None or is_large(len(obj.data.polygons))


def is_active_light(scene: bpy.types.Scene) -> bool:
    """Return whether the surface that Results shows has a share of its triangles in the viewport."""
    obj = of_results(scene)
    return obj is not None and shown_faces(obj) is not None


def show_active(scene: bpy.types.Scene, *, light: bool) -> None:
    """Show the scene's active surface with a share of its triangles, or in full."""
    obj = _of_scene(scene)
    if obj is None or obj.override_library is not None or obj.data.library is not None or obj.data.is_editmode:
        return
    if light and can_be_light(obj) and (light_modifier(obj) is None or not is_prepared(obj)):
        mesh = own_mesh(obj)
        prepare(obj, mesh.vertices, mesh.faces)
    modifier = light_modifier(obj)
    if modifier is not None:
        modifier.show_viewport = light


def is_of_ct(obj: bpy.types.Object | None, scene: bpy.types.Scene) -> bool:
    """Return whether a surface belongs to the CT in memory: the same values at the same position, whatever its name."""
    loaded, provenance = volumes.loaded(scene), read_provenance(obj)
    return loaded is not None and provenance is not None and provenance.fingerprint == loaded.statistics.fingerprint


def unit_of(obj: bpy.types.Object | None, scene: bpy.types.Scene) -> str:
    """Return the unit of the values of the CT in memory for a surface of it, such as HU; else an empty text."""
    loaded = volumes.loaded(scene)
    return loaded.volume.kind.mark if loaded is not None and is_of_ct(obj, scene) else ""


def of_structure(scene: bpy.types.Scene, item: Any) -> list[bpy.types.Object]:
    """Return the surfaces in a scene that belong to a line of the list of structures."""
    return [obj for obj, provenance in of_panel(scene) if is_made_of(item, provenance.settings)]


def of_panel(scene: bpy.types.Scene) -> Iterator[tuple[bpy.types.Object, Provenance]]:
    """Yield the surfaces in a scene of the panel's CT, in memory or not, and how they were made."""
    for obj in scene.objects:
        provenance = read_provenance(obj)
        if provenance is not None and provenance.fingerprint == scene.ctmc.volume_fingerprint:
            yield obj, provenance


def require_settings(obj: bpy.types.Object) -> ReconstructionSettings:
    """Return the settings that a surface was made with."""
    return require_provenance(obj).settings


def can_change(operator: Any, context: bpy.types.Context) -> bool:
    """Return whether the active object is a surface that can be changed, with the reason if not."""
    obj = context.view_layer.objects.active
    if not is_surface(obj):
        operator.poll_message_set("Choose a reconstructed surface first")
        return False
    try:
        require_editable(obj)
    except MeshError as error:
        operator.poll_message_set(translate_sentence(str(error)))
        return False
    return True


def mirrored_text(change: ShapeChange) -> str:
    """Return the warning of a mirrored object; empty for any other."""
    return translate("Mirrored: left and right are exchanged") if change.mirrored else ""


def scaled_text(change: ShapeChange) -> str:
    """Return the warning of a scaled object; empty for one that is as large as the patient."""
    text = translate("Scaled by {factor}: not the patient's size; Measure and Measure All give that")
    return text.format(factor=change.factors_text) if change.scaled else ""


def full_of(obj: bpy.types.Object, scene: bpy.types.Scene) -> Reconstruction | None:
    """Return the surface before simplification, from the last run or the object itself; None if unknown."""
    return full_of_last_run(obj, scene) or read_back(obj)


def full_of_last_run(obj: bpy.types.Object, scene: bpy.types.Scene) -> Reconstruction | None:
    """Return the surface before simplification of the last run; None if components were picked since."""
    if PICKED in require_provenance(obj).notes:
        return None
    return session.of(scene).full.get(origin_of(obj))


def origin_of(obj: bpy.types.Object) -> session.Origin:
    """Return the key of the surface that an object had before simplification."""
    provenance = require_provenance(obj)
    return origin(provenance.fingerprint, provenance.settings, provenance.part)


def origin(fingerprint: str, settings: ReconstructionSettings, part: str = "") -> session.Origin:
    """Return CT, settings without goal and alpha, and part: equal where the surface before simplification is."""
    plain = replace(
        settings,
        simplifier="none",
        reduction=None,
        target_faces=None,
        max_error_mm=None,
        alpha=1.0,
        min_angle_deg=DEFAULTS.min_angle_deg,
    )
    return fingerprint, plain, part


def made_of(settings: ReconstructionSettings) -> tuple[float | None, ...]:
    """Return the settings that distinguish structures: label, threshold, upper limit."""
    return settings.label, settings.threshold, settings.upper


def targets(context: bpy.types.Context, runs: list[ReconstructionSettings]) -> dict[ReconstructionSettings, int]:
    """Return the selected object for each surface to make; a surface without one gets a new object.

    A single surface goes into the active one, several into those of the same structures.

    Raises
    ------
    MeshError
        If one of the objects cannot be changed.
    """
    selected = [obj for obj in _surfaces_of_ct(context) if not require_provenance(obj).part]
    if len(runs) == 1:
        objects = {runs[0]: selected[0]} if selected[:1] == [active_surface(context)] else {}
    else:
        objects_by_structure = {made_of(settings_of(obj)): obj for obj in reversed(selected)}
        objects = {run: objects_by_structure[made_of(run)] for run in runs if made_of(run) in objects_by_structure}
    for obj in objects.values():
        require_updatable(obj)
    return {run: obj.session_uid for run, obj in objects.items()}


def part_targets(context: bpy.types.Context) -> dict[str, int]:
    """Return the selected object of each part of a solid, by the part's name; a part without one gets a new object.

    Raises
    ------
    MeshError
        If one of the objects cannot be changed.
    """
    parts = {require_provenance(obj).part: obj for obj in reversed(_surfaces_of_ct(context))}
    parts.pop("", None)
    for obj in parts.values():
        require_updatable(obj)
    return {part: obj.session_uid for part, obj in parts.items()}


def is_updated(context: bpy.types.Context, *, makes_parts: bool) -> bool:
    """Return whether Reconstruct updates the active surface: a part by parts, another one by surfaces."""
    obj = active_surface(context)
    return obj is not None and is_of_ct(obj, context.scene) and bool(require_provenance(obj).part) == makes_parts


def follow(properties: Any, name: str) -> None:
    """Update the surfaces of the panel's CT to the names, colors and opacities of the list."""
    if name not in (NAME, COLOR, OPACITY):
        return
    for obj, provenance in of_panel(properties.id_data):
        item = None if obj.library is not None else properties.structure_of(provenance.settings)
        if item is None:
            continue
        if name == NAME:
            if called(item) and not provenance.part:  # A part keeps the name that Reconstruct finds it by.
                call(obj, f"{properties.volume_name} {called(item)}".strip())
        elif name == OPACITY:
            set_opacity(obj, round(float(item.opacity), 3))
        else:
            recolor(obj, part_color(tuple(item.color), provenance.part_number))


register, unregister = change_events.following(follow)
