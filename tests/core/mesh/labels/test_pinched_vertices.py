# SPDX-License-Identifier: GPL-3.0-or-later
"""Vertices at which a surface touches itself are split, and no others."""

import numpy as np

from ctmc_addon.core.mesh.labels.pinched_vertices import split_pinched

TETRAHEDRON = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], np.int32)


def test_three_tetrahedra_in_a_vertex_get_one_each():
    faces = np.concatenate(
        [TETRAHEDRON, np.where(TETRAHEDRON, TETRAHEDRON + 3, 0), np.where(TETRAHEDRON, TETRAHEDRON + 6, 0)]
    )
    split, copied = split_pinched(faces.astype(np.int32), np.ones(10, bool))
    assert copied.tolist() == [0, 0]
    assert np.array_equal(split[:4], TETRAHEDRON)
    assert [sorted(set(split[first : first + 4].ravel())) for first in (4, 8)] == [[4, 5, 6, 10], [7, 8, 9, 11]]
    left, copied = split_pinched(faces.astype(np.int32), np.arange(10) > 0)
    assert np.array_equal(left, faces)
    assert not len(copied)


def test_two_open_fans_are_parted_and_one_stays_whole():
    fans = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 0]], np.int32)
    split, copied = split_pinched(fans, np.ones(6, bool))
    assert split.tolist() == [[0, 1, 2], [0, 2, 3], [4, 5, 6]]
    assert copied.tolist() == [0]
    assert np.array_equal(split_pinched(fans[:2], np.ones(6, bool))[0], fans[:2])
