# SPDX-License-Identifier: GPL-3.0-or-later
"""Folders of masks: files or DICOM folders, one for each structure, as one label volume."""

from __future__ import annotations

import tracemalloc
import warnings

import nibabel
import numpy as np
import pytest
from volumes import label_mask

from ctmc_addon.core import CtmcError, finish
from ctmc_addon.core.volume import ValuesInMemory
from ctmc_addon.readers import open_volume, read_volume
from ctmc_addon.readers.labels.label_map import LabelMap
from ctmc_addon.readers.labels.masks import painted_steps

SHAPE = (6, 5, 7)  # slices, rows, columns
AFFINE = np.array([[-0.8, 0, 0, 10], [0, -0.8, 0, 20], [0, 0, 2.5, -30], [0, 0, 0, 1.0]])


def said(volume, text):
    return any(text in note for note in volume.notes)


def save(path, mask, dtype=np.uint8, affine=AFFINE):
    path.parent.mkdir(parents=True, exist_ok=True)
    nibabel.save(nibabel.Nifti1Image(np.asarray(mask).T.astype(dtype), affine), path)


def boxes():
    liver, spleen = np.zeros((2, *SHAPE), np.uint8)
    liver[1:4, 1:4, 1:5] = 1
    spleen[2:5, 2:5, 3:6] = 1
    return liver, spleen


@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.float32])
@pytest.mark.parametrize("inside", [1, 255])
def test_masks_in_files_are_one_label_volume_with_their_names(tmp_path, dtype, inside):
    liver, spleen = boxes()
    folder = tmp_path / "segmentations"
    for name, mask in (("rib_10", 0 * liver), ("spleen", spleen), ("liver", liver), ("rib_9", 0 * liver)):
        save(folder / f"{name}.nii.gz", inside * mask.astype(int), dtype)
    (folder / "statistics.json").write_text("{}")
    volume = read_volume(folder)
    assert (volume.kind, volume.name, volume.values.dtype) == ("label", "segmentations", np.uint8)
    assert volume.label_names == {1: "liver", 2: "rib_9", 3: "rib_10", 4: "spleen"}
    np.testing.assert_array_equal(label_mask(volume, 1), liver)
    np.testing.assert_array_equal(label_mask(volume, 4), spleen)
    np.testing.assert_allclose(volume.affine, AFFINE, atol=1e-6)
    assert said(volume, "masks overlap and each is kept whole; they share liver and spleen 8 voxels")
    assert said(volume, "2 of 4 masks are empty: rib_9, rib_10")
    source = open_volume(folder)
    assert (source.format, source.series[0].shape, len(source.files)) == ("masks", SHAPE, 4)


@pytest.mark.parametrize("dtype", [np.int8, np.int16, np.float32])
def test_what_is_not_0_is_inside(tmp_path, dtype):
    liver, spleen = boxes()
    liver[0] = 1  # the first slice is all inside, before a value outside was seen
    for name, mask in (("liver", liver), ("spleen", spleen)):
        save(tmp_path / f"{name}.nii", -mask.astype(int), dtype)
    volume = read_volume(tmp_path)
    np.testing.assert_array_equal(label_mask(volume, 1), liver)
    np.testing.assert_array_equal(label_mask(volume, 2), spleen)


@pytest.mark.parametrize(("outside", "inside"), [(0, -1), (-1024, -769), (-769, -1024)])
def test_slices_of_one_value_are_painted_once_the_other_is_known(outside, inside):
    mask = np.zeros(SHAPE, bool)
    mask[:2], mask[3, 1:4, 2:5] = True, True
    values = np.where(mask, inside, outside).astype(np.int16)
    label_map = LabelMap(SHAPE, {1: "liver"}, {}, "liver")
    finish(painted_steps(label_map, ValuesInMemory(values), 1))
    if outside == -769:
        mask = ~mask  # the lower of two values is outside where neither is 0
    np.testing.assert_array_equal(*label_map.layers(), mask)


def test_nrrd_masks_are_read_too(tmp_path):
    import nrrd

    for name, mask in zip(("liver", "spleen"), boxes(), strict=True):
        header = {"space": "left-posterior-superior", "space directions": np.eye(3), "space origin": np.zeros(3)}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # pynrrd's own, with the newest Python
            nrrd.write(str(tmp_path / f"{name}.nrrd"), mask.T, header)
    assert read_volume(tmp_path).label_names == {1: "liver", 2: "spleen"}


def test_a_preview_beside_masks_is_no_slice(tmp_path):
    from PIL import Image

    for name, mask in zip(("liver", "spleen"), boxes(), strict=True):
        save(tmp_path / f"{name}.nii.gz", mask)
    Image.new("RGB", (40, 30)).save(tmp_path / "preview_total.png")
    assert read_volume(tmp_path).label_names == {1: "liver", 2: "spleen"}


def test_masks_on_different_grids_are_refused_in_a_sentence(tmp_path):
    liver, spleen = boxes()
    save(tmp_path / "a" / "liver.nii.gz", liver)
    save(tmp_path / "a" / "spleen.nii.gz", spleen[:, :, 1:])
    with pytest.raises(CtmcError, match="'liver' and 'spleen' in the folder a lie on different grids"):
        open_volume(tmp_path / "a")
    moved = AFFINE.copy()
    moved[0, 3] += 1
    save(tmp_path / "b" / "liver.nii.gz", liver)
    save(tmp_path / "b" / "spleen.nii.gz", spleen, affine=moved)
    with pytest.raises(CtmcError, match="'liver' and 'spleen' in the folder b lie on different grids"):
        read_volume(tmp_path / "b")


