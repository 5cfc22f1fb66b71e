# SPDX-License-Identifier: GPL-3.0-or-later
"""Slices of the CT as objects that stay and render, and surfaces that are cut open at them."""

from .cut import CUT, cut_at_slice, cuts_of, flip, is_cut_in, require_cuttable
from .follow import at_corners, corners_of, cross_at, pack_pictures, refresh, show_window, slices_of
from .plane import SLICE, add_slice, is_slice

__all__ = [
    "CUT",
    "SLICE",
    "add_slice",
    "at_corners",
    "corners_of",
    "cross_at",
    "cut_at_slice",
    "cuts_of",
    "flip",
    "is_cut_in",
    "is_slice",
    "pack_pictures",
    "refresh",
    "require_cuttable",
    "show_window",
    "slices_of",
]
