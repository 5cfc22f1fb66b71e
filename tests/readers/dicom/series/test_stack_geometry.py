# SPDX-License-Identifier: GPL-3.0-or-later
"""Order, gaps and tilt of slices, from positions alone."""

from __future__ import annotations

import numpy as np
import pytest

from ctmc_addon.core import CtmcError
from ctmc_addon.core.volume.affine import determinant
from ctmc_addon.readers.dicom.series.stack_geometry import named_gaps, stack_up

AXIAL = (1, 0, 0, 0, 1, 0)
SAGITTAL = (0, 1, 0, 0, 0, -1)


def along_z(*heights, x=0.0, y=0.0):
    return np.array([(x, y, z) for z in heights], float)


def stacked(positions, orientation=AXIAL, spacing=(0.8, 0.5), strict=False):
    return stack_up(positions, orientation, spacing, [f"s{n}" for n in range(len(positions))], strict)


@pytest.mark.parametrize("heights", [(0, 2.5, 5, 7.5), (7.5, 5, 2.5, 0), (5, 0, 7.5, 2.5)])
def test_slices_are_ordered_by_position_and_the_affine_is_exact(heights):
    stack = stacked(along_z(*heights, x=-100, y=30))
    assert [heights[at] for at in stack.order] == [0, 2.5, 5, 7.5]
    expected = [[-0.5, 0, 0, 100], [0, -0.8, 0, -30], [0, 0, 2.5, 0], [0, 0, 0, 1]]
    np.testing.assert_array_equal(stack.affine, expected)
    assert stack.notes == ()
    assert not stack.resampled


@pytest.mark.parametrize("orientation", [AXIAL, SAGITTAL, (-1, 0, 0, 0, 1, 0), (0.6, 0.8, 0, 0, 0, -1)])
def test_no_order_of_slices_mirrors_the_volume(orientation):
    row, column = np.array(orientation[:3]), np.array(orientation[3:])
    for steps in ([0, 1, 2], [2, 1, 0]):
        stack = stacked(np.array([np.cross(row, column) * 3 * step for step in steps]), orientation)
        assert determinant(stack.affine) == pytest.approx(0.8 * 0.5 * 3)


@pytest.mark.parametrize("degrees", [0.5, 18.5, -30])
def test_gantry_tilt_is_carried_by_the_third_column_and_said_with_its_angle(degrees):
    turn = np.radians(degrees)
    orientation = (1, 0, 0, 0, np.cos(turn), -np.sin(turn))
    positions = along_z(0, 4, 8, 12, x=5, y=-7)
    stack = stacked(positions, orientation)
    np.testing.assert_allclose(stack.affine[:3, 2], (0, 0, 4), atol=1e-12)
    assert not stack.resampled
    assert f"tilted by {abs(degrees):.1f} degrees" in stack.notes[0]
    for at, position in enumerate(positions):
        np.testing.assert_allclose((stack.affine @ (0, 0, at, 1))[:3], position * (-1, -1, 1), atol=1e-9)


def test_gaps_within_one_per_cent_of_the_median_are_even():
    stack = stacked(along_z(0, 2, 4.018, 6, 8))
    assert not stack.resampled
    assert stack.notes == ()
    assert stack.affine[2, 2] == 2.0


def test_gaps_within_a_hundredth_of_a_millimeter_are_even():
    assert not stacked(along_z(0, 0.5, 1.009, 1.5, 2)).resampled


def test_uneven_gaps_are_resampled_to_the_smallest_with_the_ends_in_place():
    heights = np.array([0, 1, 3, 5, 7, 9.0])
    stack = stacked(along_z(*heights))
    made = heights[stack.below] * (1 - stack.weight)
    made += heights[np.minimum(stack.below + 1, 5)] * stack.weight
    np.testing.assert_allclose(made, np.arange(10), atol=1e-12)
    assert stack.affine[2, 2] == 1.0
    assert "1 and 2 mm" in stack.notes[0]
    assert "6 slices were resampled linearly to 10" in stack.notes[0]


def test_resampling_is_no_finer_than_a_quarter_of_the_median():
    stack = stacked(along_z(0, 0.1, 4.1, 8.1, 12.1))
    assert stack.affine[2, 2] == pytest.approx(12.1 / 12)
    assert len(stack.below) == 13


def test_strict_refuses_unevenness_and_names_the_gaps():
    with pytest.raises(CtmcError, match=r"uneven \(1 and 2 mm\).*strict"):
        stacked(along_z(0, 1, 3, 5), strict=True)


def test_a_gap_of_exactly_three_medians_is_resampled_and_a_wider_one_refused_with_both_slices():
    assert stacked(along_z(0, 0.7, 1.4, 3.5, 4.2)).resampled
    with pytest.raises(CtmcError, match=r"gap of 2.2 mm between s2 at 1.4 mm and s3 at 3.6 mm.*median gap of 0.7"):
        stacked(along_z(0, 0.7, 1.4, 3.6, 4.3))


def test_of_slices_at_one_place_the_first_is_kept_and_it_is_said():
    stack = stacked(along_z(4, 2, 0, 2, 2.0001))
    assert stack.order == (2, 1, 0)
    assert stack.notes == ("2 slices are at the position of another; the first of each was kept",)


def test_one_slice_and_slices_at_one_place_are_refused():
    with pytest.raises(CtmcError, match=r"only one slice \(s0\), at 3 mm.*at least 2"):
        stacked(along_z(3))
    words = r"all 3 slices \(such as s0\) are at one position to within 0\.001 mm, at 3 mm.*at least 2"
    with pytest.raises(CtmcError, match=words):
        stacked(along_z(3, 3, 3))


def test_a_slice_beside_the_line_is_refused_beyond_half_a_pixel_and_said_below():
    positions = along_z(0, 1, 2, 3)
    positions[2, 0] = 0.2
    assert "0.2 mm off the line" in stacked(positions).notes[0]
    with pytest.raises(CtmcError, match=r"s2 is 0.2 mm off the line"):
        stacked(positions, strict=True)
    positions[2, 0] = 5
    with pytest.raises(CtmcError, match=r"s2 is 5 mm.*at most 0.25 mm"):
        stacked(positions)


def test_slices_that_creep_off_an_even_grid_are_even_and_it_is_said():
    gaps = np.repeat([2.015, 1.985], 40)
    stack = stacked(along_z(0, *np.cumsum(gaps)))
    assert not stack.resampled
    assert "up to 0.6 mm off an even grid" in stack.notes[0]


@pytest.mark.parametrize(
    "orientation", [(1, 0, 0, 1, 0, 0), (2, 0, 0, 0, 1, 0), (0, 0, 0, 0, 0, 0), (1, 0, 0, 0.5, 1, 0)]
)
def test_directions_that_are_no_perpendicular_units_are_refused(orientation):
    with pytest.raises(CtmcError, match="not a pair of perpendicular directions"):
        stacked(along_z(0, 1, 2), orientation)


def test_many_different_gaps_are_named_by_the_smallest_and_the_largest():
    assert named_gaps(np.arange(1, 20) / 2) == "0.5, 1, 1.5, 2, 2.5 and up to 9.5 mm"
