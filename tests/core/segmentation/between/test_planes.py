# SPDX-License-Identifier: GPL-3.0-or-later
"""The body between two planes against closed forms, and against distances measured edge by edge."""

from __future__ import annotations

import numpy as np
import pytest

from ctmc_addon.core import finish
from ctmc_addon.core.segmentation import Outline, between_planes_steps

SIDES = [(1.0, 1.0), (0.8, 0.5)]  # between rows, between columns, mm


def disc(radius_mm, sides_mm, center=(50.3, 49.6), shape=(101, 111)):
    """A disc around a (column, row) as 300 edges."""
    rows_mm, columns_mm = sides_mm
    y, x = np.mgrid[: shape[0], : shape[1]]
    mask = np.hypot((x - center[0]) * columns_mm, (y - center[1]) * rows_mm) <= radius_mm
    turn = np.linspace(0, 2 * np.pi, 300, endpoint=False)
    corners = np.stack(
        [center[0] + radius_mm / columns_mm * np.cos(turn), center[1] + radius_mm / rows_mm * np.sin(turn)]
    )
    return Outline(mask, corners.T, np.roll(corners.T, -1, axis=0))


def box(low, high, shape=(24, 24)):
    """A square from one column and row to another; edges at halves."""
    mask = np.zeros(shape, bool)
    mask[low : high + 1, low : high + 1] = True
    first, last = low - 0.5, high + 0.5
    corners = np.array([[first, first], [last, first], [last, last], [first, last]])
    return Outline(mask, corners, np.roll(corners, -1, axis=0))


def ring(outer, inner):
    return Outline(outer.mask & ~inner.mask, *(np.concatenate(pair) for pair in zip(outer[1:], inner[1:], strict=True)))


def bodies(below, above, shares, sides_mm=(1.0, 1.0)):
    between = finish(between_planes_steps(below, above, sides_mm))
    return [between.at(share) for share in shares]


@pytest.mark.parametrize("sides_mm", SIDES)
@pytest.mark.parametrize(("first", "last"), [(10, 10.5), (10, 13), (3, 18), (20, 15)])
def test_a_cone_has_its_radius_at_every_height(first, last, sides_mm):
    shares = (0.2, 1 / 3, 0.5, 0.8)
    for share, body in zip(shares, bodies(disc(first, sides_mm), disc(last, sides_mm), shares, sides_mm), strict=True):
        expected = disc(first + share * (last - first), sides_mm).mask
        assert np.count_nonzero(body ^ expected) <= 1


def test_a_body_that_does_not_change_is_the_same_between():
    for body in bodies(box(5, 16), box(5, 16), (0.1, 0.5, 0.9)):
        np.testing.assert_array_equal(body, box(5, 16).mask)


def test_a_square_that_moves_by_four_moves_by_one_in_a_quarter():
    below, above = box(5, 16), box(5, 16)
    moved = np.array([4, 0])
    above = Outline(np.roll(above.mask, 4, axis=1), above.start + moved, above.end + moved)
    for step, body in enumerate(bodies(below, above, (0.25, 0.5, 0.75)), 1):
        # The corners of a moved square are cut off by less than the step; its middle rows are exact.
        np.testing.assert_array_equal(body[8:14], np.roll(below.mask, step, axis=1)[8:14])


def test_a_hole_goes_on_between():
    wide, narrow = ring(box(2, 21), box(6, 17)), ring(box(2, 21), box(10, 13))
    (body,) = bodies(wide, narrow, (0.5,))
    hole = box(2, 21).mask & ~body
    np.testing.assert_array_equal(hole[8:16, 12], True)
    assert 6 * 6 < hole.sum() <= 8 * 8


def test_edges_within_a_body_do_not_count():
    below, above = box(5, 16), box(2, 19)
    plain = bodies(below, above, (0.5,))[0]
    keyhole = np.array([[4.5, 10.3], [14.5, 10.3]])
    cut = below._replace(start=np.vstack([below.start, keyhole]), end=np.vstack([below.end, keyhole[::-1]]))
    np.testing.assert_array_equal(bodies(cut, above, (0.5,))[0], plain)
    cut = above._replace(start=np.vstack([above.start, [[1.5, 10.0]]]), end=np.vstack([above.end, [[19.5, 10.0]]]))
    np.testing.assert_array_equal(bodies(below, cut, (0.5,))[0], plain)


def test_planes_may_be_exchanged():
    random = np.random.default_rng(2)
    for _ in range(5):
        pair = [
            disc(radius, (0.8, 0.5), center)
            for radius, center in zip((9, 14), random.uniform(45, 55, (2, 2)), strict=True)
        ]
        for share in (0.25, 0.5):
            np.testing.assert_array_equal(
                bodies(*pair, (share,), (0.8, 0.5))[0], bodies(*pair[::-1], (1 - share,), (0.8, 0.5))[0]
            )


def test_bodies_beside_each_other_leave_the_middle_empty():
    left, right = box(2, 5), box(16, 19)
    assert not bodies(left, right, (0.5,))[0].any()


def test_distances_are_those_to_the_nearest_edge():
    """Every sample against every edge: a triangle that grows and turns."""
    random = np.random.default_rng(7)
    y, x = np.mgrid[:40, :40]

    def triangle():
        corners = random.uniform(2, 37, (3, 2))
        turns = [
            (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])
            for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)
        ]
        mask = np.minimum.reduce(turns) >= 0
        mask |= np.maximum.reduce(turns) <= 0
        return Outline(mask, corners, np.roll(corners, -1, axis=0))

    def signed(outline):
        nearest = np.full(x.shape, np.inf)
        for a, b in zip(outline.start, outline.end, strict=True):
            along = (b - a) * (0.5, 0.8)
            at = np.stack([(x - a[0]) * 0.5, (y - a[1]) * 0.8], axis=-1)
            share = np.clip((at * along).sum(axis=-1) / (along * along).sum(), 0, 1)
            nearest = np.minimum(nearest, np.linalg.norm(at - share[..., None] * along, axis=-1))
        return np.where(outline.mask, nearest, -nearest)

    compared = 0
    for _ in range(60):
        below, above = triangle(), triangle()
        if min(below.mask.sum(), above.mask.sum()) < 60:
            continue
        (body,) = bodies(below, above, (0.4,), (0.8, 0.5))
        mm = 0.6 * signed(below) + 0.4 * signed(above)
        sure = np.abs(mm) > 0.25  # A corner that holds no sample is known by its samples alone.
        np.testing.assert_array_equal(body[sure], (mm > 0)[sure])
        compared += 1
    assert compared >= 8
