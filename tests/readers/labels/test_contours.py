# SPDX-License-Identifier: GPL-3.0-or-later
"""Filled contours against the slow rule: pixel by pixel, edge by edge."""

from __future__ import annotations

import numpy as np
import pytest

from ctmc_addon.core import finish
from ctmc_addon.readers.labels.contours import edges_of, filled_steps


def filled(contours, shape):
    edges = edges_of([np.asarray(corners, np.float64) for corners in contours], shape[0])
    top, left, mask = finish(filled_steps(edges, shape[1]))
    picture = np.zeros(shape, bool)
    picture[top : top + mask.shape[0], left : left + mask.shape[1]] = mask
    return picture


def by_pixel(contours, shape):
    """Odd crossings to the left of a pixel, or a place on an edge; and its distance to the nearest edge."""
    picture = np.zeros(shape, bool)
    distance = np.full(shape, np.inf)
    for row in range(shape[0]):
        for column in range(shape[1]):
            crossings = 0
            for corners in contours:
                for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
                    length = (x1 - x0) ** 2 + (y1 - y0) ** 2
                    share = ((column - x0) * (x1 - x0) + (row - y0) * (y1 - y0)) / length if length else 0.0
                    share = min(1.0, max(0.0, share))
                    way = np.hypot(x0 + share * (x1 - x0) - column, y0 + share * (y1 - y0) - row)
                    distance[row, column] = min(distance[row, column], way)
                    if (y0 <= row) != (y1 <= row):
                        crossings += x0 + (row - y0) / (y1 - y0) * (x1 - x0) < column
            picture[row, column] = distance[row, column] < 1e-9 or crossings % 2
    return picture, distance


@pytest.mark.parametrize("whole", [False, True])
def test_random_contours_are_filled_as_pixel_by_pixel(whole):
    random = np.random.default_rng(4)
    for _ in range(60):
        shape = tuple(random.integers(2, 12, 2).tolist())
        contours = [random.uniform(-4, 14, (random.integers(3, 8), 2)) for _ in range(random.integers(1, 4))]
        contours = [np.rint(corners) if whole else corners for corners in contours]
        picture, distance = by_pixel(contours, shape)
        different = filled(contours, shape) != picture
        assert not different[(distance < 1e-9) | (distance > 2e-3)].any()


def test_a_ring_by_keyhole_is_a_ring_by_two_contours():
    outer, inner = (
        [[1.5, 1.5], [17.5, 1.5], [17.5, 17.5], [1.5, 17.5]],
        [[5.5, 5.5], [12.5, 5.5], [12.5, 12.5], [5.5, 12.5]],
    )
    keyhole = [*outer, outer[0], inner[0], *inner[::-1], outer[0]]
    ring = filled([outer, inner], (20, 20))
    assert ring.sum() == 16 * 16 - 7 * 7
    np.testing.assert_array_equal(filled([keyhole], (20, 20)), ring)


def test_a_contour_through_the_outermost_pixels_of_a_mask_gives_the_mask():
    mask = np.zeros((12, 15), bool)
    mask[3:9, 4:11] = True
    np.testing.assert_array_equal(filled([[[4, 3], [10, 3], [10, 8], [4, 8]]], mask.shape), mask)


def test_a_circle_has_its_area():
    turn = np.linspace(0, 2 * np.pi, 2000, endpoint=False)
    circle = np.stack([256.3 + 200 * np.cos(turn), 255.7 + 200 * np.sin(turn)], axis=1)
    assert filled([circle], (512, 512)).sum() == pytest.approx(np.pi * 200**2, rel=1e-3)


@pytest.mark.parametrize("offset", [1e4, -1e4, 1e300, -1e300])
def test_contours_outside_the_picture_fill_nothing(offset):
    corners = np.array([[0.0, 0.0], [5, 0], [5, 5]])
    for shift in ((offset, 0), (0, offset), (offset, offset)):
        assert not filled([corners + shift], (9, 9)).any()


def test_a_contour_around_the_picture_fills_it():
    assert filled([np.array([[-1e300, -1e300], [1e300, -1e300], [1e300, 1e300], [-1e300, 1e300]])], (9, 9)).all()


def test_a_million_points_are_worked_on_piece_by_piece():
    turn = np.linspace(0, 200 * np.pi, 1_000_001)
    spiral = np.stack([50 + 40 * np.cos(turn), 50 + 40 * np.sin(turn)], axis=1)
    assert sum(1 for _ in filled_steps(edges_of([spiral], 101), 101)) >= 1
