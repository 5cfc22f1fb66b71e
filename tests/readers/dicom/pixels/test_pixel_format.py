# SPDX-License-Identifier: GPL-3.0-or-later
"""Bits above BitsStored are ignored after every decoder, and numbers that no pixels can have are one sentence."""

from __future__ import annotations

import warnings

import numpy as np
import pydicom
import pytest
from compressed_frames import J2K, JPEG_LS, LOSSLESS_JPEG, compressed, j2k, jpeg_ls, lossless_jpeg
from pydicom import uid
from pydicom.encaps import encapsulate, generate_frames
from refusals import refused

from ctmc_addon.core import finish
from ctmc_addon.readers import open_volume, read_volume
from ctmc_addon.readers.dicom.pixels.pixel_format import LOSSY, Pixels, padding_ends, value_bits

OVERLAYS = np.random.default_rng(4).integers(0, 1 << 16, (64, 64)).astype(np.uint16)  # all 16 bits in use
J2K_LOSSY = "1.2.840.10008.1.2.4.91"


@pytest.fixture
def decoded_here(monkeypatch):
    """Decode in this process: another takes a second to start, and gives the same values (decoding/test_process.py)."""
    monkeypatch.setattr("ctmc_addon.readers.decoding.process.interpreter", lambda: None)


def value_of_bits(stored, bits, signed):
    """The low bits as a number, two's complement where it is signed."""
    low = stored.astype(np.int64) % (1 << bits)
    return np.where(signed & (low >= 1 << (bits - 1)), low - (1 << bits), low)


@pytest.mark.usefixtures("decoded_here")
@pytest.mark.parametrize("bits", [8, 12])
@pytest.mark.parametrize("signed", [False, True])
@pytest.mark.parametrize(
    ("syntax", "encoded"),
    [(None, None), (uid.RLELossless, None), (J2K, j2k), (J2K_LOSSY, j2k), (LOSSLESS_JPEG, lossless_jpeg)],
    ids=["raw", "rle", "j2k", "j2k lossy", "jpeg lossless"],
)
def test_overlays_above_the_value_are_ignored_in_every_syntax(tmp_path, save_slice, syntax, encoded, signed, bits):
    tags = {"BitsStored": bits, "PixelRepresentation": int(signed), "RescaleIntercept": 0}
    for z in range(2):
        path = tmp_path / f"{z}.dcm"
        if syntax == uid.RLELossless:
            frame = next(generate_frames(save_slice(path, OVERLAYS, compress=syntax).PixelData, number_of_frames=1))
        else:
            frame = encoded and encoded(OVERLAYS)
        save_slice(path, OVERLAYS, (0, 0, z), **tags)
        if frame:
            compressed(path, syntax, frame)
    source = open_volume(tmp_path)
    for volume in (finish(source.read_steps()), finish(source.slabs_steps())):
        for plane in volume.values:
            np.testing.assert_array_equal(plane, value_of_bits(OVERLAYS, bits, signed))


@pytest.mark.parametrize("bits", [5, 8])
@pytest.mark.parametrize("signed", [False, True])
def test_jpeg_ls_gives_the_values_of_the_same_pixels_stored_plain(tmp_path, save_slice, signed, bits):
    frame = jpeg_ls(OVERLAYS)
    stored = pydicom.dcmread(
        pydicom.data.get_testdata_file("MR_small_jpeg_ls_lossless.dcm", download=False)
    ).pixel_array
    assert stored.max() >= 1 << 8
    tags = {"BitsStored": bits, "PixelRepresentation": int(signed), "RescaleIntercept": 0}
    for z in range(2):
        save_slice(tmp_path / f"{z}.dcm", stored.astype(np.uint16), (0, 0, z), **tags)
    plain = read_volume(tmp_path).values
    np.testing.assert_array_equal(plain[0], value_of_bits(stored.astype(np.uint16), bits, signed))
    for z in range(2):
        compressed(tmp_path / f"{z}.dcm", JPEG_LS, frame)
    np.testing.assert_array_equal(read_volume(tmp_path).values, plain)


