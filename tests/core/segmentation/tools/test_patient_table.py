# SPDX-License-Identifier: GPL-3.0-or-later
"""The table behind a body becomes air, whichever way the slices run; the body keeps every value."""

import numpy as np
import pytest
from volumes import in_file

from ctmc_addon.core import ReadError, Volume, finish
from ctmc_addon.core.segmentation import without_table_steps

SPACING = (1.6, 1.6, 2.0)
ORIENTATIONS = ("LPS", "RAS", "LSA", "PSR", "ASL")


def phantom():
    """A body with lungs, an arm beside it and a table that touches it and rises at its sides, LPS; and the table."""
    z, y, x = np.meshgrid(np.arange(24) * 2.0, np.arange(100) * 1.6, np.arange(130) * 1.6, indexing="ij")
    body = ((x - 100) / 70) ** 2 + ((y - 70) / 50) ** 2 < 1
    lungs = ((abs(x - 100) - 28) / 18) ** 2 + ((y - 65) / 28) ** 2 < 1
    arm = (x - 196) ** 2 + (y - 75) ** 2 < 22**2
    top = 121 - 0.0028 * (x - 100) ** 2
    table = ((y >= top) & (y < top + 4) & ~body & ~arm) | ((y > 140) & (abs(x - 60) < 5) & (y < 152))
    values = np.full(z.shape, -1000, np.int16)
    values[table] = 150
    values[body | arm] = 40
    values[lungs] = -850
    values[(y > 128) & (y < 131)] -= 60  # a mattress, or noise
    return values, table, body | arm


def turned(array, orientation):
    """An LPS array with its axes as an orientation says, and the affine of its grid."""
    axes, signs = [], []
    for letter in orientation:
        pair = next(pair for pair in ("LR", "PA", "SI") if letter in pair)
        axes.append(("LR", "PA", "SI").index(pair))
        signs.append(1 if letter == pair[0] else -1)
    out = array.transpose([2 - axis for axis in reversed(axes)])
    out = out[tuple(slice(None, None, sign) for sign in reversed(signs))]
    affine = np.eye(4)
    affine[:3, :3] = 0
    towards = {"L": -1, "R": 1, "P": -1, "A": 1, "S": 1, "I": -1}
    for column, (axis, letter) in enumerate(zip(axes, orientation, strict=True)):
        affine[axis, column] = towards[letter] * SPACING[axis]
    return np.ascontiguousarray(out), affine


@pytest.mark.parametrize("orientation", ORIENTATIONS)
def test_the_table_goes_and_the_body_stays(orientation):
    values, table, body = (turned(each, orientation)[0] for each in phantom())
    volume = Volume(values, turned(phantom()[0], orientation)[1], kind="HU")
    assert volume.orientation == orientation
    removed = finish(without_table_steps(volume))
    np.testing.assert_array_equal(removed.values[body], values[body])
    left = (removed.values >= -300) & table
    assert np.count_nonzero(left) < 0.02 * np.count_nonzero(table)
    milliliters = np.count_nonzero(table) * np.prod(SPACING) / 1000
    said = float(removed.notes[-1].split("(")[1].split(" ml")[0])
    assert said == pytest.approx(milliliters, rel=0.05)


def test_a_volume_in_a_file_has_the_same_values_slab_by_slab():
    values, affine = turned(phantom()[0], "LPS")
    held = finish(without_table_steps(Volume(values, affine, kind="HU")))
    fetched = finish(without_table_steps(in_file(Volume(values, affine, kind="HU"))))
    assert fetched.reader.own_bytes
    assert not held.reader.own_bytes
    np.testing.assert_array_equal(fetched.values, held.values)
    part = fetched.part(((3, 90), (20, 99), (5, 9)))
    np.testing.assert_array_equal(part.slab(1, 3), held.values[6:8, 20:99, 3:90])
    np.testing.assert_array_equal(finish(fetched.in_memory_steps((3, 2, 2))).values, held.values[::2, ::2, ::3])


def test_without_a_table_nothing_changes_and_a_note_says_so():
    values, table, _ = phantom()
    values[table] = -1000
    volume = Volume(*turned(values, "LPS"), kind="HU")
    removed = finish(without_table_steps(volume))
    assert removed.reader is volume.reader
    assert removed.notes == ("No patient table was found",)


def test_labels_stay_and_gray_values_are_refused():
    values, affine = turned(phantom()[0], "LPS")
    labels = Volume((values > 0).astype(np.uint8), affine, kind="label")
    assert finish(without_table_steps(labels)) is labels
    with pytest.raises(ReadError, match="found only in HU"):
        finish(without_table_steps(Volume(values, affine)))
