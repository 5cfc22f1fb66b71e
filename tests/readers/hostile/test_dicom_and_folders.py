# SPDX-License-Identifier: GPL-3.0-or-later
"""DICOM files and folders made to hurt: each is one sentence, or a right volume."""

from __future__ import annotations

import os
import warnings

import numpy as np
import pytest
from refusals import refused

from ctmc_addon.core import CtmcError
from ctmc_addon.readers import read_volume


def test_a_pipe_is_refused(tmp_path):
    if not hasattr(os, "mkfifo"):
        pytest.skip("this system has no named pipes")
    os.mkfifo(tmp_path / "v.nii")
    refused(tmp_path / "v.nii", "v.nii")
    refused(tmp_path, tmp_path.name)


def test_nested_folders_without_end_are_refused(tmp_path):
    folder = tmp_path
    try:
        for _ in range(1200):
            (folder / "a").mkdir()
            folder = folder / "a"
    except OSError:  # as deep as the system goes
        pass
    try:
        refused(tmp_path, tmp_path.name)
    finally:
        while folder != tmp_path:  # shutil.rmtree calls itself
            folder.rmdir()
            folder = folder.parent


@pytest.mark.parametrize("count", [20_000_000, 2_147_483_647, -1])
def test_a_number_of_frames_that_the_file_cannot_hold_is_refused(tmp_path, save_stack, save_slice, count):
    save_stack(tmp_path, range(3))
    save_slice(tmp_path / "3.dcm", np.zeros((5, 7), np.uint16), (-10, -20, 3), NumberOfFrames=count)
    refused(tmp_path, "3.dcm")
    refused(tmp_path / "3.dcm", "3.dcm")


def test_a_slice_of_0_frames_is_a_slice(tmp_path, save_stack):
    expected = save_stack(tmp_path, range(3), NumberOfFrames=0)
    np.testing.assert_array_equal(read_volume(tmp_path).values, expected)


@pytest.mark.parametrize(
    "tags",
    [
        {"PixelSpacing": ["1e300", "1e300"]},
        {"PixelSpacing": ["nan", "1"]},
        {"RescaleSlope": "nan"},
        {"RescaleSlope": "inf"},
        {"RescaleSlope": "1e308"},
        {"RescaleIntercept": "-1e300"},
    ],
)
def test_extreme_numbers_of_dicom_are_refused(tmp_path, save_stack, tags):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # pydicom's, of what it is asked to write
        save_stack(tmp_path, range(3), **tags)
    refused(tmp_path)


def test_positions_without_measure_are_refused(tmp_path, save_stack):
    save_stack(tmp_path, range(3), ImagePositionPatient=["1e308", "1e308", "1e308"])
    refused(tmp_path)


def test_slices_too_short_to_be_known_are_refused(tmp_path, save_stack):
    save_stack(tmp_path, range(4))
    for number in range(4):
        (tmp_path / f"{number}.dcm").rename(tmp_path / f"I{number}")
    (tmp_path / "I3").write_bytes(b"")
    (tmp_path / "I2").write_bytes(bytes(100))
    with pytest.raises(CtmcError) as caught:
        read_volume(tmp_path)
    damage = "named like the slices, but not DICOM"
    assert str(caught.value).startswith(
        f"I2 is a truncated or damaged DICOM file ({damage}); copy it again, or leave it out"
    )


@pytest.mark.parametrize(("photometric", "samples"), [("RGB", 3), ("YBR_FULL_422", 2)])
def test_a_color_slice_in_a_gray_series_is_said(tmp_path, save_stack, save_slice, photometric, samples):
    save_stack(tmp_path, range(3), shape=(4, 6))
    color = {"SamplesPerPixel": 3, "PhotometricInterpretation": photometric, "PlanarConfiguration": 0}
    dataset = save_slice(tmp_path / "3.dcm", np.zeros((4, 6 * samples), np.uint8), (-10, -20, 3), **color)
    dataset.Columns = 6
    dataset.save_as(tmp_path / "3.dcm")
    volume = read_volume(tmp_path)
    assert len(volume.values) == 3
    assert any("1 color image" in note for note in volume.notes)


def test_compressed_pixels_called_uncompressed_are_refused(tmp_path, save_stack):
    import pydicom

    save_stack(tmp_path, range(3), compress="1.2.840.10008.1.2.5")
    dataset = pydicom.dcmread(tmp_path / "1.dcm")
    dataset.file_meta.TransferSyntaxUID = "1.2.840.10008.1.2.1"
    content = (tmp_path / "1.dcm").read_bytes()
    wrong = content.replace(b"1.2.840.10008.1.2.5\0", b"1.2.840.10008.1.2.1\0", 1)
    assert wrong != content
    (tmp_path / "1.dcm").write_bytes(wrong)
    refused(tmp_path, "1.dcm")


def test_a_compressed_slice_that_is_cut_off_is_refused(tmp_path, save_stack):
    save_stack(tmp_path, range(3), shape=(64, 64), compress="1.2.840.10008.1.2.5")
    content = (tmp_path / "1.dcm").read_bytes()
    for share in (0.6, 0.9, 0.99):
        (tmp_path / "1.dcm").write_bytes(content[: int(share * len(content))])
        refused(tmp_path, "1.dcm")
