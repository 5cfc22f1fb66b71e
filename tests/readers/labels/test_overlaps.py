# SPDX-License-Identifier: GPL-3.0-or-later
"""Contours of one structure in one plane: holes, unions, and which of the two."""

from __future__ import annotations

import numpy as np
import pytest

from ctmc_addon.core import ReadError, finish
from ctmc_addon.readers.labels import overlaps
from ctmc_addon.readers.labels.contours import edges_of, filled_steps
from ctmc_addon.readers.labels.overlaps import united_steps


def square(left, top, right, bottom):
    """Edges at halves: pixels from one column and row to another."""
    corners = [(left, top), (right + 1, top), (right + 1, bottom + 1), (left, bottom + 1)]
    return np.array(corners, np.float64) - 0.5


def filled(contours, shape=(40, 40)):
    (top, left, mask), changed = finish(united_steps(contours, *shape, "rs.dcm"))
    picture = np.zeros(shape, bool)
    picture[top : top + mask.shape[0], left : left + mask.shape[1]] = mask
    return picture, changed


OUTER = square(2, 2, 21, 21)  # 400 pixels


@pytest.mark.parametrize(
    ("contours", "pixels", "changed"),
    [
        ([OUTER], 400, False),
        ([OUTER, square(6, 6, 15, 15)], 300, False),  # a hole
        ([OUTER, square(6, 6, 15, 15), square(8, 8, 11, 11)], 316, False),  # with an island
        ([OUTER, square(24, 2, 29, 7)], 436, False),  # beside each other
        ([OUTER, square(22, 2, 31, 11)], 500, False),  # sharing a side
        ([OUTER, square(12, 2, 31, 21)], 600, True),  # half of each
        ([OUTER, square(12, 12, 31, 31), square(22, 22, 36, 36)], 400 + 300 + 125, True),  # a chain
        ([OUTER, square(12, 2, 31, 21), square(14, 4, 18, 8)], 575, True),  # a hole in the overlap
        ([OUTER, square(12, 2, 31, 21), square(4, 4, 8, 8)], 575, True),  # a hole in one of two
        ([OUTER, square(20, 20, 29, 29)], 496, True),  # a corner
        ([OUTER, square(2, 2, 20, 20)], 39, False),  # a hole that leaves an angle
    ],
)
def test_nested_contours_are_holes_and_others_are_united(contours, pixels, changed):
    for order in (contours, contours[::-1]):
        picture, united = filled(order)
        assert (int(picture.sum()), united) == (pixels, changed)


def test_a_hole_that_sticks_out_by_a_sliver_is_a_hole():
    hole = square(2, 6, 31, 15)
    hole[[0, 3], 0] -= 0.6  # one column of pixels, of 31
    picture, united = filled([square(2, 2, 36, 36), hole], (40, 40))
    assert not united
    assert not picture[6:16, 2:32].any()


def test_a_contour_drawn_again_by_hand_is_united():
    again = square(3, 3, 22, 22)
    picture, united = filled([OUTER, again])
    assert (int(picture.sum()), united) == (400 + 39, True)


@pytest.mark.parametrize("seed", range(6))
def test_nested_and_separate_contours_are_filled_bit_by_bit_as_by_the_even_odd_rule(seed):
    random = np.random.default_rng(seed)
    contours = []
    for column in (10.2, 29.7):
        turn = np.linspace(0, 2 * np.pi, 40, endpoint=False)
        for radius in np.sort(random.uniform(1.5, 9.0, 3)):
            contours.append(np.stack([column + radius * np.cos(turn), 20.1 + 2 * radius * np.sin(turn)], axis=1))
    picture, united = filled(contours)
    top, left, mask = finish(filled_steps(edges_of(contours, 40), 40))
    np.testing.assert_array_equal(picture[top : top + mask.shape[0], left : left + mask.shape[1]], mask)
    assert (picture.sum(), united) == (mask.sum(), False)


def test_contours_beside_the_picture_fill_nothing():
    picture, united = filled([OUTER + 1000, OUTER + 1005, OUTER - 1000, square(-30, -30, -5, -5)])
    assert not picture.any()
    assert not united


def test_more_overlaps_than_a_drawing_has_are_refused_in_a_sentence(monkeypatch):
    monkeypatch.setattr(overlaps, "MOST_COMPARED", 1000)
    with pytest.raises(ReadError) as refused:
        filled([square(column, 0, column + 30, 30) for column in range(6)])
    assert str(refused.value) == (
        "contours of rs.dcm overlap each other in one plane on more than 1000 pixels, too many for drawn contours; "
        "export it again"
    )
