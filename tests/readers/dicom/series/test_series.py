# SPDX-License-Identifier: GPL-3.0-or-later
"""Which files of a DICOM folder make the volume, what is left out and said, and what is refused."""

from __future__ import annotations

import shutil

import numpy as np
import pydicom
import pytest
from pydicom import uid

from ctmc_addon.core import Budget, CtmcError, DamagedSliceError
from ctmc_addon.readers import open_volume, read_volume

AXIAL = (1, 0, 0, 0, 1, 0)


def said(volume, text):
    return any(text in note for note in volume.notes)


def test_the_series_with_most_slices_is_read_and_the_others_are_listed(tmp_path, save_stack):
    small = save_stack(tmp_path / "a", range(3), SeriesInstanceUID="1.9.1")
    large = save_stack(tmp_path / "b" / "deep", range(5), (6, 6), SeriesInstanceUID="1.9.2")
    volume = read_volume(tmp_path)
    np.testing.assert_array_equal(volume.values, large)
    assert said(volume, "2 series found: series 2, with the most slices, was read")
    assert not said(volume, "1.9.")
    assert [(one.number, one.uid, one.slices, one.size, one.modality) for one in open_volume(tmp_path).series] == [
        (1, "1.9.1", 3, (7, 5), "CT"),
        (2, "1.9.2", 5, (6, 6), "CT"),
    ]
    for series in ("1.9.1", 1, "1"):
        np.testing.assert_array_equal(read_volume(tmp_path, series=series).values, small)
    with pytest.raises(CtmcError, match=r"no series '1.9.7'; choose by number from series 1: 3 slices.*series 2"):
        read_volume(tmp_path, series="1.9.7")


def test_scouts_and_other_sizes_are_left_out_and_said(tmp_path, save_stack, save_slice):
    hu = save_stack(tmp_path, range(4))
    save_slice(
        tmp_path / "scout.dcm", np.zeros((5, 7), np.uint16), (0, 0, 50), ImageType=["ORIGINAL", "PRIMARY", "LOCALIZER"]
    )
    save_slice(tmp_path / "large.dcm", np.zeros((9, 9), np.uint16), (0, 0, 4))
    save_slice(tmp_path / "sagittal.dcm", np.zeros((5, 7), np.uint16), ImageOrientationPatient=[0, 1, 0, 0, 0, -1])
    volume = read_volume(tmp_path)
    np.testing.assert_array_equal(volume.values, hu)
    assert said(volume, "1 scout left out")
    assert said(volume, "2 slices of another size")


def test_mr_is_read_and_said(tmp_path, save_stack):
    save_stack(tmp_path, range(3), Modality="MR", RescaleSlope=None, RescaleIntercept=None)
    volume = read_volume(tmp_path)
    assert volume.kind == "gray value"
    assert said(volume, "series is MR, not CT")


@pytest.mark.parametrize(
    "missing", ["Rows", "Columns", "BitsAllocated", "BitsStored", "PhotometricInterpretation", "PixelRepresentation"]
)
def test_a_slice_without_the_size_or_type_of_its_pixels_is_refused(tmp_path, save_stack, missing):
    save_stack(tmp_path, range(3))
    dataset = pydicom.dcmread(tmp_path / "1.dcm")
    del dataset[missing]
    dataset.save_as(tmp_path / "1.dcm")
    with pytest.raises(CtmcError, match=r"1\.dcm .*truncated or damaged"):
        read_volume(tmp_path)


def test_one_file_stands_for_its_series_in_its_folder(tmp_path, save_stack):
    hu = save_stack(tmp_path, range(4))
    save_stack(tmp_path / "other", range(9))
    (tmp_path / "notes.txt").write_text("no slice")
    volume = read_volume(tmp_path / "2.dcm")
    np.testing.assert_array_equal(volume.values, hu)
    assert volume.name == tmp_path.name


def test_one_file_of_a_series_with_a_broken_slice_is_refused(tmp_path, save_stack):
    save_stack(tmp_path, range(4))
    (tmp_path / "3.dcm").write_bytes((tmp_path / "3.dcm").read_bytes()[:140])
    with pytest.raises(CtmcError, match=r"3\.dcm is a truncated or damaged DICOM file \(140 bytes\)"):
        read_volume(tmp_path / "1.dcm")