@pytest.mark.parametrize("signed", [False, True])
def test_frames_of_an_overlaid_jpeg_2000_file_are_those_of_the_plain_one(tmp_path, save_frames, signed):
    stored = np.stack([OVERLAYS, OVERLAYS[::-1], OVERLAYS.T])
    places = [(0, 0, z) for z in range(3)]
    dataset = save_frames(tmp_path / "ct.dcm", stored, places, BitsStored=12, PixelRepresentation=int(signed))
    plain = read_volume(tmp_path / "ct.dcm").values
    dataset.file_meta.TransferSyntaxUID = J2K
    dataset.PixelData = encapsulate([j2k(np.ascontiguousarray(plane)) for plane in stored])
    dataset["PixelData"].VR, dataset["PixelData"].is_undefined_length = "OB", True
    dataset.save_as(tmp_path / "ct.dcm")
    np.testing.assert_array_equal(read_volume(tmp_path / "ct.dcm").values, plain)
    np.testing.assert_array_equal(plain, value_of_bits(stored, 12, signed) - 1000)


@pytest.mark.parametrize("syntax", ["201", "202", "203", "81", "90", "91"])
@pytest.mark.parametrize(("signed", "value"), [(0, 0x830), (1, 0x830 - 0x1000)])
def test_the_bits_of_a_value_are_found_after_any_decoder(syntax, signed, value):
    options = {"bits_stored": 12, "pixel_representation": signed}
    pixels = Pixels(f"1.2.840.10008.1.2.4.{syntax}", True, False, None, 0, options)
    stored = np.array([[0x5830, 0xF830, 0x0830]], np.uint16).view(np.int16 if signed else np.uint16)
    assert value_bits(stored, pixels).tolist() == [[value] * 3]
    stored.flags.writeable = False
    assert value_bits(stored, pixels).tolist() == [[value] * 3]


@pytest.mark.parametrize("syntax", sorted(LOSSY))
def test_values_that_a_lossy_codec_overshot_do_not_wrap(syntax):
    unsigned = Pixels(syntax, True, False, None, 0, {"bits_stored": 12, "pixel_representation": 0})
    signed = Pixels(syntax, True, False, None, 0, {"bits_stored": 12, "pixel_representation": 1})
    assert value_bits(np.array([[0, 4090, 4096, 4110]], np.uint16), unsigned).tolist() == [[0, 4090, 4095, 4095]]
    stored = np.array([[-2051, -2040, -7, 2000, 2060]], np.int16)
    assert value_bits(stored, signed).tolist() == [[-2048, -2040, -7, 2000, 2047]]


def test_an_overlay_on_air_in_lossy_jpeg_2000_is_ignored(tmp_path, save_slice):
    stored = np.full((64, 64), 1064, np.uint16)
    stored[:16] = 24
    overlaid = stored.copy()
    overlaid[4:8, 10:50] |= 1 << 12
    for z in range(2):
        save_slice(tmp_path / f"{z}.dcm", stored, (0, 0, z), BitsStored=12)
        compressed(tmp_path / f"{z}.dcm", J2K_LOSSY, j2k(overlaid))
    np.testing.assert_array_equal(read_volume(tmp_path).values, np.stack([stored, stored]).astype(np.int16) - 1024)


UNSIGNED = {"bits_stored": 12, "pixel_representation": 0}


def air_and_metal(side=128):
    """Air of 0 to 29 with a saturated block of 30 x 40 pixels, and which pixels it has."""
    stored = np.random.default_rng(5).integers(0, 30, (side, side)).astype(np.uint16)
    metal = np.zeros((side, side), bool)
    metal[20:50, 20:60] = True
    stored[metal] = 4095
    return stored, metal


