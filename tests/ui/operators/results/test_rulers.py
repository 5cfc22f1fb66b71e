# SPDX-License-Identifier: GPL-3.0-or-later
"""The operators `ctmc.measure_distance` and `ctmc.measure_angle` from a script. Clicks are tested in a window."""

import pytest

bpy = pytest.importorskip("bpy")

from ctmc_addon.blender.rulers import rulers_of, text_of


def test_points_given_in_millimeters_become_objects(scene):
    assert bpy.ops.ctmc.measure_distance(points_mm=(0, 0, 700, 3, 4, 712)) == {"FINISHED"}
    assert bpy.ops.ctmc.measure_angle(points_mm=(10, 0, 0, 0, 0, 0, 5, 5, 0)) == {"FINISHED"}
    assert [text_of(ruler) for ruler in rulers_of(scene)] == ["13.0 mm", "45.0\N{DEGREE SIGN}"]
    assert rulers_of(scene)[0].location[:] == pytest.approx((0.015, 0.02, 7.06))


def test_points_that_are_the_same_are_refused(scene):
    with pytest.raises(RuntimeError, match="Two points are the same"):
        bpy.ops.ctmc.measure_distance(points_mm=(1, 2, 3, 1, 2, 3))
    assert rulers_of(scene) == []
