# SPDX-License-Identifier: GPL-3.0-or-later
"""Small bar charts as PNG: a few panels side by side, the value on every bar."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...core.files.atomic_write import whole_file

PANEL = (900, 640)  # pixels
LEFT, RIGHT, TOP, BOTTOM = 120, 30, 150, 100
DPI = 200
TEXT, TITLE = 24, 30  # pixels
BAR = 110  # at most, pixels
INK, GRAY, RULE = (30, 30, 30), (110, 110, 110), (222, 222, 222)
# Distinguishable by the color-blind, and in gray (Okabe and Ito 2008).
COLORS = ((0, 90, 160), (230, 159, 0), (0, 158, 115))


@dataclass(frozen=True)
class Panel:
    """One chart: a group of bars for every label, a bar in it for every series.

    Parameters
    ----------
    title : str
        What is shown, with its unit.
    across : str
        What the labels are.
    labels : sequence of str
    series : mapping of name to values
        A value for every label; None draws no bar.
    """

    title: str
    across: str
    labels: Sequence[str]
    series: Mapping[str, Sequence[float | None]]


def panel_of(title: str, across: str, labels: Sequence[str], rows: Sequence[Mapping[str, Any]], **series: str) -> Panel:
    """Return a chart of a table's rows; `series` are names in the legend and the keys of their values."""
    return Panel(title, across, labels, {name: [row[key] for row in rows] for name, key in series.items()})


def write_plot(path: Path, panels: Sequence[Panel]) -> None:
    """Draw the panels side by side and write them to a PNG, whole or not at all.

    Parameters
    ----------
    path : Path
    panels : sequence of Panel
    """
    from PIL import Image, ImageDraw

    picture = Image.new("RGB", (PANEL[0] * len(panels), PANEL[1]), "white")
    for at, panel in enumerate(panels):
        draw_panel(ImageDraw.Draw(picture), panel, at * PANEL[0])
    with whole_file(path) as temporary:
        picture.save(temporary, "PNG", dpi=(DPI, DPI))


def draw_panel(pen: Any, panel: Panel, left: int) -> None:
    """One panel, its left edge at pixel `left`."""
    text, title = font(TEXT), font(TITLE)
    x0, x1 = left + LEFT, left + PANEL[0] - RIGHT
    y0, y1 = TOP, PANEL[1] - BOTTOM
    most = max((value for values in panel.series.values() for value in values if value is not None), default=0.0)
    marks = ticks(most)

    def height(value: float) -> float:
        return y1 - (y1 - y0) * value / marks[-1]

    pen.text((x0, 30), panel.title, INK, title)
    if len(panel.series) > 1:
        legend(pen, panel, x0, text)
    for mark in marks:
        pen.line([(x0, height(mark)), (x1, height(mark))], RULE if mark else INK, 2)
        pen.text((x0 - 14, height(mark)), f"{mark:g}", GRAY, text, anchor="rm")
    group = (x1 - x0) / max(len(panel.labels), 1)
    bar = min(0.8 * group / len(panel.series), BAR)
    for at, label in enumerate(panel.labels):
        middle = x0 + (at + 0.5) * group
        pen.text((middle, y1 + 14), label, INK, text, anchor="mt")
        for which, values in enumerate(panel.series.values()):
            value = values[at]
            if value is None:
                continue
            start = middle + (which - len(panel.series) / 2) * bar
            pen.rectangle([(start + 3, height(value)), (start + bar - 3, y1)], COLORS[which % len(COLORS)])
            pen.text((start + bar / 2, height(value) - 8), f"{value:.3g}", INK, font(TEXT - 4), anchor="mb")
    pen.text(((x0 + x1) / 2, PANEL[1] - 14), panel.across, GRAY, text, anchor="mb")


def legend(pen: Any, panel: Panel, x: float, face: Any) -> None:
    """The colors of the series in a line under the title."""
    for which, name in enumerate(panel.series):
        pen.rectangle([(x, 84), (x + 24, 108)], COLORS[which % len(COLORS)])
        pen.text((x + 34, 96), name, INK, face, anchor="lm")
        x += 34 + pen.textlength(name, face) + 40


def ticks(most: float) -> list[float]:
    """Round numbers from 0 to at least `most`, four to six steps.

    Examples
    --------
    >>> ticks(0.83)
    [0.0, 0.2, 0.4, 0.6, 0.8, 1.0]
    """
    if most <= 0:
        return [0.0, 1.0]
    power = 10.0 ** math.floor(math.log10(most / 4))
    step = next(factor * power for factor in (1, 2, 5, 10) if most / (factor * power) <= 6)
    return [float(f"{at * step:.6g}") for at in range(math.ceil(most / step - 1e-9) + 1)]


def font(size: int) -> Any:
    """Pillow's own letters: the same on every machine."""
    from PIL import ImageFont

    return ImageFont.load_default(size)
