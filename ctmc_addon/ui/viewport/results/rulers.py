# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the values of rulers next to their wires, and the wire of a ruler in progress."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import bpy
import numpy as np

from ....blender.rulers import place_of, points_of, rulers_of, text_of
from ....blender.viewport import draw_labels, draw_lines, draw_path

COLOR = (1.0, 0.85, 0.35, 1.0)
LETTERS = 13.0  # Height in pixels.
WIDTH = 2.0


@dataclass
class _Pending:
    """The points clicked so far, and the one under the mouse; world space."""

    world_points: list[Any] = field(default_factory=list)
    next_point: Any = None


pending = _Pending()
_handlers: list[Any] = []


def _draw_wire() -> None:
    """Draw the wire of the ruler in progress."""
    world_points = [*pending.world_points, *([] if pending.next_point is None else [pending.next_point])]
    if len(world_points) < 2:
        return
    context = bpy.context
    size = (context.region.width, context.region.height)
    pairs = [(number, number + 1) for number in range(len(world_points) - 1)]
    draw_lines(np.array([point[:] for point in world_points]), pairs, COLOR, size, WIDTH)


def _draw_values() -> None:
    """Draw the line and the value of each visible ruler, on top of everything."""
    context = bpy.context
    if context.space_data is None or not context.space_data.overlay.show_overlays:
        return
    from bpy_extras.view3d_utils import location_3d_to_region_2d

    rulers = [ruler for ruler in rulers_of(context.scene) if ruler.visible_get()]
    for ruler in rulers:  # The measured slice hides half of its wire.
        places = [location_3d_to_region_2d(context.region, context.region_data, point) for point in points_of(ruler)]
        if None not in places:
            draw_path([(place.x, place.y) for place in places], COLOR)
    if rulers:
        shown = [(text_of(ruler), place_of(ruler)) for ruler in rulers]
        draw_labels(context.region, context.region_data, shown, LETTERS * context.preferences.system.ui_scale)


def register() -> None:
    """Draw in every 3D viewport of a Blender with a window."""
    if bpy.app.background:
        return
    add = bpy.types.SpaceView3D.draw_handler_add
    _handlers.append(add(_draw_wire, (), "WINDOW", "POST_VIEW"))
    _handlers.append(add(_draw_values, (), "WINDOW", "POST_PIXEL"))


def unregister() -> None:
    """Stop drawing."""
    while _handlers:
        bpy.types.SpaceView3D.draw_handler_remove(_handlers.pop(), "WINDOW")
    pending.world_points, pending.next_point = [], None
