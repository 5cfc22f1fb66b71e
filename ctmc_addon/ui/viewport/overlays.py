# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the slice, the region's box and the patient's sides over every 3D viewport; nothing of it is stored.

The draw handlers exist only where there is a window. They read the scene, keep the last picture on the graphics card
and draw nothing where no volume is loaded or the viewport's overlays are switched off.
"""

from __future__ import annotations

import math
from typing import Any

import bpy
import numpy as np

from ...blender.slices import is_cut_in
from ...blender.viewport import OverlayPicture, draw_letters, draw_lines
from ...core import Volume
from ...core.volume import (
    EDGES,
    TINT_SHARE,
    ValueKind,
    label_slices,
    region_corners,
    side_positions,
    slice_at,
    slice_corners,
    slice_values,
    volume_box,
    windowed,
    with_labels,
)
from ..properties.ct.view import window_and_level
from ..properties.preferences import machine
from ..properties.surface.structures import LABEL, THRESHOLD
from ..state.ct import volumes
from ..state.draw.tools import tool_of
from ..state.surface import structures
from .draw import drawn
from .results import maps
from .surface import live, solid

REGION_COLOR = (1.0, 0.75, 0.1, 0.9)
VOLUME_COLOR = (1.0, 1.0, 1.0, 0.18)
DISPLAY_GAMMA = 2.2
LETTER_PIXELS = 16.0

_handlers: list[Any] = []
_last: dict[str, Any] = {}  # "key", "volume" and "picture" of the slice drawn last


def _scene_volume(context: bpy.types.Context) -> Volume | None:
    """Return the volume to draw in this viewport, or None."""
    space = context.space_data
    if space is None or space.type != "VIEW_3D" or not space.overlay.show_overlays:
        return None
    return volumes.current(context.scene)


def requested_labels(settings: Any) -> tuple[int, ...]:
    """Return the labels of the next surfaces; none if they are by threshold."""
    if not settings.use_label:
        return ()
    ticked = [item for item in settings.labels if item.chosen]
    return tuple(item.value for item in ticked if item.kind == LABEL) or (() if ticked else (settings.label,))


def label_colors(settings: Any) -> dict[int, tuple[float, ...]]:
    """Return the display colors of the labels of the list, converted from linear colors."""
    return {item.value: _as_it_appears(item.color) for item in settings.labels if item.kind == LABEL}


def _as_it_appears(color: Any) -> tuple[float, ...]:
    """Return the display color of a linear color."""
    return tuple(light ** (1 / DISPLAY_GAMMA) for light in color)


def _ticked_bands(settings: Any) -> tuple[tuple[float, float, tuple[float, ...]], ...]:
    """Return the ticked thresholds of the list: lowest and highest value, and display color."""
    if not settings.use_label:
        return ()
    return tuple(
        (item.threshold, item.upper if item.use_upper else math.inf, _as_it_appears(item.color))
        for item in settings.labels
        if item.chosen and item.kind == THRESHOLD
    )


def _slice_picture(scene: bpy.types.Scene, volume: Volume) -> OverlayPicture:
    """Return the current slice, updated only when it has changed."""
    view, settings = scene.ctmc_view, scene.ctmc
    shown_slice = slice_at(volume, view.plane, view.position)
    labels, bands = requested_labels(settings), _ticked_bands(settings)
    by_hand = drawn.labels_of(scene)  # `drawn` lays those over the slice
    labels = tuple(label for label in labels if label not in by_hand)
    draws = bool(tool_of(bpy.context))  # Drawings show best on gray.
    above, upper = (None, None) if settings.use_label or draws else volumes.used_limits(scene)
    upper = None if above is None else upper
    window, level = window_and_level(view)
    scale = machine().scale
    of_labels = _shown_labels(scene, volume) if settings.use_label else None
    colors = label_colors(settings) if of_labels is not None else {}
    key = (shown_slice, window, level, above, upper, labels, bands, scale, tuple(colors.items()), of_labels)
    if _last.get("volume") is not volume or _last.get("key") != key:
        values = slice_values(volume, shown_slice)
        tinted = labels if volume.kind != ValueKind.HU and of_labels is None else ()
        shown = windowed(values, window, level, above, tinted, upper)
        for low, high, color in bands:
            shown = with_labels(shown, [(values >= low) & (values <= high)], {1: color}, (1,), TINT_SHARE)
        if of_labels is not None:
            is_gray = volume.kind != ValueKind.LABEL
            below = shown if is_gray else np.zeros_like(shown) + np.array([0, 0, 0, 1], np.float32)
            layers = label_slices(of_labels, shown_slice)
            shown = with_labels(below, layers, colors, labels, TINT_SHARE if is_gray else 1.0)
        picture = OverlayPicture(shown, slice_corners(volume, shown_slice) * scale)
        _last.update(volume=volume, key=key, picture=picture)
    last: OverlayPicture = _last["picture"]
    return last


def shows_slice(scene: bpy.types.Scene, volume: Volume) -> bool:
    """Return whether the slice is drawn: not in the plane of a cut, which shows the same picture."""
    view = scene.ctmc_view
    if not view.show_slice:
        return False
    corners = slice_corners(volume, slice_at(volume, view.plane, view.position))
    return not is_cut_in(scene, corners * machine().scale)


def _shown_labels(scene: bpy.types.Scene, volume: Volume) -> Volume | None:
    """Return the labels on the samples of the shown volume; None if there are none on these samples."""
    labels = volume if volumes.is_coarse(scene) else structures.label_volume(scene)
    return labels if labels is not None and labels.kind == ValueKind.LABEL and len(scene.ctmc.labels) else None


def _draw_in_space() -> None:
    """Draw the slice and the box of the region, which objects may hide."""
    context = bpy.context
    if volumes.current(context.scene) is not _last.get("volume"):
        _last.clear()
    volume = _scene_volume(context)
    if volume is None:
        return
    scale, settings = machine().scale, context.scene.ctmc
    size = (context.region.width, context.region.height)
    if shows_slice(context.scene, volume):
        _slice_picture(context.scene, volume).draw(context.region_data)
    draw_lines(volume_box(volume) * scale, EDGES, VOLUME_COLOR, size, 1.0)
    if settings.use_region:
        full = volumes.current_full(context.scene) or volume
        corners = region_corners(full, tuple(settings.region), settings.region_unit)
        draw_lines(corners * scale, EDGES, REGION_COLOR, size, 2.0)
    solid.draw(context, size)
    if solid.shows(context):
        live.follow_solid(context.scene)


def _draw_on_top() -> None:
    """Draw legend and letters over everything."""
    context = bpy.context
    if context.space_data.overlay.show_overlays:
        maps.draw(context)
    volume = _scene_volume(context)
    if volume is None or not context.scene.ctmc_view.show_letters:
        return
    corners = volume_box(volume) * machine().scale
    size = LETTER_PIXELS * context.preferences.system.ui_scale
    middle = (corners[0] + corners[7]) / 2
    draw_letters(context.region, context.region_data, side_positions(corners), middle, size)


def register() -> None:
    """Draw in every 3D viewport of a Blender with a window."""
    if bpy.app.background:
        return
    add = bpy.types.SpaceView3D.draw_handler_add
    _handlers.append(add(_draw_in_space, (), "WINDOW", "POST_VIEW"))
    _handlers.append(add(_draw_on_top, (), "WINDOW", "POST_PIXEL"))


def unregister() -> None:
    """Stop drawing, and free the picture."""
    while _handlers:
        bpy.types.SpaceView3D.draw_handler_remove(_handlers.pop(), "WINDOW")
    _last.clear()
