# SPDX-License-Identifier: GPL-3.0-or-later
"""List the series of the CT for the dropdown of `ctmc.load`."""

from __future__ import annotations

from typing import Any

import bpy

from ....core import length_text
from ....readers import Series, series_names
from ....reporting.formatting import capitalized
from ...state.ct import volumes
from ...translations import translate

_items: list[tuple[str, str, str]] = []  # Blender does not keep the texts of a list that is made when it is drawn.


def items(_operator: Any, context: bpy.types.Context | None) -> list[tuple[str, str, str]]:
    """Return the series of the panel's CT: number, name, what distinguishes it."""
    ct = None if context is None else volumes.loaded(context.scene)
    if ct is not None:
        names = series_names(ct.series)
        listed = [(str(line.number), name, facts_of(line)) for line, name in zip(ct.series, names, strict=True)]
        if listed != _items:
            _items[:] = listed
    return _items


def facts_of(series: Series) -> str:
    """Return number and kernel as set by the scanner, spacing and number of slices, size, folder."""
    facts = {
        "No. {number}": series.dicom_number,
        "kernel {kernel}": series.kernel,
        "{gap} apart": "" if series.spacing_mm is None else length_text(series.spacing_mm),
        "{count} slices": str(series.slices),
        "{columns} x {rows}": "size",
        "in {folder}": series.folder,
    }
    columns, rows = series.size
    words = [
        translate(text).format(
            number=value, kernel=value, gap=value, count=value, folder=value, columns=columns, rows=rows
        )
        for text, value in facts.items()
        if value
    ]
    text = ", ".join(words)
    return capitalized(text)