@pytest.mark.parametrize("syntax", sorted(LOSSY))
def test_an_overlay_on_air_is_ignored_although_the_picture_has_metal(syntax):
    stored, _ = air_and_metal()
    overlaid = stored.copy()
    overlaid[80:90, 10:60] |= 1 << 12  # 500 pixels
    pixels = Pixels(syntax, True, False, None, 0, UNSIGNED)
    np.testing.assert_array_equal(value_bits(overlaid, pixels), stored)
    overlaid = stored.copy()
    overlaid[35] |= 1 << 12  # a line across the metal and the air to both sides
    far = np.ones(stored.shape, bool)
    far[35, :20], far[35, 60:] = np.arange(20) < 3, np.arange(60, 128) > 77
    np.testing.assert_array_equal(value_bits(overlaid, pixels)[far], stored[far])


@pytest.mark.parametrize("syntax", sorted(LOSSY))
@pytest.mark.parametrize("worst", [1, 40, 200])
@pytest.mark.parametrize("signed", [0, 1])
def test_metal_that_a_codec_overshot_stays_metal_beside_overlays(syntax, worst, signed):
    stored, metal = air_and_metal()
    errors = np.random.default_rng(6).integers(-worst, worst + 1, stored.shape)
    decoded = np.where(metal, stored + errors, stored).astype(np.int16)
    decoded[25:30, 25:30] = 4096  # an even part
    expected = np.where(metal, np.minimum(decoded, 4095), stored)
    decoded[80:90, 10:60] |= 1 << 12
    shift = 2048 * signed
    if signed:
        decoded[80:90, 10:60] = stored[80:90, 10:60]
    options = UNSIGNED | {"pixel_representation": signed}
    decoded = (decoded - shift).astype(np.int16 if signed else np.uint16)
    values = value_bits(decoded, Pixels(syntax, True, False, None, 0, options))
    np.testing.assert_array_equal(values.astype(int) + shift, expected)


def test_pixels_of_a_reversible_codestream_are_never_overshot(tmp_path, save_slice):
    stored, _ = air_and_metal()
    overlaid = stored.copy()
    overlaid[10:20, 20:60] |= 1 << 12  # touches the metal
    for z in range(2):
        save_slice(tmp_path / f"{z}.dcm", stored, (0, 0, z), BitsStored=12)
        compressed(tmp_path / f"{z}.dcm", J2K_LOSSY, j2k(overlaid))
    np.testing.assert_array_equal(read_volume(tmp_path).values[1], stored.astype(np.int16) - 1024)


def test_metal_in_lossy_jpeg_2000_stays_metal(tmp_path, save_slice):
    """A codestream of 16 bits goes beyond the 4095 of a saturated implant."""
    stored = np.zeros((64, 64), np.uint16)
    stored[20:40, 20:40] = 4095
    for z in range(2):
        dataset = save_slice(tmp_path / f"{z}.dcm", stored, (0, 0, z), RescaleIntercept=0)
        dataset.compress(uid.JPEG2000, j2k_psnr=[70], generate_instance_uid=False)
        assert dataset.pixel_array.max() > 4095
        dataset.BitsStored, dataset.HighBit = 12, 11
        pydicom.dcmwrite(tmp_path / f"{z}.dcm", dataset, enforce_file_format=True)
    values = read_volume(tmp_path).values
    assert values.max() == 4095
    assert np.abs(values - stored.astype(np.int16)).max() < 256


NUMBERS = [
    ({"BitsAllocated": 4096}, "BitsAllocated is 4096, and it must be 1, 8, 16, 32 or 64"),
    ({"BitsAllocated": 12, "BitsStored": 12}, "BitsAllocated is 12, and it must be 1, 8, 16, 32 or 64"),
    ({"BitsAllocated": 0}, "BitsAllocated is 0, and it must be 1, 8, 16, 32 or 64"),
    ({"BitsStored": 17}, "BitsStored is 17, and with BitsAllocated 16 it must be from 1 to 16"),
    ({"BitsStored": 0, "HighBit": 0}, "BitsStored is 0, and with BitsAllocated 16 it must be from 1 to 16"),
    ({"PixelRepresentation": 7}, "PixelRepresentation is 7, and it must be 0 or 1"),
    ({"SamplesPerPixel": 0}, "SamplesPerPixel is 0, and it must be 1"),
    ({"SamplesPerPixel": 40000}, "SamplesPerPixel is 40000, and it must be 1"),
    ({"NumberOfFrames": -1}, "NumberOfFrames is -1, and it must be 1 or more"),
    ({"Rows": 0}, "Rows is 0, and it must be from 1 to 65535"),
    ({"Columns": 0}, "Columns is 0, and it must be from 1 to 65535"),
]


