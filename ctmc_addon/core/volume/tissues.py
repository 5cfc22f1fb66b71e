# SPDX-License-Identifier: GPL-3.0-or-later
"""Usual thresholds of tissues in CT, Hounsfield units.

Round numbers between a tissue and what lies around it, in the ranges of Kalender, Computed Tomography (2011), ch. 1;
contrast and dose move them, so they are a first guess.
"""

from __future__ import annotations

from typing import NamedTuple


class Tissue(NamedTuple):
    """The name of a tissue, its threshold in HU, and what the surface then encloses."""

    name: str
    threshold: float
    text: str


TISSUES = {
    "skin": Tissue("Skin", -300.0, "The body's surface against air"),
    "lung": Tissue("Lung", -500.0, "Airways and lungs, as hollows in the body"),
    "soft": Tissue("Soft Tissue", -20.0, "Muscle and organs without fat"),
    "vessel": Tissue("Contrast Vessel", 150.0, "Vessels with contrast medium, and bone"),
    "bone": Tissue("Bone", 200.0, "Bone, spongy bone included"),
    "compact": Tissue("Compact Bone", 500.0, "Hard bone only"),
    "metal": Tissue("Metal", 2000.0, "Implants and fillings"),
}


def surface_name(kind: str, threshold: float) -> str:
    """Return what the surface at a threshold is called: after the tissue that begins below it, where values are HU.

    Examples
    --------
    >>> surface_name("HU", 226.0), surface_name("HU", -900.0), surface_name("grey value", 120.0)
    ('Bone 226 HU', 'Surface -900 HU', 'Surface 120')
    """
    number = f"{threshold:.6g}"
    if kind != "HU":
        return f"Surface {number}"
    below = [tissue for tissue in TISSUES.values() if tissue.threshold <= threshold]
    name = max(below, key=lambda tissue: tissue.threshold).name if below else "Surface"
    return f"{name} {number} HU"
