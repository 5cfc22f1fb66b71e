# SPDX-License-Identifier: GPL-3.0-or-later
"""Choose one of the CTs of the file, free its memory, or remove it."""

from __future__ import annotations

import bpy
from bpy.props import BoolProperty, StringProperty

from ....blender.datablocks import remove_with_data
from ....blender.rulers import is_ruler
from ....blender.scene.ct_box import objects_beside
from ....blender.slices import SLICE, is_cut_box, is_slice
from ....blender.surface import read_provenance
from ....blender.volume import of_ct
from ... import jobs
from ...needs import Needs
from ...state import session
from ...state.ct import scans, volumes
from ...translations import OURS, translate


class _CTOperator(Needs):
    """Base of operators on one CT of the scene, by default the panel's."""

    needs = (jobs.idle,)

    def ct(self, context: bpy.types.Context) -> str:
        """Return the fingerprint of the CT; empty for one that the scene does not have, with a report."""
        fingerprint = str(self.fingerprint or context.scene.ctmc.volume_fingerprint)  # type: ignore[attr-defined]
        if scans.state_of(context.scene, fingerprint) is None:
            self.report({"ERROR"}, translate("This CT is not in the scene; load it first"))  # type: ignore[attr-defined]
            return ""
        return fingerprint


def _fingerprint() -> StringProperty:
    """Return the property that names a CT."""
    return StringProperty(name="CT", description="Fingerprint of the CT", options={"SKIP_SAVE", "HIDDEN"})


class CTMC_OT_choose_ct(_CTOperator, bpy.types.Operator):
    """Show another CT of the file in the panel."""

    bl_idname = "ctmc.choose_ct"
    bl_label = "Choose CT"
    bl_description = "Show this CT in the panel, with its structures and its threshold"
    bl_options = {"UNDO"}  # noqa: RUF012

    fingerprint: _fingerprint()

    def execute(self, context: bpy.types.Context) -> set[str]:
        fingerprint = self.ct(context)
        if not fingerprint:
            return {"CANCELLED"}
        scans.activate(context.scene, fingerprint)
        session.redraw_viewports()
        return {"FINISHED"}


class CTMC_OT_free_ct(_CTOperator, bpy.types.Operator):
    """Free the memory of a CT; the file keeps it."""

    bl_idname = "ctmc.free_ct"
    bl_label = "Free Memory"
    bl_description = (
        "Free the memory of this CT. Its surfaces, drawings and settings stay; "
        "Load Again reads its values from its file"
    )

    fingerprint: _fingerprint()

    def execute(self, context: bpy.types.Context) -> set[str]:
        fingerprint = self.ct(context)
        if not fingerprint:
            return {"CANCELLED"}
        volumes.release(fingerprint)
        session.redraw_viewports()
        return {"FINISHED"}


class CTMC_OT_remove_ct(_CTOperator, bpy.types.Operator):
    """Remove a CT from the scene, from memory, and its objects if asked."""

    bl_idname = "ctmc.remove_ct"
    bl_label = "Remove CT"
    bl_description = "Remove this CT from the scene and from memory; its file is not touched"
    bl_options = {"UNDO"}  # noqa: RUF012

    fingerprint: _fingerprint()
    with_objects: BoolProperty(
        name="Remove Its Objects Too",
        description="Also remove its surfaces, slices, Volume objects, distances, angles and drawings",
        options={"SKIP_SAVE"},
        translation_context=OURS,
    )

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        return set(context.window_manager.invoke_props_dialog(self))

    def draw(self, context: bpy.types.Context) -> None:
        ct = scans.state_of(context.scene, self.fingerprint or context.scene.ctmc.volume_fingerprint)
        if ct is not None:
            self.layout.label(text=scans.name_of(context.scene, ct), icon="VOLUME_DATA", translate=False)
        self.layout.prop(self, "with_objects")

    def execute(self, context: bpy.types.Context) -> set[str]:
        scene, fingerprint = context.scene, self.ct(context)
        if not fingerprint:
            return {"CANCELLED"}
        if self.with_objects:
            remove_with_data(scene, objects_of(scene, fingerprint))
            drawn = scene.ctmc_draw.structures
            for number in reversed(range(len(drawn))):
                if drawn[number].fingerprint == fingerprint:
                    drawn.remove(number)
        scans.remove(scene, fingerprint)
        if not any(scans.state_of(each, fingerprint) for each in bpy.data.scenes):
            volumes.release(fingerprint)
        scans.note(context)
        session.redraw_viewports()
        return {"FINISHED"}


def objects_of(scene: bpy.types.Scene, fingerprint: str) -> list[bpy.types.Object]:
    """Return the objects made from a CT: surfaces, slices, Volume objects, and rulers and cuts beside its box.

    Rulers and cuts beside a box of several readings of a path belong to all of them.
    """
    own = []
    for obj in scene.objects:
        provenance = read_provenance(obj)
        is_surface = provenance is not None and provenance.fingerprint == fingerprint
        if is_surface or (is_slice(obj) and obj[SLICE] == fingerprint):
            own.append(obj)
    own += of_ct(scene, fingerprint)
    if scans.other_readings(scene, fingerprint):
        return own
    return own + [obj for obj in objects_beside(scene, fingerprint) if is_ruler(obj) or is_cut_box(obj)]


register, unregister = bpy.utils.register_classes_factory((CTMC_OT_choose_ct, CTMC_OT_free_ct, CTMC_OT_remove_ct))
