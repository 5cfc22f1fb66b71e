# SPDX-License-Identifier: GPL-3.0-or-later
"""Real CT beside the checkout: HU equal to pydicom's own, corners where the positions say."""

from __future__ import annotations

import nibabel
import numpy as np
import pydicom
import pytest
import tifffile
from meshes import non_manifold_edges

from ctmc_addon.core import CtmcError, ReconstructionSettings, reconstruct
from ctmc_addon.readers import open_volume, read_volume


def headers(folder):
    found = []
    for path in folder.iterdir():
        try:
            found.append(pydicom.dcmread(path))
        except pydicom.errors.InvalidDicomError:
            continue
    return sorted(found, key=lambda one: float(one.ImagePositionPatient[2]))


def assert_corners(volume, datasets, pixel_ras, places):
    for at, dataset in zip(places, datasets, strict=True):
        for row in (0, dataset.Rows - 1):
            for column in (0, dataset.Columns - 1):
                found = (volume.affine @ (column, row, at, 1))[:3]
                np.testing.assert_allclose(found, pixel_ras(dataset, row, column), atol=1e-3)


@pytest.mark.parametrize("name", ["ts_dicom_j2k", "lidc0314_abdomen30"])
def test_hu_and_corners_of_a_dicom_series(real, pixel_ras, name):
    datasets = headers(real(name))
    volume = read_volume(real(name))
    for plane, dataset in zip(volume.values, datasets, strict=True):
        np.testing.assert_array_equal(plane, pydicom.pixels.apply_rescale(dataset.pixel_array, dataset))
    assert_corners(volume, datasets, pixel_ras, range(len(datasets)))
    assert (volume.kind, volume.notes, volume.values.dtype) == ("HU", (), np.int16)


@pytest.mark.parametrize("topology", ["classic", "trilinear"])
def test_lung_between_two_limits_is_closed_and_manifold_in_real_ct(real, topology):
    settings = ReconstructionSettings(
        threshold=-950, upper=-600, close_border=True, topology=topology, region=(60, 120, 4, 300, 360, 24)
    )
    mesh = reconstruct(read_volume(real("lidc0314_abdomen30")), settings).mesh
    assert len(mesh.faces) > 100_000
    assert mesh.closed
    assert len(non_manifold_edges(mesh)) == 0
    assert mesh.volume > 0


def test_gap_of_the_j2k_series_is_2_mm_though_its_slices_are_3_mm_thick(real):
    assert read_volume(real("ts_dicom_j2k")).spacing == pytest.approx((0.9765625, 0.9765625, 2.0))


def test_the_tilted_head_keeps_its_tilt_and_its_ends(real, pixel_ras):
    datasets = headers(real("ge_gantry_tilt"))
    volume = read_volume(real("ge_gantry_tilt"))
    last = len(volume.values) - 1
    assert_corners(volume, [datasets[0], datasets[-1]], pixel_ras, [0, last])
    notes = " ".join(volume.notes)
    assert "1.08, 4 and 7 mm" in notes
    assert "tilted by 18.5 degrees" in notes
    assert "padding" in notes
    for plane, dataset in ((volume.values[0], datasets[0]), (volume.values[last], datasets[-1])):
        stored = dataset.pixel_array
        np.testing.assert_array_equal(plane[stored != -1500], stored[stored != -1500])
        assert (plane[stored == -1500] == volume.values.min()).all()
    assert volume.values.min() > -1500


def test_strict_refuses_the_uneven_head(real):
    with pytest.raises(CtmcError, match=r"1.08, 4 and 7 mm.*strict"):
        read_volume(real("ge_gantry_tilt"), strict=True)


def test_slices_too_far_apart_are_refused_by_name(real):
    with pytest.raises(CtmcError, match=r"gap of 115 mm between CT29.dcm.*and CT24.dcm.*median gap of 32.5 mm"):
        read_volume(real("kits_dupe_positions"))


def test_the_enhanced_file_stands_where_its_frames_say(real):
    path = real("dicom_singles") / "eCT_Supplemental.dcm"
    volume, dataset = read_volume(path), pydicom.dcmread(path)
    frames = dataset.pixel_array.astype(int) - 1024
    # Its rows run to the right, so the normal runs to the feet: the file's second frame comes first.
    np.testing.assert_array_equal(volume.values, frames[::-1])
    np.testing.assert_allclose((volume.affine @ (0, 0, 0, 1))[:3], (-99.5, 301.5, -149), atol=1e-9)
    np.testing.assert_allclose((volume.affine @ (0, 0, 1, 1))[:3], (-99.5, 301.5, -159), atol=1e-9)
    assert volume.orientation == "RPI"


def test_a_folder_of_single_slices_lists_its_series(real):
    assert [one.slices for one in open_volume(real("dicom_singles")).series] == [1, 1, 2, 1]


@pytest.mark.parametrize("name", ["example_ct", "example_seg_dicom", "example_seg_fast_force_split"])
def test_nifti_equals_nibabel(real, name):
    path = real("ts_nifti") / f"{name}.nii.gz"
    volume, oracle = read_volume(path), nibabel.load(path)
    np.testing.assert_array_equal(volume.values.T, np.asarray(oracle.dataobj))
    np.testing.assert_array_equal(volume.affine, oracle.affine)
    assert volume.kind == ("HU" if name == "example_ct" else "label")
    assert volume.label_names.get(5) == (None if name == "example_ct" else "liver")


def test_labels_and_their_ct_share_one_place(real):
    ct, labels = read_volume(real("ts_dicom_j2k")), read_volume(real("ts_nifti") / "example_seg_dicom.nii.gz")
    inside = np.argwhere(labels.values == 5)[:, ::-1]  # (n, 3) x, y, z of the liver
    points = inside @ labels.affine[:3, :3].T + labels.affine[:3, 3]
    index = np.rint((points - ct.affine[:3, 3]) @ np.linalg.inv(ct.affine[:3, :3]).T).astype(int)
    liver = ct.values[index[:, 2], index[:, 1], index[:, 0]]
    assert 40 < np.median(liver) < 180


def test_png_and_tiff_stacks_equal_their_dicom_series(real):
    hu = read_volume(real("ts_dicom_j2k")).values
    tiff = read_volume(real("png_tif_stacks") / "stack_multipage.tif")
    np.testing.assert_array_equal(tiff.values, tifffile.imread(real("png_tif_stacks") / "stack_multipage.tif"))
    png16 = read_volume(real("png_tif_stacks") / "png16_offset1024").values.astype(int) - 1024
    png8 = read_volume(real("png_tif_stacks") / "png8_window").values
    assert any((tiff.values == one).all() for one in (hu, hu[::-1]))
    assert any((png16 == one).all() for one in (hu, hu[::-1]))
    assert png8.shape == hu.shape


def test_the_headers_of_vtks_head_are_joined(real):
    volume = read_volume(real("other/vtk_headsq") / "quarter.nhdr")
    folder = real("other/vtk_headsq")
    for number in (1, 10, 93):
        raw = np.fromfile(folder / f"quarter.{number}", "<i2").reshape(64, 64)
        np.testing.assert_array_equal(volume.values[number - 1], raw)
    assert volume.spacing == pytest.approx((3.2, 3.2, 1.5))
