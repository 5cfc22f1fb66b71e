# SPDX-License-Identifier: GPL-3.0-or-later
"""The rotation test of Su and Ma, 4.3: how long a surface takes to turn once."""

from ..viewport.shaders import can_draw
from .levels import Level, levels_in, show_only, simplified_steps
from .timing import SIZES, Drawing, LevelTimes, frames_of, rotation_steps, rotation_test_steps
from .window import ViewportDrawing
