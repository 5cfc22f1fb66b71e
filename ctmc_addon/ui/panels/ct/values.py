# SPDX-License-Identifier: GPL-3.0-or-later
"""Write the range of a CT's values for the panel."""

from __future__ import annotations

from ....core.volume import ValueKind
from ...translations import translate


def values_fact(low: float, high: float, kind: ValueKind) -> tuple[str, str]:
    """Return name and range of the values of a volume of this kind."""
    if kind == ValueKind.LABEL:
        name, text = translate("Labels"), translate("{low} to {high}")
    elif kind == ValueKind.HU:
        name, text = translate("Values"), translate("{low} to {high} HU")
    else:
        name, text = translate("Values"), translate("{low} to {high} (no HU)")
    return name, text.format(low=f"{low:g}", high=f"{high:g}")
