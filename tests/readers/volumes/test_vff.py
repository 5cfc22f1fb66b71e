# SPDX-License-Identifier: GPL-3.0-or-later
"""VFF: big-endian values behind a text header."""

import numpy as np
import pytest

from ctmc_addon.core import CtmcError
from ctmc_addon.readers import open_volume, read_volume

VALUES = np.random.default_rng(0).integers(-1000, 3000, (4, 5, 6)).astype(np.int16)
HEADER = (
    "ncaa\nrank=3;\ntype=raster;\nformat=slice;\nbits=16;\nbands=1;\nsize=6 5 4;\n"
    "spacing=1.0 1.0 2.0;\norigin=0.0 0.0 0.0;\nelementsize=0.045;\ntitle=a bone;\n"
)


def saved(path, values=VALUES, header=HEADER, end=b"\f\n"):
    path.write_bytes(header.encode() + end + values.astype(values.dtype.newbyteorder(">")).tobytes())
    return path


@pytest.mark.parametrize(
    ("bits", "dtype", "end"), [(8, "u1", b"\f\n"), (16, "i2", b"\f\n"), (16, "i2", b"\f"), (32, "f4", b"\f\n")]
)
def test_values_and_spacing(tmp_path, bits, dtype, end):
    values = (VALUES % 200).astype(dtype)
    volume = read_volume(saved(tmp_path / "ct.vff", values, HEADER.replace("bits=16", f"bits={bits}"), end))
    np.testing.assert_array_equal(volume.values, values)
    assert volume.values.dtype == np.dtype(dtype)
    np.testing.assert_allclose(volume.spacing, (0.045, 0.045, 0.09))
    assert any("VFF has no orientation" in note for note in volume.notes)
    assert any("floating point" in note for note in volume.notes) == (bits == 32)


@pytest.mark.parametrize("end", [b"\f", b"\f\n", b"\f\r\n"])
@pytest.mark.parametrize("first", [10, 13, 0x0A0D, 0x0D0A])
def test_values_begin_behind_the_line_of_the_form_feed(tmp_path, end, first):
    values = VALUES.copy()
    values[0, 0, 0] = first
    path = saved(tmp_path / "ct.vff", values, end=end)
    np.testing.assert_array_equal(read_volume(path).values, values)


def test_a_field_without_a_value_ends_with_its_line(tmp_path):
    header = HEADER.replace("bits=16", "title=\nbits=16")
    np.testing.assert_array_equal(read_volume(saved(tmp_path / "ct.vff", header=header)).values, VALUES)


def test_the_first_bytes_tell_the_format(tmp_path):
    assert open_volume(saved(tmp_path / "bone")).format == "VFF"


def test_scale_and_offset_are_applied_with_a_note(tmp_path):
    scaled = HEADER + "data_scale=2.0;\ndata_offset=-100.0;\n"
    volume = read_volume(saved(tmp_path / "ct.vff", header=scaled))
    np.testing.assert_array_equal(volume.values, VALUES.astype(int) * 2 - 100)
    assert "the file's data_scale 2 and data_offset -100 are applied" in volume.notes


def test_a_file_without_the_size_of_its_elements_has_no_spacing(tmp_path):
    volume = read_volume(saved(tmp_path / "ct.vff", header=HEADER.replace("elementsize=0.045;\n", "")))
    assert volume.spacing == (1, 1, 1)
    assert any("VFF has no spacing" in note for note in volume.notes)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("bits=16", "bits=12", "values of 12 bits, and 8, 16 and 32 are read"),
        ("bits=16", "bits=x", "'x' as bits"),
        ("bands=1", "bands=3", "3 numbers a voxel"),
        ("size=6 5 4", "size=6 5", "sizes \\(6, 5\\)"),
        ("size=6 5 4", "size=6 5 1", "only one slice"),
        ("size=6 5 4", "size=6 5 400", "truncated"),
        ("bands=1", "bands=1;\ndata_scale=1e300", "data_scale of 1e\\+300"),
        ("elementsize=0.045", "elementsize=zero", "'zero' as elementsize, not a number"),
        ("elementsize=0.045", "elementsize=0", "spacing of 0 x 0 x 0 mm"),
    ],
)
def test_a_wrong_header_is_refused_by_name(tmp_path, old, new, sentence):
    with pytest.raises(CtmcError, match=rf"ct\.vff.*{sentence}"):
        read_volume(saved(tmp_path / "ct.vff", header=HEADER.replace(old, new)))


def test_a_header_without_end_is_refused(tmp_path):
    with pytest.raises(CtmcError, match="its header has no end"):
        read_volume(saved(tmp_path / "ct.vff", values=np.ones((4, 5, 6), np.int16), end=b"\n"))
