# SPDX-License-Identifier: GPL-3.0-or-later
"""Define the combo of thresholds, and the number below it, which always shows the threshold that is used.

As in settings.py, this module must not hold `bpy` itself, nor anything that does.
"""

from __future__ import annotations

from typing import Any

from ....core.volume import TISSUES
from ..kinds import choice, decimal

OTSU = ("otsu", "Otsu", "The threshold that best separates the values of the volume, or region, into two classes")
CUSTOM = ("custom", "Custom", "Use the number below")
TISSUE_ITEMS = [(key, tissue.name, f"{tissue.text} [HU]") for key, tissue in TISSUES.items()]
KEYS = ["otsu", *TISSUES, "custom"]


def used_threshold(properties: Any) -> float | None:
    """Return the threshold of a reconstruction; None if it is not known yet."""
    from ...state.ct import volumes

    return volumes.used_threshold(properties.id_data)


def take_tissue(properties: Any, key: str) -> None:
    """Set the usual threshold of a tissue, with its upper limit if it has one."""
    tissue = TISSUES[key]
    properties.use_upper = tissue.upper is not None
    properties.threshold = tissue.threshold
    if tissue.upper is not None:
        properties.upper = tissue.upper


def _tissue_of(properties: Any) -> str:
    """Return the tissue whose usual limits are set; empty if there is none."""
    limits = (properties.threshold, properties.upper if properties.use_upper else None)
    return next((key for key, tissue in TISSUES.items() if (tissue.threshold, tissue.upper) == limits), "")


def _get_choice(properties: Any) -> int:
    if not properties.use_threshold:
        return 0
    return KEYS.index(_tissue_of(properties) or "custom")


def _set_choice(properties: Any, number: int) -> None:
    """Take Otsu's threshold, that of a tissue, or the number that is shown; a tissue's upper limit goes with it."""
    key = KEYS[number]
    if key in TISSUES:
        take_tissue(properties, key)
        return
    value = used_threshold(properties)
    if key == "custom":
        properties.threshold = properties.threshold if value is None else value
        return
    if properties.upper in {tissue.upper for tissue in TISSUES.values()}:
        properties.use_upper = False
    properties.use_threshold = False


def _get_gray_choice(properties: Any) -> int:
    return int(properties.use_threshold)


def _set_gray_choice(properties: Any, is_custom: int) -> None:
    _set_choice(properties, len(KEYS) - 1 if is_custom else 0)


def _get_value(properties: Any) -> float:
    value = None if properties.use_threshold else used_threshold(properties)
    return float(properties.threshold if value is None else value)


def _set_value(properties: Any, value: float) -> None:
    """Set the threshold; an upper limit below it is switched off."""
    if properties.use_upper and value > properties.upper:
        properties.use_upper = False
    properties.threshold = value


def threshold_properties() -> dict[str, Any]:
    """Return the combo for HU, that for other values, and the number."""
    text = "Threshold of the surface: Otsu's, the usual one of a tissue, or a number"
    return {
        "threshold_from": choice(
            "Threshold From", text, items=[OTSU, *TISSUE_ITEMS, CUSTOM], get=_get_choice, set=_set_choice
        ),
        "gray_from": choice(
            "Threshold From",
            "Threshold of the surface: Otsu's, or a number",
            items=[OTSU, CUSTOM],
            get=_get_gray_choice,
            set=_set_gray_choice,
        ),
        "threshold_value": decimal(
            "Threshold",
            "Gray value at which the surface lies: voxels at or above it are inside. Larger = denser tissue only",
            precision=1,
            step=1000,
            get=_get_value,
            set=_set_value,
        ),
    }
