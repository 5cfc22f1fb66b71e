# SPDX-License-Identifier: GPL-3.0-or-later
"""Headers of DICOM slices: the elements that are read, values of the wrong kind, sequences of any length."""

from __future__ import annotations

import numpy as np
import pydicom
import pytest
from fuzz.dicom_seeds import J2K, RLE, dicom
from pydicom.datadict import tag_for_keyword

from ctmc_addon.core import ReadError, finish
from ctmc_addon.readers import open_volume, read_volume
from ctmc_addon.readers.dicom.header import KEYWORDS, ImageFile, read_header
from ctmc_addon.readers.optional_imports import quiet

IMPLICIT = "1.2.840.10008.1.2"
REAL = ["dicom_singles", "ge_gantry_tilt", "kits_dupe_positions", "seg_dcmqi/ct-3slice", "ts_dicom_j2k"]
REAL += ["ibsi_lung_tumor/dicom/image", "ircadb01_abdomen", "lidc0314_abdomen30"]


def test_keywords_are_the_dictionarys_and_none_is_about_the_patient():
    tags = [tag_for_keyword(keyword) for keyword in KEYWORDS]
    assert None not in tags
    assert len(set(tags)) == len(tags)
    assert not [tag for tag in tags if tag >> 16 == 0x0010]


def check_described(path):
    """A header is pydicom's own values of the whole file."""
    with quiet():
        image, dataset = read_header(path), pydicom.dcmread(path)
        assert isinstance(image, ImageFile)
        assert (image.rows, image.columns, image.uid) == (dataset.Rows, dataset.Columns, dataset.SOPInstanceUID)
        assert (image.series, image.modality) == (dataset.SeriesInstanceUID, dataset.Modality)
        if "ImagePositionPatient" in dataset:
            assert image.frames[0].position == tuple(map(float, dataset.ImagePositionPatient))
            assert image.frames[0].slope == float(dataset.get("RescaleSlope", 1))
        assert image.pixels.syntax == dataset.file_meta.TransferSyntaxUID
        content = path.read_bytes()
        if not image.pixels.compressed:
            assert content[image.pixels.start :].startswith(dataset.PixelData)


@pytest.mark.parametrize("seed", [dicom(), dicom(IMPLICIT), dicom(compress=RLE), dicom(compress=J2K)])
def test_a_header_has_pydicoms_values(tmp_path, seed):
    seed(tmp_path)
    check_described(tmp_path / "0.dcm")


@pytest.mark.parametrize("name", REAL)
def test_headers_of_real_slices_have_pydicoms_values(real, name):
    for path in sorted(file for file in real(name).iterdir() if file.is_file())[:8]:
        if not path.name.startswith("LICENSE"):
            check_described(path)


@pytest.mark.parametrize("representation", [0, 1])
@pytest.mark.parametrize(
    ("bits", "keyword", "value"), [(32, "PixelPaddingValue", -2000), (0, "PixelPaddingValue", -2000), (16, "Rows", 0)]
)
def test_wide_padding_and_slices_without_rows_or_bits(tmp_path, bits, keyword, value, representation):
    dicom(IMPLICIT)(tmp_path)
    for path in tmp_path.glob("*.dcm"):
        dataset = pydicom.dcmread(path)
        dataset.BitsAllocated = dataset.BitsStored = bits
        dataset.PixelRepresentation = representation
        dataset.add_new(keyword, "SS" if value < 0 else "US", value)
        dataset.PixelData = bytes(max(2, dataset.Rows * dataset.Columns * bits // 8))
        dataset.save_as(path)
    if bits == 32:
        with quiet():
            headers = [read_header(path) for path in sorted(tmp_path.glob("*.dcm"))]
        padding = -2000 if representation else 63536
        assert {header.pixels.padding for header in headers} == {(padding, padding)}
    else:
        number = f"{keyword} is 0" if keyword == "Rows" else "BitsAllocated is 0"
        with pytest.raises(ReadError, match=rf"\({number}, and it must be .*\); export it again"):
            read_volume(tmp_path)


def test_sequences_of_any_length_are_passed_over(tmp_path):
    """A value within a sequence is not the file's own, at whatever depth and however its end is told."""
    dicom()(tmp_path)
    path = tmp_path / "0.dcm"
    for undefined in (True, False):
        dataset = pydicom.dcmread(path)
        inner, outer = pydicom.Dataset(), pydicom.Dataset()
        inner.Rows, outer.ReferencedImageSequence = 7, [inner, inner]
        outer.is_undefined_length_sequence_item = undefined
        dataset.SourceImageSequence = [outer]
        dataset["SourceImageSequence"].is_undefined_length = undefined
        dataset.save_as(tmp_path / "nested.dcm")
        with quiet():
            assert read_header(tmp_path / "nested.dcm").rows == dataset.Rows != 7


def test_a_number_of_another_value_representation_is_one_sentence(tmp_path, save_slice):
    """A text in PixelRepresentation, from which NumPy's type would be made."""
    for z in range(3):
        save_slice(tmp_path / f"{z}.dcm", np.ones((4, 5), np.uint16), (0, 0, z))
        dataset = pydicom.dcmread(tmp_path / f"{z}.dcm")
        dataset[0x00280103] = pydicom.DataElement(0x00280103, "DS", "0")
        dataset.save_as(tmp_path / f"{z}.dcm")
    with pytest.raises(ReadError, match=r"0\.dcm .*PixelRepresentation is not one whole number, and it must be 0 or 1"):
        read_volume(tmp_path)


@pytest.mark.parametrize("damage", [["16", "16"], "x"])
@pytest.mark.parametrize("keep_open", [False, True])
def test_bits_that_are_no_number_are_one_sentence(tmp_path, save_slice, damage, keep_open):
    for z in range(3):
        save_slice(tmp_path / f"{z}.dcm", np.ones((4, 5), np.uint16), (0, 0, z))
        dataset = pydicom.dcmread(tmp_path / f"{z}.dcm")
        dataset[0x00280101] = pydicom.DataElement(0x00280101, "LO", damage)
        dataset.save_as(tmp_path / f"{z}.dcm")
    source = open_volume(tmp_path)
    words = r"0\.dcm .*BitsStored is not one whole number, and with BitsAllocated 16 it must be from 1 to 16"
    with pytest.raises(ReadError, match=words):
        finish(source.slabs_steps() if keep_open else source.read_steps())
