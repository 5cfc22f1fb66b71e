# SPDX-License-Identifier: GPL-3.0-or-later
"""Begin a region: the operator `ctmc.fit_region`."""

from __future__ import annotations

import bpy

from ...core.volume import region_limits
from ..needs import Needs
from ..state import volumes


class CTMC_OT_fit_region(Needs, bpy.types.Operator):
    """Begin with a box around the whole CT."""

    bl_idname = "ctmc.fit_region"
    bl_label = "Fit Region to Volume"
    bl_description = "Put the region's box around the whole CT; its handles in the viewport then make it smaller"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    needs = (volumes.has_volume,)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Set it, and use it."""
        settings, volume = context.scene.ctmc, volumes.current_full(context.scene)
        assert volume is not None, "poll asks for one"
        settings.region = region_limits(volume, settings.region_unit)
        return {"FINISHED"}


register, unregister = bpy.utils.register_classes_factory((CTMC_OT_fit_region,))
