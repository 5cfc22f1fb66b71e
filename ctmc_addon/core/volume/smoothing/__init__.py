# SPDX-License-Identifier: GPL-3.0-or-later
"""Smoothing before extraction: a Gaussian, or the smoothest field that agrees with a label at every sample.

Read `constrained` in this order: `bricks` (where the work is done), `signed_distance` (the start), `bounds` (what is
known), `relaxation` (the smoothest field within it), `islands` (the volume of small components kept, found by
`label_components`), `volume_constant` (the volume of the whole kept), `constrained` (all of it in order),
`smooth_field` (what comes out). `between_labels` smooths the wall between two labels.
"""

from .between_labels import between_labels_steps
from .constrained import MOST_STEPS, REMEDY, automatic_refinement, constrained_steps, reach_of
from .gaussian import REACH, smoothed_middle, smoothed_plane, weights
from .label_components import LabelComponents, label_components_steps
from .methods import SMOOTHINGS, Smoothing, smoothing_of, used_settings
from .smooth_field import SmoothField, refined_affine

__all__ = [
    "MOST_STEPS",
    "REACH",
    "REMEDY",
    "SMOOTHINGS",
    "LabelComponents",
    "SmoothField",
    "Smoothing",
    "automatic_refinement",
    "between_labels_steps",
    "constrained_steps",
    "label_components_steps",
    "reach_of",
    "refined_affine",
    "smoothed_middle",
    "smoothed_plane",
    "smoothing_of",
    "used_settings",
    "weights",
]
