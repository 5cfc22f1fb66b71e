# SPDX-License-Identifier: GPL-3.0-or-later
"""Write names in a column left and right of a picture, each with a line to its structure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...colors import Color
from ..letters import CAP
from ..rendering.visibility import DepthMaps
from .annotations import GAP_MM, LEADING, Board
from .layout import SheetLayout
from .ruler_marks import add_line

LINE_MM = 0.18
BORDER_MM = 0.22  # Border of paper around a line, so that it shows on any ground.
DOT_MM = 0.9  # Diameter of the dot at a line's end.
UNOBSTRUCTED_SHARE = 0.15
"""A line ends on the unobstructed part of a structure if it is more than this share of the visible part."""
STUB_MM = 1.5  # Length of a line before it bends.


@dataclass(frozen=True)
class Callout:
    """A name, its color, and the position of its visible structure, mm on the page; None if it is hidden."""

    name: str
    color: Color
    at: tuple[float, float] | None


def seen_at(maps: DepthMaps, which: int, occluders: Sequence[int]) -> tuple[float, float] | None:
    """Return a position, (right, up), as far inside the visible part of a surface as possible; None if it is hidden.

    A part with no other surface behind or in front of it is preferred.
    """
    seen = maps.visible(which, occluders)
    unobstructed = seen & ~np.isfinite(np.delete(maps.depths, which, axis=0)).any(axis=0)
    inside = unobstructed if unobstructed.sum() > UNOBSTRUCTED_SHARE * seen.sum() else seen
    if not inside.any():
        return None
    while (smaller := eroded(inside)).any():
        inside = smaller
    rows, columns = np.nonzero(inside)
    nearest = int(np.argmin((rows - rows.mean()) ** 2 + (columns - columns.mean()) ** 2))
    return maps.position(int(rows[nearest]), int(columns[nearest]))


def eroded(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the cells of a mask, (rows, columns), whose four neighbors are in it too."""
    padded = np.pad(mask, 1)
    return mask & padded[2:, 1:-1] & padded[:-2, 1:-1] & padded[1:-1, 2:] & padded[1:-1, :-2]


def draw_callouts(board: Board, layout: SheetLayout, callouts: Sequence[Callout]) -> None:
    """Write the names left and right of the first picture of a page, each at the height of its structure."""
    left, bottom, right, top = layout.pictures[0]
    middle = (left + right) / 2
    # Half of them on each side, those farthest left at the left; what is not seen has no place of its own.
    order = sorted(callouts, key=lambda callout: callout.at[0] if callout.at else middle)
    half = (len(order) + 1) // 2
    line = LEADING * board.font_mm
    for side, column in ((-1, order[:half]), (1, order[half:])):
        column = sorted(column, key=lambda callout: callout.at[1] if callout.at else bottom)
        wished = np.array([callout.at[1] if callout.at else bottom for callout in column])
        heights = spread(wished, line, bottom + line / 2, top - line / 2)
        for callout, height in zip(column, heights.tolist(), strict=True):
            _draw_callout(board, callout, layout.margin if side < 0 else board.size_mm[0] - layout.margin, height, side)


def _draw_callout(board: Board, callout: Callout, outer: float, height: float, side: int) -> None:
    """Write one name at a height, with a square of its color and a line inwards."""
    square, cap = CAP * board.font_mm, CAP * board.font_mm
    base = height - cap / 2
    start = outer if side < 0 else outer - square
    board.rectangle((start, base, start + square, base + square), callout.color)
    text = outer - side * (square + GAP_MM)
    board.text(callout.name, text, base, "LEFT" if side < 0 else "RIGHT")
    if callout.at is None:
        return
    begin = text - side * (board.width_of(callout.name) + GAP_MM)
    points = np.array([(begin, height), (begin - side * STUB_MM, height), callout.at])
    end = np.array([callout.at, callout.at])
    for width, dot, color, behind in (
        (LINE_MM + 2 * BORDER_MM, DOT_MM + 2 * BORDER_MM, board.paper, 0.4),
        (LINE_MM, DOT_MM, board.pen, 0.3),
    ):
        add_line(board, points, width, color, behind)
        board.disc(tuple(end[0].tolist()), dot / 2, color, behind)


def spread(wished: NDArray[np.float64], gap: float, low: float, high: float) -> NDArray[np.float64]:
    """Return heights at least a gap apart and between two limits, near the wished ones; rising, as these are.

    The gap is less if the limits leave too little room.

    Examples
    --------
    >>> spread(np.array([1.0, 1.0, 9.0]), 2.0, 0.0, 10.0).tolist()
    [0.0, 2.0, 9.0]
    >>> spread(np.array([9.0, 9.0, 9.0]), 2.0, 0.0, 10.0).tolist()
    [6.0, 8.0, 10.0]
    """
    count = len(wished)
    if not count:
        return wished
    gap = min(gap, (high - low) / max(count - 1, 1))
    steps = gap * np.arange(count)
    # Without the gaps rising heights are enough: names that would overlap share the mean of what they wish for.
    free = wished - steps
    blocks: list[tuple[float, int]] = []
    for value in free.tolist():
        blocks.append((value, 1))
        while len(blocks) > 1 and blocks[-2][0] > blocks[-1][0]:
            (first, many), (second, more) = blocks[-2:]
            blocks[-2:] = [((first * many + second * more) / (many + more), many + more)]
    near = np.repeat([value for value, _ in blocks], [many for _, many in blocks])
    return np.clip(near, low, high - steps[-1]) + steps
