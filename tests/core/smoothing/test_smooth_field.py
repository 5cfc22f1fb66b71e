# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the refined slices lie, and how far outside a closed border is."""

import numpy as np
import pytest

from ctmc_addon.core.smoothing.smooth_field import refined_affine, with_closed_ends


def test_the_labels_own_slices_stay_where_they_are():
    affine = np.array([[0.7, 0.1, 0.3, 4.0], [0.0, 0.8, 0.2, -5.0], [0.1, 0.0, 2.5, 6.0], [0.0, 0.0, 0.0, 1.0]])
    refined = refined_affine(affine, 4, 3)
    for slice_ in (0, 1, 7):
        at, of_label = np.array([5.0, 6.0, 3 + 4 * slice_, 1.0]), np.array([5.0, 6.0, slice_, 1.0])
        np.testing.assert_allclose(refined @ at, affine @ of_label, atol=1e-12)


@pytest.mark.parametrize(("steps", "added"), [(1, 0), (2, 2), (3, 1), (4, 3), (5, 2)])
def test_a_closed_border_is_half_a_slice_gap_outside(steps, added):
    values = np.ones((3, 2, 2), np.float32)
    closed, first = with_closed_ends(values, steps)
    assert first == added
    assert len(closed) == 3 + 2 * added
    assert (closed[first : len(closed) - first] == values).all()
