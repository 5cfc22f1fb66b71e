# SPDX-License-Identifier: GPL-3.0-or-later
"""Contours that do not lie on the slices of the CT: what is between them is filled, gaps stay, and notes say so."""

from __future__ import annotations

import numpy as np
import pytest
from volumes import label_mask

from ctmc_addon.readers import read_volume

CLOSED = "CLOSED_PLANAR"
ROW_MM, COLUMN_MM = 0.8, 0.5  # of the CT that `save_stack` writes, from (-10, -20)
SIZE = (40, 50)


def at(columns, rows, z):
    """Positions in mm of pixels at a height."""
    return np.stack([-10 + COLUMN_MM * columns, -20 + ROW_MM * rows, np.full(len(columns), float(z))], axis=1)


def box(z, left=4, top=4, width=12, height=12):
    """A contour around 12 x 12 = 144 pixels."""
    x, y = left - 0.5, top - 0.5
    return CLOSED, at(np.array([x, x + width, x + width, x]), np.array([y, y, y + height, y + height]), z)


def circle(radius_mm, z):
    turn = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    return CLOSED, at(24.3 + radius_mm / COLUMN_MM * np.cos(turn), 19.8 + radius_mm / ROW_MM * np.sin(turn), z)


def disc(radius_mm):
    """The pixels of a circle."""
    y, x = np.mgrid[: SIZE[0], : SIZE[1]]
    return np.hypot((x - 24.3) * COLUMN_MM, (y - 19.8) * ROW_MM) <= radius_mm


def counts(volume, label=1):
    return label_mask(volume, label).sum(axis=(1, 2)).tolist()


@pytest.fixture
def read(tmp_path, save_stack, save_structures):
    """Read contours by structure beside a CT with slices at these heights."""

    def read_contours(slices, **structures):
        save_stack(tmp_path / "ct", slices, SIZE)
        save_structures(tmp_path / "rs.dcm", structures)
        return read_volume(tmp_path / "rs.dcm")

    return read_contours


@pytest.mark.parametrize(
    ("slices", "heights", "first", "last", "between"),
    [
        pytest.param(np.arange(12) * 2.0, np.arange(6) * 3.0 + 2, 1, 8, 5, id="3 on 2"),
        pytest.param(np.arange(16) * 2.0, np.arange(6) * 5.0, 0, 12, 10, id="5 on 2"),
        pytest.param(np.arange(14) * 1.0, np.arange(5) * 2.5, 0, 10, 8, id="2.5 on 1"),
        pytest.param(np.arange(9) * 2.0, np.arange(6) * 2.0 + 3, 2, 6, 5, id="half a slice off"),
        pytest.param(np.arange(9) * 2.0, np.arange(6) * 2.0 + 3.0004, 2, 6, 5, id="half a slice and a rounding off"),
        pytest.param(np.arange(9) * 2.0, np.arange(6) * 2.0 + 2.9996, 2, 6, 5, id="half a slice less a rounding off"),
        pytest.param(np.arange(9) * 2.0, np.arange(6) * 2.0 + 2.4, 1, 6, 5, id="a fifth of a slice off"),
        pytest.param(np.arange(9) * 2.0, np.arange(12) * 1.0 + 2, 1, 6, 0, id="1 on 2"),
        pytest.param(np.arange(8) * 3.0, np.arange(14) * 1.25 + 2, 1, 6, 2, id="1.25 on 3"),
        pytest.param(np.arange(9) * 1.0, np.arange(6) * 1.0 + 2, 2, 7, 0, id="1 on 1"),
    ],
)
def test_a_box_has_its_pixels_on_every_slice_from_the_first_contour_to_the_last(
    read, slices, heights, first, last, between
):
    volume = read(slices, box=[box(z) for z in np.random.default_rng(3).permutation(heights)])
    expected = [144 if first <= number <= last else 0 for number in range(len(slices))]
    assert counts(volume) == expected
    mm, apart = slices[1] - slices[0], heights[1] - heights[0]
    noted = [note for note in volume.notes if "filled by distance" in note]
    assert noted == [
        f"contours lie {apart:.3g} mm apart and slices {mm:.3g} mm; slices between contours were filled by distance: "
        f"box {between}"
    ] * bool(between)


@pytest.mark.parametrize(("apart", "offset"), [(3.0, 0.0), (5.0, 0.0), (2.0, 1.0), (2.5, 0.3), (2.0, 0.0), (1.0, 0.0)])
def test_the_slices_of_a_cone_have_its_radius_there(read, apart, offset):
    heights = np.arange(offset, 20.01, apart)
    volume = read(np.arange(11) * 2.0, cone=[circle(3 + 0.31 * z, z) for z in heights])
    for number, plane in enumerate(label_mask(volume, 1)):
        z = 2.0 * number
        if heights[0] <= z <= heights[-1]:
            assert np.count_nonzero(plane ^ disc(3 + 0.31 * z)) <= 2


