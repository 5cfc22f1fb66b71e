# SPDX-License-Identifier: GPL-3.0-or-later
"""Lay out a page: rows of cells with their captions, a footer, and a caption for the whole."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from ....core import SettingsError
from ..letters import CAP
from ..spec import FEW_STRUCTURES, Box, Cell, FigureStyle, Page
from .annotations import COLUMN_GAP_MM, LEADING, Board

MARGIN_MM = 2.5
GAP_MM = 3.0  # Gap between cells side by side.
ROW_GAP_MM = 4.0
MOST_IN_A_COLUMN = 6
FOOTER_GAP_MM = 2.0
ROOM = 1.04  # Room for a cell's contents, as a multiple of their size.
HEIGHTS = (0.4, 1.25)  # Lowest and highest ratio of height to width of a cell, if the page's height is free.
MOST_HEIGHT_MM = 230.0  # Height of a journal's page: the limit if the height is free.
LEAST_OF_REST = 1.07  # A picture is at least this much taller than its legend and all else on the page.
SMALLEST_MM = 8.0  # Smallest picture.
LEADER_MM = 4.0  # Shortest line from a name to the picture.
LEAST_SHARE = 0.36  # Smallest share of the width that names leave for the picture.


@dataclass(frozen=True)
class SheetLayout:
    """Positions of a page's parts, mm from its lower left corner; `unit` is Blender units of a millimeter."""

    height_mm: float
    unit: float
    margin: float
    pictures: tuple[Box, ...]
    texts: tuple[tuple[str, ...], ...]  # Lines under every picture.
    captions_top: float  # Distance from a picture down to the top of its caption's first capital.
    cap_mm: float
    footer_bottom: float
    footer_mm: float
    caption_top: float
    caption: tuple[str, ...]
    legend_columns: int = 1
    legend_above_mm: float = 0.0
    """Distance from the footer's bottom to a legend above scale bar and axes; 0 for a legend at their side."""
    has_name_columns: bool = False  # Names are in columns left and right of the picture, and not in the footer.

    def center(self, which: int) -> tuple[float, float]:
        """Return the middle of a cell's picture."""
        left, bottom, right, top = self.pictures[which]
        return (left + right) / 2, (bottom + top) / 2

    def caption_at(self, which: int) -> tuple[float, float]:
        """Return the middle of the first baseline of a cell's caption."""
        left, bottom, right, _ = self.pictures[which]
        return (left + right) / 2, bottom - self.captions_top - self.cap_mm


def make_layout(
    cells: Sequence[Cell],
    page: Page,
    style: FigureStyle,
    extent: tuple[float, float],
    board: Board,
    reach_mm: float,
    turning: bool = False,
) -> SheetLayout:
    """Lay out a page.

    Parameters
    ----------
    extent : (width, height)
        Room that every cell needs, Blender units.
    board : Board
        Measures letters.
    reach_mm : float
        Reach of the patient's axes.
    turning : bool
        The surfaces will turn, so names cannot be left and right of them.

    Raises
    ------
    SettingsError
        If the page is too small for its cells.
    """
    columns = min(style.columns or _columns_for(len(cells)), len(cells))
    rows = math.ceil(len(cells) / columns)
    inner = page.printed_width_mm - 2 * MARGIN_MM
    names = [surface.name for surface in cells[0].surfaces if surface.name]
    aside = 0.0 if turning or len(cells) > 1 else _name_columns_mm(names, style, board, inner)
    width = (inner - (columns - 1) * GAP_MM) / columns - 2 * aside
    font, cap = page.font_mm, CAP * page.font_mm
    texts = tuple(tuple(row for line in cell.lines for row in board.lines_of(line, width)) for cell in cells)
    lines = max(len(text) for text in texts)
    captions = (2.0 + cap + (lines - 1) * LEADING * font + 0.3 * font) if lines else 0.0
    caption = tuple(board.lines_of(style.caption, inner)) if style.caption else ()
    caption_mm = (cap + (len(caption) - 1) * LEADING * font + 0.3 * font) if caption else 0.0
    names = [] if aside else names
    bar_and_axes_mm = (
        0.25 * inner + 5.0 + (2 * reach_mm + font + 6.0 if style.orientation else 0.0)
    )  # Width of the scale bar and the axes.
    widths = [board.width_of(name) for name in names]
    legend_columns, legend_above = _columns_of_legend(widths, inner - bar_and_axes_mm, cap), 0.0
    footer = footer_mm(math.ceil(len(names) / legend_columns), style, font, reach_mm)
    across = _columns_of_legend(widths, inner, cap)
    above = footer_mm(0, style, font, reach_mm) + FOOTER_GAP_MM
    stacked = above + _legend_mm(math.ceil(len(names) / across), font)
    if names and style.colors is None and stacked < footer:  # A long legend takes the page's width.
        legend_columns, legend_above, footer = across, above, stacked
    below = (
        MARGIN_MM
        + caption_mm
        + (FOOTER_GAP_MM if caption and footer else 0.0)
        + footer
        + (FOOTER_GAP_MM if footer or caption else 0.0)
    )
    if page.height_mm is None:
        low, high = HEIGHTS
        rest = below + rows * captions + (rows - 1) * ROW_GAP_MM + MARGIN_MM
        height = width * min(max(extent[1] / extent[0], low), high)
        if names:
            height = max(height, LEAST_OF_REST * rest / rows)
        if rest + rows * height > MOST_HEIGHT_MM:
            height = max((MOST_HEIGHT_MM - rest) / rows, min(height, width * low))
        total = rest + rows * height
    else:
        total = page.height_mm
        height = (total - below - MARGIN_MM - (rows - 1) * ROW_GAP_MM) / rows - captions
    widest = max((board.width_of(line) for text in texts for line in text), default=0.0)
    remedies = []
    if width < SMALLEST_MM or widest > width + GAP_MM:
        need = (max(SMALLEST_MM, widest) + 2 * aside) * columns + (columns - 1) * GAP_MM + 2 * MARGIN_MM
        remedies.append(f"a width of {math.ceil(need)} mm or more" + (", or fewer columns" if columns > 1 else ""))
    if height < SMALLEST_MM and (page.height_mm is not None or not remedies):  # A free height follows the width.
        need = total + rows * (SMALLEST_MM - height)
        remedies.append(f"a height of {math.ceil(need)} mm or more")
    if remedies:
        raise SettingsError(
            f"{columns} x {rows} cells with their captions do not fit {page.printed_width_mm:g} x {total:.0f} mm; "
            f"choose {' and '.join(remedies)}"
        )
    pictures = []
    for which in range(len(cells)):
        row, column = divmod(which, columns)
        left = MARGIN_MM + aside + column * (width + GAP_MM)
        top = total - MARGIN_MM - row * (height + captions + ROW_GAP_MM)
        pictures.append((left, top - height, left + width, top))
    return SheetLayout(
        height_mm=total,
        unit=ROOM * max(extent[0] / width, extent[1] / height),
        margin=MARGIN_MM,
        pictures=tuple(pictures),
        texts=texts,
        captions_top=2.0,
        cap_mm=cap,
        footer_bottom=MARGIN_MM + caption_mm + (FOOTER_GAP_MM if caption and footer else 0.0),
        footer_mm=footer,
        caption_top=MARGIN_MM + caption_mm,
        caption=caption,
        legend_columns=legend_columns,
        legend_above_mm=legend_above,
        has_name_columns=aside > 0,
    )


