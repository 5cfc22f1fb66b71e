# SPDX-License-Identifier: GPL-3.0-or-later
"""Say why a tool cannot be used when it is clicked: the operator `ctmc.draw_refuse`.

Blender passes a click that an operator's poll refuses to the next key, which would select the object under the mouse,
or none, and so activate another CT.
"""

from __future__ import annotations

from typing import Any

import bpy
from bpy.props import StringProperty

from ...needs import Needs
from ...state.ct import volumes
from ...translations import translate


class Reason:
    """A stand-in for an operator's class that keeps the reason of its needs."""

    text = ""

    def poll_message_set(self, text: str) -> None:
        """Keep the reason."""
        self.text = text


class CTMC_OT_draw_refuse(Needs, bpy.types.Operator):
    """Stands behind a tool in its keys, for clicks that the tool's operator did not take."""

    bl_idname = "ctmc.draw_refuse"
    bl_label = "Refuse Click"
    bl_description = "Explain why a tool cannot be used now"
    bl_options = {"INTERNAL"}  # noqa: RUF012  (Blender reads it from the class)

    operator: StringProperty(options={"HIDDEN", "SKIP_SAVE"})

    needs = (volumes.has_volume,)

    def execute(self, _context: bpy.types.Context) -> set[str]:
        return {"CANCELLED"}

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        reason: Any = Reason()
        if all(need(reason, context) for need in getattr(bpy.types, self.operator).needs):
            return {"CANCELLED", "PASS_THROUGH"}  # The tool passed the click through itself.
        self.report({"WARNING"}, translate(reason.text))
        return {"CANCELLED"}


register, unregister = bpy.utils.register_classes_factory((CTMC_OT_draw_refuse,))
