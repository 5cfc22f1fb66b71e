# SPDX-License-Identifier: GPL-3.0-or-later
"""Skin of a head is said to show a face; bone, labels and trunks are not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ctmc_addon.core import ReconstructionSettings, Volume, reconstruct
from ctmc_addon.core.mesh.faces_shown import NOTE
from ctmc_addon.readers import read_volume

SHARED = Path(__file__).parents[3].parent / "shared" / "data"


def body(width_mm, depth_mm, height_mm, kind="HU", spacing_mm=4.0):
    """A tube of water in air, standing on the lower end of its box."""
    sides = [round(length / spacing_mm / 2) for length in (width_mm, depth_mm)]
    y, x = np.ogrid[-sides[1] - 3 : sides[1] + 4, -sides[0] - 3 : sides[0] + 4]
    inside = (x / sides[0]) ** 2 + (y / sides[1]) ** 2 <= 1
    values = np.where(inside, 0, -1000)[None].repeat(round(height_mm / spacing_mm), 0).astype(np.int16)
    return Volume(values, np.diag([-spacing_mm, -spacing_mm, spacing_mm, 1.0]), kind=kind)


def says(volume, threshold):
    return NOTE in reconstruct(volume, ReconstructionSettings(threshold=threshold)).notes


@pytest.mark.parametrize(("width_mm", "depth_mm"), [(150, 190), (120, 150), (190, 230)])
def test_a_head_shows_a_face(width_mm, depth_mm):
    assert says(body(width_mm, depth_mm, 160), -300.0)


@pytest.mark.parametrize(
    ("width_mm", "depth_mm", "height_mm"), [(350, 240, 300), (280, 250, 300), (90, 90, 300), (150, 190, 50)]
)
def test_trunks_limbs_and_thin_slices_of_a_head_show_none(width_mm, depth_mm, height_mm):
    assert not says(body(width_mm, depth_mm, height_mm), -300.0)


def test_bone_and_gray_values_show_none():
    head = body(150, 190, 160)
    bone = Volume(np.where(head.values == 0, 1000, -1000).astype(np.int16), head.affine, kind="HU")
    assert not says(bone, 300.0)
    assert not says(body(150, 190, 160, "gray value"), -300.0)


@pytest.mark.once
@pytest.mark.parametrize(
    ("name", "face"),
    [
        ("ge_gantry_tilt", True),
        ("ircadb01_abdomen", False),
        ("ts_dicom_j2k", False),
        ("ts_nifti/example_ct.nii.gz", False),
    ],
)
def test_a_real_head_shows_a_face_and_real_abdomens_none(name, face):
    if not (SHARED / name).exists():
        pytest.skip(f"real CT '{name}' is not beside the checkout")
    assert says(read_volume(SHARED / name), -300.0) == face
