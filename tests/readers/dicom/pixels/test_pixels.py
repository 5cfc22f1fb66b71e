# SPDX-License-Identifier: GPL-3.0-or-later
"""DICOM pixels and places: HU against pydicom's own, corners against the positions themselves."""

from __future__ import annotations

import numpy as np
import pydicom
import pytest
from pydicom import uid

from ctmc_addon.core import CtmcError
from ctmc_addon.readers import open_volume, read_volume

AXIAL = (1, 0, 0, 0, 1, 0)

SYNTAXES = [
    uid.ImplicitVRLittleEndian,
    uid.ExplicitVRLittleEndian,
    uid.DeflatedExplicitVRLittleEndian,
    uid.ExplicitVRBigEndian,
]


def said(volume, text):
    return any(text in note for note in volume.notes)


def hounsfield(dataset):
    return pydicom.pixels.apply_rescale(dataset.pixel_array, dataset)


@pytest.mark.parametrize("z", [(0, 1.5, 3), (3, 1.5, 0), (1.5, 3, 0)])
def test_a_series_is_ordered_by_position_and_keeps_integers(tmp_path, save_stack, z):
    hu = save_stack(tmp_path, z)
    volume = read_volume(tmp_path)
    np.testing.assert_array_equal(volume.values, hu[np.argsort(z)])
    assert volume.values.dtype == np.int16
    assert volume.kind == "HU"
    assert volume.notes == ()
    np.testing.assert_array_equal(volume.affine, [[-0.5, 0, 0, 10], [0, -0.8, 0, 20], [0, 0, 1.5, 0], [0, 0, 0, 1]])


@pytest.mark.parametrize("syntax", SYNTAXES)
@pytest.mark.parametrize("dtype", ["uint8", "int8", "uint16", "int16", "uint32", "int32"])
def test_every_uncompressed_syntax_and_type_gives_pydicoms_values(tmp_path, save_slice, syntax, dtype):
    limits = np.iinfo(dtype)
    random = np.random.default_rng(1)
    for z in range(2):
        stored = random.integers(max(limits.min, -5000), min(limits.max, 5000), (3, 4)).astype(dtype)
        save_slice(tmp_path / f"{z}.dcm", stored, (0, 0, z), syntax)
    volume = read_volume(tmp_path)
    for z in range(2):
        np.testing.assert_array_equal(volume.values[z], hounsfield(pydicom.dcmread(tmp_path / f"{z}.dcm")))


@pytest.mark.parametrize("compress", [uid.RLELossless, uid.JPEG2000Lossless])
def test_compressed_slices_give_the_same_values(tmp_path, save_stack, compress):
    hu = save_stack(tmp_path, range(6), (40, 40), compress=compress)
    np.testing.assert_array_equal(read_volume(tmp_path).values, hu)


@pytest.mark.parametrize("compress", [None, uid.RLELossless])
def test_pixels_are_read_without_parsing_a_header_again(tmp_path, save_stack, monkeypatch, compress):
    hu = save_stack(tmp_path, range(3), (40, 40), compress=compress)
    source = open_volume(tmp_path)
    monkeypatch.setattr("pydicom.filereader.read_dataset", lambda *_, **__: pytest.fail("a header was parsed again"))
    np.testing.assert_array_equal(source.read().values, hu)


@pytest.mark.parametrize("signed", [False, True])
def test_bits_above_bits_stored_are_ignored(tmp_path, save_slice, signed):
    random = np.random.default_rng(2)
    for z in range(2):
        stored = random.integers(0, 65536, (4, 5)).astype(np.uint16)
        save_slice(tmp_path / f"{z}.dcm", stored, (0, 0, z), BitsStored=12, PixelRepresentation=int(signed))
    volume = read_volume(tmp_path)
    for z in range(2):
        np.testing.assert_array_equal(volume.values[z], hounsfield(pydicom.dcmread(tmp_path / f"{z}.dcm")))