def _name_columns_mm(names: Sequence[str], style: FigureStyle, board: Board, inner_mm: float) -> float:
    """Return the width of the columns of names left and right of a picture; 0 without such columns."""
    if style.style != "illustration" or style.colors is not None or not 2 <= len(names) <= FEW_STRUCTURES:
        return 0.0
    wide = max(board.width_of(name) for name in names) + CAP * board.font_mm + LEADER_MM
    return wide if inner_mm - 2 * wide >= LEAST_SHARE * inner_mm else 0.0


def _columns_of_legend(widths_mm: Sequence[float], room_mm: float, side_mm: float) -> int:
    """Return the columns of a legend with names of these widths: one for a few, else as many as fit.

    Examples
    --------
    >>> _columns_of_legend([20.0] * 5, 100.0, 2.0), _columns_of_legend([20.0] * 60, 100.0, 2.0)
    (1, 3)
    """
    if len(widths_mm) <= MOST_IN_A_COLUMN:
        return 1

    def taken(columns: int) -> float:
        rows = math.ceil(len(widths_mm) / columns)
        starts = range(0, len(widths_mm), rows)
        return sum(max(widths_mm[at : at + rows]) + side_mm + GAP_MM + COLUMN_GAP_MM for at in starts)

    return max((columns for columns in range(2, len(widths_mm)) if taken(columns) <= room_mm), default=1)


def _legend_mm(rows: int, font: float) -> float:
    return (rows - 1) * LEADING * font + font


def footer_mm(legend_rows: int, style: FigureStyle, font: float, reach_mm: float) -> float:
    """Return the height of the footer, mm: scale bar, legend or color bar, and the patient's axes.

    Parameters
    ----------
    legend_rows : int
    style : FigureStyle
    font : float
        Size of the letters, mm.
    reach_mm : float
        Distance from the middle of the patient's axes to their letters.
    """
    heights = [0.0]
    if style.scale_bar:
        heights.append(1.4 + font)
    if style.colors is not None:
        heights.append((4.2 if style.colors.gaps else 3.0) * LEADING * font)
    elif legend_rows:
        heights.append(_legend_mm(legend_rows, font))
    if style.orientation:
        heights.append(2 * reach_mm + font)
    return max(heights)


def _columns_for(count: int) -> int:
    """Return the cells per row: all of up to three, else as many as make the sheet about square.

    Examples
    --------
    >>> [_columns_for(count) for count in (1, 3, 4, 6, 9)]
    [1, 3, 2, 3, 3]
    """
    return count if count <= 3 else math.ceil(math.sqrt(count))
