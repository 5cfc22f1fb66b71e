# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the closed panels of settings: components, normals, and rarely changed ones."""

from __future__ import annotations

import bpy

from .layout import SubPanel, draw_setting, prepare


class _SettingsPanel(SubPanel):
    """A panel that shows these settings; inherited before `bpy.types.Panel`."""

    names: tuple[str, ...] = ()

    def draw(self: bpy.types.Panel, context: bpy.types.Context) -> None:
        prepare(self.layout)
        for name in self.names:
            draw_setting(self.layout, context.scene.ctmc, name)


class CTMC_PT_parts(_SettingsPanel, bpy.types.Panel):
    """Panel for kept components, and for closing the surface."""

    bl_idname = "CTMC_PT_parts"
    bl_label = "Components"
    names = ("keep_parts", "min_part_mm3", "close_border")


class CTMC_PT_normals(_SettingsPanel, bpy.types.Panel):
    """Panel for the normals that shade surfaces."""

    bl_idname = "CTMC_PT_normals"
    bl_label = "Normals"
    names = ("normals",)


class CTMC_PT_advanced(_SettingsPanel, bpy.types.Panel):
    """Panel for ambiguous voxels, and for the value that replaces NaN."""

    bl_idname = "CTMC_PT_advanced"
    bl_label = "Advanced"
    names = ("topology", "nan_as")


register, unregister = bpy.utils.register_classes_factory((CTMC_PT_parts, CTMC_PT_normals, CTMC_PT_advanced))
