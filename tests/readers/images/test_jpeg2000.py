# SPDX-License-Identifier: GPL-3.0-or-later
"""Folders of JPEG 2000 slices: values of every depth as they were encoded, by pylibjpeg's OpenJPEG."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from ctmc_addon.core import ReadError
from ctmc_addon.readers import read_volume

openjpeg = pytest.importorskip("openjpeg.utils")


def saved(folder, bits=12, signed=False, codec=0, end="j2k"):
    """Three slices without loss."""
    low = -(1 << bits - 1) if signed else 0
    dtype = np.dtype(f"{'i' if signed else 'u'}{1 if bits <= 8 else 2}")
    values = np.random.default_rng(0).integers(low, low + (1 << bits), (3, 40, 44)).astype(dtype)
    for number, plane in enumerate(values):
        content = openjpeg.encode_array(plane, bits_stored=bits, codec_format=codec)
        (folder / f"s{number}.{end}").write_bytes(bytes(content))
    return values


@pytest.mark.parametrize("bits", [5, 8, 10, 12, 16])
@pytest.mark.parametrize("signed", [False, True])
@pytest.mark.parametrize(("codec", "end"), [(0, "j2k"), (0, "j2c"), (1, "jp2")])
def test_values_of_every_depth_are_those_encoded(tmp_path, bits, signed, codec, end):
    values = saved(tmp_path, bits, signed, codec, end)
    volume = read_volume(tmp_path)
    np.testing.assert_array_equal(volume.values, values)
    assert volume.values.dtype == values.dtype
    assert any("no spacing" in note for note in volume.notes)


@pytest.mark.parametrize("share", [0.3, 0.6, 0.99])
@pytest.mark.parametrize(("codec", "end"), [(0, "j2k"), (1, "jp2")])
def test_a_slice_cut_off_is_refused(tmp_path, share, codec, end):
    saved(tmp_path, codec=codec, end=end)
    path = tmp_path / f"s1.{end}"
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    with pytest.raises(ReadError, match=rf"s1\.{end} is truncated"):
        read_volume(tmp_path)


def test_color_is_refused(tmp_path):
    for number in range(3):
        pixels = np.random.default_rng(number).integers(0, 255, (40, 44, 3)).astype(np.uint8)
        Image.fromarray(pixels).save(tmp_path / f"s{number}.jp2")
    with pytest.raises(ReadError, match="colored"):
        read_volume(tmp_path)


def test_far_more_pixels_than_bytes_are_refused_before_they_are_decoded(tmp_path):
    saved(tmp_path)
    content = bytearray((tmp_path / "s0.j2k").read_bytes())
    content[8:16] = (12000).to_bytes(4, "big") * 2  # Xsiz and Ysiz
    (tmp_path / "s0.j2k").write_bytes(content)
    with pytest.raises(ReadError, match="claims 144000000 pixels"):
        read_volume(tmp_path)