def test_a_slice_cut_off_anywhere_is_refused_and_never_left_out(tmp_path, save_stack):
    save_stack(tmp_path, range(4))
    whole = (tmp_path / "3.dcm").read_bytes()
    for size in range(132, len(whole), 6):
        (tmp_path / "3.dcm").write_bytes(whole[:size])
        with pytest.raises(CtmcError, match=r"3\.dcm .*truncated"):
            read_volume(tmp_path)


def test_a_broken_file_of_another_series_is_no_hindrance(tmp_path, save_stack):
    hu = save_stack(tmp_path / "ten", range(4), SeriesInstanceUID="1.5.10")
    save_stack(tmp_path / "one", range(3), SeriesInstanceUID="1.5.1")
    broken = tmp_path / "one" / "2.dcm"
    broken.write_bytes(broken.read_bytes()[:-100])
    np.testing.assert_array_equal(read_volume(tmp_path).values, hu)


def test_a_mistaken_series_lists_many_in_part(tmp_path, save_stack):
    for number in range(15):
        save_stack(tmp_path / str(number), range(2 + (number == 13)), SeriesInstanceUID=f"1.5.{number}")
    volume = read_volume(tmp_path)
    assert len(volume.values) == 3
    assert said(volume, "15 series found: series 14, with the most slices, was read")
    with pytest.raises(CtmcError, match="series 12: 2 slices of 7 x 5, CT; and 3 more"):
        read_volume(tmp_path, series=16)


def save_dicomdir(folder):
    """A directory file without records, which is all that a reader who walks the folder may see of it."""
    folder.mkdir()
    meta = pydicom.dataset.FileMetaDataset()
    meta.TransferSyntaxUID = uid.ExplicitVRLittleEndian
    meta.MediaStorageSOPClassUID = uid.MediaStorageDirectoryStorage
    meta.MediaStorageSOPInstanceUID = uid.generate_uid()
    directory = pydicom.Dataset()
    directory.file_meta = meta
    directory.FileSetID, directory.DirectoryRecordSequence = "TEST", []
    pydicom.dcmwrite(folder / "DICOMDIR", directory, enforce_file_format=True)
    return folder


def test_stray_files_and_a_dicomdir_do_no_harm(tmp_path, save_stack):
    hu = save_stack(tmp_path / "IMAGES", range(3))
    disc = save_dicomdir(tmp_path / "disc")
    (tmp_path / "IMAGES").rename(disc / "IMAGES")
    (tmp_path / "disc" / "README.TXT").write_text("made for a test")
    (tmp_path / "disc" / "AUTORUN").write_bytes(b"\x08\x00" + bytes(range(40)))
    (tmp_path / "disc" / "empty").write_bytes(b"")
    for path in (tmp_path / "disc", tmp_path / "disc" / "DICOMDIR"):
        volume = read_volume(path)
        np.testing.assert_array_equal(volume.values, hu)
        assert volume.name == "disc"


NAMES = ["image_{}", "{}.dcm", "IM-0001-{:04d}", "1.2.840.113.{}", "0f1e{:04x}-77aa-4bcd"]
CONTENTS = [b"", b"\0" * 5000, b"\x08\0\x05\0CS", b"not found: the server is busy" * 9]


@pytest.mark.parametrize("content", CONTENTS, ids=["empty", "zeros", "cut off", "a page"])
@pytest.mark.parametrize("name", NAMES)
def test_a_file_named_like_the_slices_that_is_none_is_not_passed_over(tmp_path, save_stack, name, content):
    save_stack(tmp_path / "ct", range(5))
    for number in range(5):
        (tmp_path / "ct" / f"{number}.dcm").rename(tmp_path / "ct" / name.format(number + 8))
    path = tmp_path / "ct" / name.format(10)
    path.write_bytes(content)
    with pytest.raises(CtmcError) as refused:
        read_volume(tmp_path / "ct")
    damage = "named like the slices, but not DICOM" if content else "0 bytes"
    assert str(refused.value) == (
        f"{path.name} is a truncated or damaged DICOM file ({damage}); copy it again, or leave it out with skip_damaged"
    )
    with pytest.raises(CtmcError, match="is a truncated or damaged DICOM file"):
        read_volume(path.with_name(name.format(9)))


