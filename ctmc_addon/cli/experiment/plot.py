# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw small bar charts side by side as PNG, with the value on every bar."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...core.files.atomic_write import whole_file

# Sizes in pixels; a bar may be narrower.
CHART = (900, 640)
LEFT, RIGHT, TOP, BOTTOM = 120, 30, 150, 100
TEXT, TITLE = 24, 30
BAR = 110
DPI = 200
INK, GRAY, RULE = (30, 30, 30), (110, 110, 110), (222, 222, 222)
# Distinguishable by the color-blind, and in gray (Okabe and Ito 2008).
COLORS = ((0, 90, 160), (230, 159, 0), (0, 158, 115))

Series = Mapping[str, Sequence[float | None]]


@dataclass(frozen=True)
class Plot:
    """Charts side by side: in each a group of bars for every label, and a bar in it for every series.

    Parameters
    ----------
    caption : str
        Of the plot in table.md.
    across : str
        The meaning of the labels.
    labels : sequence of str
    charts : mapping of title to series
        Titles have units. A series is a name and a value for every label; None draws no bar.
    """

    caption: str
    across: str
    labels: Sequence[str]
    charts: Mapping[str, Series]

    def write(self, path: Path) -> None:
        """Draw the charts and write them to a PNG, whole or not at all."""
        from PIL import Image, ImageDraw

        picture = Image.new("RGB", (CHART[0] * len(self.charts), CHART[1]), "white")
        for at, (title, shown) in enumerate(self.charts.items()):
            self._draw(ImageDraw.Draw(picture), title, shown, at * CHART[0])
        with whole_file(path) as temporary:
            picture.save(temporary, "PNG", dpi=(DPI, DPI))

    def _draw(self, pen: Any, title: str, shown: Series, left: int) -> None:
        """Draw one chart, its left edge at pixel `left`."""
        text = _font(TEXT)
        x0, x1 = left + LEFT, left + CHART[0] - RIGHT
        y0, y1 = TOP, CHART[1] - BOTTOM
        most = max((value for values in shown.values() for value in values if value is not None), default=0.0)
        marks = ticks(most)

        def height(value: float) -> float:
            return y1 - (y1 - y0) * value / marks[-1]

        pen.text((x0, 30), title, INK, _font(TITLE))
        if len(shown) > 1:
            _legend(pen, shown, x0, text)
        for mark in marks:
            pen.line([(x0, height(mark)), (x1, height(mark))], RULE if mark else INK, 2)
            pen.text((x0 - 14, height(mark)), f"{mark:g}", GRAY, text, anchor="rm")
        group = (x1 - x0) / max(len(self.labels), 1)
        bar = min(0.8 * group / len(shown), BAR)
        for at, label in enumerate(self.labels):
            middle = x0 + (at + 0.5) * group
            pen.text((middle, y1 + 14), label, INK, text, anchor="mt")
            for which, values in enumerate(shown.values()):
                value = values[at]
                if value is None:
                    continue
                start = middle + (which - len(shown) / 2) * bar
                pen.rectangle([(start + 3, height(value)), (start + bar - 3, y1)], COLORS[which % len(COLORS)])
                pen.text((start + bar / 2, height(value) - 8), f"{value:.3g}", INK, _font(TEXT - 4), anchor="mb")
        pen.text(((x0 + x1) / 2, CHART[1] - 14), self.across, GRAY, text, anchor="mb")


def series(rows: Sequence[Mapping[str, Any]], **keys: str) -> Series:
    """Return the series of a chart by their names in the legend, from the values of rows under the keys."""
    return {name: [row[key] for row in rows] for name, key in keys.items()}


def _legend(pen: Any, shown: Series, x: float, face: Any) -> None:
    """Draw the colors of the series in a line under the title."""
    for which, name in enumerate(shown):
        pen.rectangle([(x, 84), (x + 24, 108)], COLORS[which % len(COLORS)])
        pen.text((x + 34, 96), name, INK, face, anchor="lm")
        x += 34 + pen.textlength(name, face) + 40


def ticks(most: float) -> list[float]:
    """Return round numbers from 0 to at least `most` in four to six steps.

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


def _font(size: int) -> Any:
    """Return Pillow's own letters, which are the same on every machine."""
    from PIL import ImageFont

    return ImageFont.load_default(size)
