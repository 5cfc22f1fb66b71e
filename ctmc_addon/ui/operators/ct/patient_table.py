# SPDX-License-Identifier: GPL-3.0-or-later
"""Read the CT again without the table, or with it: the operator `ctmc.remove_table`."""

from __future__ import annotations

from typing import Any

import bpy

from ....core.volume import ValueKind
from ... import jobs
from ...needs import Needs
from ...state.ct import volumes


def holds_hu(operator: Any, context: bpy.types.Context) -> bool:
    """Return whether the CT is in HU, which finding a table needs, with the reason if not."""
    volume = volumes.current(context.scene)
    if volume is None or volume.kind != ValueKind.HU:
        operator.poll_message_set("A table can be found only in a CT in HU")
        return False
    return True


class CTMC_OT_remove_table(Needs, bpy.types.Operator):
    """Read the CT again, with or without what lies behind the patient."""

    bl_idname = "ctmc.remove_table"
    bl_label = "Remove Patient Table"
    bl_description = (
        "Read the CT again and replace what lies behind the patient and is not part of the body, "
        "such as the table, by air; press again to bring it back. Existing surfaces do not change"
    )

    needs = (jobs.idle, volumes.has_volume, holds_hu)

    def execute(self, context: bpy.types.Context) -> set[str]:
        return self.toggle(context, "EXEC_DEFAULT")

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        return self.toggle(context, "INVOKE_DEFAULT")

    def toggle(self, context: bpy.types.Context, how: str) -> set[str]:
        """Load again, with the switch the other way."""
        loaded = volumes.require_loaded(context.scene)
        context.scene.ctmc.remove_table = not loaded.reading.remove_table
        bpy.ops.ctmc.load(how, again=True)
        return {"FINISHED"}


register, unregister = bpy.utils.register_classes_factory((CTMC_OT_remove_table,))