def test_a_file_of_another_name_beside_the_slices_is_left_out_and_said(tmp_path, save_stack):
    hu = save_stack(tmp_path, range(3))
    for name in ("VERSION", "broken.dcm", "0.dcm.txt", "1.jpg"):
        (tmp_path / name).write_bytes(b"")
    volume = read_volume(tmp_path)
    np.testing.assert_array_equal(volume.values, hu)
    assert volume.notes == ("2 files left out, named like DICOM or without a suffix, but not DICOM",)


@pytest.mark.parametrize(
    "head", [b"II*\0\x08\0\0\0", b"MM\0*\0\0\0\x08", b"II+\0\x08\0\0\0", b"\x89PNG\r\n", b"NRRD0004\n"]
)
def test_a_slice_without_suffix_that_begins_like_another_format_is_dicom(tmp_path, save_stack, head):
    hu = save_stack(tmp_path, range(3))  # PS3.10 7.1: the preamble may make a TIFF of the file, too
    for file in list(tmp_path.iterdir()):
        file.with_suffix("").write_bytes(head + file.read_bytes()[len(head) :])
        file.unlink()
    np.testing.assert_array_equal(read_volume(tmp_path / "1").values, hu)
    np.testing.assert_array_equal(read_volume(tmp_path).values, hu)


def test_files_without_suffix_or_preamble_are_found(tmp_path, save_stack):
    hu = save_stack(tmp_path, range(3))
    for file in list(tmp_path.iterdir()):
        file.with_suffix("").write_bytes(file.read_bytes()[132:])
        file.unlink()
    np.testing.assert_array_equal(read_volume(tmp_path).values, hu)


def test_no_patient_data_leaves_the_reader(tmp_path, save_stack):
    save_stack(tmp_path, (0, 1, 3, 3), SeriesDescription="Muster liver")
    save_stack(tmp_path / "x", (0, 1), SeriesInstanceUID="1.2.77")
    volume = read_volume(tmp_path)
    with pytest.raises(CtmcError) as caught:
        read_volume(tmp_path, series="9")
    series = open_volume(tmp_path).series
    text = " ".join([*volume.notes, volume.name, str(caught.value), *map(repr, series), *(one.text for one in series)])
    assert "Muster" not in text
    assert "4711" not in text
    assert "1.2.3.4.5" not in " ".join(volume.notes)


def test_series_are_told_apart_on_screen_by_what_the_operator_called_them(tmp_path, save_stack):
    bone = {"SeriesNumber": 4, "SeriesDescription": "THORAX\n  BONE", "ConvolutionKernel": ["B70f", "3"]}
    save_stack(tmp_path / "s1" / "a", (0, 1.5, 3), SeriesInstanceUID="1.9.1", **bone)
    save_stack(tmp_path / "s2", (0, 5), SeriesInstanceUID="1.9.2", SeriesNumber=5, SeriesDescription="x" * 64)
    assert [one.screen_text for one in open_volume(tmp_path).series] == [
        "series 1: 3 slices of 7 x 5, CT, 1.5 mm apart, no. 4, THORAX BONE, B70f 3, in s1/a",
        f"series 2: 2 slices of 7 x 5, CT, 5 mm apart, no. 5, {'x' * 64}, in s2",
    ]
    assert open_volume(tmp_path / "s2").series[0].folder == ""


def test_a_missing_pixel_spacing_is_refused_unless_one_is_given(tmp_path, save_stack):
    save_stack(tmp_path, range(3), PixelSpacing=None)
    with pytest.raises(CtmcError, match=r"no PixelSpacing.*give the spacing"):
        read_volume(tmp_path)
    volume = read_volume(tmp_path, spacing=(0.7, 0.6, 2))
    assert volume.spacing == pytest.approx((0.7, 0.6, 2))
    assert said(volume, "0.7 x 0.6 x 2 mm as asked, where the series has no PixelSpacing and 1 mm between slices")


