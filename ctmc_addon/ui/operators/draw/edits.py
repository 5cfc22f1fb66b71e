# SPDX-License-Identifier: GPL-3.0-or-later
"""Edit a whole drawn structure: margin, islands, holes, combine, between slices."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy
import numpy as np
from bpy.props import BoolProperty

from ....core import ReconstructionSettings, SettingsError, Steps, Volume
from ....core.segmentation import (
    Flags,
    Window,
    between_slices_steps,
    combined,
    drawn_axis,
    grown_window,
    holes_filled_steps,
    islands_steps,
    margin_steps,
)
from ... import jobs
from ...properties.preferences import machine
from ...properties.surface.structures import LABEL
from ...state import session
from ...state.draw import drawings, masks
from ...state.surface import structures
from .needs import (
    DrawTarget,
    allowed_steps,
    can_draw,
    has_structure,
    limits_of,
    named_volume_text,
    require,
    require_active,
    target_of,
    volume_of,
)

Work = Callable[[Flags, Volume, Window], Steps[Flags]]
"""Makes another mask of a window of a mask."""


class _Edit(jobs.LongOperator):
    """An operator that replaces the mask of the active structure; it provides `work`."""

    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)
    needs = (jobs.idle, can_draw, has_structure)

    def work(self, scene: bpy.types.Scene) -> Work:
        """Read the settings once."""
        raise NotImplementedError

    def reach_mm(self, _scene: bpy.types.Scene) -> float:
        """Return how far outside of the structure the work looks."""
        return 0.0

    def plan(self, context: bpy.types.Context) -> Steps[jobs.Conclusion]:
        """Return the work on the window of the structure."""
        scene = context.scene
        item, volume = require_active(scene), volume_of(scene)
        window = masks.window_in(scene, item)
        if window is None:
            raise SettingsError(f"{drawings.line_of(scene, item).name} is empty; draw it first")
        reach_mm = self.reach_mm(scene) + max(volume.spacing) * 1.01  # Add a sample around it, for holes.
        window = grown_window(window, reach_mm, volume.spacing, volume.shape)
        mask = masks.of(scene, item).mask[window].copy()
        return edit_steps(self.work(scene)(mask, volume, window), window, target_of(scene, item))


def edit_steps(work: Steps[Flags], window: Window, target: DrawTarget) -> Steps[jobs.Conclusion]:
    """Compute the mask, then change the structure at once."""
    mask = yield from work

    def conclude() -> str:
        scene, item = require(target)
        masks.replace(scene, item, window, mask)
        session.of(scene).message = ""
        return named_volume_text(scene, item)

    return conclude


class CTMC_OT_draw_margin(_Edit, bpy.types.Operator):
    """Grow or shrink by millimeters."""

    bl_idname = "ctmc.draw_margin"
    bl_label = "Margin"
    bl_description = "Grow the structure by the margin on all sides, within the range; a negative margin shrinks it"

    def reach_mm(self, scene: bpy.types.Scene) -> float:
        return max(0.0, float(scene.ctmc_draw.margin_mm))

    def work(self, scene: bpy.types.Scene) -> Work:
        margin_mm, limits = scene.ctmc_draw.margin_mm, limits_of(scene.ctmc_draw)

        def steps(mask: Flags, volume: Volume, window: Window) -> Steps[Flags]:
            allowed = yield from allowed_steps(volume, window, limits)
            return (yield from margin_steps(mask, volume.spacing, margin_mm, allowed))

        return steps


class CTMC_OT_draw_islands(_Edit, bpy.types.Operator):
    """Keep the largest island, or drop the small ones."""

    bl_idname = "ctmc.draw_islands"
    bl_label = "Remove Islands"
    bl_description = "Remove small disconnected parts"

    largest: BoolProperty(name="Largest Only", description="Keep only the largest island", options={"SKIP_SAVE"})

    def work(self, scene: bpy.types.Scene) -> Work:
        at_least_mm3 = 0.0 if self.largest else scene.ctmc_draw.islands_mm3
        largest = 1 if self.largest else None

        def steps(mask: Flags, volume: Volume, _window: Window) -> Steps[Flags]:
            return (yield from islands_steps(mask, volume.voxel_mm3, at_least_mm3, largest))

        return steps


class CTMC_OT_draw_holes(_Edit, bpy.types.Operator):
    """Fill what is enclosed."""

    bl_idname = "ctmc.draw_holes"
    bl_label = "Fill Holes"
    bl_description = "Fill holes that the structure encloses on all sides"

    def work(self, _scene: bpy.types.Scene) -> Work:
        def steps(mask: Flags, volume: Volume, _window: Window) -> Steps[Flags]:
            return (yield from holes_filled_steps(mask, volume.voxel_mm3))

        return steps


class CTMC_OT_draw_between(_Edit, bpy.types.Operator):
    """Fill the slices between drawn ones."""

    bl_idname = "ctmc.draw_between"
    bl_label = "Between Slices"
    bl_description = "Fill the slices between the drawn ones, in each plane that was drawn on"

    def work(self, _scene: bpy.types.Scene) -> Work:
        budget = machine().budget

        def steps(mask: Flags, volume: Volume, _window: Window) -> Steps[Flags]:
            return (yield from between_slices_steps(mask, volume.spacing, None, drawn_axis(mask), budget))

        return steps


class CTMC_OT_draw_combine(_Edit, bpy.types.Operator):
    """Add, take away, or keep what overlaps with another structure."""

    bl_idname = "ctmc.draw_combine"
    bl_label = "Combine"
    bl_description = "Combine the structure with another one, which does not change"

    def plan(self, context: bpy.types.Context) -> Steps[jobs.Conclusion]:
        """Return the work on the whole CT, because the other structure may lie anywhere."""
        scene, how = context.scene, context.scene.ctmc_draw.combination
        item, volume, name = drawings.active(scene), volume_of(scene), scene.ctmc_draw.other
        lines = [line for line in scene.ctmc.labels if item is not None and line.source != item.key]
        line = next((line for line in lines if name and line.name == name and line.kind == LABEL), None)
        if item is None or line is None:
            raise SettingsError("choose another structure to combine with, drawn or a label")
        first, second = masks.of(scene, item).mask.copy(), _mask_of(scene, line)
        z, y, x = (slice(0, count) for count in volume.shape)
        return edit_steps(_combined_steps(first, second, how), (z, y, x), target_of(scene, item))


def _mask_of(scene: bpy.types.Scene, line: Any) -> Flags:
    """Return the voxels of a label of the list; raise a `LabelError` if they are not in memory."""
    mask = np.zeros(volume_of(scene).shape, bool)
    for layer in structures.require_volume_of(scene, ReconstructionSettings(label=line.value)).each_layer:
        mask |= layer.values == line.value
    return mask


def _combined_steps(first: Flags, second: Flags, how: str) -> Steps[Flags]:
    yield from ()
    return combined(first, second, how)


CLASSES: tuple[Any, ...] = (
    CTMC_OT_draw_margin,
    CTMC_OT_draw_islands,
    CTMC_OT_draw_holes,
    CTMC_OT_draw_between,
    CTMC_OT_draw_combine,
)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
