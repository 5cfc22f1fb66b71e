# SPDX-License-Identifier: GPL-3.0-or-later
"""Handles of the solid: a cut follows the mouse along its normal or turns about its middle, a drain across the view."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ctmc_addon.blender.viewport import place_on_axis
from ctmc_addon.ui.operators.surface.drag_solid import moving, moving_drain, turning
from ctmc_addon.ui.viewport.surface.solid_handles import middle_of

SCALE = 0.01
FORWARD = (0.0, 1.0, 0.0)


def ray(x_mm, z_mm):
    """The ray of a view from the front at a place, mm."""
    return np.array([x_mm, -900.0, z_mm]) * SCALE, np.array(FORWARD)


@pytest.fixture
def middle(loaded):
    """The middle of the only cut, which is across z, mm."""
    bpy.ops.ctmc.cut_add(direction="Z")
    return middle_of(loaded, 0)


def test_a_cut_moves_along_its_normal_by_as_much_as_the_mouse(loaded, middle):
    [cut] = loaded.ctmc_solid.cuts
    before = tuple(cut.point)
    drag = moving(loaded, 0, ray(middle[0] + 5.0, middle[2] + 2.0))
    drag(ray(middle[0] - 3.0, middle[2] + 6.5))
    assert tuple(cut.point) == pytest.approx((before[0], before[1], before[2] + 4.5), abs=1e-4)
    assert tuple(cut.normal) == (0.0, 0.0, 1.0)
    drag(ray(middle[0] + 5.0, middle[2] + 2.0))
    assert tuple(cut.point) == pytest.approx(before, abs=1e-4)


def test_a_cut_turns_about_its_middle_until_its_normal_points_at_the_mouse(loaded, middle):
    [cut] = loaded.ctmc_solid.cuts
    drag = turning(loaded, 0, ray(middle[0], middle[2] + 10.0))
    drag(ray(middle[0] + 10.0, middle[2] + 10.0))
    assert tuple(cut.normal) == pytest.approx((0.5**0.5, 0.0, 0.5**0.5), abs=1e-6)
    assert tuple(cut.point) == pytest.approx(tuple(middle), abs=1e-4)
    drag(ray(middle[0], middle[2] - 10.0))
    assert tuple(cut.normal) == pytest.approx((0.0, 0.0, -1.0), abs=1e-6)
    drag(ray(middle[0], middle[2]))  # In the middle there is no direction.
    assert tuple(cut.normal) == pytest.approx((0.0, 0.0, -1.0), abs=1e-6)


def test_a_drain_moves_across_the_view(loaded):
    loaded.cursor.location = (0.01, 0.02, 0.03)
    bpy.ops.ctmc.drain_add()
    [drain] = loaded.ctmc_solid.drains
    moving_drain(loaded, 0, ray(1.0, 3.0))(ray(4.0, 1.0))
    assert tuple(drain.point) == pytest.approx((4.0, 2.0, 1.0), abs=1e-4)


def test_nothing_is_told_of_an_axis_that_is_looked_along():
    assert place_on_axis(ray(0.0, 0.0), np.zeros(3), np.array(FORWARD)) is None
    slanted = np.array([0.6, 0.0, 0.8])
    assert place_on_axis(ray(3.0, 4.0), np.zeros(3), slanted) == pytest.approx(0.05)


def test_without_a_mouse_nothing_is_dragged(loaded, middle):
    before = tuple(loaded.ctmc_solid.cuts[0].point)
    assert bpy.ops.ctmc.solid_drag(what="MOVE", index=0) == {"CANCELLED"}
    assert tuple(loaded.ctmc_solid.cuts[0].point) == before
    assert middle.shape == (3,)
