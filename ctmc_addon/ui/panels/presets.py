# SPDX-License-Identifier: GPL-3.0-or-later
"""Manage presets of settings, shipped ones and a user's own, as everywhere in Blender."""

from __future__ import annotations

from pathlib import Path

import bpy
from bl_operators.presets import AddPresetBase  # type: ignore[import-not-found]
from bl_ui.utils import PresetPanel  # type: ignore[import-not-found]

from ...core import SETTINGS
from ..properties.limits import optional, switch
from ..properties.surface.settings import OF_ONE_VOLUME
from .layout import SidePanel

SHIPPED = Path(__file__).parents[1]  # Blender searches this folder for presets/ctmc.
SUBFOLDER = "ctmc"


def _preset_values() -> list[str]:
    """Return the values of a preset: first the settings, which switch themselves on, then the switches."""
    names = [name for name in SETTINGS if name not in OF_ONE_VOLUME]
    return [f"settings.{name}" for name in names] + [f"settings.{switch(name)}" for name in names if optional(name)]


class CTMC_OT_preset_add(AddPresetBase, bpy.types.Operator):
    """Keep the settings of the panel as a preset, or remove one."""

    bl_idname = "ctmc.preset_add"
    bl_label = "Add CTMC Preset"
    bl_description = "Save the settings of the panel as a preset"

    preset_menu = "CTMC_PT_presets"
    preset_subdir = SUBFOLDER
    preset_defines = ["settings = bpy.context.scene.ctmc"]  # noqa: RUF012  (Blender reads it from the class)
    preset_values = _preset_values()


class CTMC_PT_presets(PresetPanel, SidePanel, bpy.types.Panel):
    """Panel with the list of presets."""

    bl_idname = "CTMC_PT_presets"
    bl_label = "CTMC Presets"
    bl_region_type = "HEADER"
    preset_subdir = SUBFOLDER
    preset_operator = "script.execute_preset"
    preset_add_operator = "ctmc.preset_add"


_register, _unregister = bpy.utils.register_classes_factory((CTMC_OT_preset_add, CTMC_PT_presets))


def register() -> None:
    """Register list and operator, and show Blender the shipped ones."""
    _register()
    bpy.utils.register_preset_path(str(SHIPPED))


def unregister() -> None:
    """Unregister them."""
    bpy.utils.unregister_preset_path(str(SHIPPED))
    _unregister()