def test_slope_and_intercept_are_taken_slice_by_slice(tmp_path, save_slice):
    stored = np.arange(12, dtype=np.uint16).reshape(3, 4)
    for z, (slope, intercept) in enumerate([(1, -1024), (2, 0), (3, 5)]):
        save_slice(tmp_path / f"{z}.dcm", stored, (0, 0, z), RescaleSlope=slope, RescaleIntercept=intercept)
    volume = read_volume(tmp_path)
    np.testing.assert_array_equal(volume.values, np.stack([stored - 1024.0, stored * 2.0, stored * 3.0 + 5]))
    assert volume.values.dtype == np.int16


def test_a_fractional_slope_gives_float32(tmp_path, save_slice):
    stored = np.arange(12, dtype=np.uint16).reshape(3, 4) * 1000
    for z, slope in enumerate([1, 0.1]):
        save_slice(tmp_path / f"{z}.dcm", stored, (0, 0, z), RescaleSlope=slope)
    volume = read_volume(tmp_path)
    assert volume.values.dtype == np.float32
    np.testing.assert_array_equal(volume.values[1], (stored * 0.1 - 1024).astype(np.float32))


def test_values_beyond_int16_are_read_into_int32(tmp_path, save_slice):
    for z in range(4):
        save_slice(tmp_path / f"{z}.dcm", np.full((3, 4), 60000 * (z == 3), np.uint16), (0, 0, z))
    volume = read_volume(tmp_path)
    assert volume.values.dtype == np.int32
    assert volume.values.max() == 58976


def test_missing_slope_and_intercept_are_one_and_zero(tmp_path, save_stack):
    hu = save_stack(tmp_path, range(3), RescaleSlope=None, RescaleIntercept=None)
    np.testing.assert_array_equal(read_volume(tmp_path).values, hu + 1024)


def test_tilted_and_oblique_corners_agree_with_the_positions(tmp_path, save_slice, pixel_ras):
    turn = np.radians(20)
    orientation = (np.cos(0.3), np.sin(0.3), 0, -np.sin(0.3) * np.cos(turn), np.cos(0.3) * np.cos(turn), -np.sin(turn))
    datasets = []
    for z in range(4):
        stored = np.full((5, 7), z, np.uint16)
        position = (-120.5 + 0.1 * z, 33.25, 700 - 3 * z)
        tags = {"ImageOrientationPatient": [round(value, 6) for value in orientation]}
        datasets.append(save_slice(tmp_path / f"{z}.dcm", stored, position, **tags))
    volume = read_volume(tmp_path)
    assert said(volume, "tilted")
    for at, plane in enumerate(volume.values):
        dataset = datasets[plane[0, 0] + 1024]
        for row, column in ((0, 0), (0, 6), (4, 0), (4, 6)):
            found = (volume.affine @ (column, row, at, 1))[:3]
            np.testing.assert_allclose(found, pixel_ras(dataset, row, column), atol=1e-3)


def test_uneven_slices_are_interpolated_between_their_neighbors(tmp_path, save_slice):
    for z, value in ((0, 0), (1, 100), (3, 300), (5, 501), (7, 700)):
        save_slice(tmp_path / f"{z}.dcm", np.full((3, 4), value, np.int16), (0, 0, z), RescaleIntercept=0)
    volume = read_volume(tmp_path)
    np.testing.assert_array_equal(volume.values[:, 1, 2], [0, 100, 200, 300, 400, 501, 600, 700])
    assert volume.values.dtype == np.int16
    assert said(volume, "gaps between slices are uneven (1 and 2 mm)")
    with pytest.raises(CtmcError, match="strict"):
        read_volume(tmp_path, strict=True)


def test_a_long_stack_is_resampled_as_numpy_interpolates(tmp_path, save_stack):
    z = np.cumsum(np.r_[0, np.tile([1, 2], 30)]).astype(float)
    hu = save_stack(tmp_path, z)
    volume = read_volume(tmp_path)
    expected = np.stack([np.interp(np.arange(91), z, hu[:, r, c]) for r in range(5) for c in range(7)], axis=1)
    np.testing.assert_array_equal(volume.values.reshape(91, -1), np.rint(expected))


