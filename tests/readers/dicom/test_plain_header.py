# SPDX-License-Identifier: GPL-3.0-or-later
"""The header of plain slices against pydicom's, whatever was changed in it."""

from __future__ import annotations

import random

import numpy as np
import pydicom
import pytest
from fuzz.dicom_seeds import J2K, RLE, dicom
from fuzz.mutations import change_dicom_element, mutated

from ctmc_addon.core import ReadError, finish
from ctmc_addon.readers import open_volume, read_volume
from ctmc_addon.readers.dicom import plain_header
from ctmc_addon.readers.dicom.header import KEYWORDS, ImageFile, PlainSlices, read_other, read_plain
from ctmc_addon.readers.dicom.plain_header import OTHERS, PLAIN, elements_of
from ctmc_addon.readers.optional_imports import quiet

EXPLICIT, IMPLICIT = "1.2.840.10008.1.2.1", "1.2.840.10008.1.2"
REAL = ["dicom_singles", "ge_gantry_tilt", "kits_dupe_positions", "seg_dcmqi/ct-3slice", "ts_dicom_j2k"]
REAL += ["ibsi_lung_tumor/dicom/image", "ircadb01_abdomen", "lidc0314_abdomen30"]


def both(path):
    """The file as it is read by itself, None where pydicom has to look, and as pydicom reads it."""
    with quiet():
        return read_plain(path), read_other(path)


def said(image):
    return vars(image) if isinstance(image, ImageFile) else image


def slice_path(folder, seed):
    seed(folder)
    return folder / "0.dcm"


def test_keywords_and_value_representations_are_the_dictionarys():
    from pydicom.datadict import dictionary_VR, keyword_for_tag

    for tag, (keyword, representation) in PLAIN.items():
        assert keyword_for_tag(tag) == keyword
        assert representation in dictionary_VR(tag)
    assert [keyword_for_tag(tag) for tag in OTHERS] == list(OTHERS.values())
    assert "PatientName" not in KEYWORDS


@pytest.mark.parametrize("seed", [dicom(), dicom(IMPLICIT), dicom(compress=RLE), dicom(compress=J2K)])
def test_a_plain_slice_is_read_as_pydicom_reads_it(tmp_path, seed):
    ours, pydicoms = both(slice_path(tmp_path, seed))
    assert isinstance(ours, ImageFile)
    assert said(ours) == said(pydicoms)


@pytest.mark.parametrize("name", REAL)
def test_real_slices_are_plain_and_read_as_pydicom_reads_them(real, name):
    for path in sorted(file for file in real(name).iterdir() if file.is_file())[:8]:
        ours, pydicoms = both(path)
        assert ours is not None or name == "dicom_singles"
        assert ours is None or said(ours) == said(pydicoms)


@pytest.mark.parametrize("seed", [dicom(), dicom(IMPLICIT), dicom(compress=RLE)])
def test_a_changed_slice_is_read_as_pydicom_reads_it_or_left_to_it(tmp_path, seed):
    chance = random.Random(0)
    whole = slice_path(tmp_path, seed).read_bytes()
    changed = tmp_path / "changed.dcm"
    plain = 0
    for number in range(150):
        content = bytearray(whole)
        if number % 2:
            change_dicom_element(chance, content)
        changed.write_bytes(bytes(content) if number % 2 else mutated(chance, whole))
        ours, pydicoms = both(changed)
        if ours is not None:
            plain += 1
            assert said(ours) == said(pydicoms), number
        behind = PlainSlices()  # what is shared with a slice before is not looked at again, and must be as if it were
        assert said(behind.read(tmp_path / "0.dcm"))
        assert [said(behind.read(changed)) for _ in range(2)] == [said(ours)] * 2, number
        assert said(behind.read(tmp_path / "1.dcm")) == said(read_plain(tmp_path / "1.dcm")), number
    assert 30 < plain < 140


@pytest.mark.parametrize("name", REAL)
def test_real_slices_are_read_one_after_the_other_as_each_alone(real, name):
    slices = PlainSlices()
    for path in sorted(file for file in real(name).iterdir() if file.is_file()):
        assert said(slices.read(path)) == said(read_plain(path))


def test_a_slice_laid_out_as_the_one_before_is_compared_and_not_parsed(tmp_path, monkeypatch):
    dicom()(tmp_path)
    parsed = []
    monkeypatch.setattr(plain_header, "elements_of", lambda *words: parsed.append(words) or elements_of(*words))
    slices = PlainSlices()
    images = [slices.read(path) for path in sorted(tmp_path.glob("*.dcm"))]
    assert len(images) == len({image.uid for image in images}) > 2
    assert len({image.frames[0].position for image in images}) == len(images)
    assert len(parsed) == 2  # the groups of the first file
    assert all(image.pixels is images[0].pixels for image in images)


