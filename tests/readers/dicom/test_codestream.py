# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames that are cut off or lie about their size are refused, though the decoders give a picture for them."""

from __future__ import annotations

import numpy as np
import pytest

from ctmc_addon.core import ReadError
from ctmc_addon.readers import read_volume
from ctmc_addon.readers.dicom.codestream import codestream_size, frame_damage

J2K, LOSSLESS_JPEG, JPEG_LS = "1.2.840.10008.1.2.4.90", "1.2.840.10008.1.2.4.70", "1.2.840.10008.1.2.4.80"


def lossless_jpeg(pixels):
    """A 16 bit lossless JPEG (T.81 annex H): every difference to the left neighbor in a category of 16 bits."""
    rows, columns = pixels.shape
    left = np.concatenate([np.roll(pixels[:, :1], 1, 0), pixels[:, :-1]], axis=1).astype(np.int64)
    left[0, 0] = 1 << 15
    differences = ((pixels - left + (1 << 15)) % (1 << 16) - (1 << 15)).ravel()
    sizes = [int(abs(value)).bit_length() for value in differences]
    # Each of the 17 categories is a code of 5 bits.
    bits = "".join(
        f"{size:05b}" + (f"{value if value > 0 else value + (1 << size) - 1:0{size}b}" if 0 < size < 16 else "")
        for value, size in zip(differences.tolist(), sizes, strict=True)
    )
    bits += "1" * (-len(bits) % 8)
    data = int(bits, 2).to_bytes(len(bits) // 8, "big").replace(b"\xff", b"\xff\x00")
    table = b"\x00" + bytes([0, 0, 0, 0, 17, *[0] * 11]) + bytes(range(17))
    return (
        b"\xff\xd8\xff\xc3\x00\x0b\x10"
        + rows.to_bytes(2, "big")
        + columns.to_bytes(2, "big")
        + b"\x01\x01\x11\x00\xff\xc4"
        + (2 + len(table)).to_bytes(2, "big")
        + table
        + b"\xff\xda\x00\x08\x01\x01\x00\x01\x00\x00"
        + data
        + b"\xff\xd9"
    )


def jpeg_ls(pixels):
    """A JPEG-LS picture as pydicom brings one along: nothing here writes them."""
    pydicom = pytest.importorskip("pydicom")
    from pydicom.data import get_testdata_file
    from pydicom.encaps import generate_frames

    path = get_testdata_file("MR_small_jpeg_ls_lossless.dcm", download=False)
    if path is None:
        pytest.skip("this pydicom has no JPEG-LS file")
    dataset = pydicom.dcmread(path)
    return next(generate_frames(dataset.PixelData, number_of_frames=1))


def j2k(pixels):
    utils = pytest.importorskip("openjpeg.utils")
    return utils.encode_array(pixels, photometric_interpretation=2)


@pytest.fixture
def save_compressed(tmp_path, save_slice):
    """Three slices of one frame each; the second one as given."""

    def save(syntax, frame, damaged, shape):
        import pydicom
        from pydicom.encaps import encapsulate

        for number in range(3):
            path = tmp_path / f"{number}.dcm"
            save_slice(path, np.zeros(shape, np.uint16), (0, 0, number), InstanceNumber=number)
            dataset = pydicom.dcmread(path)
            dataset.file_meta.TransferSyntaxUID = syntax
            dataset.PixelData = encapsulate([damaged if number == 1 else frame])
            dataset["PixelData"].VR, dataset["PixelData"].is_undefined_length = "OB", True
            dataset.save_as(path)
        return tmp_path

    return save


KINDS = pytest.mark.parametrize(
    ("syntax", "encoded"), [(J2K, j2k), (LOSSLESS_JPEG, lossless_jpeg), (JPEG_LS, jpeg_ls)], ids=["j2k", "ll", "ls"]
)
PIXELS = np.random.default_rng(0).integers(0, 3000, (64, 64)).astype(np.uint16)


@KINDS
def test_a_whole_frame_is_read(save_compressed, syntax, encoded):
    frame = encoded(PIXELS)
    values = read_volume(save_compressed(syntax, frame, frame, PIXELS.shape)).values
    assert values.shape == (3, 64, 64)
    if syntax != JPEG_LS:
        np.testing.assert_array_equal(values[1], PIXELS.astype(np.int16) - 1024)


@KINDS
def test_a_frame_that_is_cut_off_is_refused(save_compressed, syntax, encoded):
    frame = encoded(PIXELS)
    for share in (0.05, 0.97):
        assert frame_damage(frame[: int(share * len(frame))], 64, 64, 1)
    folder = save_compressed(syntax, frame, frame[: int(0.6 * len(frame))], PIXELS.shape)
    with pytest.raises(ReadError, match=r"1\.dcm .* truncated or damaged"):
        read_volume(folder)


@KINDS
def test_a_frame_of_another_size_is_refused_before_it_is_decoded(save_compressed, syntax, encoded):
    frame = bytearray(encoded(PIXELS))
    rows, columns, samples = codestream_size(bytes(frame))
    assert (rows, columns, samples) == (64, 64, 1)
    at = 12 if syntax == J2K else frame.index(b"\x00\x40\x00\x40")
    frame[at : at + 2] = b"\x7f\xff"
    with pytest.raises(ReadError, match=r"1\.dcm .* header says 64 x 64 x 1"):
        read_volume(save_compressed(syntax, encoded(PIXELS), bytes(frame), PIXELS.shape))


@pytest.mark.parametrize("end", [b"", b"\x00", b"\xff", b"\x00\x00\x00"])
def test_what_fills_a_frame_up_is_no_damage(end):
    assert frame_damage(lossless_jpeg(PIXELS) + end, 64, 64, 1) == ""


def test_frames_of_other_kinds_are_passed_over():
    assert frame_damage(b"\x02\x00\x00\x00" + bytes(100), 64, 64, 1) == ""


@pytest.mark.parametrize(
    "frame", [b"\xff\xd8", b"\xff\xd8\xff\xff\xff\xff", b"\xff\x4f\xff\x51\x00", b"\xff\xd8\xff\xe0\x00\x00"]
)
def test_a_frame_of_a_few_bytes_is_damaged(frame):
    assert frame_damage(frame, 64, 64, 1)
