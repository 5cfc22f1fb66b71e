# SPDX-License-Identifier: GPL-3.0-or-later
"""Single tools: what they use of the preferences and the panel, and what the panel shows of them."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
from ui.drawing import drawn as drawn_panels
from ui.strokes import mask, middle, stroke

from ctmc_addon.core import Budget
from ctmc_addon.core.segmentation.between import slices as between_slices
from ctmc_addon.ui import operators
from ctmc_addon.ui.panels import draw as draw_panel
from ctmc_addon.ui.properties.drawing import points_of
from ctmc_addon.ui.properties.preferences import Machine


def test_between_slices_uses_the_threads_of_the_preferences(drawing, monkeypatch):
    used, own_threads = [], between_slices.threads_of

    def threads(count):
        used.append(count)
        return own_threads(count)

    monkeypatch.setattr(between_slices, "threads_of", threads)
    monkeypatch.setattr(operators.draw.edits, "machine", lambda: Machine(Budget(3)))
    x, y, z = middle()
    for shift in (-6, 6):
        stroke((x, y, z + shift))
    bpy.ops.ctmc.draw_between()
    assert used == [3]


def test_scissors_remove_what_the_lasso_encloses(drawing):
    drawing.radius_mm, drawing.ball = 5.0, True
    stroke(middle())
    x, _, _ = middle()
    view = np.eye(4)
    view[0, 3] = -x  # clip space is mm, its middle in the middle of the ball
    half = [(0, -99), (99, -99), (99, 99), (0, 99)]
    before = mask().copy()
    bpy.ops.ctmc.draw_cut(view=view.ravel().tolist(), lasso=points_of(half), keep_inside=False)
    assert 0.4 * before.sum() < mask().sum() < 0.6 * before.sum()
    assert not (mask() & ~before).any()


def test_scissors_cut_to_a_depth_below_what_is_seen_first(drawing):
    drawing.radius_mm, drawing.ball, drawing.depth_mm = 5.0, True, 4.0
    stroke(middle())
    before = mask().copy()
    lasso = points_of([(-99, -99), (99, -99), (99, 99), (-99, 99)])
    bpy.ops.ctmc.draw_cut(view=np.eye(4).ravel().tolist(), lasso=lasso, keep_inside=False)  # seen along z
    layers = np.flatnonzero(before.any(axis=(1, 2)))
    assert len(layers) == 4  # of 2 mm
    before[layers[:3]] = False
    assert (mask() == before).all()


@pytest.mark.parametrize(
    ("tool", "own"), [("ctmc.scissors", {"depth_mm"}), ("ctmc.brush", {"radius_mm", "ball"}), ("ctmc.grow", {"method"})]
)
def test_the_panel_shows_the_settings_of_the_active_tool_alone(drawing, monkeypatch, tool, own):
    monkeypatch.setattr(draw_panel, "tool_of", lambda _context: tool)
    shown = set(drawn_panels(draw_panel.CTMC_PT_draw).shown)
    assert shown & {"depth_mm", "radius_mm", "ball", "method"} == own