def test_the_slices_of_a_ball_lie_between_it_and_the_cones_through_its_contours(read):
    radius = lambda z: np.sqrt(np.maximum(0.0, 81 - np.square(z)))  # noqa: E731
    heights = np.arange(-8.0, 8.01, 2.0)
    volume = read(np.arange(-8, 9) * 1.0, ball=[circle(radius(z), z) for z in heights])
    for number, plane in enumerate(label_mask(volume, 1)):
        z = number - 8.0
        chord = np.interp(z, heights, radius(heights))
        assert np.count_nonzero(plane ^ disc(chord)) <= 2
        assert abs(int(plane.sum()) - np.pi * radius(z) ** 2 / (ROW_MM * COLUMN_MM)) < (12 if abs(z) < 6 else 45)


def test_a_gap_far_wider_than_the_usual_distance_stays_and_is_said(read):
    heights = [0, 3, 6, 9, 21, 24, 27]
    volume = read(np.arange(15) * 2.0, two=[box(z) for z in heights])
    assert counts(volume) == [144] * 5 + [0] * 6 + [144] * 3 + [0]
    assert "gaps between contours far wider than the usual distance stay empty: two 12 mm" in volume.notes


@pytest.mark.parametrize(
    ("drawn", "apart"),
    [("#..#.#####..#..#", 3), (".###.###", 2), ("###..###", 3), ("#.#########.##..#", 2), ("#..........#", 11)],
)
def test_skipped_slices_are_filled_beside_contours_on_every_slice(read, drawn, apart):
    heights = [float(z) for z, mark in enumerate(drawn) if mark == "#"]
    volume = read(np.arange(len(drawn) + 1), body=[box(z) for z in heights], other=[box(2, left=24), box(3, left=24)])
    first = int(heights[0])
    assert counts(volume) == [0] * first + [144] * (len(drawn) - first) + [0]
    assert volume.notes == (
        f"contours lie {apart} mm apart and slices 1 mm; slices between contours were filled by distance: "
        f"body {drawn[first:].count('.')}",
    )


@pytest.mark.parametrize("skipped", [5, 8, 12])
def test_a_gap_beside_contours_on_every_slice_stays_empty_and_is_said(read, skipped):
    heights = [1, 2, 3, 4, *range(5 + skipped, 9 + skipped)]
    volume = read(np.arange(10 + skipped), body=[box(z) for z in heights])
    assert counts(volume) == [0] + [144] * 4 + [0] * skipped + [144] * 4 + [0]
    assert volume.notes == (
        f"gaps between contours far wider than the usual distance stay empty: body {skipped + 1} mm",
    )


def test_slices_between_two_contours_are_filled_whatever_other_structures_have(read):
    alone = read(np.arange(12) * 2.0, nodes=[box(2), box(14)])
    assert counts(alone) == [0] + [144] * 7 + [0] * 4
    body = [box(z, left=24) for z in range(0, 22, 2)]
    beside = read(np.arange(12) * 2.0, body=body, nodes=[box(2), box(14)])
    assert counts(beside, 2) == counts(alone)
    assert beside.notes == tuple(alone.notes)


def test_contours_on_every_other_slice_change_evenly_between(read):
    volume = read(np.arange(6) * 2.0, r=[box(z, left=1, width=9 + z, height=9) for z in (0, 4, 8)])
    assert [int(plane[8].sum()) for plane in volume.values] == [9, 11, 13, 15, 17, 0]


@pytest.mark.parametrize("rounding", [0.004, -0.004, 0.05, -0.15])
def test_contours_a_rounding_beside_the_slices_are_drawn_on_them(read, rounding):
    heights = np.arange(2, 13, 2.0)
    exact = read(np.arange(8) * 2.0, cone=[circle(3 + z / 2, z) for z in heights])
    volume = read(np.arange(8) * 2.0, cone=[circle(3 + z / 2, z + rounding) for z in heights])
    np.testing.assert_array_equal(volume.values, exact.values)
    assert volume.notes == exact.notes == ()


def test_a_contour_alone_is_on_the_slice_nearest_to_it(read):
    volume = read(np.arange(6) * 2.0, low=[box(2.9)], half=[box(5.0, left=24)], high=[box(7.2, top=20)])
    assert [counts(volume, label).index(144) for label in (1, 2, 3)] == [1, 2, 4]
    assert [sum(counts(volume, label)) for label in (1, 2, 3)] == [144] * 3


def test_contours_beyond_the_ct_count_for_the_slices_inside(read):
    volume = read(np.arange(5) * 2.0, cone=[circle(4 + z / 4, z) for z in (-7, -2, 3, 8, 13, 18)])
    for number, plane in enumerate(label_mask(volume, 1)):
        assert np.count_nonzero(plane ^ disc(4 + number / 2)) <= 1
    assert "contours above or below all slices: 3 left out (cone 3)" in volume.notes


