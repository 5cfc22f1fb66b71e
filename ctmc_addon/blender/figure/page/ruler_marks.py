# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw distances and angles on a figure: a line with ends, or with an arc, and the value next to it.

They are drawn on the page, before the surfaces, with a white border, so that they are read on any ground.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import bpy
import numpy as np
from numpy.typing import NDArray

from ...colors import Color
from ...surface import mesh_data as meshes
from ..letters import CAP, text_curve
from .annotations import Board

WIDTH_MM = 0.35  # Width of lines.
BORDER_MM = 0.25  # White border around lines and letters.
END_MM = 1.6  # Length of a line's ends.
ARC_MM = 3.5  # Largest radius of an angle's arc; short sides have half of their length.
ROOM_MM = 1.2  # Distance from a line to its value.
PAGE_EDGE_MM = 1.0  # Values keep this distance from the page's edge.


def ruler_mark(board: Board, points_mm: Sequence[tuple[float, float]], text: str) -> None:
    """Draw a distance between two points of the page, or an angle at the second of three, and its value.

    Parameters
    ----------
    board : Board
    points_mm : sequence of (x, y) float
        On the page.
    text : str
        The value.
    """
    points = np.array(points_mm, np.float64)
    lines = [points, *(ends(points) if len(points) == 2 else [arc(points)])]
    for line in lines:
        add_line(board, line, WIDTH_MM + 2 * BORDER_MM, board.paper, 0.4)
        add_line(board, line, WIDTH_MM, board.pen, 0.3)
    wide, tall = board.width_of(text), CAP * board.font_mm
    x, y = value_position(points, wide, tall, board.size_mm)
    for thickness, color, behind in ((BORDER_MM, board.paper, 0.2), (0.0, board.pen, 0.0)):
        shape = text_curve(text, board.font_mm)
        shape.align_x, shape.resolution_u, shape.offset = "CENTER", 4, thickness
        board.put("CTMC Ruler", shape, x, y, board.ink(color), behind)


def ends(points: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Return short lines across both ends of a line.

    Parameters
    ----------
    points : (2, 2) float64
        Millimeters on the page.

    Returns
    -------
    list of (2, 2) float64
    """
    along = unit(points[1] - points[0])
    across = np.array([-along[1], along[0]]) * END_MM / 2
    return [np.stack([point - across, point + across]) for point in points]


def arc(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the arc of an angle below 180 degrees."""
    sides = points[[0, 2]] - points[1]
    first, last = np.arctan2(sides[:, 1], sides[:, 0])
    way = (last - first + math.pi) % (2 * math.pi) - math.pi
    radius = min(ARC_MM, 0.5 * float(np.hypot(*sides.T).min()))
    angles = first + way * np.linspace(0.0, 1.0, 24)
    return points[1] + radius * np.column_stack([np.cos(angles), np.sin(angles)])


def value_position(
    points: NDArray[np.float64], wide: float, tall: float, page_mm: tuple[float, float]
) -> tuple[float, float]:
    """Return the middle of a value's baseline: next to the middle of a line, or beyond the corner of an angle.

    It is on the other side where that would leave the page.
    """
    if len(points) == 2:
        along = unit(points[1] - points[0])
        away = np.array([-along[1], along[0]])
        away = away if away[1] >= 0 else -away  # Put the value above.
        at = points.mean(axis=0)
    else:
        away = -unit(unit(points[0] - points[1]) + unit(points[2] - points[1]))
        at = points[1]
    # So far that the box of the letters is clear of the line.
    reach = ROOM_MM + abs(away[0]) * wide / 2 + abs(away[1]) * tall / 2
    half, page = np.array([wide, tall]) / 2 + PAGE_EDGE_MM, np.array(page_mm)
    first, second = (at + side * away * reach for side in (1, -1))
    middle = first if ((half <= first) & (first <= page - half)).all() else second
    x, y = np.clip(middle, half, page - half)
    return float(x), float(y - tall / 2)


def unit(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a vector's direction; upwards where it has none.

    Parameters
    ----------
    vector : (2,) float64
    """
    length = float(np.hypot(*vector))
    return vector / length if length > 1e-9 else np.array([0.0, 1.0])


def add_line(board: Board, line: NDArray[np.float64], width: float, color: Color, behind: float) -> bpy.types.Object:
    """Return a line through positions of the page, extended at both ends by half its width."""
    steps = np.diff(line, axis=0)
    along = steps / np.maximum(np.hypot(*steps.T), 1e-9)[:, None] * width / 2
    across = np.column_stack([-along[:, 1], along[:, 0]])
    start, end = line[:-1] - along, line[1:] + along
    corners = np.stack([start - across, end - across, end + across, start + across], axis=1).reshape(-1, 2)
    first = 4 * np.arange(len(steps), dtype=np.int32)
    faces = np.concatenate([np.stack([first, first + 1, first + 2], 1), np.stack([first, first + 2, first + 3], 1)])
    shape = meshes.new_mesh("CTMC Ruler", np.column_stack([corners, 0 * corners[:, :1]]).astype(np.float32), faces)
    return board.put("CTMC Ruler", shape, 0.0, 0.0, board.ink(color), behind)
