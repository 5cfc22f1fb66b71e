# SPDX-License-Identifier: GPL-3.0-or-later
"""Show slices of the CT as objects that stay and render, and cut surfaces at them or with a box."""

from .cut import CUT, cut_at_slice, cuts_of, flip, is_cut_in
from .cut_box import add_cut_box, cut_away, cut_box_of, flip_cut_away, near_half, remove_cut_away
from .cuttable import is_cut_box, is_cuttable, require_cuttable
from .follow import at_corners, corners_of, cross_at, pack_pictures, refresh, show_window, slices_of
from .plane import SLICE, add_slice, is_slice
