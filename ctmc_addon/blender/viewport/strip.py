# SPDX-License-Identifier: GPL-3.0-or-later
"""Lay out and draw the histogram as a strip along the lower edge of a 3D viewport.

Pixels count from the region's lower left corner. `gpu` and `blf` exist only where Blender draws.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .overlay import FONT, Color

# Pixels at Blender's usual size, from the lower edge up.
GAP, TICKS, PLOT, BANDS, NAMES, TITLE = 8, 18, 96, 18, 15, 20
SIDE = 14  # Margin left and right of the axis.
LETTERS = 11
REACH = 9  # Distance from a line at which the mouse still grabs it.
NARROWEST = 120

BACKGROUND, PLOT_BACKGROUND = (0.10, 0.10, 0.11, 0.92), (0.05, 0.05, 0.06, 1.0)
OUTSIDE, INSIDE = (0.42, 0.42, 0.45, 1.0), (0.90, 0.58, 0.25, 1.0)
LINE, LINE_HELD, FAINT, TEXT = (1.0, 1.0, 1.0, 1.0), (1.0, 0.95, 0.45, 1.0), (1.0, 1.0, 1.0, 0.12), (0.9, 0.9, 0.9, 1.0)
Width = Callable[[str], float]
"""Returns the width of a text, pixels."""
BAND_COLORS = ((0.24, 0.32, 0.42, 1.0), (0.32, 0.28, 0.40, 1.0))  # Neighboring bands alternate between two colors.


@dataclass(frozen=True)
class Strip:
    """Position of the strip in a region.

    Parameters
    ----------
    left, right : float
        Its ends, pixels.
    low, high : float
        The values at the ends of its axis.
    scale : float
        Scale of Blender's interface.
    names : int
        Rows above the bands, for names that do not fit into them.
    """

    left: float
    right: float
    low: float
    high: float
    scale: float = 1.0
    names: int = 0

    @property
    def bottom(self) -> float:
        """Return the strip's lower edge, pixels."""
        return GAP * self.scale

    @property
    def top(self) -> float:
        """Return the strip's upper edge, pixels."""
        return self.bottom + (TICKS + PLOT + BANDS + NAMES * self.names + TITLE) * self.scale

    @property
    def axis(self) -> tuple[float, float]:
        """Return the pixels of `low` and `high`."""
        return self.left + SIDE * self.scale, self.right - SIDE * self.scale

    @property
    def pixel(self) -> float:
        """Return the width of a pixel, in values."""
        first, last = self.axis
        return (self.high - self.low) / max(1.0, last - first)

    @property
    def reach(self) -> float:
        """Return the distance from a line at which the mouse still grabs it, in values."""
        return REACH * self.scale * self.pixel

    def x_of(self, value: float) -> float:
        """Return the pixel of a value, limited to the ends of the strip."""
        return self.axis[0] + (min(max(value, self.low), self.high) - self.low) / self.pixel

    def value_at(self, x: float) -> float:
        """Return the value at a pixel, limited to the ends of the axis."""
        return min(max(self.low + (x - self.axis[0]) * self.pixel, self.low), self.high)

    def holds(self, x: float, y: float) -> bool:
        """Return whether a pixel lies in the strip."""
        return self.left <= x <= self.right and self.bottom <= y <= self.top


def strip_in(area: Any, low: float, high: float, scale: float) -> Strip:
    """Return the strip in a 3D viewport, as wide as its toolbar and sidebar leave free.

    Parameters
    ----------
    area : bpy.types.Area
    low : float
        Value at the left end.
    high : float
        Value at the right end.
    scale : float
        Scale of the interface.
    """
    region = next(region for region in area.regions if region.type == "WINDOW")
    left, right = 0.0, float(region.width)
    for bar in area.regions:
        if bar.width <= 1 or bar.type not in ("TOOLS", "UI", "HUD"):
            continue
        begin, end = bar.x - region.x, bar.x + bar.width - region.x
        if bar.type == "HUD" or bar.alignment == "LEFT":
            left = max(left, end) if begin < region.width / 2 else left
        elif bar.alignment == "RIGHT":
            right = min(right, begin)
    gap = GAP * scale
    left, right = left + gap, right - gap
    if right - left < NARROWEST * scale:
        left, right = gap, region.width - gap
    return Strip(left, right, low, high, scale)