def test_a_pixel_spacing_of_zero_is_refused(tmp_path, save_stack):
    save_stack(tmp_path, range(3), PixelSpacing=[0, 0])
    with pytest.raises(CtmcError, match=r"PixelSpacing of 0 mm.*from 1e-06 to 10000 mm"):
        read_volume(tmp_path)
    assert said(read_volume(tmp_path, spacing=1), "1 x 1 x 1 mm as asked, where the series has a PixelSpacing of 0 mm")


def test_slices_without_positions_are_refused(tmp_path, save_stack):
    save_stack(tmp_path, range(3), ImagePositionPatient=None)
    with pytest.raises(CtmcError, match=r"none of the 3 slices.*ImagePositionPatient"):
        read_volume(tmp_path)


def test_one_slice_only_is_refused(tmp_path, save_stack):
    save_stack(tmp_path, (4,))
    with pytest.raises(CtmcError, match=r"only one slice.*at least 2 slices"):
        read_volume(tmp_path)


@pytest.mark.parametrize("keep", [140, 300, 0.5, 0.99])
@pytest.mark.parametrize("compress", [None, uid.RLELossless])
def test_a_truncated_slice_is_refused_by_name(tmp_path, save_stack, keep, compress):
    save_stack(tmp_path, range(3), (20, 30), compress=compress)
    file = tmp_path / "1.dcm"
    whole = file.read_bytes()
    file.write_bytes(whole[: keep if keep > 1 else int(len(whole) * keep)])
    with pytest.raises(CtmcError, match=r"1\.dcm.*(truncated|damaged).*copy it again"):
        read_volume(tmp_path)


def test_noise_with_a_dicom_name_is_refused(tmp_path):
    file = tmp_path / "noise.dcm"
    file.write_bytes(np.random.default_rng(3).bytes(5000))
    with pytest.raises(CtmcError, match=r"noise.dcm is not a DICOM image"):
        read_volume(file)
    with pytest.raises(CtmcError, match=r"none is a DICOM image"):
        read_volume(tmp_path)
    file.write_bytes(bytes(128) + b"DICM" + np.random.default_rng(3).bytes(5000))
    for path in (file, tmp_path):
        with pytest.raises(CtmcError, match=r"noise.dcm is a truncated or damaged DICOM file \(5132 bytes\)"):
            read_volume(path)


def test_a_folder_of_dicom_without_images_is_refused(tmp_path):
    from pydicom.dataset import Dataset, FileMetaDataset

    report = Dataset()
    report.file_meta = FileMetaDataset()
    report.file_meta.TransferSyntaxUID = uid.ExplicitVRLittleEndian
    report.SOPClassUID, report.SOPInstanceUID, report.Modality = uid.BasicTextSRStorage, uid.generate_uid(), "SR"
    report.file_meta.MediaStorageSOPClassUID = report.SOPClassUID
    report.file_meta.MediaStorageSOPInstanceUID = report.SOPInstanceUID
    pydicom.dcmwrite(tmp_path / "report.dcm", report, enforce_file_format=True)
    with pytest.raises(CtmcError, match=r"1 file, and none is a DICOM image"):
        read_volume(tmp_path)


def test_color_images_are_refused(tmp_path, save_slice):
    for z in range(2):
        tags = {
            "SamplesPerPixel": 3,
            "PhotometricInterpretation": "RGB",
            "PlanarConfiguration": 0,
            "Rows": 2,
            "Columns": 2,
        }
        save_slice(tmp_path / f"{z}.dcm", np.zeros((2, 6), np.uint8), (0, 0, z), **tags)
    with pytest.raises(CtmcError, match="2 color images are not CT"):
        read_volume(tmp_path)


def test_a_look_up_table_in_place_of_a_slope_is_refused(tmp_path, save_stack):
    from pydicom.dataset import Dataset

    table = Dataset()
    table.LUTDescriptor, table.LUTData = [4, 0, 16], bytes(8)
    table["LUTData"].VR = "OW"
    save_stack(tmp_path, range(2), ModalityLUTSequence=[table])
    with pytest.raises(CtmcError, match="look-up table"):
        read_volume(tmp_path)


