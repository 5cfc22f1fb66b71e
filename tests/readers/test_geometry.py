# SPDX-License-Identifier: GPL-3.0-or-later
"""A spacing that is given stands for lengths of 0: along the file's direction, else at right angles to the others."""

from __future__ import annotations

import itertools

import nibabel
import numpy as np
import pytest

from ctmc_addon.core.errors import VolumeError
from ctmc_addon.readers import read_volume
from ctmc_addon.readers.geometry import respaced

VALUES = np.arange(210, dtype=np.int16).reshape(7, 6, 5)
GIVEN = (0.5, 0.7, 2.0)
TURN = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])  # columns of length 1 at right angles
NOTE = "the file has no direction along {}: taken at right angles; flip x, y or z changes it"


def affine_of(matrix, at=(1, 2, 3)):
    affine = np.eye(4)
    affine[:3, :3], affine[:3, 3] = matrix, at
    return affine


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("signs", [(1, 1), (1, -1), (-1, 1), (-1, -1)])
def test_one_axis_without_length_stands_at_right_angles_and_runs_as_axial_slices_do(axis, signs):
    matrix = np.diag([3.0, 4.0, 5.0])
    others = [other for other in range(3) if other != axis]
    matrix[:, others] *= signs
    matrix[:, axis] = 0
    expected = np.diag(GIVEN)
    expected[:, others] *= signs
    expected[axis, axis] *= (-1, -1, 1)[axis]
    affine, words, notes = respaced(affine_of(matrix), GIVEN)
    np.testing.assert_array_equal(affine, affine_of(expected))
    assert words.endswith(" mm")
    assert notes == (NOTE.format("xyz"[axis]),)


@pytest.mark.parametrize("missing", [part for count in (1, 2, 3) for part in itertools.combinations(range(3), count)])
@pytest.mark.parametrize("matrix", [TURN, TURN[:, ::-1], np.eye(3)[[1, 2, 0]], np.eye(3)[[2, 0, 1]]])
def test_axes_without_length_are_at_right_angles_of_any_others(missing, matrix):
    flat = matrix.copy()
    flat[:, missing] = 0
    affine, _, notes = respaced(affine_of(flat), GIVEN)
    found = affine[:3, :3]
    np.testing.assert_allclose(found.T @ found, np.diag(np.square(GIVEN)), atol=1e-12)
    known = [axis for axis in range(3) if axis not in missing]
    np.testing.assert_allclose(found[:, known], matrix[:, known] * np.array(GIVEN)[known])
    np.testing.assert_array_equal(affine[:3, 3], (1, 2, 3))
    assert notes == (NOTE.format(", ".join("xyz"[axis] for axis in missing)),)


def test_an_affine_with_all_lengths_keeps_its_directions_without_a_note():
    affine, words, notes = respaced(affine_of(TURN * (1, 2, 3)), GIVEN)
    np.testing.assert_allclose(affine, affine_of(TURN * GIVEN))
    assert (words, notes) == ("instead of the file's own 1 x 2 x 3 mm", ())


@pytest.mark.parametrize("hand", [1, -1])
def test_a_metaimage_says_the_direction_of_an_axis_without_length(tmp_path, hand):
    matrix = TURN * (1, 1, hand)
    rows = " ".join(map(str, matrix.T.ravel()))
    head = f"NDims = 3\nDimSize = 5 6 7\nElementType = MET_SHORT\nTransformMatrix = {rows}\n"
    head += "ElementSpacing = 1 1 0\nElementDataFile = LOCAL\n"
    (tmp_path / "ct.mha").write_bytes(head.encode() + VALUES.tobytes())
    volume = read_volume(tmp_path / "ct.mha", spacing=GIVEN)
    np.testing.assert_allclose(volume.affine[:3, :3], np.diag([-1, -1, 1]) @ matrix * GIVEN, atol=1e-12)
    assert volume.notes == ("spacing 0.5 x 0.7 x 2 mm as asked, instead of the file's own 1 x 1 x 0 mm",)


def test_axes_in_one_plane_are_refused_with_and_without_a_spacing(tmp_path):
    image = nibabel.Nifti1Image(VALUES.T, np.eye(4))
    header = image.header.copy()
    header["vox_offset"], header["magic"], header["srow_z"] = 352, b"n+1", (0, 0, 0, 0)
    header["srow_x"] = (1, 0, 1, 0)
    (tmp_path / "ct.nii").write_bytes(header.binaryblock + bytes(4) + VALUES.tobytes())
    for spacing in (None, GIVEN):
        with pytest.raises(VolumeError, match=r"^ct\.nii: the affine is singular: its axes lie in one plane; repair"):
            read_volume(tmp_path / "ct.nii", spacing=spacing)
