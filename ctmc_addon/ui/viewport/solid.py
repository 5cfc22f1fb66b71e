# SPDX-License-Identifier: GPL-3.0-or-later
"""Show the panel's solid in the viewport while the page Surface is open: planes of cuts, pegs and drains."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ...blender.viewport import ball, cylinder, draw_fill, draw_lines
from ...core import SettingsError
from ...core.solid import Bar, drain_bars, peg_bars, rectangle_of
from ..properties.preferences import machine
from ..state import solids

PAGE = "SURFACE"
CUT_COLOR, CUT_TINT = (0.95, 0.45, 0.1, 1.0), (0.95, 0.45, 0.1, 0.15)
PEG_COLOR, DRAIN_COLOR = (0.95, 0.45, 0.1, 1.0), (0.2, 0.7, 1.0, 1.0)
LINE = 1.5  # Pixels.
SIDES = ((0, 1), (1, 2), (2, 3), (3, 0))


@dataclass(frozen=True)
class SolidOutline:
    """What the viewport shows of a solid, RAS+ mm.

    Parameters
    ----------
    planes : list of (4, 3) float64
        Rectangles of the cuts.
    pegs, drains : list of Bar
    places : list of ((x, y, z), radius)
        Drains whose direction is not known yet, because no surface was made.
    """

    planes: list[NDArray[np.float64]]
    pegs: list[Bar]
    drains: list[Bar]
    places: list[tuple[tuple[float, float, float], float]]


def outline_of(scene: bpy.types.Scene) -> SolidOutline | None:
    """Return the outline of the panel's solid; None without one. Lines that make no sense yet are left out."""
    stored = scene.ctmc_solid
    if not len(stored.cuts) and not len(stored.drains):
        return None
    box = solids.box_of(scene)
    if box is None:
        return None
    cuts = [cut.to_request() for cut in stored.cuts if any(cut.normal)]
    planes = [rectangle_of(cut, box) for cut in cuts]
    try:
        pegs = stored.pegs_request()
    except SettingsError:
        pegs = None
    pairs = zip(cuts, planes, strict=True)
    standing = [] if pegs is None else [bar for cut, plane in pairs for bar in peg_bars(cut, pegs, plane)]
    drains = [drain.to_request() for drain in stored.drains]
    vertices = solids.vertices_of(scene) if drains else None
    if vertices is None:
        places = [(drain.point, drain.diameter / 2) for drain in drains if drain.point is not None]
        return SolidOutline(planes, standing, [], places)
    return SolidOutline(planes, standing, [bar for drain in drains for bar in drain_bars(drain, vertices)], [])


def draw(context: bpy.types.Context, size: tuple[float, float]) -> None:
    """Draw the outline of the panel's solid into a viewport of this size, pixels."""
    outline = outline_of(context.scene) if context.window_manager.ctmc_page == PAGE else None
    if outline is None:
        return
    scale = machine().scale
    for plane in outline.planes:
        draw_fill(plane * scale, CUT_TINT)
        draw_lines(plane * scale, SIDES, CUT_COLOR, size, LINE)
    for bars, color in ((outline.pegs, PEG_COLOR), (outline.drains, DRAIN_COLOR)):
        for bar in bars:
            _draw_wire(cylinder(bar.start, bar.end, bar.radius), color, size, scale)
    for point, radius in outline.places:
        _draw_wire(ball(point, radius), DRAIN_COLOR, size, scale)


def _draw_wire(wire: tuple[NDArray[np.float64], Any], color: Any, size: tuple[float, float], scale: float) -> None:
    points, pairs = wire
    draw_lines(points * scale, pairs, color, size, LINE)