def test_a_missing_codec_is_named_with_its_syntax(tmp_path, save_stack, monkeypatch):
    save_stack(tmp_path, range(2), (40, 40), compress=uid.JPEG2000Lossless)
    from pydicom.pixels.decoders import JPEG2000LosslessDecoder

    monkeypatch.setattr(type(JPEG2000LosslessDecoder), "is_available", property(lambda self: False))
    with pytest.raises(CtmcError, match=r"'JPEG 2000 Image Compression \(Lossless Only\)'.*pylibjpeg-openjpeg"):
        read_volume(tmp_path)


def test_an_unknown_syntax_is_named(tmp_path, save_stack):
    save_stack(tmp_path, range(2))
    for file in tmp_path.iterdir():
        dataset = pydicom.dcmread(file)
        dataset.file_meta.TransferSyntaxUID = uid.MPEG2MPML
        dataset["PixelData"].VR = "OB"
        dataset.PixelData = pydicom.encaps.encapsulate([dataset.PixelData])
        pydicom.dcmwrite(file, dataset, enforce_file_format=True)
    with pytest.raises(CtmcError, match=r"MPEG2.*cannot decode"):
        read_volume(tmp_path)


def test_a_volume_beyond_the_memory_is_refused_before_it_is_read(tmp_path, save_stack, monkeypatch):
    save_stack(tmp_path, range(3))
    monkeypatch.setattr(
        "ctmc_addon.readers.dicom.pixels.stored.stored_frames", lambda *_: pytest.fail("a slice was read")
    )
    with pytest.raises(CtmcError, match=r"7 x 5 x 3.*memory"):
        read_volume(tmp_path, budget=Budget(bytes=100))


def test_copies_of_a_slice_in_other_folders_change_nothing(tmp_path, save_stack):
    hu = save_stack(tmp_path / "a", range(3))
    shutil.copytree(tmp_path / "a", tmp_path / "copy")
    np.testing.assert_array_equal(read_volume(tmp_path).values, hu)


def test_a_series_of_pictures_without_places_is_never_preferred(tmp_path, save_stack):
    hu = save_stack(tmp_path / "ct", range(3))
    save_stack(tmp_path / "pictures", range(9), SeriesInstanceUID="1.2.9", ImagePositionPatient=None)
    np.testing.assert_array_equal(read_volume(tmp_path).values, hu)
    assert [one.slices for one in open_volume(tmp_path).series] == [3, 9]


def test_a_file_of_a_smaller_group_chooses_its_own_group(tmp_path, save_stack, save_slice):
    save_stack(tmp_path, range(5))
    for z in range(3):
        save_slice(tmp_path / f"wide{z}.dcm", np.full((8, 9), z, np.uint16), (0, 0, z))
    assert read_volume(tmp_path / "wide1.dcm").size == (9, 8, 3)


def test_values_not_in_hu_are_said(tmp_path, save_stack):
    save_stack(tmp_path, range(3), RescaleType="US")
    volume = read_volume(tmp_path)
    assert volume.kind == "gray value"
    assert said(volume, "not in HU")


def turned_slices(folder, save_slice, degrees, count=20):
    for number in range(count):
        turn = np.radians(degrees * number)
        save_slice(
            folder / f"{number}.dcm",
            np.ones((4, 5), np.uint16),
            (0, 0, 2 * number),
            InstanceNumber=number + 1,
            ImageOrientationPatient=[
                f"{value:.9f}" for value in (np.cos(turn), np.sin(turn), 0, -np.sin(turn), np.cos(turn), 0)
            ],
        )


@pytest.mark.parametrize(
    ("degrees", "count", "one", "most"),
    [(0.1, 20, "0.1", "1.9"), (0.1, 2, "0.1", "0.1"), (5, 20, "5", "95"), (0.003, 40, "0.003", "0.12")],
)
def test_slices_that_turn_are_refused_for_their_turn(tmp_path, save_slice, degrees, count, one, most):
    turned_slices(tmp_path, save_slice, degrees, count)
    with pytest.raises(CtmcError) as caught:
        read_volume(tmp_path)
    assert str(caught.value) == (
        f"the {count} slices turn: ImageOrientationPatient differs by {one} degrees from one to the next and by {most} "
        f"degrees between 0.dcm and {count - 1}.dcm, and slices of one volume differ by at most 0.006 degrees; "
        "resample the series to parallel slices (MPR) and export these"
    )


