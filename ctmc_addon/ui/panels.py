"""The tab CTMC in the 3D viewport's sidebar."""

from __future__ import annotations

from typing import Any

import bpy

from ..core.errors import SettingsError
from ..core.settings import described
from . import volumes
from .properties import optional, switch

ALWAYS_SHOWN = ("threshold", "label", "stride", "alpha", "simplifier", "reduction", "target_faces", "max_error_mm")


class CTMC_PT_main(bpy.types.Panel):
    """Load, surface, voxels and alpha, simplify, reconstruct."""

    bl_idname = "CTMC_PT_main"
    bl_label = "CTMC"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "CTMC"

    def draw(self, context: bpy.types.Context) -> None:
        """Show what is needed for every surface."""
        layout, settings = self.layout, context.scene.ctmc
        layout.use_property_split = True
        layout.use_property_decorate = False
        layout.operator("ctmc.load", icon="FILE_FOLDER")
        volume = volumes.current(context.scene)
        if volume is not None:
            column, rows, slices = volume.size
            x, y, z = volume.spacing
            box = layout.box()
            box.label(text=volume.name)
            box.label(text=f"{column} x {rows} x {slices} voxels, {volume.orientation}")
            box.label(text=f"{x:.4g} x {y:.4g} x {z:.4g} mm, {volume.kind}")
        for name in ALWAYS_SHOWN:
            draw_setting(layout, settings, name)
        try:
            chosen = settings.to_settings()
        except SettingsError as error:
            layout.label(text=str(error), icon="ERROR")
        else:
            if not chosen.alpha_matters:
                layout.label(text="Alpha does nothing on a label that is not softened", icon="INFO")
        layout.operator("ctmc.reconstruct", icon="MESH_ICOSPHERE")
        layout.operator("ctmc.export", icon="EXPORT")


class CTMC_PT_more(bpy.types.Panel):
    """The settings that most surfaces leave alone."""

    bl_idname = "CTMC_PT_more"
    bl_label = "More"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "CTMC"
    bl_parent_id = "CTMC_PT_main"
    bl_options = {"DEFAULT_CLOSED"}  # noqa: RUF012  (Blender reads it from the class)

    def draw(self, context: bpy.types.Context) -> None:
        """Show every other setting."""
        self.layout.use_property_split = True
        self.layout.use_property_decorate = False
        for name in described():
            if name not in ALWAYS_SHOWN:
                draw_setting(self.layout, context.scene.ctmc, name)


def draw_setting(layout: Any, settings: Any, name: str) -> None:
    """One setting, with its switch if it may be absent."""
    if not optional(name):
        layout.prop(settings, name)
        return
    row = layout.row(heading=described()[name].label)
    row.prop(settings, switch(name), text="")
    value = row.row()
    value.active = getattr(settings, switch(name))
    value.prop(settings, name, text="")


register, unregister = bpy.utils.register_classes_factory((CTMC_PT_main, CTMC_PT_more))
