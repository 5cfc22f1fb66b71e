# SPDX-License-Identifier: GPL-3.0-or-later
"""A CT and the masks of its organs below one folder: which series is read, and where its labels are found."""

from __future__ import annotations

import numpy as np
import pytest

from ctmc_addon.readers import labels_beside, open_volume, read_volume, series_names, volume_name, volume_place
from ctmc_addon.readers.dicom.series import mask_series

ORGANS = ("artery", "liver", "portalvein")


@pytest.fixture
def save_patient(save_stack, save_slice):
    """Write a CT and masks in folders that sort before its own; returns the CT in HU."""

    def save(root, ct="PATIENT_DICOM", masks="MASKS_DICOM", slices=5, **tags):
        for number, organ in enumerate(ORGANS, 1):
            stored = np.zeros((slices, 5, 7), np.uint8)
            stored[1:-1, number : number + 2, 2:5] = 255
            for z, plane in enumerate(stored):
                place = {"SeriesInstanceUID": f"1.7.{number}", "InstanceNumber": z + 1, "RescaleIntercept": 0}
                save_slice(root / masks / organ / f"image_{z}", plane, (-10, -20, z), **place)
        return save_stack(root / ct, range(slices), SeriesInstanceUID="1.7.9", **tags)

    return save


@pytest.mark.parametrize("masks", ["MASKS_DICOM", "organs", "a Segmentation", "a/labels"])
def test_among_series_of_equal_length_the_ct_comes_before_its_masks(tmp_path, save_patient, masks):
    hu = save_patient(tmp_path, masks=masks)
    volume = read_volume(tmp_path)
    np.testing.assert_array_equal(volume.values, hu)
    assert volume.notes == ("4 series found: series 4, which is not a mask, was read",)
    assert volume.kind == "HU"


def test_a_ct_is_found_by_its_values_if_all_folders_are_named_like_masks(tmp_path, save_patient):
    hu = save_patient(tmp_path, ct="masked/z", masks="masked")
    np.testing.assert_array_equal(read_volume(tmp_path).values, hu)


def test_one_slice_of_each_series_settles_it_and_named_masks_need_none(tmp_path, save_patient, monkeypatch):
    looked = []
    middle_is_mask_steps = mask_series.middle_is_mask_steps

    def counted(slices):
        looked.append(slices[0].image.series)
        return middle_is_mask_steps(slices)

    monkeypatch.setattr(mask_series, "middle_is_mask_steps", counted)
    save_patient(tmp_path)
    assert open_volume(tmp_path).selected_series(None).number == 4
    assert looked == ["1.7.9"]


def test_no_slice_is_decoded_where_one_series_is_the_longest(tmp_path, save_patient, save_stack, monkeypatch):
    save_patient(tmp_path)
    hu = save_stack(tmp_path / "MASKS_DICOM" / "later", range(6), SeriesInstanceUID="1.8")
    monkeypatch.setattr(mask_series, "middle_is_mask_steps", None)
    assert open_volume(tmp_path).selected_series(None).slices == len(hu)


@pytest.mark.parametrize("series", ["PATIENT_DICOM", "patient_dicom", "4", "1.7.9", "THORAX"])
def test_a_series_is_chosen_by_folder_description_number_or_uid(tmp_path, save_patient, series):
    hu = save_patient(tmp_path, SeriesDescription="Thorax")
    np.testing.assert_array_equal(read_volume(tmp_path, series=series).values, hu)
    assert read_volume(tmp_path, series="masks_dicom/liver").kind == "label"


def test_series_have_the_names_that_tell_them_apart(tmp_path, save_patient):
    save_patient(tmp_path, SeriesDescription="Thorax 1.5")
    names = series_names(open_volume(tmp_path).series)
    assert names == ("MASKS_DICOM/artery", "MASKS_DICOM/liver", "MASKS_DICOM/portalvein", "Thorax 1.5")


def test_the_masks_below_the_opened_folder_are_its_labels(tmp_path, save_patient):
    save_patient(tmp_path)
    assert labels_beside(tmp_path) == (tmp_path / "MASKS_DICOM",)
    assert labels_beside(tmp_path / "PATIENT_DICOM") == (tmp_path / "MASKS_DICOM",)
    labels = read_volume(tmp_path / "MASKS_DICOM")
    assert dict(labels.label_names) == {1: "artery", 2: "liver", 3: "portalvein"}


def save_structures(path, referenced):
    """Write the beginning of a structure set that names a frame of reference."""
    path.parent.mkdir(parents=True)
    head = bytes(128) + b"DICM" + b"\x02\x00\x02\x00UI\x1d\x001.2.840.10008.5.1.4.1.1.481.3\x00"
    path.write_bytes(head + b"\x20\x00\x52\x00UI" + len(referenced).to_bytes(2, "little") + referenced)


@pytest.mark.parametrize("opened", ["image", "image/3.dcm"])
def test_labels_in_a_folder_beside_that_of_the_slices_are_found(tmp_path, save_stack, opened):
    patient = tmp_path / "patient7" / "dicom"
    save_stack(patient / "image", range(4))
    save_structures(patient / "rs" / "RS.dcm", b"1.2.3.4.5")
    assert labels_beside(volume_place(patient / opened)) == (patient / "rs" / "RS.dcm",)
    (patient / "rs" / "notes.txt").write_text("a folder of other things")
    assert labels_beside(volume_place(patient / opened)) == ()


def test_the_structures_of_another_patient_beside_the_ct_are_not_its_labels(tmp_path, save_stack):
    for patient, frame in (("A", "1.7.1"), ("B", "1.7.11")):
        save_stack(tmp_path / f"ct_{patient}", range(4), SeriesInstanceUID=f"1.5.{frame}", FrameOfReferenceUID=frame)
        save_structures(tmp_path / f"rt_{patient}" / "RS.dcm", frame.encode())
    assert labels_beside(tmp_path / "ct_A") == (tmp_path / "rt_A" / "RS.dcm",)
    assert labels_beside(tmp_path / "ct_B") == (tmp_path / "rt_B" / "RS.dcm",)


@pytest.mark.parametrize(("folders", "found"), [(10, 1), (11, 0)])
def test_many_folders_beside_that_of_the_slices_are_not_searched(tmp_path, save_stack, folders, found):
    save_stack(tmp_path / "ct", range(4))
    save_structures(tmp_path / "rt" / "RS.dcm", b"1.2.3.4.5")
    for number in range(folders - 1):
        (tmp_path / f"patient{number}").mkdir()
    assert len(labels_beside(tmp_path / "ct")) == found


@pytest.mark.parametrize(
    ("folder", "name"),
    [("tumor/image", "tumor"), ("tumor/dicom/Images", "tumor"), ("tumor/dicom", "dicom"), ("tumor/image_2", "image_2")],
)
def test_a_folder_called_image_is_named_after_the_one_above(tmp_path, save_stack, folder, name):
    save_stack(tmp_path / folder, range(3))
    assert read_volume(tmp_path / folder).name == name
    assert volume_name(tmp_path / folder / "0.dcm") == name
