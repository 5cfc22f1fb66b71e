# SPDX-License-Identifier: GPL-3.0-or-later
"""Begin a region: the operator `ctmc.fit_region`."""

from __future__ import annotations

import bpy

from ...needs import Needs
from ...properties.panel import fit_region
from ...state.ct import volumes


class CTMC_OT_fit_region(Needs, bpy.types.Operator):
    """Put the box around the ticked labels, else around the whole CT."""

    bl_idname = "ctmc.fit_region"
    bl_label = "Fit"
    bl_description = (
        "Fit the region to the ticked labels, or to the whole CT if none is ticked; drag its handles "
        "in the viewport to move it"
    )
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    needs = (volumes.has_volume,)

    def execute(self, context: bpy.types.Context) -> set[str]:
        fit_region(context.scene.ctmc)
        return {"FINISHED"}


register, unregister = bpy.utils.register_classes_factory((CTMC_OT_fit_region,))
