# SPDX-License-Identifier: GPL-3.0-or-later
"""The histogram's strip: values and pixels, against closed forms. The drawing is tested in a window."""

from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("bpy")

from ctmc_addon.blender.viewport.strip import SIDE, Strip, bar_boxes, rectangles, strip_in


def region(kind, x, width, alignment="NONE"):
    return SimpleNamespace(type=kind, x=x, width=width, alignment=alignment)


@pytest.mark.parametrize("scale", [1.0, 2.0])
def test_a_pixel_and_its_value_are_each_others_inverse(scale):
    strip = Strip(100, 900, -1000, 3000, scale)
    first, last = strip.axis
    assert (first, last) == (100 + SIDE * scale, 900 - SIDE * scale)
    assert (strip.x_of(-1000), strip.x_of(3000)) == pytest.approx((first, last))
    for x in np.linspace(first, last, 7):
        assert strip.x_of(strip.value_at(x)) == pytest.approx(x)
    assert (strip.value_at(0), strip.value_at(5000)) == (-1000, 3000)
    assert (strip.x_of(-9000), strip.x_of(9000)) == pytest.approx((first, last))


def test_bars_tile_the_axis_and_stand_at_their_values():
    strip = Strip(0, 228, 0, 200)  # a pixel a value
    boxes = bar_boxes(strip, np.array([0.0, 1.0, 0.5]), 50.0, 25.0)
    assert boxes[:, 0] == pytest.approx([64, 89, 114])
    assert boxes[1:, 0] == pytest.approx(boxes[:-1, 2])
    heights = boxes[:, 3] - boxes[:, 1]
    assert heights[0] == 0
    assert heights[2] == pytest.approx(heights[1] / 2)


def test_two_triangles_cover_a_box():
    corners = rectangles(np.array([[1.0, 2.0, 4.0, 6.0]])).reshape(2, 3, 3).astype(np.float64)
    areas = [np.linalg.norm(np.cross(b - a, c - a)) / 2 for a, b, c in corners]
    assert sum(areas) == pytest.approx(12.0)
    assert corners.reshape(-1, 3).min(axis=0).tolist() == [1, 2, 0]
    assert corners.reshape(-1, 3).max(axis=0).tolist() == [4, 6, 0]


def test_the_strip_takes_what_toolbar_and_sidebar_leave_free():
    bars = [region("TOOLS", 10, 50, "LEFT"), region("UI", 700, 310, "RIGHT")]
    strip = strip_in(SimpleNamespace(regions=[region("WINDOW", 10, 1000), *bars]), 0, 1, 1.0)
    assert (strip.left, strip.right) == (58, 682)
    hidden = [region("TOOLS", 10, 1, "LEFT"), region("UI", 1009, 1, "RIGHT")]
    strip = strip_in(SimpleNamespace(regions=[region("WINDOW", 10, 1000), *hidden]), 0, 1, 1.0)
    assert (strip.left, strip.right) == (8, 992)
