# SPDX-License-Identifier: GPL-3.0-or-later
"""Define preferences of the machine, not of a file: threads, preview budget, scene scale, memory limit, units."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy
from bpy.props import BoolProperty, FloatProperty, IntProperty

from ...blender.surface import SCALE
from ...core import Budget
from ..state import change_events
from ..translations import OURS, translate

# As an extension this package lies in bl_ext.<repository>.ctmc, and that is what Blender calls the add-on.
ADDON = __package__.rpartition(".ctmc_addon.")[0] or "ctmc_addon"
GIB = 2**30


def limits_changed(_preferences: bpy.types.AddonPreferences, _context: bpy.types.Context) -> None:
    """Count costs again with the new limits."""
    for scene in bpy.data.scenes:
        change_events.notify(scene.ctmc, "memory_gib")


class CTMCPreferences(bpy.types.AddonPreferences):
    """Threads, preview budget, scene scale, memory limit, units."""

    bl_idname = ADDON

    threads: IntProperty(
        name="Threads",
        description="Threads for extracting and reading. 0 = one for each processor, at most 8. Results are the same",
        default=0,
        min=0,
        max=64,
    )
    preview_ms: IntProperty(
        name="Preview Budget [ms]",
        description="How long a coarse preview may take while a slider moves [ms]. Larger = finer, and less smooth",
        default=100,
        min=10,
        max=2000,
    )
    scene_scale: FloatProperty(
        name="Scene Scale",
        description="Blender units per mm, for new surfaces. Exports are always in millimeters",
        default=SCALE,
        min=0.0001,
        max=10.0,
        precision=4,
    )
    memory_gib: FloatProperty(
        name="Memory Limit [GiB]",
        description="Memory that a surface may take [GiB]. 0 = what the machine has available",
        default=0.0,
        min=0.0,
        max=1024.0,
        precision=1,
        update=limits_changed,
    )
    show_mm: BoolProperty(
        name="Show Millimeters in New Files",
        description=(
            "Set the units to the patient's millimeters when the first CT is loaded into a file that was never saved "
            "and has Blender's own units"
        ),
        default=True,
    )

    def draw(self, _context: bpy.types.Context) -> None:
        self.layout.use_property_split = True
        for name in ("threads", "preview_ms", "scene_scale", "memory_gib"):
            row = self.layout.row(heading=translate(self.bl_rna.properties[name].name), heading_ctxt=OURS)
            row.use_property_split = False
            is_auto = name in ("threads", "memory_gib") and not getattr(self, name)
            row.prop(self, name, text=translate("auto") if is_auto else "")
        self.layout.prop(self, "show_mm")


WHOLE_MACHINE = Budget()


@dataclass(frozen=True)
class Machine:
    """The preferences as core takes them."""

    budget: Budget = WHOLE_MACHINE
    preview_seconds: float = 0.1
    scale: float = SCALE
    show_mm: bool = True


def machine() -> Machine:
    """Return the preferences of this machine; the defaults if the package is not enabled as an add-on."""
    addon: Any = bpy.context.preferences.addons.get(ADDON)
    preferences = getattr(addon, "preferences", None)
    if preferences is None:
        return Machine()
    return Machine(
        budget=Budget(preferences.threads or None, int(preferences.memory_gib * GIB) or None),
        preview_seconds=preferences.preview_ms / 1000,
        scale=preferences.scene_scale,
        show_mm=preferences.show_mm,
    )


register, unregister = bpy.utils.register_classes_factory((CTMCPreferences,))