def test_a_ct_and_its_labels_in_one_folder_are_no_masks(tmp_path):
    random = np.random.default_rng(0)
    save(tmp_path / "a" / "ct.nii.gz", random.integers(-1000, 1000, SHAPE), np.int16)
    save(tmp_path / "a" / "labels.nii.gz", random.integers(0, 5, SHAPE))
    with pytest.raises(CtmcError, match=r"choose 'ct\.nii\.gz' or 'labels\.nii\.gz' in it"):
        read_volume(tmp_path / "a")
    save(tmp_path / "b" / "volume-1.nii", boxes()[0])
    save(tmp_path / "b" / "segmentation-1.nii", boxes()[1])
    with pytest.raises(CtmcError, match="choose 'segmentation-1"):
        read_volume(tmp_path / "b")


def test_a_file_of_many_labels_among_masks_is_refused_by_name(tmp_path):
    save(tmp_path / "all.nii.gz", np.random.default_rng(0).integers(0, 5, SHAPE))
    save(tmp_path / "liver.nii.gz", boxes()[0])
    with pytest.raises(CtmcError, match=r"'all' .* holds the values 0, [1-4] and 4, so it is not a mask"):
        read_volume(tmp_path)


def test_dicom_masks_in_sibling_folders_are_one_label_volume(tmp_path, save_slice):
    liver, tumor = boxes()
    for name, mask in (("livertumor10", tumor), ("liver", liver), ("livertumor9", 0 * liver)):
        for number, plane in enumerate(mask):
            tags = {"RescaleIntercept": 0, "SeriesInstanceUID": "1.2.3", "InstanceNumber": number + 1}
            save_slice(tmp_path / "MASKS_DICOM" / name / f"image_{number}", 255 * plane, (0, 0, 1.6 * number), **tags)
    volume = read_volume(tmp_path / "MASKS_DICOM")
    assert volume.label_names == {1: "liver", 2: "livertumor9", 3: "livertumor10"}
    np.testing.assert_array_equal(label_mask(volume, 1), liver)
    np.testing.assert_array_equal(label_mask(volume, 3), tumor)
    assert said(volume, "1 of 3 masks is empty: livertumor9")
    alone = read_volume(tmp_path / "MASKS_DICOM" / "liver")
    assert (alone.kind, alone.label_names, alone.notes) == ("label", {255: "liver"}, ())
    np.testing.assert_array_equal(alone.values, 255 * liver.astype(int))


def test_a_dicom_mask_that_keeps_the_intercept_of_its_ct_is_a_mask_too(tmp_path, save_slice):
    for name, mask in zip(("liver", "spleen"), boxes(), strict=True):
        for number, plane in enumerate(mask):
            save_slice(
                tmp_path / name / f"{number}", 255 * plane, (0, 0, 1.6 * number), SeriesInstanceUID=f"1.{len(name)}"
            )
    volume = read_volume(tmp_path)
    assert [set(np.unique(layer.values)) for layer in volume.each_layer] == [{0, 1}, {0, 2}]


def test_two_series_of_ct_in_sibling_folders_stay_series(tmp_path, save_stack):
    hu = save_stack(tmp_path / "arterial", range(5), SeriesInstanceUID="1.9.1")
    save_stack(tmp_path / "venous", range(4), SeriesInstanceUID="1.9.2")
    volume = read_volume(tmp_path)
    np.testing.assert_array_equal(volume.values, hu)
    assert volume.kind == "HU"


def test_many_masks_take_the_memory_of_their_layers_and_little_more(tmp_path):
    shape = (200, 256, 256)
    for number in range(6):
        mask = np.zeros(shape, np.uint8)
        mask[number * 30 : number * 30 + 31] = 1
        save(tmp_path / f"organ_{number}.nii.gz", mask)
    read_volume(tmp_path)
    tracemalloc.start()
    volume = read_volume(tmp_path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(volume.each_layer) == 2  # neighbors share a slice
    assert peak < 1.75 * 2 * volume.values.nbytes


@pytest.mark.parametrize("dtype", [np.uint8, np.int16])
@pytest.mark.parametrize(
    ("values", "other", "holds"),
    [
        (np.arange(210).reshape(SHAPE) - 1000, np.int16, "the values -1000, -999 and -791"),
        (np.linspace(0, 1, 210).reshape(SHAPE), np.float32, r"the values 0, 0\.00478\d+ and 1"),
        (np.arange(210).reshape(SHAPE) % 4, np.uint16, "the values 0, 1 and 3"),
    ],
    ids=["CT", "probabilities", "labels"],
)
def test_what_is_no_mask_among_masks_is_named_with_its_values(tmp_path, dtype, values, other, holds):
    liver, spleen = boxes()
    save(tmp_path / "case" / "liver.nii.gz", liver, dtype)
    save(tmp_path / "case" / "spleen.nii.gz", spleen, dtype)
    save(tmp_path / "case" / "more.nii.gz", values, other)
    sentence = rf"^the folder case has 2 masks, and 'more\.nii\.gz' holds {holds}, so it is not a mask; move it out of "
    with pytest.raises(CtmcError, match=sentence + "the folder to read the masks, or choose one file$"):
        read_volume(tmp_path / "case")
    (tmp_path / "case" / "more.nii.gz").rename(tmp_path / "more.nii.gz")
    assert read_volume(tmp_path / "case").label_names == {1: "liver", 2: "spleen"}
