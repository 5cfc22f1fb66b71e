# SPDX-License-Identifier: GPL-3.0-or-later
"""Headers whose values could be read in two ways, or take without end to be read: refused, or as other readers do."""

from __future__ import annotations

import struct

import nibabel
import numpy as np
import pydicom
import pytest

from ctmc_addon.core import ReadError
from ctmc_addon.readers import read_volume
from ctmc_addon.readers.dicom.header import Broken, read_header
from ctmc_addon.readers.volumes.nifti import NiftiFile, label_table

VALUES = np.random.default_rng(0).integers(0, 250, (4, 20, 24)).astype(np.int16)


def nrrd(path, encoding="raw", endian="endian: little\n", content=None):
    head = f"NRRD0004\ntype: short\ndimension: 3\nsizes: 24 20 4\nencoding: {encoding}\n{endian}spacings: 1 1 2\n\n"
    path.write_bytes(head.encode() + (VALUES.tobytes() if content is None else content))
    return path


@pytest.mark.parametrize("endian", ["", "endian: weird\n", "endian: middle\n"])
def test_nrrd_values_of_unknown_byte_order_are_refused_as_teem_does(tmp_path, endian):
    with pytest.raises(ReadError, match="endian"):
        read_volume(nrrd(tmp_path / "ct.nrrd", endian=endian))


def test_nrrd_text_needs_no_byte_order(tmp_path):
    content = " ".join(map(str, VALUES.ravel())).encode()
    read = read_volume(nrrd(tmp_path / "ct.nrrd", "ascii", "", content))
    np.testing.assert_array_equal(read.values, VALUES)


@pytest.mark.parametrize("word", [b"1_0", b"1" * 100_000, b"0" * 990_000])
def test_a_word_that_is_no_number_is_refused_before_room_is_made_for_it(tmp_path, word):
    content = b"0 " * 400 + word + b" " + b"0 " * 1519
    with pytest.raises(ReadError, match="not a number"):
        read_volume(nrrd(tmp_path / "ct.nrrd", "ascii", content=content))


def test_a_spacing_below_0_turns_an_axis_round_as_in_itk(tmp_path):
    """SimpleITK 2.5.7: GetSpacing() is (1, 1, 2), and GetDirection() has -1 for x."""
    head = "ObjectType = Image\nNDims = 3\nDimSize = 24 20 4\nElementType = MET_SHORT\nElementSpacing = -1 1 2\n"
    (tmp_path / "ct.mha").write_bytes(head.encode() + b"ElementDataFile = LOCAL\n" + VALUES.tobytes())
    np.testing.assert_array_equal(np.diag(read_volume(tmp_path / "ct.mha").affine), [1, -1, 2, 1])


def nifti(path, extension=b"", **fields):
    header = nibabel.Nifti1Image(VALUES.T, np.diag([-0.5, -0.5, 2, 1])).header.copy()
    header["vox_offset"], header["magic"] = 352 + len(extension), b"n+1"
    for field, value in fields.items():
        header[field] = value
    flag = b"\1\0\0\0" if extension else bytes(4)
    path.write_bytes(header.binaryblock + flag + extension + VALUES.tobytes())
    return path


def extension(content, code=0, size=None):
    content = content.ljust(-(-(len(content) + 8) // 16) * 16 - 8)
    return struct.pack("<ii", len(content) + 8 if size is None else size, code) + content


@pytest.mark.parametrize(
    "content",
    [
        extension(b"x" * 8, 2) * 500_000,
        extension(b"<LabelTable>" * 100_000),
        extension(b"\x08\0\x40\x11" + b"\xff" * 4 + b"\xfe\xff\0\xe0" * 5_000, 2),
        extension(b"<LabelTable>" + b"<a>" * 50_000),
    ],
    ids=["many", "tables without end", "DICOM", "deep"],
)
def test_whatever_extensions_hold_the_values_are_read(tmp_path, content):
    """Parsed by nibabel, or searched by a pattern, the first two took longer than anyone waits."""
    np.testing.assert_array_equal(read_volume(nifti(tmp_path / "ct.nii", content)).values, VALUES)


@pytest.mark.parametrize("size", [0, -16, 7, 64, 2**31 - 1, -(2**31)])
def test_an_extension_that_lies_about_its_size_is_refused(tmp_path, size):
    with pytest.raises(ReadError, match=f"extension of {size} bytes"):
        read_volume(nifti(tmp_path / "ct.nii", extension(b"x" * 24, 4, size)))


def test_a_table_in_the_second_extension_names_labels(tmp_path):
    table = b'<Labels><LabelTable><Label Key="1" Red="1" Green="0" Blue="0">liver</Label></LabelTable></Labels>'
    path = nifti(tmp_path / "ct.nii", extension(b"other", 6) + extension(table))
    assert label_table(NiftiFile(path).extensions) == ({1: "liver"}, {1: (255, 0, 0)})


@pytest.mark.parametrize("fields", [{"scl_slope": 3e38, "scl_inter": 3e38}, {"scl_slope": 1, "scl_inter": -1e30}])
def test_a_scale_whose_values_are_infinite_is_refused(tmp_path, fields):
    with pytest.raises(ReadError, match="broken scale"):
        read_volume(nifti(tmp_path / "ct.nii", **fields))


def test_a_dicom_file_with_two_kinds_of_pixels_is_damaged(tmp_path, save_stack):
    save_stack(tmp_path, [0.0, 1.0])
    path = sorted(tmp_path.iterdir())[0]
    dataset = pydicom.dcmread(path)
    dataset.FloatPixelData = bytes(4 * dataset.Rows * dataset.Columns)
    dataset.save_as(path)
    header = read_header(path)
    assert isinstance(header, Broken)
    assert header.damage == "both PixelData and FloatPixelData"


def test_a_frame_longer_than_any_file_is_a_sentence(tmp_path, save_frames):
    """In an Extended Offset Table, of 2**64 - 1 bytes."""
    path = tmp_path / "ct.dcm"
    save_frames(path, VALUES.astype(np.uint16), [(0, 0, z) for z in range(4)])
    dataset = pydicom.dcmread(path)
    dataset.compress("1.2.840.10008.1.2.5", generate_instance_uid=False, encapsulate_ext=True)
    dataset.ExtendedOffsetTableLengths = struct.pack("<Q", 2**64 - 1) * int(dataset.NumberOfFrames)
    dataset.save_as(path)
    with pytest.raises(ReadError, match=r"ct\.dcm"):
        read_volume(path)
