# SPDX-License-Identifier: GPL-3.0-or-later
"""Grow a structure from a click: the operator `ctmc.draw_grow`.

To borders, all clicks in a structure compete with those in its surroundings. A click changes only samples whose result
it changes, so strokes drawn between two clicks stay. In a range, a click adds connected samples, and Alt removes them.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from bpy.props import BoolProperty, FloatVectorProperty

from ....core import SettingsError, Steps, Volume
from ....core.segmentation import (
    Change,
    Click,
    Flags,
    Window,
    change_of,
    compete_steps,
    connected_steps,
    range_mask_steps,
    sample_at,
)
from ... import jobs
from ...state import session
from ...state.draw import drawings, masks
from ...translations import translate
from ...viewport.ct.slice_hits import slice_under
from .needs import DrawTarget, can_draw, limits_of, named_volume_text, require, target_of, volume_of, whole

Sample = tuple[int, int, int]


class CTMC_OT_draw_grow(jobs.LongOperator, bpy.types.Operator):
    """Grow a structure from a click."""

    bl_idname = "ctmc.draw_grow"
    bl_label = "Grow"
    bl_description = (
        "Click in a structure to grow it to its border, or through connected values in the range. "
        "Alt click a leak to remove it"
    )
    bl_options = {"UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    point_mm: FloatVectorProperty(name="Point", size=3, precision=3, options={"HIDDEN", "SKIP_SAVE"})
    surroundings: BoolProperty(
        name="Surroundings", description="The click marks the surroundings of the structure", options={"SKIP_SAVE"}
    )

    needs = (jobs.idle, can_draw)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Begin at the mouse on a slice; a click off all slices passes through."""
        if context.area is None or context.area.type != "VIEW_3D":
            self.report({"ERROR"}, translate("Press this in a 3D viewport"))
            return {"CANCELLED"}
        hit = slice_under(context.scene, context.area, event)
        if hit is None:
            return {"CANCELLED", "PASS_THROUGH"}
        self.point_mm = hit.point_mm
        session.of(context.scene).message = ""
        return self.begin(context)

    def plan(self, context: bpy.types.Context) -> Steps[jobs.Conclusion]:
        """Return the work of a click; a new structure is added only when it is done."""
        scene, drawing = context.scene, context.scene.ctmc_draw
        volume = volume_of(scene)
        sample = sample_at(volume, self.point_mm)
        item = drawings.active(scene)
        limits = limits_of(drawing)
        if drawing.method == "connected":
            before = None if item is None else masks.of(scene, item).mask
            limits = (drawing.low, drawing.high)
            work = _connected_click_steps(
                volume, sample, before, limits, drawing.reach_mm, drawing.opening_mm, self.surroundings
            )
            return _conclusion_steps(work, target_of(scene, item), None)
        earlier_clicks = (
            [] if item is None else [Click(tuple(click.sample), int(click.inside)) for click in item.clicks]
        )
        clicks = (*earlier_clicks, Click(sample, 0 if self.surroundings else 1))
        grown = None if item is None else masks.of(scene, item).grown
        how = (limits, drawing.hu_per_mm, drawing.reach_mm)
        work = _compete_click_steps(volume, clicks, how, grown)
        return _conclusion_steps(work, target_of(scene, item), clicks[-1])


class _Grown:
    """Samples that a click adds to a structure and removes from it, and the state that the next click starts from."""

    def __init__(self, window: Window, added: Flags, taken: Flags, kept: tuple[Any, Change] | None) -> None:
        self.window, self.added, self.taken, self.kept = window, added, taken, kept


def _conclusion_steps(work: Steps[_Grown], target: DrawTarget, click: Click | None) -> Steps[jobs.Conclusion]:
    """Do the work of a click, then change the structure at once."""
    grown = yield from work

    def conclude() -> str:
        scene, item = require(target)
        if click is not None:
            added = item.clicks.add()
            added.sample, added.inside = click.sample, bool(click.structure)
        drawn = masks.of(scene, item)
        window, add, take = grown.window, grown.added, grown.taken
        masks.replace(scene, item, window, (drawn.mask[window] | add) & ~take)
        drawn.grown = grown.kept
        return named_volume_text(scene, item)

    return conclude


def _compete_click_steps(
    volume: Volume, clicks: tuple[Click, ...], how: tuple[Any, ...], grown: tuple[Any, Change] | None
) -> Steps[_Grown]:
    """Let all clicks compete, and return the changes by the last one."""
    limits, hu_per_mm, reach_mm = how
    allowed = None if limits is None else (yield from range_mask_steps(volume, *limits))
    if allowed is not None:
        for click in clicks:  # Earlier clicks may be outside of a range that was moved.
            allowed[click.sample] |= bool(click.structure) and click is not clicks[-1]
    if not any(click.structure for click in clicks):
        raise SettingsError("click in the structure first; Alt click then removes leaks")
    after = (yield from compete_steps(volume, clicks, allowed, hu_per_mm, reach_mm)) == 1
    before = np.zeros(volume.shape, bool)
    key = (clicks[:-1], how)
    if grown is not None and grown[0] == key:
        grown[1].apply(before)
    elif any(click.structure for click in clicks[:-1]):
        before = (yield from compete_steps(volume, clicks[:-1], allowed, hu_per_mm, reach_mm)) == 1
    kept = ((clicks, how), change_of(np.zeros(volume.shape, bool), after))
    return _Grown(whole(volume.shape), after & ~before, before & ~after, kept)


def _connected_click_steps(
    volume: Volume,
    sample: Sample,
    before: Flags | None,
    limits: tuple[float, float],
    reach_mm: float,
    opening_mm: float,
    takes: bool,
) -> Steps[_Grown]:
    """Return the samples connected to a click: in a range to add them, in the structure to remove them."""
    window = whole(volume.shape)
    if takes:
        if before is None or not before[sample]:
            raise SettingsError("the structure does not reach this point; Alt click where it has leaked")
        connected = yield from connected_steps(before, [sample], volume.spacing, reach_mm, opening_mm)
        return _Grown(window, np.zeros_like(connected), connected, None)
    allowed = yield from range_mask_steps(volume, *limits)
    connected = yield from connected_steps(allowed, [sample], volume.spacing, reach_mm, opening_mm)
    return _Grown(window, connected, np.zeros_like(connected), None)


register, unregister = bpy.utils.register_classes_factory((CTMC_OT_draw_grow,))
