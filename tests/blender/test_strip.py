# SPDX-License-Identifier: GPL-3.0-or-later
"""The histogram's strip: values and pixels, against closed forms. The drawing is tested in a window."""

from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("bpy")

from ctmc_addon.blender.viewport.strip import NAMES, SIDE, Strip, bar_boxes, placed_names, rectangles, strip_in
from ctmc_addon.core.volume import tissue_bands


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


def test_every_band_has_its_name_and_no_name_or_line_crosses_another():
    bands = tissue_bands(-1024.0, 3071.0)
    for right in (260.0, 500.0, 1400.0):
        strip = Strip(0, right, -1024, 3071)
        named = [(band.low, band.high, (f"{band.name} {band.low:g}", band.name)) for band in bands]
        names = placed_names(strip, named, lambda text: 6.0 * len(text))
        assert len(names) == len(bands)
        ends = [(name.row, name.x, name.x + 6.0 * len(name.text)) for name in names]
        assert all(x >= 0 and end <= right for _, x, end in ends)
        for number, (row, x, end) in enumerate(ends):
            for other, other_x, other_end in ends[number + 1 :]:
                assert row != other or end < other_x or other_end < x
        inside = [name for name in names if name.row == 0]
        assert names[-1] in inside
        assert len(inside) < len(names)  # contrast vessels take 50 HU, which no width of a screen names


def test_the_strip_is_higher_by_the_rows_of_its_names():
    plain, two = Strip(0, 500, -1, 1, 2.0), Strip(0, 500, -1, 1, 2.0, names=2)
    assert two.top - plain.top == 2 * NAMES * 2.0
    assert two.holds(10, two.top)
    assert not plain.holds(10, two.top)