@pytest.mark.parametrize(("numbers", "sentence"), NUMBERS, ids=[str(numbers) for numbers, _ in NUMBERS])
@pytest.mark.parametrize("kind", ["plain", "rle", "j2k", "frames"])
def test_a_number_that_no_pixels_have_is_said_with_its_limit(
    tmp_path, save_slice, save_frames, kind, numbers, sentence
):
    compress = {"rle": uid.RLELossless, "j2k": uid.JPEG2000Lossless}.get(kind)
    if kind == "frames":
        save_frames(tmp_path / "1.dcm", np.zeros((3, 5, 7), np.uint16), [(0, 0, z) for z in range(3)])
    else:
        for z in range(3):
            save_slice(tmp_path / f"{z}.dcm", np.ones((40, 40), np.uint16), (0, 0, z), compress=compress)
    dataset = pydicom.dcmread(tmp_path / "1.dcm")
    for keyword, value in numbers.items():
        setattr(dataset, keyword, value)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        dataset.save_as(tmp_path / "1.dcm")
    for path in (tmp_path, tmp_path / "1.dcm"):
        other_slices = ", or leave it out with skip_damaged" * (path == tmp_path and kind != "frames")
        expected = f"1.dcm is a truncated or damaged DICOM file ({sentence}); export it again{other_slices}"
        assert refused(path) == expected


@pytest.mark.parametrize("keyword", ["BitsStored", "PixelRepresentation"])
def test_a_number_that_is_missing_is_said(tmp_path, save_stack, keyword):
    save_stack(tmp_path, range(3))
    dataset = pydicom.dcmread(tmp_path / "1.dcm")
    delattr(dataset, keyword)
    dataset.save_as(tmp_path / "1.dcm")
    refused(tmp_path, "1.dcm", f"{keyword} is missing")


@pytest.mark.usefixtures("decoded_here")
@pytest.mark.parametrize(("bits", "high_bit"), [(12, 15), (16, 11), (12, 60000)])
@pytest.mark.parametrize("kind", ["plain", "rle", "j2k", "frames"])
def test_a_high_bit_changes_no_value_and_is_quoted(tmp_path, save_slice, save_frames, kind, bits, high_bit):
    stored = np.random.default_rng(8).integers(0, 4096, (3, 40, 40)).astype(np.uint16)
    compress = {"rle": uid.RLELossless, "j2k": uid.JPEG2000Lossless}.get(kind)
    if kind == "frames":
        save_frames(tmp_path / "0.dcm", stored, [(0, 0, z) for z in range(3)])
    else:
        for z in range(3):
            save_slice(tmp_path / f"{z}.dcm", stored[z], (0, 0, z), compress=compress, RescaleIntercept=-1000)
    for path in tmp_path.iterdir():
        dataset = pydicom.dcmread(path)
        dataset.BitsStored, dataset.HighBit = bits, high_bit
        dataset.save_as(path)
    volume = read_volume(tmp_path / "0.dcm" if kind == "frames" else tmp_path)
    np.testing.assert_array_equal(volume.values, stored.astype(np.int16) - 1000)
    assert f"HighBit is {high_bit} (slices: 3), and with BitsStored {bits} it must be {bits - 1}: " + (
        f"the lowest {bits} bits are the value"
    ) in [note for note in volume.notes if "HighBit" in note]


