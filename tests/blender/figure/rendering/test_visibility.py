# SPDX-License-Identifier: GPL-3.0-or-later
"""What hides what from the camera, on scenes whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest

from ctmc_addon.blender.figure.rendering.visibility import HIDES, depth_maps, hiding


def square(side, depth, at=(0.0, 0.0)):
    """A square facing the camera, as (right, up, backward) and triangles."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float) * side + [*at, depth]
    return corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32)


def test_a_map_has_the_area_and_the_depth_of_what_is_seen():
    maps = depth_maps([square(10.0, 3.0), square(5.0, 7.0, (2.0, 2.0))])
    areas = [float(np.isfinite(depth).sum()) * maps.cell**2 for depth in maps.depths]
    assert areas == pytest.approx([100.0, 25.0], rel=0.03)
    assert [set(depth[np.isfinite(depth)].tolist()) for depth in maps.depths] == [{3.0}, {7.0}]


@pytest.mark.parametrize("covered", [0.1, 0.5, 0.9])
def test_the_hidden_share_is_that_of_the_area_behind(covered):
    maps = depth_maps([square(10.0, 0.0), square(10.0, 5.0, (10.0 * (1 - covered), 0.0))])
    assert maps.hidden_share(0, by=1) == pytest.approx(covered, abs=0.02)
    assert maps.hidden_share(1, by=0) == 0.0


def test_what_hides_more_than_a_quarter_of_a_tumor_gives_way_and_what_stands_beside_or_behind_it_does_not():
    tumor = square(10.0, 0.0)
    before, little, behind = square(10.0, 5.0), square(10.0, 5.0, (10 - 10 * HIDES * 0.8, 0.0)), square(30.0, -5.0)
    maps = depth_maps([tumor, before, little, behind])
    assert hiding(maps, [True, False, False, False]) == [False, True, False, False]


def test_no_tumor_gives_way_to_another_and_a_wall_in_the_same_place_hides_nothing():
    maps = depth_maps([square(10.0, 0.0), square(10.0, 5.0), square(10.0, 5.0)])
    assert hiding(maps, [True, True, False]) == [False, False, True]
    assert hiding(depth_maps([square(10.0, 0.0), square(10.0, 0.0)]), [True, False]) == [False, False]


def test_without_a_tumor_only_what_hides_all_the_others_gives_way():
    outer, first, second = square(10.0, 5.0), square(2.0, 0.0, (1.0, 1.0)), square(2.0, 0.0, (6.0, 6.0))
    assert hiding(depth_maps([outer, first, second]), [False] * 3) == [True, False, False]
    assert hiding(depth_maps([outer, first, square(2.0, 0.0, (9.0, 9.0))]), [False] * 3) == [False, False, False]
    assert hiding(depth_maps([outer]), [False]) == [False]
