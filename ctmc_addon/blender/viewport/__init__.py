# SPDX-License-Identifier: GPL-3.0-or-later
"""Temporary drawings over a 3D viewport, and the direction it looks from."""

from .dragging import place_on_axis, place_on_plane
from .eye import clip, frame, is_held, show_from
from .legend import draw_legend
from .overlay import OverlayPicture, draw_fill, draw_labels, draw_letters, draw_lines, draw_path
from .preview_surface import PreviewSurface
from .shaders import WHOLE, can_draw, free_shader
from .strip import Shown, Strip, draw_strip, placed_names, strip_in, width_of
from .wires import ball, cylinder
