# SPDX-License-Identifier: GPL-3.0-or-later
"""NIfTI, NRRD and NumPy files made to hurt: each is one sentence, or a right volume."""

from __future__ import annotations

import gzip
import struct

import nibabel
import numpy as np
import pytest
from refusals import refused

from ctmc_addon.core import CtmcError
from ctmc_addon.readers import open_volume, read_volume

VALUES = np.random.default_rng(0).integers(0, 250, (4, 20, 24)).astype(np.int16)  # (slices, rows, columns)
NRRD = "NRRD0004\ntype: short\ndimension: 3\nsizes: 24 20 4\nendian: little\nencoding: {}\n{}\n"


def nifti(path, **fields):
    """A NIfTI file whose header has other values in some fields."""
    image = nibabel.Nifti1Image(VALUES.T, np.eye(4))
    nibabel.save(image, path.with_suffix(".nii"))
    content = bytearray(path.with_suffix(".nii").read_bytes())
    header = np.frombuffer(content, image.header.template_dtype, 1)
    for name, value in fields.items():
        header[name] = value
    path.write_bytes(gzip.compress(content) if path.suffix == ".gz" else content)
    return path


@pytest.mark.parametrize("offset", [np.nan, np.inf, -np.inf, -1, 0, 347, 1e30])
@pytest.mark.parametrize("name", ["ct.nii", "ct.nii.gz"])
def test_nifti_values_that_begin_nowhere_are_refused(tmp_path, name, offset):
    refused(nifti(tmp_path / name, vox_offset=offset), name)


@pytest.mark.parametrize("slices", [2**62, 792633534417207300, 10**9])
def test_a_nifti_of_more_slices_than_any_memory_is_refused(tmp_path, slices):
    nibabel.save(nibabel.Nifti2Image(VALUES.T, np.eye(4)), tmp_path / "ct.nii")
    content = bytearray((tmp_path / "ct.nii").read_bytes())
    content[40:48] = slices.to_bytes(8, "little")
    (tmp_path / "ct.nii").write_bytes(content)
    with pytest.raises(CtmcError, match=r"ct\.nii"):
        read_volume(tmp_path / "ct.nii")


def test_a_nifti_header_extension_is_not_unpacked_without_end(tmp_path):
    content = bytearray(nifti(tmp_path / "ct.nii", vox_offset=1 << 30).read_bytes())
    content[348:360] = b"\x01\0\0\0" + struct.pack("<ii", (1 << 30) - 352, 6)
    (tmp_path / "big.nii.gz").write_bytes(gzip.compress(bytes(content) + bytes(1 << 24)))
    refused(tmp_path / "big.nii.gz", "big.nii.gz")


@pytest.mark.parametrize("extra", [0, 1000, 3 << 20])
def test_one_changed_bit_in_gzip_is_noticed_however_long_it_unpacks(tmp_path, extra):
    plain = nifti(tmp_path / "ct.nii").read_bytes() + bytes(extra)
    packed = bytearray(gzip.compress(plain, 0))  # stored, so that only the check sum can tell
    path = tmp_path / "packed.nii.gz"
    path.write_bytes(packed)
    np.testing.assert_array_equal(read_volume(path).values, VALUES)
    packed[1000] ^= 1
    path.write_bytes(packed)
    refused(path, "packed.nii.gz")


def test_gzip_that_unpacks_to_far_more_than_its_values_is_refused(tmp_path):
    plain = nifti(tmp_path / "ct.nii").read_bytes()
    (tmp_path / "bomb.nii.gz").write_bytes(gzip.compress(plain + bytes(1 << 27)))
    refused(tmp_path / "bomb.nii.gz", "bomb.nii.gz")


def detached(folder, data_file, encoding="raw"):
    """An `.nhdr` with this data file, beside 4 files of one slice each and one of all."""
    folder.mkdir(exist_ok=True)
    for number, plane in enumerate(VALUES):
        (folder / f"s{number}.raw").write_bytes(plane.tobytes())
    (folder / "all.raw").write_bytes(VALUES.tobytes())
    path = folder / "ct.nhdr"
    path.write_text(NRRD.format(encoding, f"data file: {data_file}"))
    return path


@pytest.mark.parametrize(
    "data_file", ["all.raw", "./all.raw", "s%d.raw 0 3 1", "s%01d.raw 0 3 1 2", "LIST\ns0.raw\ns1.raw\ns2.raw\ns3.raw"]
)
def test_nrrd_data_beside_the_header_is_read(tmp_path, data_file):
    np.testing.assert_array_equal(read_volume(detached(tmp_path / "in", data_file)).values, VALUES)


@pytest.mark.parametrize(
    "data_file",
    ["../secret.raw", "/etc/passwd", "\\\\host\\share\\x.raw", "C:\\x.raw", "c:x.raw", "a/../../secret.raw", "..", "."],
)
def test_nrrd_data_outside_the_headers_folder_is_not_opened(tmp_path, data_file):
    (tmp_path / "secret.raw").write_bytes(VALUES.tobytes())
    refused(detached(tmp_path / "in", data_file), "ct.nhdr", "folder")


