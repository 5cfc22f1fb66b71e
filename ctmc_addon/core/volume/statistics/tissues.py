# SPDX-License-Identifier: GPL-3.0-or-later
"""Usual thresholds of tissues in CT, Hounsfield units.

Round numbers between a tissue and what lies around it, in the ranges of Kalender, Computed Tomography (2011), ch. 1;
contrast and dose move them, so they are a first guess.
"""

from __future__ import annotations

from typing import NamedTuple

from ..value_kind import ValueKind


class Tissue(NamedTuple):
    """The name of a tissue, its threshold in HU, what the surface then encloses, and its upper limit if it has one."""

    name: str
    threshold: float
    text: str
    upper: float | None = None


TISSUES = {
    "skin": Tissue("Skin", -300.0, "The body's surface against air"),
    "lung": Tissue("Lung", -950.0, "Lungs, without air and what is denser", -600.0),
    "soft": Tissue("Soft Tissue", -20.0, "Muscle and organs without fat"),
    "vessel": Tissue("Contrast Vessel", 150.0, "Vessels with contrast medium, and bone"),
    "bone": Tissue("Bone", 200.0, "Bone, spongy bone included"),
    "compact": Tissue("Compact Bone", 500.0, "Hard bone only"),
    "metal": Tissue("Metal", 2000.0, "Implants and fillings"),
}


def tissue_name(kind: str, threshold: float, upper: float | None = None) -> str:
    """Return the tissue that a surface is of, where values are HU; else "Surface".

    That is the tissue that begins below the threshold, or the one that both limits lie in.

    Examples
    --------
    >>> tissue_name("HU", 226.0), tissue_name("HU", -950.0, -600.0), tissue_name("gray value", 120.0)
    ('Bone', 'Lung', 'Surface')
    """
    if kind != ValueKind.HU:
        return "Surface"
    below = [tissue for tissue in TISSUES.values() if tissue.upper is None and tissue.threshold <= threshold]
    around = [
        tissue
        for tissue in TISSUES.values()
        if tissue.upper is not None and upper is not None and tissue.threshold <= threshold <= upper <= tissue.upper
    ]
    return max(around or below, key=lambda tissue: tissue.threshold).name if around or below else "Surface"


def surface_name(kind: str, threshold: float, upper: float | None = None) -> str:
    """Return the name of a surface: its tissue and its limits.

    Examples
    --------
    >>> surface_name("HU", 226.0), surface_name("HU", -900.0), surface_name("gray value", 120.0)
    ('Bone 226 HU', 'Surface -900 HU', 'Surface 120')
    >>> surface_name("HU", -950.0, -600.0), surface_name("HU", 226.0, 500.0), surface_name("HU", -950.0, 0.0)
    ('Lung -950 to -600 HU', 'Bone 226 to 500 HU', 'Surface -950 to 0 HU')
    >>> surface_name("Gy", 20.0)
    'Surface 20 Gy'
    """
    number = f"{threshold:.6g}" if upper is None else f"{threshold:.6g} to {upper:.6g}"
    mark = ValueKind(kind).mark if kind else ""
    return f"{tissue_name(kind, threshold, upper)} {number} {mark}".rstrip()
