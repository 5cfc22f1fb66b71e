# SPDX-License-Identifier: GPL-3.0-or-later
"""The table of 256 cases is derived from the cube; these tests prove what it must have."""

from collections import Counter
from itertools import permutations, product

import numpy as np
import pytest

from ctmc_addon.core.extraction.case_table import (
    CLASSIC,
    EDGES,
    FACES,
    FACES_OF_EDGE,
    case_triangles,
    face_segments,
    loops,
)


def corner_permutations():
    """The cube's 24 rotations as permutations of its corners."""
    for axes in permutations(range(3)):
        for flips in product((0, 1), repeat=3):
            matrix = np.zeros((3, 3), int)
            for row, (axis, flip) in enumerate(zip(axes, flips, strict=True)):
                matrix[row, axis] = 1 - 2 * flip
            if round(np.linalg.det(matrix)) == 1:
                yield [sum(((corner >> axes[row] & 1) ^ flips[row]) << row for row in range(3)) for corner in range(8)]


ROTATIONS = list(corner_permutations())


def rotated(case, rotation):
    return sum(1 << rotation[corner] for corner in range(8) if case >> corner & 1)


def test_the_cases_fall_into_the_papers_15_classes():
    assert len(ROTATIONS) == 24
    classes = {min(min(rotated(case, r), 255 - rotated(case, r)) for r in ROTATIONS) for case in range(256)}
    assert len(classes) == 15


def test_the_stored_table_is_the_derived_one():
    derived = [case_triangles(case) for case in range(256)]
    np.testing.assert_array_equal(CLASSIC.triangle_count, [len(triangles) for triangles in derived])
    np.testing.assert_array_equal(CLASSIC.triangle_edges, [edges for triangles in derived for edges in triangles])
    ends = np.cumsum(CLASSIC.triangle_count, dtype=np.intp)
    np.testing.assert_array_equal(CLASSIC.first_triangle, ends - CLASSIC.triangle_count)


def test_a_rotated_case_has_as_many_triangles():
    for case in range(256):
        assert {len(case_triangles(rotated(case, r))) for r in ROTATIONS} == {len(case_triangles(case))}


@pytest.mark.parametrize("case", range(256))
def test_every_crossed_edge_is_in_one_loop_and_no_other_edge_is(case):
    crossed = [e for e, (a, b) in enumerate(EDGES) if (case >> a ^ case >> b) & 1]
    assert sorted(edge for loop in loops(case) for edge in loop) == crossed


@pytest.mark.parametrize("axis", range(3))
def test_every_shared_face_is_cut_the_same_way_from_both_sides(axis):
    """The high face of one voxel is the low face of the next, seen from the other side."""
    low, high = FACES[2 * axis], FACES[2 * axis + 1]
    step = 1 << axis
    assert {corner | step for corner in low} == set(high)
    across = {
        EDGES.index(ends): EDGES.index((ends[0] | step, ends[1] | step)) for ends in EDGES if set(ends) <= set(low)
    }
    for pattern in product((0, 1), repeat=4):
        from_next = sum(1 << corner for corner, bit in zip(low, pattern, strict=True) if bit)
        from_first = sum(1 << (corner | step) for corner, bit in zip(low, pattern, strict=True) if bit)
        seen_from_next = {(across[a], across[b]) for a, b in face_segments(from_next, low)}
        assert {(b, a) for a, b in seen_from_next} == set(face_segments(from_first, high))


def test_no_triangles_inner_edge_lies_in_a_face_of_the_cube():
    for case in range(256):
        sides = Counter(frozenset((t[i], t[i - 1])) for t in case_triangles(case) for i in range(3))
        inner = [side for side, count in sides.items() if count == 2]
        assert not [side for side in inner if frozenset.intersection(*(FACES_OF_EDGE[e] for e in side))]
        assert max(sides.values(), default=0) <= 2


def test_triangles_face_away_from_the_inside_corners():
    middle = np.array([[sum(c >> axis & 1 for c in ends) / 2 for axis in range(3)] for ends in EDGES])
    for corner in range(8):
        (triangle,) = case_triangles(1 << corner)
        a, b, c = middle[list(triangle)]
        outward = np.cross(b - a, c - a)
        inside = np.array([corner >> axis & 1 for axis in range(3)])
        assert outward @ ((a + b + c) / 3 - inside) > 0