@pytest.mark.parametrize(
    "data_file",
    [
        "x%d 0 1000000 1",
        "x%900000000d 1 1 1",
        "p%d.raw 0 1000000000000 1",
        "p%0999999999d.raw 1 4 1",
        "a%s%d.raw 1 4 1",
        "s%d.raw 0 3 0",
        "s%d.raw 3 0 1",
        "s%n.raw 0 3 1",
        "s%d.raw 0 2 1",
        "LIST\n" + "s0.raw\n" * 5,
    ],
)
def test_nrrd_names_of_data_files_are_bounded_by_the_slices(tmp_path, data_file):
    refused(detached(tmp_path, data_file), "ct.nhdr")


@pytest.mark.parametrize(
    ("encoding", "field"),
    [
        ("raw", "line skip: 10000000000000"),
        ("raw", "line skip: -1"),
        ("raw", "byte skip: -5"),
        ("gzip", "byte skip: -1"),
        ("raw", "byte skip: 10000000000000"),
        ("gzip", "byte skip: 10000000000000"),
    ],
)
def test_nrrd_skips_outside_the_file_are_refused(tmp_path, encoding, field):
    data = VALUES.tobytes() if encoding == "raw" else gzip.compress(VALUES.tobytes())
    (tmp_path / "ct.nrrd").write_bytes(NRRD.format(encoding, field + "\n").encode() + data)
    refused(tmp_path / "ct.nrrd", "ct.nrrd")


@pytest.mark.parametrize("number", ["70000", "-40000", "1.5", "x", "9" * 400])
def test_nrrd_numbers_in_words_outside_their_type_are_refused(tmp_path, number):
    words = [str(value) for value in VALUES.ravel()]
    words[7] = number
    (tmp_path / "ct.nrrd").write_text(NRRD.format("ascii", "") + " ".join(words))
    refused(tmp_path / "ct.nrrd", "ct.nrrd")


@pytest.mark.parametrize("value", ["9" * 5000, "9" * 19, "1.5", "-1", "x"])
@pytest.mark.parametrize("key", ["LabelValue", "Layer"])
def test_a_segments_number_that_is_none_is_refused(tmp_path, key, value):
    other = "Layer" if key == "LabelValue" else "LabelValue"
    fields = f"Segment0_{key}:={value}\nSegment0_{other}:=0\nSegment0_Name:=liver\n"
    (tmp_path / "ct.nrrd").write_bytes(NRRD.format("raw", fields).encode() + VALUES.tobytes())
    with pytest.raises(CtmcError) as caught:
        read_volume(tmp_path / "ct.nrrd")
    shown = value[:20] + "..." * (len(value) > 20)
    assert str(caught.value) == (
        f"ct.nrrd has '{shown}' as {key} of segment 0, and a whole number of 18 digits at most belongs there; "
        "export it again"
    )


def test_a_segment_without_a_value_is_passed_over(tmp_path):
    header = NRRD.format("raw", "Segment0_ID:=a\nSegment1_LabelValue:=\nSegment2_LabelValue:=3\nSegment2_Name:=liver\n")
    (tmp_path / "ct.nrrd").write_bytes(header.encode() + VALUES.tobytes())
    assert read_volume(tmp_path / "ct.nrrd").label_names == {3: "liver"}


@pytest.mark.parametrize("shape", [(-10, 10, 10), (True, 10, 10), (0, 10, 10), (10**9, 10**9, 10**9)])
def test_npy_shapes_that_no_volume_has_are_refused(tmp_path, shape):
    with (tmp_path / "ct.npy").open("wb") as file:
        np.lib.format.write_array_header_1_0(file, {"descr": "<i2", "fortran_order": False, "shape": shape})
        file.write(bytes(2000))
    with pytest.raises(Exception, match=r"ct\.npy") as caught:
        read_volume(tmp_path / "ct.npy")
    assert type(caught.value).__module__ == "ctmc_addon.core.errors"


def test_a_deeply_nested_npy_header_is_refused(tmp_path):
    header = b"{'descr': '<i2', 'fortran_order': False, 'shape': " + b"(" * 4000 + b"}"
    (tmp_path / "ct.npy").write_bytes(b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header)
    refused(tmp_path / "ct.npy", "ct.npy", "numpy.save")


def test_a_source_opens_without_its_values(tmp_path):
    source = open_volume(nifti(tmp_path / "ct.nii.gz"))
    assert (source.format, source.has_geometry, source.name, source.files) == (
        "NIfTI",
        True,
        "ct",
        (tmp_path / "ct.nii.gz",),
    )
    assert (source.series[0].shape, source.series[0].dtype) == (VALUES.shape, "int16")
    np.testing.assert_array_equal(source.read().values, VALUES)
