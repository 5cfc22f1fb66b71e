# SPDX-License-Identifier: GPL-3.0-or-later
"""Show the cuts, pegs and drains of the panel's solid in the viewport while the page Surface is open."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ....blender.viewport import ball, cylinder, draw_fill, draw_lines
from ....core.solid import Bar, rectangle_of
from ...properties.preferences import machine
from ...state.surface import solids
from . import solid_places

PAGE = "SURFACE"
CUT_COLOR, CUT_TINT = (0.95, 0.45, 0.1, 1.0), (0.95, 0.45, 0.1, 0.15)
PEG_COLOR, HOLE_COLOR, DRAIN_COLOR = (0.95, 0.45, 0.1, 1.0), (0.95, 0.45, 0.1, 0.4), (0.2, 0.7, 1.0, 1.0)
LINE = 1.5  # Width of lines, pixels.
SIDES = ((0, 1), (1, 2), (2, 3), (3, 0))
Wire = tuple[NDArray[np.float64], Any]


@dataclass(frozen=True)
class SolidOutline:
    """Outline of a solid in the viewport, RAS+ mm.

    Parameters
    ----------
    planes : list of (4, 3) float64
        Rectangles of the cuts.
    pegs, holes, drains : list of Bar
    places : list of ((x, y, z), radius)
        Points and radii of drains that are not placed yet.
    """

    planes: list[NDArray[np.float64]]
    pegs: list[Bar]
    holes: list[Bar]
    drains: list[Bar]
    places: list[tuple[tuple[float, float, float], float]]


def outline_of(scene: bpy.types.Scene) -> SolidOutline | None:
    """Return the outline of the panel's solid; None without a solid. Incomplete cuts are left out."""
    stored = scene.ctmc_solid
    if not len(stored.cuts) and not len(stored.drains):
        return None
    box = solids.box_of(scene)
    if box is None:
        return None
    planes = [rectangle_of(cut.to_request(), box) for cut in stored.cuts if any(cut.normal)]
    placed = solid_places.places_of(scene)
    if placed is None:
        drains = [drain.to_request() for drain in stored.drains]
        unknown = [(drain.point, drain.diameter / 2) for drain in drains if drain.point is not None]
        return SolidOutline(planes, [], [], [], unknown)
    pegs = [] if placed.pegs is None else list(placed.pegs.bars)
    holes = [Bar(peg.start, peg.end, peg.radius + stored.clearance) for peg in pegs]
    return SolidOutline(planes, pegs, holes, list(placed.drains.bars), [])


def shows(context: bpy.types.Context) -> bool:
    """Return whether the page of the solid is open."""
    return bool(context.window_manager.ctmc_page == PAGE)


def draw(context: bpy.types.Context, size: tuple[float, float]) -> None:
    """Draw the outline of the panel's solid into a viewport of this size, pixels."""
    outline = outline_of(context.scene) if shows(context) else None
    if outline is None:
        return
    scale = machine().scale
    for plane in outline.planes:
        draw_fill(plane * scale, CUT_TINT)
        draw_lines(plane * scale, SIDES, CUT_COLOR, size, LINE)
    for bars, color in ((outline.pegs, PEG_COLOR), (outline.holes, HOLE_COLOR), (outline.drains, DRAIN_COLOR)):
        _draw_wires([_whole(bar) for bar in bars], color, size, scale)
    _draw_wires([ball(*place) for place in outline.places], DRAIN_COLOR, size, scale)


def _whole(bar: Bar) -> Wire:
    """Return the cylinder of a bar, longer by its round end."""
    along = np.subtract(bar.end, bar.start)
    return cylinder(bar.start, bar.end + along * (bar.radius / np.linalg.norm(along)), bar.radius)


def _draw_wires(wires: Iterable[Wire], color: Any, size: tuple[float, float], scale: float) -> None:
    """Draw all wires with one call, because each call is slow."""
    points, pairs, count = [], [], 0
    for own, joined in wires:
        points.append(own)
        pairs += [(start + count, end + count) for start, end in joined]
        count += len(own)
    if points:
        draw_lines(np.concatenate(points) * scale, pairs, color, size, LINE)
