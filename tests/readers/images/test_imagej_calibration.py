# SPDX-License-Identifier: GPL-3.0-or-later
"""ImageJ's calibration of gray values: a straight line is applied, any other function is named."""

from __future__ import annotations

import numpy as np
import pytest
import tifffile

from ctmc_addon.core import CtmcError, finish
from ctmc_addon.readers import open_volume, read_volume

HU = np.random.default_rng(0).integers(-1000, 1500, (4, 6, 5))


def saved(path, stored, axes="ZYX", **options):
    line = {"cf": 0, "c0": -1024.0, "c1": 1.0, "vunit": "Gray Value"}
    metadata = {"axes": axes, **line, **options.pop("metadata", {})}
    tifffile.imwrite(path, stored, imagej=True, metadata=metadata, **options)
    return path


def notes_with(volume, words):
    return [note for note in volume.notes if words in note]


@pytest.mark.parametrize("intercept", [-1024, -32768])
@pytest.mark.parametrize("byteorder", "<>")
@pytest.mark.parametrize("compression", [None, "zlib"])
def test_signed_values_come_back_as_integers(tmp_path, intercept, byteorder, compression):
    stored = (HU - intercept).astype(np.uint16)
    options = {"byteorder": byteorder} | ({"compression": compression} if compression else {})
    path = saved(tmp_path / "ct.tif", stored, metadata={"c0": intercept}, **options)
    volume = read_volume(path)
    np.testing.assert_array_equal(volume.values, tifffile.imread(path).astype(int) + intercept)
    np.testing.assert_array_equal(volume.values, HU)
    assert volume.values.dtype == np.int16
    assert notes_with(volume, f"ImageJ's calibration was applied: gray value = 1 x stored - {-intercept}")
    slabs = finish(open_volume(path).slabs_steps())
    assert slabs.dtype == np.int16
    np.testing.assert_array_equal(slabs.reader.read(range(1, 3), range(6), range(5)), HU[1:3])


def test_values_beyond_16_bits_become_32_bits(tmp_path):
    stored = np.array([0, 65535], np.uint16).reshape(2, 1, 1) * np.ones((1, 3, 3), np.uint16)
    volume = read_volume(saved(tmp_path / "ct.tif", stored))
    assert (volume.values.dtype, volume.values.min(), volume.values.max()) == (np.int32, -1024, 64511)


@pytest.mark.parametrize("dtype", ["u1", "u2"])
def test_a_slope_with_decimals_gives_float32(tmp_path, dtype):
    stored = np.arange(60, dtype=dtype).reshape(3, 4, 5)
    volume = read_volume(saved(tmp_path / "ct.tif", stored, metadata={"c0": -0.5, "c1": 0.25}))
    np.testing.assert_array_equal(volume.values, stored * 0.25 - 0.5)
    assert volume.values.dtype == np.float32


@pytest.mark.parametrize("end", [".tif", ".TIFF"])
def test_a_folder_of_single_slices_is_calibrated_too(tmp_path, end):
    for number, plane in enumerate(HU):
        saved(tmp_path / f"{number}{end}", (plane + 32768).astype(np.uint16), "YX", metadata={"c0": -32768.0})
    volume = read_volume(tmp_path)
    np.testing.assert_array_equal(volume.values, HU)
    assert volume.values.dtype == np.int16
    part = read_volume(tmp_path, region=(1, 0, 1, 4, 5, 3), stride=(2, 2, 2))
    np.testing.assert_array_equal(part.values, HU[1:4:2, 0:6:2, 1:5:2])


def test_slices_of_different_calibrations_are_refused(tmp_path):
    for number, plane in enumerate(HU):
        intercept = -1024 if number != 2 else -1000
        saved(tmp_path / f"{number}.tif", (plane + 1024).astype(np.uint16), "YX", metadata={"c0": intercept})
    words = (
        r"the slices differ in calibration: 2.tif is calibrated as 1 x stored - 1000 and most are calibrated as "
        r"1 x stored - 1024; take the others out of the folder"
    )
    with pytest.raises(CtmcError, match=words):
        read_volume(tmp_path)


def test_each_time_and_channel_is_calibrated(tmp_path):
    values = np.random.default_rng(1).integers(-900, 900, (2, 4, 3, 6, 5))
    path = saved(tmp_path / "ct.tif", (values + 1024).astype(np.uint16), "TZCYX")
    for time in (1, 2):
        np.testing.assert_array_equal(read_volume(path, time=time).values, values[time - 1, :, 0])


