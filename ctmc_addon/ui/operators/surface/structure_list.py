# SPDX-License-Identifier: GPL-3.0-or-later
"""The list of structures: ticks, thresholds as structures, removal, and the eyes of their surfaces."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.props import EnumProperty, IntProperty

from ....blender.colors import BONE, color_of
from ....core import CtmcError, ReconstructionSettings, finish
from ....core.volume import anatomy_of, tissue_name, used_threshold_steps
from ... import jobs
from ...needs import Needs
from ...properties.surface.structures import follow_ticks, tick
from ...state.ct import volumes
from ...state.draw import drawings
from ...state.results import surfaces
from ...translations import translate
from ..ct.slice_object import in_object_mode


def _has_structures(operator: Any, context: bpy.types.Context) -> bool:
    """Return whether the list has a line, with the reason if not."""
    if not len(context.scene.ctmc.labels):
        operator.poll_message_set("The list has no structure; load labels or add a threshold")
        return False
    return True


class CTMC_OT_tick_structures(Needs, bpy.types.Operator):
    """Tick all structures, none, or those that are not ticked."""

    bl_idname = "ctmc.tick_structures"
    bl_label = "Tick Structures"
    bl_description = "Tick all structures of the list, none, or those not ticked now"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    which: EnumProperty(
        name="Which",
        items=[
            ("all", "All", "Tick all"),
            ("none", "None", "Tick none"),
            ("invert", "Invert", "Tick those not ticked, untick the others"),
        ],
    )

    needs = (_has_structures,)

    def execute(self, context: bpy.types.Context) -> set[str]:
        stored = context.scene.ctmc
        if self.which == "invert":
            tick(stored, lambda item: not item.chosen)
        else:
            tick(stored, lambda _: self.which == "all")
        follow_ticks(stored)
        return {"FINISHED"}


class CTMC_OT_add_threshold(Needs, bpy.types.Operator):
    """Add the threshold of the panel to the structures."""

    bl_idname = "ctmc.add_threshold"
    bl_label = "Add Threshold"
    bl_description = (
        "Add a structure to the list by threshold: the panel's threshold and upper limit, or Otsu's "
        "threshold if none is set"
    )
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    needs = (volumes.has_volume,)

    def execute(self, context: bpy.types.Context) -> set[str]:
        scene, stored = context.scene, context.scene.ctmc
        ct = volumes.require_loaded(scene)
        try:
            value, upper = _limits_of_panel(scene)
        except CtmcError as error:
            return jobs.refuse(self, scene.session_uid, error)
        name = tissue_name(ct.volume.kind, value, upper)
        color = BONE if anatomy_of(name) is None else color_of(1, None, name)
        item = stored.add_threshold(translate(name), color, value, upper)
        stored.label_index = len(stored.labels) - 1
        item.chosen = True
        return {"FINISHED"}


def _limits_of_panel(scene: bpy.types.Scene) -> tuple[float, float | None]:
    """Return the threshold and upper limit of the panel; Otsu's threshold where it has none."""
    stored, ct = scene.ctmc, volumes.require_loaded(scene)
    otsu = used_threshold_steps(ct.volume, ct.for_copy(ReconstructionSettings()))
    return stored.threshold if stored.use_threshold else finish(otsu), stored.upper if stored.use_upper else None


class CTMC_OT_remove_structure(Needs, bpy.types.Operator):
    """Remove the marked structure from the list; surfaces stay."""

    bl_idname = "ctmc.remove_structure"
    bl_label = "Remove Structure"
    bl_description = "Remove the selected structure and its drawing from the list. Its surface and files stay"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    needs = (in_object_mode, _has_structures)

    def execute(self, context: bpy.types.Context) -> set[str]:
        stored = context.scene.ctmc
        drawings.remove(context.scene, stored.labels[min(stored.label_index, len(stored.labels) - 1)])
        return {"FINISHED"}


class CTMC_OT_structure_eye(Needs, bpy.types.Operator):
    """Hide or show the surface of a structure."""

    bl_idname = "ctmc.structure_eye"
    bl_label = "Show Structure"
    bl_description = "Hide or show the surface of the structure, in the viewport and in renders"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    index: IntProperty(name="Structure", options={"SKIP_SAVE", "HIDDEN"})

    needs = (_has_structures,)

    def execute(self, context: bpy.types.Context) -> set[str]:
        item = context.scene.ctmc.labels[self.index]
        objects = surfaces.of_structure(context.scene, item)
        is_shown = any(is_visible(obj) for obj in objects)
        for obj in objects:
            obj.hide_set(is_shown)
            obj.hide_viewport, obj.hide_render = obj.hide_viewport and is_shown, is_shown
        return {"FINISHED"}


def is_visible(obj: bpy.types.Object) -> bool:
    """Return whether an object is not hidden."""
    return not (obj.hide_get() or obj.hide_viewport)


register, unregister = bpy.utils.register_classes_factory(
    (CTMC_OT_tick_structures, CTMC_OT_add_threshold, CTMC_OT_remove_structure, CTMC_OT_structure_eye)
)