@pytest.mark.parametrize(
    ("keyword", "value"),
    [("Rows", 4), ("BitsStored", 12), ("RescaleIntercept", "-7"), ("SeriesInstanceUID", "1.2.3.9"), ("Modality", "MR")],
)
def test_a_value_that_differs_from_the_slice_before_is_taken(tmp_path, keyword, value):
    dicom()(tmp_path)
    path = tmp_path / "1.dcm"
    dataset = pydicom.dcmread(path)
    before = dataset[keyword].value
    length = len(str(before))
    setattr(dataset, keyword, str(value).ljust(length, "0")[:length] if isinstance(value, str) else value)
    dataset.save_as(path)
    slices = PlainSlices()
    first, second = (slices.read(tmp_path / name) for name in ("0.dcm", "1.dcm"))
    assert isinstance(first, ImageFile)
    assert said(second) == said(both(path)[1])


@pytest.mark.parametrize(
    ("seed", "length"),
    [(dicom(), b"OB\0\0\6\0\0\0"), (dicom(IMPLICIT), b"\6\0\0\0"), (dicom(compress=RLE), b"OB\0\0\6\0\0\0")],
)
def test_padding_behind_the_pixels_is_passed_over_where_it_is_whole(tmp_path, seed, length):
    whole = slice_path(tmp_path, seed).read_bytes()
    padding = (b"\xfc\xff\xfc\xff" + length + bytes(6)) * 2
    changed = tmp_path / "changed.dcm"
    plain = []
    for count in range(len(padding) + 1):
        changed.write_bytes(whole + padding[:count])
        ours, pydicoms = both(changed)
        if ours is not None:
            plain.append(count)
            assert said(ours) == said(pydicoms), count
    assert plain == [0, len(padding) // 2]


def nested_slices(folder, syntax):
    """Write two slices of each of two series, laid out alike, with sequences of all lengths; return their bytes."""
    dicom(syntax)(folder)
    contents = []
    for number in range(4):
        dataset = pydicom.dcmread(folder / f"{number}.dcm")
        dataset.ImageType, dataset.ContentTime, dataset.TriggerTime = ["ORIGINAL", "AXIAL"], f"12000{number}", number
        dataset.NumberOfFrames, dataset.SeriesInstanceUID = 1, f"1.2.3.4{number // 2}"
        dataset.BitsStored, dataset.HighBit = 12, 11
        dataset.add_new("PixelPaddingValue", "US", 60 + number)
        dataset.private_block(0x0009, "MAKER", create=True).add_new(1, "UN", b"\x28\0\x10\0US\x02\0\x09\0")
        inner, outer = pydicom.Dataset(), pydicom.Dataset()
        inner.Rows, outer.ReferencedImageSequence = 7, [inner, inner]
        dataset.SourceImageSequence, dataset.ReferencedStudySequence = [outer, outer], [outer]
        dataset["ReferencedStudySequence"].is_undefined_length = outer.is_undefined_length_sequence_item = True
        dataset.save_as(folder / f"{number}.dcm")
        contents.append((folder / f"{number}.dcm").read_bytes())
    return contents


@pytest.mark.parametrize("syntax", [EXPLICIT, IMPLICIT])
def test_slices_in_any_order_are_read_as_each_alone(tmp_path, syntax):
    """Among the slices of two series are some with another byte anywhere before the pixels, and some that are cut."""
    chance = random.Random(0)
    whole = nested_slices(tmp_path, syntax)
    paths = [tmp_path / f"{number}.dcm" for number in range(4)]
    alone = [said(read_plain(path)) for path in paths]
    end = alone[0]["pixels"].start
    changed = tmp_path / "changed.dcm"
    slices, compared, plain = PlainSlices(), 0, 0
    for at in range(0, end, 2):
        number = chance.randrange(4)
        assert said(slices.read(paths[number])) == alone[number]
        layout = slices.headers.layout
        content = bytearray(chance.choice(whole))
        content[at] = chance.choice((content[at] ^ 1, (content[at] + 2) % 256, 0, *b" 019."))
        changed.write_bytes(content[: chance.randrange(len(content))] if at % 16 == 0 else content)
        expected = said(read_plain(changed))
        assert said(slices.read(changed)) == expected, at
        plain += expected is not None
        compared += expected is not None and slices.headers.layout.starts is layout.starts
    assert plain > 0.3 * end / 2
    assert compared > 0.8 * plain


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
        ours, pydicoms = both(path)
        assert ours is None or said(ours) == said(pydicoms)
    if bits != 32:
        number = f"{keyword} is 0" if keyword == "Rows" else "BitsAllocated is 0"
        with pytest.raises(ReadError, match=rf"\({number}, and it must be .*\); export it again"):
            read_volume(tmp_path)


def test_sequences_of_any_length_are_passed_over(tmp_path):
    """A value within a sequence is not the file's own, at whatever depth and however its end is told."""
    path = slice_path(tmp_path, dicom())
    for undefined in (True, False):
        dataset = pydicom.dcmread(path)
        inner, outer = pydicom.Dataset(), pydicom.Dataset()
        inner.Rows, outer.ReferencedImageSequence = 7, [inner, inner]
        outer.is_undefined_length_sequence_item = undefined
        dataset.SourceImageSequence = [outer]
        dataset["SourceImageSequence"].is_undefined_length = undefined
        dataset.save_as(tmp_path / "nested.dcm")
        ours, pydicoms = both(tmp_path / "nested.dcm")
        assert said(ours) == said(pydicoms)
        assert ours.rows == dataset.Rows != 7


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