@pytest.mark.parametrize(
    ("code", "name"),
    [(1, "polynomial of degree 2"), (8, "gamma variate"), (21, "uncalibrated optical density"), (99, "unknown")],
)
def test_another_function_is_named_and_not_applied(tmp_path, code, name):
    stored = (HU + 1024).astype(np.uint16)
    volume = read_volume(saved(tmp_path / "ct.tif", stored, metadata={"cf": code, "c2": 0.5}))
    np.testing.assert_array_equal(volume.values, stored)
    (note,) = notes_with(volume, f"ImageJ's calibration cf={code} ({name}) is not applied")
    assert note.endswith("in ImageJ, Image > Type > 32-bit applies it before saving")


@pytest.mark.parametrize("bad", [{"c1": 0}, {"c1": "nan"}, {"c0": "inf"}, {"c1": "wide"}, {"c0": "1" * 400}])
def test_a_line_without_slope_or_numbers_is_named_and_not_applied(tmp_path, bad):
    stored = (HU + 1024).astype(np.uint16)
    volume = read_volume(saved(tmp_path / "ct.tif", stored, metadata=bad))
    np.testing.assert_array_equal(volume.values, stored)
    (note,) = notes_with(volume, "ImageJ's calibration cf=0, c0=")
    assert note.endswith("is not applied: gray values are those stored")


def test_the_identity_and_the_range_of_display_change_nothing(tmp_path):
    stored = (HU + 1024).astype(np.uint16)
    metadata = {"c0": 0.0, "c1": 1.0, "min": 100.0, "max": 900.0}
    volume = read_volume(saved(tmp_path / "ct.tif", stored, metadata=metadata))
    np.testing.assert_array_equal(volume.values, stored)
    assert volume.values.dtype == np.uint16
    assert not notes_with(volume, "calibration")


def test_floating_point_values_and_colors_are_not_calibrated(tmp_path):
    floats = saved(tmp_path / "float.tif", HU.astype(np.float32))
    colors = saved(tmp_path / "rgb.tif", np.repeat((HU % 200).astype(np.uint8)[..., None], 3, axis=3), "ZYXS")
    of_floats = "8 and 16 bits, and this file has float32"
    of_colors = "gray values, and this file has colors"
    for path, expected, fits in ((floats, HU, of_floats), (colors, HU % 200, of_colors)):
        volume = read_volume(path)
        np.testing.assert_array_equal(volume.values, expected)
        assert f"ImageJ's calibration is not applied: cf=0 is for {fits}" in volume.notes


@pytest.mark.parametrize("dtype", ["u1", "u2", "f4"])
def test_the_code_of_no_calibration_is_not_said(tmp_path, dtype):
    stored = (HU % 200).astype(dtype)
    volume = read_volume(saved(tmp_path / "plain.tif", stored, metadata={"cf": 20}))
    np.testing.assert_array_equal(volume.values, stored)
    assert not notes_with(volume, "calibration")


def test_a_function_beside_floating_point_values_has_no_remedy_in_imagej(tmp_path):
    volume = read_volume(saved(tmp_path / "float.tif", HU.astype(np.float32), byteorder=">", metadata={"cf": 8}))
    (note,) = notes_with(volume, "calibration")
    assert note == "ImageJ's calibration is not applied: cf=8 is for 8 and 16 bits, and this file has float32"


def test_a_calibration_where_0_is_white_is_named_and_not_applied(tmp_path):
    stored = (HU + 1024).astype(np.uint16)
    volume = read_volume(saved(tmp_path / "ct.tif", stored, photometric="miniswhite"))
    (note,) = notes_with(volume, "ImageJ's calibration cf=0 of a picture in which 0 is white is not applied")
    assert note.endswith("in ImageJ, Image > Type > 32-bit applies it before saving")


def test_zeroclip_is_said(tmp_path):
    volume = read_volume(saved(tmp_path / "ct.tif", (HU + 1024).astype(np.uint16), metadata={"zeroclip": True}))
    np.testing.assert_array_equal(volume.values, HU)
    assert notes_with(volume, "zeroclip is not applied: gray values below 0 are kept")


def test_signed_storage_is_raised_before_it_is_calibrated_as_in_imagej(tmp_path):
    lines = "ImageJ=1.53t\nimages=4\nslices=4\ncf=0\nc0=-32768\nc1=1\nvunit=Gray Value\n"
    stored = HU.astype(np.int16)
    tifffile.imwrite(tmp_path / "ct.tif", stored, description=lines, metadata=None, photometric="minisblack")
    volume = read_volume(tmp_path / "ct.tif")
    np.testing.assert_array_equal(volume.values, HU)
    assert not notes_with(volume, "calibration")