def rectangles(boxes: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return two triangles for each box.

    Parameters
    ----------
    boxes : (n, 4)
        Left, bottom, right, top.

    Returns
    -------
    (6 n, 3) float32
    """
    corners = boxes[:, [0, 1, 2, 1, 2, 3, 0, 1, 2, 3, 0, 3]].reshape(-1, 2)  # (6 n, 2)
    return np.column_stack((corners, np.zeros(len(corners)))).astype(np.float32)


def bar_boxes(strip: Strip, heights: NDArray[np.float64], start: float, width: float) -> NDArray[np.float64]:
    """Return the boxes of bars on the strip's axis, clipped at its ends: (n, 4) left, bottom, right, top."""
    ends = start + width * np.arange(len(heights) + 1)
    pixels = strip.axis[0] + (np.clip(ends, strip.low, strip.high) - strip.low) / strip.pixel
    foot = strip.bottom + TICKS * strip.scale
    tops = foot + heights * (PLOT - 4) * strip.scale
    return np.column_stack((pixels[:-1], np.full(len(heights), foot), pixels[1:], tops))


@dataclass(frozen=True)
class Name:
    """The name of a band at a pixel: in the band (row 0), or above it with a line down to its lower end."""

    text: str
    x: float
    row: int
    band: float


def placed_names(strip: Strip, bands: Sequence[tuple[float, float, Sequence[str]]], width: Width) -> list[Name]:
    """Return the positions of all bands' names.

    A name stands in its band if any of its texts fits, else above it in the lowest row that is free to the right.
    Names are placed from the right, so that no line crosses a name.
    """
    placed, ends = [], [strip.right] * (len(bands) + 1)
    for low, high, texts in reversed(bands):
        begin, end, gap = strip.x_of(low), strip.x_of(high), 3 * strip.scale
        fitting = next((text for text in texts if width(text) <= end - begin - 2 * gap), None)
        if fitting is not None:
            placed.append(Name(fitting, begin + gap, 0, begin))
            continue
        wide = width(texts[0])
        x = max(strip.left, min(begin, strip.right - wide))
        row = next(row for row in range(1, len(ends)) if x + wide <= ends[row] or ends[row] == strip.right)
        ends[row] = x - 2 * gap
        placed.append(Name(texts[0], x, row, begin))
    return placed[::-1]


def width_of(text: str, scale: float) -> float:
    """Return how wide a text of the strip is, pixels.

    Parameters
    ----------
    text : str
    scale : float
        Scale of the interface.
    """
    import blf

    blf.size(FONT, LETTERS * scale)
    return float(blf.dimensions(FONT, text)[0])


def _draw_boxes(boxes: NDArray[np.float64], color: Color) -> None:
    import gpu
    from gpu_extras.batch import batch_for_shader

    if not len(boxes):
        return
    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    batch = batch_for_shader(shader, "TRIS", {"pos": rectangles(np.asarray(boxes, np.float64))})
    shader.bind()
    shader.uniform_float("color", color)
    batch.draw(shader)


def draw_text(text: str, x: float, y: float, room: tuple[float, float], middle: bool = False) -> bool:
    """Write a text; return whether it fits.

    Parameters
    ----------
    text : str
    x : float
        Left end or middle of the text, pixels.
    y : float
        Baseline of the text, pixels.
    room : (left, right) float
        Pixels into which it is pushed.
    middle : bool
        Whether `x` is its middle.
    """
    import blf

    width = blf.dimensions(FONT, text)[0]
    if width > room[1] - room[0]:
        return False
    x = min(max(x - width / 2 if middle else x, room[0]), room[1] - width)
    blf.position(FONT, x, y, 0.0)
    blf.draw(FONT, text)
    return True


@dataclass(frozen=True, eq=False)
class Shown:
    """Content of the strip.

    Parameters
    ----------
    bars : tuple of (heights, start, width)
    ticks : sequence of (value, text)
    bands : sequence of (low, high, texts)
        The longest text that fits is written, or the first above the band.
    limits : tuple of (threshold, upper)
        None for a limit that is not set; the upper limit is then drawn at the end.
    held : int or None
        The line that the mouse holds or would take, 0 or 1.
    title, hint : str
        Texts at the left and the right of the upper edge.
    pointed : tuple of (value, text) or None
        Part of the strip under the mouse.
    """

    bars: tuple[NDArray[np.float64], float, float]
    ticks: Sequence[tuple[float, str]]
    bands: Sequence[tuple[float, float, Sequence[str]]]
    limits: tuple[float | None, float | None]
    held: int | None = None
    title: str = ""
    hint: str = ""
    pointed: tuple[float, str] | None = None


def draw_strip(strip: Strip, shown: Shown) -> None:
    """Draw the strip in the current region."""
    import blf
    import gpu

    gpu.state.blend_set("ALPHA")
    scale, (first, last) = strip.scale, strip.axis
    foot = strip.bottom + TICKS * scale
    head = foot + PLOT * scale
    _draw_boxes(np.array([[strip.left, strip.bottom, strip.right, strip.top]]), BACKGROUND)
    _draw_boxes(np.array([[first, foot, last, head]]), PLOT_BACKGROUND)
    _draw_bars(strip, shown)
    grid = [strip.x_of(value) for value, _ in shown.ticks]
    _draw_boxes(np.array([[x, foot, x + scale, head] for x in grid]).reshape(-1, 4), FAINT)
    blf.size(FONT, LETTERS * scale)
    blf.color(FONT, *TEXT)
    for (_, text), x in zip(shown.ticks, grid, strict=True):
        draw_text(text, x, strip.bottom + 5 * scale, (strip.left, strip.right), middle=True)
    for number, (low, high, _) in enumerate(shown.bands):
        begin, end = strip.x_of(low), strip.x_of(high)
        _draw_boxes(np.array([[begin, head, end - scale, head + BANDS * scale]]), BAND_COLORS[number % 2])
    _draw_names(strip, shown, head)
    _draw_limits(strip, shown, foot, head)
    y = strip.top - (TITLE - 6) * scale
    width = blf.dimensions(FONT, shown.title)[0]
    draw_text(shown.title, first, y, (first, last))
    draw_text(shown.hint, last, y, (first + width + 12 * scale, last))
    if shown.pointed is not None:
        value, text = shown.pointed
        x = strip.x_of(value)
        _draw_boxes(np.array([[x, foot, x + scale, head]]), (1.0, 1.0, 1.0, 0.35))
        wide = blf.dimensions(FONT, text)[0] + 8 * scale
        left = min(x + 6 * scale, last - wide)
        _draw_boxes(np.array([[left, head - 20 * scale, left + wide, head - 3 * scale]]), (0.0, 0.0, 0.0, 0.75))
        draw_text(text, left + 4 * scale, head - 15 * scale, (left, last))
    gpu.state.blend_set("NONE")


def _draw_names(strip: Strip, shown: Shown, head: float) -> None:
    """Draw the names of the bands, whose lower edge is at `head`."""
    scale = strip.scale
    for name in placed_names(strip, shown.bands, lambda text: width_of(text, scale)):
        y = head + (BANDS + NAMES * (name.row - 1)) * scale if name.row else head
        if name.row:
            _draw_boxes(np.array([[name.band, head + BANDS * scale, name.band + scale, y + 4 * scale]]), TEXT)
        draw_text(name.text, name.x, y + 5 * scale, (strip.left, strip.right))


def _draw_bars(strip: Strip, shown: Shown) -> None:
    """Draw the bars; those between the limits are colored."""
    boxes = bar_boxes(strip, *shown.bars)
    threshold, upper = shown.limits
    begin = strip.axis[1] if threshold is None else strip.x_of(threshold)
    end = strip.axis[1] if upper is None else strip.x_of(upper)
    _draw_boxes(boxes, OUTSIDE)
    inside = boxes.copy()
    inside[:, [0, 2]] = np.clip(inside[:, [0, 2]], begin, max(begin, end))
    _draw_boxes(inside[inside[:, 2] > inside[:, 0]], INSIDE)


def _draw_limits(strip: Strip, shown: Shown, foot: float, head: float) -> None:
    """Draw the two limits, each with a grip at its head; the upper limit's is hollow if it is not set."""
    scale = strip.scale
    threshold, upper = shown.limits
    for number, value in enumerate((threshold, upper)):
        if value is None and number == 0:
            continue
        x = strip.axis[1] if value is None else strip.x_of(value)
        color = LINE_HELD if shown.held == number else LINE
        if value is None:
            color = (*color[:3], 0.5)
        _draw_boxes(np.array([[x - scale, foot, x + scale, head]]), color)
        _draw_boxes(np.array([[x - 4 * scale, foot, x + 4 * scale, foot + 12 * scale]]), color)
