# SPDX-License-Identifier: GPL-3.0-or-later
"""Wires of round shapes: every point lies on the shape, and the lines close its circles."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

pytest.importorskip("bpy")

from ctmc_addon.blender.viewport import ball, cylinder


@pytest.mark.parametrize("end", [(1.0, 2.0, 9.0), (4.0, -1.0, 3.5), (1.0, 8.0, 3.0)])
def test_a_cylinder_has_two_circles_around_its_axis(end):
    start = np.array((1.0, 2.0, 3.0))
    points, pairs = cylinder(start, end, 2.5)
    axis = np.subtract(end, start)
    along = (points - start) @ axis / (axis @ axis)
    assert along == pytest.approx([0.0] * 24 + [1.0] * 24, abs=1e-12)
    off = points - start - along[:, None] * axis
    assert np.linalg.norm(off, axis=1) == pytest.approx(2.5)
    assert sum(one < 24 <= other for one, other in pairs) == 4
    circles = Counter(point for pair in pairs if (pair[0] < 24) == (pair[1] < 24) for point in pair)
    assert circles == dict.fromkeys(range(48), 2)


def test_a_ball_has_three_circles_across_the_axes():
    points, pairs = ball((1.0, 2.0, 3.0), 4.0)
    off = (points - (1.0, 2.0, 3.0)).reshape(3, 24, 3)
    assert np.linalg.norm(off, axis=2) == pytest.approx(4.0)
    flat = [np.flatnonzero(np.ptp(circle, axis=0) < 1e-12).tolist() for circle in off]
    assert sorted(flat) == [[0], [1], [2]]
    assert Counter(point for pair in pairs for point in pair) == dict.fromkeys(range(72), 2)
