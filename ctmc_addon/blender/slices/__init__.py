# SPDX-License-Identifier: GPL-3.0-or-later
"""Slices of the CT as objects that stay and render, and surfaces that are cut open at them."""

from .cut import CUT, cut_at_slice, require_cuttable
from .plane import SLICE, add_slice, is_slice

__all__ = ["CUT", "SLICE", "add_slice", "cut_at_slice", "is_slice", "require_cuttable"]
