# SPDX-License-Identifier: GPL-3.0-or-later
"""Remove components of the active surface, or close it: `ctmc.remove_small`, `ctmc.keep_largest`, `ctmc.close_border`.

The setting goes to the panel too, or the next Update would restore the removed parts. Their message says so, the panel
says above Reconstruct what its settings take away, and `ctmc.stop_removing` switches one off.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import bpy
from bpy.props import EnumProperty

from ....blender.surface import as_shown
from ....core import SETTINGS, Steps, volume_text
from ....reporting.formatting import count
from ... import jobs
from ...needs import Needs
from ...state import session
from ...state.results import measurements, surfaces
from ...translations import translate
from .simplify import from_full_steps

REMOVING = ("keep_parts", "min_part_mm3", "region")
"""Settings of the panel that take something away from every surface."""
_CHOICES = [(name, SETTINGS[name].label, SETTINGS[name].text) for name in REMOVING]


def removal_text(settings: Any, name: str) -> str:
    """Return the text of the components that a setting of the panel removes or adds; empty without any."""
    value = getattr(settings, name)
    if name == "region":
        return translate("Leaves out everything outside the region") if settings.use_region else ""
    if not value:
        return ""
    if name == "min_part_mm3":
        return translate("Removes components below {volume}").format(volume=volume_text(value))
    if name == "close_border":
        return translate("Closes the border")
    text = "Keeps the largest component" if value == 1 else "Keeps the {count} largest components"
    return translate(text).format(count=count(value))


class _ComponentsOperator(jobs.LongOperator):
    """Base of the three operators, before `bpy.types.Operator`."""

    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    needs: tuple[Any, ...] = (jobs.idle, surfaces.can_change)
    changes: Mapping[str, Any]
    extracts = False

    def plan(self, context: bpy.types.Context) -> Steps[jobs.Conclusion]:
        changes = self.changes_of(context.view_layer.objects.active)
        work = from_full_steps(context, changes, extracts=self.extracts)
        return _with_panel_steps(work, context.scene.session_uid, changes)

    def changes_of(self, obj: bpy.types.Object) -> Mapping[str, Any]:
        """Return the settings to change on an object's surface."""
        del obj
        return self.changes


def _with_panel_steps(work: Steps[jobs.Conclusion], uid: int, changes: Mapping[str, Any]) -> Steps[jobs.Conclusion]:
    """Do the work, then show the same settings in the panel."""
    conclude = yield from work

    def conclude_and_show() -> str:
        message = conclude()
        scene = session.scene_of(uid)
        if scene is not None:
            for name, value in changes.items():
                setattr(scene.ctmc, name, value)
            texts = [removal_text(scene.ctmc, name) for name in changes]
            message += ". " + translate("For the next surfaces too: {what}").format(what=", ".join(texts))
        return message

    return conclude_and_show


def is_open(operator: Any, context: bpy.types.Context) -> bool:
    """Return whether the active surface was left open and its CT can close it, with the reason if not."""
    obj = context.view_layer.objects.active
    if surfaces.require_settings(obj).close_border:
        operator.poll_message_set("The border is closed already")
        return False
    if not surfaces.is_of_ct(obj, context.scene):
        operator.poll_message_set("Make a surface of this CT active first")
        return False
    return True


class CTMC_OT_remove_small(_ComponentsOperator, bpy.types.Operator):
    """Remove the small components of the active surface."""

    bl_idname = "ctmc.remove_small"
    bl_label = "Remove Small Components"
    bl_description = (
        "Remove components and fill cavities below a thousandth of the largest component; nothing is extracted again. "
        "The next surfaces do the same until you switch it off above Reconstruct"
    )

    def changes_of(self, obj: bpy.types.Object) -> Mapping[str, Any]:
        """Return the volume below which the components of a surface are small."""
        measurement = measurements.of(obj)
        if measurement is None or not measurement.measures.small:  # Files of 0.3 do not have it.
            return {"min_part_mm3": as_shown(obj).mesh.measures.small}
        return {"min_part_mm3": measurement.measures.small}


class CTMC_OT_keep_largest(_ComponentsOperator, bpy.types.Operator):
    """Keep the largest component of the active surface."""

    bl_idname = "ctmc.keep_largest"
    bl_label = "Keep Largest Component"
    bl_description = (
        "Keep the largest component of the active surface, with its cavities; nothing is extracted again. "
        "The next surfaces do the same until you switch it off above Reconstruct"
    )

    changes = {"keep_parts": 1}  # noqa: RUF012


class CTMC_OT_close_border(_ComponentsOperator, bpy.types.Operator):
    """Close the active surface where the volume cuts it."""

    bl_idname = "ctmc.close_border"
    bl_label = "Close Border"
    bl_description = (
        "Make the active surface again, closed where the border of the volume or region cuts it. "
        "The next surfaces are closed too"
    )

    needs = (jobs.idle, surfaces.can_change, is_open)
    changes = {"close_border": True}  # noqa: RUF012
    extracts = True


class CTMC_OT_stop_removing(Needs, bpy.types.Operator):
    """Switch off a setting of the panel that takes something away."""

    bl_idname = "ctmc.stop_removing"
    bl_label = "Keep Everything"
    bl_description = "Switch this off, so that the next surfaces keep what it removes"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    setting: EnumProperty(
        name="Setting", description="Setting to switch off", items=_CHOICES, options={"SKIP_SAVE", "HIDDEN"}
    )

    needs = (jobs.idle,)

    def execute(self, context: bpy.types.Context) -> set[str]:
        settings = context.scene.ctmc
        if self.setting == "region":
            settings.use_region = False
        else:
            setattr(settings, self.setting, 0)
        return {"FINISHED"}


register, unregister = bpy.utils.register_classes_factory(
    (CTMC_OT_remove_small, CTMC_OT_keep_largest, CTMC_OT_close_border, CTMC_OT_stop_removing)
)
