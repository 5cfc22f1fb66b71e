# SPDX-License-Identifier: GPL-3.0-or-later
"""Air around the body in a slice, against the slow and obvious way, and a chest on a table."""

from __future__ import annotations

import numpy as np
import pytest

from ctmc_addon.core.volume import outside_air


def walked(values):
    """The same, one sample after the other."""
    rows, columns = values.shape
    border = [(r, c) for r in range(rows) for c in range(columns) if r in (0, rows - 1) or c in (0, columns - 1)]
    found, front = set(), [place for place in border if values[place] <= -800]
    while front:
        row, column = place = front.pop()
        if place in found:
            continue
        found.add(place)
        for near in ((row - 1, column), (row + 1, column), (row, column - 1), (row, column + 1)):
            if 0 <= near[0] < rows and 0 <= near[1] < columns and values[near] <= -800:
                front.append(near)
    mask = np.zeros(values.shape, bool)
    for place in found:
        mask[place] = True
    return mask


@pytest.mark.parametrize("seed", range(5))
def test_it_is_what_a_walk_from_the_border_reaches(seed):
    values = np.where(np.random.default_rng(seed).random((23, 31)) < 0.62, -1000, 40)
    np.testing.assert_array_equal(outside_air(values), walked(values))


@pytest.mark.parametrize("turned", [False, True])
def test_a_lung_cut_off_at_the_upper_end_is_inside_and_the_gap_to_the_table_outside(turned):
    values = np.full((40, 30), -1000)  # rows run from the head to the feet
    values[:, 3], values[:, 8:25] = 0, 40  # table, body
    values[:15, 12:18] = -850  # lung
    expected = np.ones((40, 30), bool)
    expected[:, 3] = expected[:, 8:25] = False
    found = outside_air(values.T, 1).T if turned else outside_air(values, 0)
    np.testing.assert_array_equal(found, expected)


def test_what_is_no_number_around_the_body_is_outside():
    body = np.full((4, 4), np.nan)
    body[1:3, 1:3] = -1000
    body[2, 2] = 40
    assert outside_air(body).sum() == 15