def test_a_hole_between_planes_is_a_hole(read):
    ring = [contour for z in (0, 5, 10, 15) for contour in (box(z), box(z, 8, 8, 4, 4))]
    volume = read(np.arange(8) * 2.0, ring=ring)
    assert counts(volume) == [144 - 16] * 8
    keyhole = []
    for z in (0, 5, 10, 15):
        outer, inner = box(z)[1], box(z, 8, 8, 4, 4)[1]
        keyhole.append((CLOSED, np.concatenate([outer, outer[:1], inner[:1], inner[::-1], outer[:1]])))
    again = read(np.arange(8) * 2.0, ring=keyhole)
    np.testing.assert_array_equal(again.values, volume.values)


def test_a_hole_a_rounding_beside_the_plane_of_its_contour_is_a_hole(read):
    ring = [contour for z in (2, 4, 6) for contour in (box(z), box(z + 0.05, 8, 8, 4, 4))]
    volume = read(np.arange(6) * 2.0, ring=ring)
    assert counts(volume) == [0, 128, 128, 128, 0, 0]
    assert volume.notes == ()


def test_contours_that_overlap_in_part_are_united_on_slices_and_between(read):
    pairs = [contour for z in (0, 3, 6, 9) for contour in (box(z), box(z, left=10))]
    volume = read(np.arange(6) * 2.0, box=pairs, other=[box(z, top=22) for z in (0, 3, 6, 9)])
    assert counts(volume) == [18 * 12] * 5 + [0]
    assert "partly overlapping contours were united (planes: box 4)" in volume.notes


def test_contours_by_exclusive_or_leave_their_overlap_out(read):
    pairs = [("CLOSEDPLANAR_XOR", box(4)[1]), ("CLOSEDPLANAR_XOR", box(4, left=10)[1])]
    volume = read(np.arange(6) * 2.0, box=pairs)
    assert counts(volume) == [0, 0, 144, 0, 0, 0]
    assert volume.notes == ()


def test_bodies_that_lie_beside_each_other_leave_slices_between_empty_and_it_is_said(read):
    volume = read(np.arange(8) * 1.0, r=[box(1), box(5, left=30)])
    assert counts(volume) == [0, 144, 0, 0, 0, 144, 0, 0]
    assert "slices between contours that do not overlap are empty: r 3" in volume.notes


def test_a_tip_smaller_than_a_pixel_ends_a_cone(read):
    volume = read(np.arange(8) * 1.0, cone=[circle(radius, z) for radius, z in ((0.05, 0), (4.05, 5))])
    for number, plane in enumerate(label_mask(volume, 1)[:6]):
        assert np.count_nonzero(plane ^ disc(0.05 + 0.8 * number)) <= 2


def test_contours_are_filled_on_an_oblique_ct(tmp_path, save_stack, save_structures):
    turn = np.deg2rad(25)
    row = np.array([np.cos(turn), np.sin(turn), 0.0])
    column = np.array([0.0, 0.0, -1.0])
    normal = np.cross(row, column)
    origin = np.array([-10.0, -20.0, 30.0])
    for number in range(9):
        position = origin + 2.0 * number * normal
        save_stack(
            tmp_path / "ct" / f"{number}",
            [0],
            SIZE,
            ImagePositionPatient=position.tolist(),
            ImageOrientationPatient=[*row, *column],
        )

    def contour(z):
        corners = ((3.5, 3.5), (15.5, 3.5), (15.5, 15.5), (3.5, 15.5))
        return CLOSED, [origin + COLUMN_MM * x * row + ROW_MM * y * column + z * normal for x, y in corners]

    save_structures(tmp_path / "rs.dcm", {"box": [contour(z) for z in (0, 3, 6, 9, 12)]})
    volume = read_volume(tmp_path / "rs.dcm")
    assert counts(volume) == [144] * 7 + [0, 0]
    assert volume.values[3, 4:16, 4:16].all()


def test_a_body_along_a_tilted_stack_keeps_its_pixels_between(tmp_path, save_stack, save_structures):
    """Slices 2 mm apart that move by 0.8 mm along the rows; contours that move as much, 3 mm apart."""
    for number in range(7):
        save_stack(
            tmp_path / "ct" / f"{number}", [0], SIZE, ImagePositionPatient=[-10, -20 + 0.8 * number, 2.0 * number]
        )
    contours = [(CLOSED, box(z)[1] + np.array([0, 0.4 * z, 0])) for z in (0, 3, 6, 9, 12)]
    save_structures(tmp_path / "rs.dcm", {"box": contours})
    volume = read_volume(tmp_path / "rs.dcm")
    assert counts(volume) == [144] * 7
    assert volume.values[:, 4:16, 4:16].all()


def test_a_ct_without_one_of_its_slices_takes_the_contour_there(read):
    volume = read([0.0, 2.0, 4.0, 8.0, 10.0, 12.0], cone=[circle(3 + z / 4, z) for z in (2, 4, 6, 8, 10)])
    assert volume.values.shape[0] == 7
    for number, plane in enumerate(label_mask(volume, 1)):
        expected = disc(3 + number / 2) if 1 <= number <= 5 else np.zeros(SIZE, bool)
        np.testing.assert_array_equal(plane, expected)
