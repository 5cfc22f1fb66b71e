# SPDX-License-Identifier: GPL-3.0-or-later
"""A dose (RTDOSE): its values in Gy, the place of its frames, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from ctmc_addon.core import ReadError, ReconstructionSettings, reconstruct
from ctmc_addon.core.volume import transform_points
from ctmc_addon.core.volume.sampling import sampled
from ctmc_addon.readers import labels_beside, open_volume, read_volume, volumes_beside

ROWS, COLUMNS, FRAMES = 6, 8, 5
RELATIVE, DOWNWARD = (0.0, 3.0, 6.0, 9.0, 12.0), (0.0, -3.0, -6.0, -9.0, -12.0)


def field_lps(points_lps):
    """Return the analytic dose, Gy: linear, so that it is exact between samples."""
    return 20.0 + 0.3 * points_lps[..., 0] - 0.2 * points_lps[..., 1] + 0.5 * points_lps[..., 2]


def places(position, orientation, along, spacing=(2.5, 1.5)):
    """Return the center of every voxel, (frames, rows, columns, 3) LPS mm; frames lie `along` from the first."""
    orientation = np.array(orientation, float)
    rows = np.arange(ROWS)[None, :, None, None] * spacing[0] * orientation[3:]
    columns = np.arange(COLUMNS)[None, None, :, None] * spacing[1] * orientation[:3]
    return np.array(position, float) + np.array(along, float)[:, None, None, :] + rows + columns


def stored_field(points_lps, dtype, scaling):
    return np.rint(field_lps(points_lps) / scaling).astype(dtype)


def check_against_field(volume, points_lps, tolerance):
    """Compare with the field at all samples and at random points between them, in RAS mm."""
    ras = points_lps.reshape(-1, 3) * (-1, -1, 1)
    low, high = ras.min(axis=0), ras.max(axis=0)
    assert np.abs(sampled(volume, ras) - field_lps(points_lps.reshape(-1, 3))).max() < tolerance
    corner = ras[0]
    between = corner + np.random.default_rng(0).uniform(0, 1, (500, 3)) * (ras[-1] - corner)
    found = sampled(volume, between)
    inside = ((between >= low) & (between <= high)).all(axis=1)
    assert inside.all()
    assert np.abs(found - field_lps(between * (-1, -1, 1))).max() < tolerance


@pytest.mark.parametrize(("dtype", "scaling"), [(np.uint16, 0.001), (np.uint32, 1.5e-6)])
@pytest.mark.parametrize("offsets", [RELATIVE, DOWNWARD], ids=["upward", "downward"])
@pytest.mark.parametrize("form", ["relative", "absolute"])
def test_values_are_gray_and_frames_are_placed_by_both_forms(tmp_path, save_dose, form, offsets, dtype, scaling):
    position = (-10.0, -20.0, 30.0)
    points = places(position, (1, 0, 0, 0, 1, 0), [(0, 0, offset) for offset in offsets])
    given = offsets if form == "relative" else [offset + position[2] for offset in offsets]
    save_dose(tmp_path / "rd.dcm", stored_field(points, dtype, scaling), given, position, scaling)
    volume = read_volume(tmp_path / "rd.dcm")
    assert (volume.kind, volume.dtype, volume.kind.unit) == ("Gy", np.float32, "Gy")
    assert volume.shape == (FRAMES, ROWS, COLUMNS)
    check_against_field(volume, points, max(scaling, 3e-5))


def test_offsets_run_along_the_cross_product_of_the_directions(tmp_path, save_dose):
    orientation = (0.8, 0.6, 0, 0, 0, -1)  # coronal, turned
    normal = np.cross(orientation[:3], orientation[3:])
    points = places((5.0, -7.0, 11.0), orientation, [offset * normal for offset in RELATIVE])
    stored = stored_field(points, np.uint32, 1e-6)
    save_dose(tmp_path / "rd.dcm", stored, RELATIVE, (5.0, -7.0, 11.0), 1e-6, ImageOrientationPatient=list(orientation))
    volume = read_volume(tmp_path / "rd.dcm")
    ras = points.reshape(-1, 3) * (-1, -1, 1)
    assert np.abs(sampled(volume, ras.astype(np.float32)) - field_lps(points.reshape(-1, 3))).max() < 1e-4


def test_feet_first_directions_put_frames_along_their_own_normal(tmp_path, save_dose):
    points = places((50.0, -7.0, 11.0), (-1, 0, 0, 0, 1, 0), [(0, 0, -offset) for offset in RELATIVE])
    stored = stored_field(points, np.uint32, 1e-6)
    save_dose(
        tmp_path / "rd.dcm", stored, RELATIVE, (50.0, -7.0, 11.0), 1e-6, ImageOrientationPatient=[-1, 0, 0, 0, 1, 0]
    )
    check_against_field(read_volume(tmp_path / "rd.dcm"), points, 1e-4)


def test_frames_around_zero_are_the_same_in_both_forms(tmp_path, save_dose):
    stored = np.arange(5 * 6 * 8).reshape(5, 6, 8).astype(np.uint16)
    save_dose(tmp_path / "rd.dcm", stored, RELATIVE, (0.0, 0.0, 0.0))
    volume = read_volume(tmp_path / "rd.dcm")
    np.testing.assert_allclose(volume.affine, np.diag([-1.5, -2.5, 3.0, 1.0]), atol=1e-12)
    np.testing.assert_array_equal(volume.values, (stored * 0.001).astype(np.float32))


def test_a_whole_number_of_gray_is_a_float_too(tmp_path, save_dose):
    save_dose(tmp_path / "rd.dcm", np.ones((5, 6, 8), np.uint16), RELATIVE, scaling=1.0)
    volume = read_volume(tmp_path / "rd.dcm")
    assert (volume.dtype, volume.kind) == (np.float32, "Gy")
    assert open_volume(tmp_path / "rd.dcm").series[0].dtype == "float32"


def test_a_part_is_read_like_the_whole(tmp_path, save_dose):
    stored = np.random.default_rng(0).integers(0, 60000, (5, 6, 8)).astype(np.uint16)
    save_dose(tmp_path / "rd.dcm", stored, DOWNWARD)
    whole = read_volume(tmp_path / "rd.dcm")
    part = read_volume(tmp_path / "rd.dcm", region=(1, 2, 1, 6, 5, 3))
    np.testing.assert_array_equal(part.values, whole.values[1:4, 2:6, 1:7])
    assert part.kind == "Gy"


def test_uneven_frames_are_resampled_and_said(tmp_path, save_dose):
    offsets = (0.0, 3.0, 6.0, 10.0, 12.0)
    points = places((-10, -20, 30), (1, 0, 0, 0, 1, 0), [(0, 0, offset) for offset in offsets])
    save_dose(tmp_path / "rd.dcm", stored_field(points, np.uint32, 1e-6), offsets, scaling=1e-6)
    volume = read_volume(tmp_path / "rd.dcm")
    assert any("uneven" in note for note in volume.notes)
    index = np.argwhere(np.ones(volume.shape))[:, ::-1]
    exact = field_lps(transform_points(volume.affine, index) * (-1, -1, 1))
    np.testing.assert_allclose(volume.values.ravel(), exact, atol=1e-4)


def test_a_compressed_dose_is_read(tmp_path, save_dose):
    stored = np.random.default_rng(0).integers(0, 60000, (5, 64, 80)).astype(np.uint16)
    save_dose(tmp_path / "rd.dcm", stored, RELATIVE, compress="1.2.840.10008.1.2.4.90")
    np.testing.assert_array_equal(read_volume(tmp_path / "rd.dcm").values, (stored * 0.001).astype(np.float32))


@pytest.mark.parametrize(
    ("tags", "text"),
    [
        ({"DoseUnits": "RELATIVE"}, "the dose is not in Gy: DoseUnits is RELATIVE"),
        ({"DoseType": "EFFECTIVE"}, "weighted by its biological effect"),
        ({"DoseSummationType": "BEAM"}, "a part of the plan's (DoseSummationType BEAM)"),
    ],
)
def test_what_is_not_a_plan_in_gray_is_said(tmp_path, save_dose, tags, text):
    save_dose(tmp_path / "rd.dcm", np.ones((5, 6, 8), np.uint16), RELATIVE, **tags)
    volume = read_volume(tmp_path / "rd.dcm")
    assert any(text in note for note in volume.notes)
    assert volume.kind == ("gray value" if "DoseUnits" in tags else "Gy")


def test_a_plan_in_gray_has_no_note(tmp_path, save_dose):
    save_dose(tmp_path / "rd.dcm", np.ones((5, 6, 8), np.uint16), RELATIVE)
    assert read_volume(tmp_path / "rd.dcm").notes == ()


@pytest.mark.parametrize(
    ("offsets", "tags", "text"),
    [
        ((0.0, 3.0), {}, "GridFrameOffsetVector has 2 numbers for 5 frames"),
        (None, {}, "GridFrameOffsetVector has 0 numbers for 5 frames"),
        ((7.0, 10.0, 13.0, 16.0, 19.0), {}, "begins with 7, which is neither 0 nor z of the first frame, 30"),
        (RELATIVE, {"DoseGridScaling": None}, "DoseGridScaling is missing"),
        (RELATIVE, {"ImagePositionPatient": None}, "ImagePositionPatient or ImageOrientationPatient is missing"),
    ],
)
def test_a_dose_that_cannot_be_placed_or_scaled_is_refused(tmp_path, save_dose, offsets, tags, text):
    save_dose(tmp_path / "rd.dcm", np.ones((5, 6, 8), np.uint16), offsets, **tags)
    with pytest.raises(ReadError) as error:
        read_volume(tmp_path / "rd.dcm")
    assert text in str(error.value)
    assert "export it again" in str(error.value)


def test_an_isodose_is_a_surface(tmp_path, save_dose):
    z, y, x = np.meshgrid(np.arange(31), np.arange(31), np.arange(31), indexing="ij")
    dose = 60.0 - 3.0 * np.sqrt((x - 15.0) ** 2 + (y - 15.0) ** 2 + (z - 15.0) ** 2)
    stored = np.rint(np.maximum(dose, 0) * 1000).astype(np.uint16)
    save_dose(tmp_path / "rd.dcm", stored, np.arange(31.0), PixelSpacing=[1.0, 1.0])
    mesh = reconstruct(read_volume(tmp_path / "rd.dcm"), ReconstructionSettings(threshold=30.0)).mesh
    assert mesh.closed
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * 10.0**3, rel=0.01)


def test_a_ct_with_a_dose_in_its_folder_is_read_as_before(tmp_path, save_stack, save_dose):
    hu = save_stack(tmp_path / "ct", range(4))
    save_dose(tmp_path / "ct" / "rd.dcm", np.ones((9, 6, 8), np.uint16), np.arange(9.0))
    volume = read_volume(tmp_path / "ct")
    assert volume.kind == "HU"
    np.testing.assert_array_equal(volume.values, hu)
    assert not any("rd" in note for note in volume.notes)
    assert volumes_beside(tmp_path / "ct") == (tmp_path / "ct" / "rd.dcm",)
    assert labels_beside(tmp_path / "ct") == ()


def test_a_folder_of_one_dose_is_the_dose_and_of_two_is_a_choice(tmp_path, save_dose):
    save_dose(tmp_path / "rd" / "a.dcm", np.ones((5, 6, 8), np.uint16), RELATIVE)
    assert read_volume(tmp_path / "rd").kind == "Gy"
    save_dose(tmp_path / "rd" / "b.dcm", np.ones((5, 6, 8), np.uint16), RELATIVE)
    with pytest.raises(ReadError, match=r"has 2 doses \(a.dcm, b.dcm\); choose one of them"):
        read_volume(tmp_path / "rd")


def test_a_dose_in_a_folder_beside_belongs_to_the_ct_of_its_frame_of_reference(tmp_path, save_stack, save_dose):
    save_stack(tmp_path / "ct", range(4), FrameOfReferenceUID="1.2.3.99")
    save_stack(tmp_path / "other", range(4), FrameOfReferenceUID="1.2.3.98")
    save_dose(tmp_path / "dose" / "rd.dcm", np.ones((5, 6, 8), np.uint16), RELATIVE)
    assert volumes_beside(tmp_path / "ct") == (tmp_path / "dose" / "rd.dcm",)
    assert volumes_beside(tmp_path / "other") == ()