@pytest.mark.parametrize(("padding", "limit"), [(63536, None), (63536, 63540), (63540, 63536)])
@pytest.mark.parametrize("signed", [0, 1])
def test_padding_with_bits_above_bits_stored_is_padding(tmp_path, save_slice, signed, padding, limit):
    stored = np.random.default_rng(8).integers(0, 2000, (40, 40)).astype(np.uint16)
    stored[:5] = 63536
    padding, limit = (end and end - 65536 * signed for end in (padding, limit))  # elements have the pixels' sign
    tags = {"BitsStored": 12, "PixelRepresentation": signed, "PixelPaddingValue": padding, "RescaleIntercept": -1000}
    for z in range(2):
        save_slice(tmp_path / f"{z}.dcm", stored, (0, 0, z), PixelPaddingRangeLimit=limit, **tags)
    volume = read_volume(tmp_path)
    lowest = int(stored[5:].min()) - 1000
    assert (volume.values[:, :5] == lowest).all()
    np.testing.assert_array_equal(volume.values[1, 5:], stored[5:].astype(np.int16) - 1000)
    assert f"400 padding pixels were set to the lowest value, {lowest}" in volume.notes


def test_a_padding_range_across_the_highest_value_is_not_all_values():
    options = {"bits_allocated": 16, "bits_stored": 12, "pixel_representation": 0}
    ends = padding_ends({"PixelPaddingValue": 4090, "PixelPaddingRangeLimit": 4097}, options)
    assert ends == (4090, 4097)


def test_a_file_without_high_bit_is_read(tmp_path, save_stack):
    hu = save_stack(tmp_path, range(3))
    for path in tmp_path.iterdir():
        dataset = pydicom.dcmread(path)
        del dataset.HighBit
        dataset.save_as(path)
    np.testing.assert_array_equal(read_volume(tmp_path).values, hu)


@pytest.mark.parametrize(
    ("slope", "intercept"), [("0", "0"), ("nan", "0"), ("inf", "0"), ("1", "-1e10"), ("2e9", "0"), ("1", "nan")]
)
@pytest.mark.parametrize("kind", ["plain", "rle", "j2k", "frames"])
def test_a_scale_that_gives_no_values_is_said_with_its_limit(tmp_path, save_slice, save_frames, kind, slope, intercept):
    scale = {"RescaleSlope": slope, "RescaleIntercept": intercept}
    compress = {"rle": uid.RLELossless, "j2k": uid.JPEG2000Lossless}.get(kind)
    path = tmp_path / "ct.dcm"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # pydicom's, of what it is asked to write
        if kind == "frames":
            places = [(0, 0, z) for z in range(3)]
            save_frames(path, np.zeros((3, 5, 7), np.uint16), places, slopes=[slope] * 3, intercepts=[intercept] * 3)
        else:
            for z in range(3):
                name = tmp_path / f"{z}.dcm"
                save_slice(name, np.ones((40, 40), np.uint16), (0, 0, z), compress=compress, **scale)
    text = refused(path if kind == "frames" else tmp_path)
    assert text == (
        f"the series has a RescaleSlope of {float(slope):g} and a RescaleIntercept of {float(intercept):g}, which give "
        "no usable values: the slope must not be 0, and both at most 1e+09; export it again"
    )


def test_frames_and_functional_groups_that_differ_in_number_are_said(tmp_path, save_frames):
    dataset = save_frames(tmp_path / "ct.dcm", np.zeros((4, 5, 7), np.uint16), [(0, 0, z) for z in range(4)])
    dataset.NumberOfFrames = 3
    dataset.save_as(tmp_path / "ct.dcm")
    expected = "ct.dcm is a truncated or damaged DICOM file (4 functional groups for 3 frames); export it again"
    assert refused(tmp_path / "ct.dcm") == expected


def test_a_direction_that_is_no_number_is_not_called_a_position(tmp_path, save_stack):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        save_stack(tmp_path, range(3), ImageOrientationPatient=["nan"] * 6)
    refused(tmp_path, "no image in", "has a position and a direction (ImageOrientationPatient)")
