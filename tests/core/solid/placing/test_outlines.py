# SPDX-License-Identifier: GPL-3.0-or-later
"""Planes of cuts: a rectangle that covers the box, positions along the normal."""

from __future__ import annotations

import numpy as np
import pytest

from ctmc_addon.core.solid import Cut, moved_to, position_of, rectangle_of

BOX = np.array([[x, y, z] for z in (0.0, 8.0) for y in (-2.0, 4.0) for x in (0.0, 5.0)])
NORMALS = [(0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, -3.0, 0.0), (1.0, 2.0, -0.5), (-0.2, 0.1, 0.1)]


@pytest.mark.parametrize("normal", NORMALS)
def test_a_rectangle_lies_in_the_plane_and_covers_the_box_seen_along_the_normal(normal):
    cut = Cut((1.0, 1.0, 2.0), normal)
    corners = rectangle_of(cut, BOX)
    unit = np.array(normal) / np.linalg.norm(normal)
    assert (corners - cut.point) @ unit == pytest.approx(np.zeros(4), abs=1e-12)
    across, up = corners[1] - corners[0], corners[3] - corners[0]
    assert across @ up == pytest.approx(0.0, abs=1e-9)
    assert corners[2] == pytest.approx(corners[0] + across + up)
    for side in (across, up):
        shares = (BOX - corners[0]) @ side / (side @ side)
        assert (shares.min(), shares.max()) == pytest.approx((0.0, 1.0), abs=1e-12)


@pytest.mark.parametrize("normal", NORMALS)
def test_a_cut_moves_along_its_normal_alone(normal):
    cut = Cut((1.0, 1.0, 2.0), normal)
    moved = moved_to(cut, position_of(cut) + 3.0)
    assert position_of(moved) == pytest.approx(position_of(cut) + 3.0)
    assert np.subtract(moved.point, cut.point) == pytest.approx(3 * np.array(normal) / np.linalg.norm(normal))
    assert moved.normal == cut.normal