def test_duplicate_positions_are_dropped_and_said(tmp_path, save_stack):
    hu = save_stack(tmp_path, (0, 1, 2, 1, 2, 3))
    volume = read_volume(tmp_path)
    np.testing.assert_array_equal(volume.values, hu[[0, 1, 2, 5]])
    assert said(volume, "2 slices are at the position of another")


@pytest.mark.parametrize(
    ("signed", "padding", "limit", "padded"),
    [(True, 63536, None, -2000), (True, -2000, None, -2000), (True, -2000, -1990, -1995), (False, 65535, None, 65535)],
)
def test_padding_takes_the_lowest_real_value_and_is_said(tmp_path, save_slice, signed, padding, limit, padded):
    from pydicom.dataelem import DataElement

    dtype = np.int16 if signed else np.uint16
    for z in range(3):
        stored = np.full((4, 4), 1000 + z, dtype)
        stored[0] = padded
        dataset = save_slice(tmp_path / f"{z}.dcm", stored, (0, 0, z))
        vr = "SS" if padding < 0 else "US"
        dataset[0x00280120] = DataElement(0x00280120, vr, padding)
        if limit is not None:
            dataset[0x00280121] = DataElement(0x00280121, vr, limit)
        pydicom.dcmwrite(tmp_path / f"{z}.dcm", dataset, enforce_file_format=True)
    volume = read_volume(tmp_path)
    assert volume.values.dtype == np.int16
    assert (volume.values[:, 0] == -24).all()
    assert volume.values.min() == -24
    assert [plane[1, 1] for plane in volume.values] == [-24, -23, -22]
    assert said(volume, "12 padding pixels were set to the lowest value, -24")


def test_padding_beside_a_resampled_slice_makes_no_step(tmp_path, save_slice):
    for z in (0, 1, 3, 5):
        stored = np.full((2, 4), 100, np.int16)
        stored[:, 0] = -2000
        stored[0, 1] = -2000 if z == 1 else 100
        save_slice(tmp_path / f"{z}.dcm", stored, (0, 0, z), RescaleIntercept=0, PixelPaddingValue=-2000)
    volume = read_volume(tmp_path)
    assert len(volume.values) == 6
    assert (volume.values == 100).all()


def test_a_series_of_padding_alone_is_refused(tmp_path, save_slice):
    for z in range(2):
        save_slice(tmp_path / f"{z}.dcm", np.full((2, 2), 5, np.uint16), (0, 0, z), PixelPaddingValue=5)
    with pytest.raises(CtmcError, match="all 8 pixels"):
        read_volume(tmp_path)


def test_float_pixels_stay_float32(tmp_path, save_slice):
    values = np.random.default_rng(0).normal(0, 500, (3, 4, 5)).astype(np.float32)
    for z, plane in enumerate(values):
        dataset = save_slice(
            tmp_path / f"{z}.dcm", plane.view(np.uint32), (0, 0, z), RescaleIntercept=None, RescaleSlope=None
        )
        dataset.FloatPixelData = plane.tobytes()
        del dataset.PixelData
        pydicom.dcmwrite(tmp_path / f"{z}.dcm", dataset, enforce_file_format=True)
    volume = read_volume(tmp_path)
    np.testing.assert_array_equal(volume.values, values)
    assert volume.values.dtype == np.float32


def test_a_read_needs_little_more_memory_than_the_volume(tmp_path, save_stack):
    import tracemalloc

    save_stack(tmp_path, range(20), (512, 512))
    read_volume(tmp_path)  # what libraries keep for good
    tracemalloc.start()
    volume = read_volume(tmp_path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    slice_bytes = volume.values[0].nbytes
    assert peak < volume.values.nbytes + 4 * slice_bytes