def test_frames_that_turn_are_refused_for_their_turn(tmp_path, save_frames):
    dataset = save_frames(tmp_path / "ct.dcm", np.ones((6, 4, 5), np.uint16), [(0, 0, z) for z in range(6)])
    for number, frame in enumerate(dataset.PerFrameFunctionalGroupsSequence):
        turn = np.radians(0.1 * number)
        item = pydicom.Dataset()
        item.ImageOrientationPatient = [1, 0, 0, 0, round(np.cos(turn), 9), round(np.sin(turn), 9)]
        frame.PlaneOrientationSequence = [item]
    dataset.save_as(tmp_path / "ct.dcm")
    with pytest.raises(CtmcError, match=r"6 slices turn: .* 0\.5 degrees between ct\.dcm frame 1 and ct\.dcm frame 6"):
        read_volume(tmp_path / "ct.dcm")


def test_stacks_of_three_directions_are_read_as_the_first(tmp_path, save_slice):
    ways = [(1, 0, 0, 0, 1, 0), (1, 0, 0, 0, 0, -1), (0, 1, 0, 0, 0, -1)]
    for number in range(9):
        place = [0.0, 0.0, 0.0]
        place[(2, 1, 0)[number // 3]] = number
        tags = {"ImageOrientationPatient": list(ways[number // 3]), "InstanceNumber": number + 1}
        save_slice(tmp_path / f"{number}.dcm", np.full((4, 5), number, np.uint16), place, RescaleIntercept=0, **tags)
    volume = read_volume(tmp_path)
    assert volume.values[:, 0, 0].tolist() == [0, 1, 2]
    assert "6 slices of another size, orientation or spacing left out" in volume.notes


def test_a_series_is_read_without_its_damaged_slices_if_asked(tmp_path, save_stack):
    hu = save_stack(tmp_path, range(0, 60, 2))
    file = tmp_path / "16.dcm"
    file.write_bytes(file.read_bytes()[:-30])
    with pytest.raises(DamagedSliceError, match=r"16\.dcm .*, or leave it out with skip_damaged$"):
        read_volume(tmp_path)
    volume = read_volume(tmp_path, skip_damaged=True)
    assert volume.size == (7, 5, 30)
    assert volume.spacing == (0.5, 0.8, 2.0)
    np.testing.assert_array_equal(np.delete(volume.values, 16, axis=0), np.delete(hu, 16, axis=0))
    np.testing.assert_array_equal(volume.values[16], np.rint((hu[15].astype(float) + hu[17]) / 2))
    assert volume.notes == (
        "slice 17 of 30, by file name, is damaged and was left out; the gap was filled by linear interpolation",
        "the gaps between slices are uneven (2 and 4 mm): 29 slices were resampled linearly to 30, 2 mm apart",
    )
    with pytest.raises(CtmcError, match=r"uneven \(2 and 4 mm\) and strict"):
        read_volume(tmp_path, skip_damaged=True, strict=True)


def test_damaged_slices_at_the_end_leave_no_gap_and_many_in_a_row_too_wide_a_one(tmp_path, save_stack):
    hu = save_stack(tmp_path, range(12))
    for number in (10, 11):
        (tmp_path / f"{number}.dcm").write_bytes(b"")
    volume = read_volume(tmp_path, skip_damaged=True)
    np.testing.assert_array_equal(volume.values, hu[:10])
    note = "slices 11 and 12 of 12, by file name, are damaged and were left out; no gap remains within the stack"
    assert volume.notes == (note,)
    for number in (3, 4, 5):
        (tmp_path / f"{number}.dcm").write_bytes(b"")
    with pytest.raises(CtmcError, match=r"gap of 4 mm between 2\.dcm .* is more than 3 times the median gap"):
        read_volume(tmp_path, skip_damaged=True)
