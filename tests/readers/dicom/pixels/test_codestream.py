# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames that are cut off or lie about their size are refused, though the decoders give a picture for them."""

from __future__ import annotations

import numpy as np
import pytest
from compressed_frames import J2K, JPEG_LS, LOSSLESS_JPEG, compressed, j2k, jpeg_ls, lossless_jpeg

from ctmc_addon.core import ReadError
from ctmc_addon.readers import read_volume
from ctmc_addon.readers.dicom.pixels.codestream import codestream_size, frame_damage


@pytest.fixture
def save_compressed(tmp_path, save_slice):
    """Three slices of one frame each; the second one as given."""

    def save(syntax, frame, damaged, shape):
        for number in range(3):
            path = tmp_path / f"{number}.dcm"
            save_slice(path, np.zeros(shape, np.uint16), (0, 0, number), InstanceNumber=number)
            compressed(path, syntax, damaged if number == 1 else frame)
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
