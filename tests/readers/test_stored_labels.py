# SPDX-License-Identifier: GPL-3.0-or-later
"""Labels that files store with a scale or as floats are the labels that were saved, in every format and way to read."""

import warnings

import nibabel
import numpy as np
import pytest
from volumes import label_mask
from zarr_stores import save_store

from ctmc_addon.core import LabelError, ReconstructionSettings, finish, reconstruct
from ctmc_addon.core.volume import label_extents_steps
from ctmc_addon.readers import open_volume, read_volume

AFFINE = np.diag([0.8, 0.8, 1.5, 1.0])
LABEL_INTENT = 1002  # NIFTI_INTENT_LABEL
NEARLY = "Values that are not whole were read as the nearest label, such as {} as {}."


def organs(dtype=np.float64):
    values = np.zeros((12, 11, 10), dtype)  # x, y, z
    values[1:5, 1:5, 1:5], values[6:11, 1:5, 1:5], values[1:5, 6:11, 6:10] = 1, 6, 117
    return values


def saved(path, values, dtype=None, intent=0, kind=nibabel.Nifti1Image, **header):
    image = kind(values, AFFINE)
    if dtype is not None:
        image.set_data_dtype(dtype)  # nibabel finds the scale
    image.header["intent_code"] = intent
    for field, value in header.items():
        image.header[field] = value
    nibabel.save(image, path)
    return path


def nearly(values):
    return np.where(values == 6, np.float32(5.9999995), values).astype(np.float32)


def slabs_of(path):
    return finish(open_volume(path).slabs_steps())


@pytest.mark.parametrize("read", [read_volume, slabs_of])
@pytest.mark.parametrize("name", ["organs.nii", "organs.nii.gz"])
@pytest.mark.parametrize(
    ("dtype", "note"), [(np.int16, NEARLY.format("6.000412", 6)), (np.uint8, NEARLY.format("0.9176471", 1))]
)
def test_labels_that_nibabel_scales_are_those_that_were_saved(tmp_path, read, name, dtype, note):
    path = saved(tmp_path / name, organs(), dtype)
    assert not np.array_equal(nibabel.load(path).get_fdata(), organs()), "else nothing is tested"
    volume = read(path)
    assert volume.kind == "label"
    np.testing.assert_array_equal(volume.values.T, organs())
    assert [text for text in volume.notes if "whole" in text] == [note]
    assert list(finish(label_extents_steps(volume))) == [1, 6, 117]


@pytest.mark.parametrize("read", [read_volume, slabs_of])
def test_a_surface_in_a_region_has_the_note_once(tmp_path, read):
    volume = read(saved(tmp_path / "organs.nii", organs(), np.uint8))
    settings = ReconstructionSettings(label=6, region=(5, 0, 0, 11, 6, 6))  # the farthest value, 0.918, is not in it
    notes = reconstruct(volume, settings).notes
    assert [note for note in notes if "whole" in note] == [NEARLY.format("0.9176471", 1)]


@pytest.mark.parametrize("read", [read_volume, slabs_of])
def test_labels_of_more_than_8_bits_come_through_a_scale_where_they_are_asked_for(tmp_path, read):
    labels = np.where(organs() == 117, 1024, organs())
    volume = read(saved(tmp_path / "organs.nii", labels, np.int16))
    assert volume.kind == "gray value"  # as integers of more than 8 bits are
    assert list(finish(label_extents_steps(volume))) == [1, 6, 1024]
    np.testing.assert_array_equal(volume.as_labels.values.T, labels)
    volume = read(saved(tmp_path / "organs-labels.nii", labels, np.int16))
    assert volume.kind == "label"
    np.testing.assert_array_equal(volume.values.T, labels)


def test_a_scale_that_does_not_tell_whole_numbers_apart_is_refused(tmp_path):
    labels = np.where(organs() == 117, 1000, organs())
    volume = read_volume(saved(tmp_path / "organs.nii", labels, np.uint8))  # steps of 3.92: 6 was stored as 7.84
    with pytest.raises(LabelError, match=r"its value 7\.84314 is not within 0\.00784 of a whole number; .* a scale$"):
        finish(label_extents_steps(volume))


def save_nrrd(path, values):
    nrrd = pytest.importorskip("nrrd")
    header = {"space": "RAS", "space directions": np.diag([0.8, 0.8, 1.5]), "space origin": (0,) * 3}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of pynrrd's own use of dates
        nrrd.write(str(path), values, header)


def save_mha(path, values):
    lines = ["ObjectType = Image", "NDims = 3", "DimSize = 12 11 10", "ElementSpacing = 0.8 0.8 1.5"]
    lines += ["ElementType = MET_FLOAT", "ElementDataFile = LOCAL"]
    path.write_bytes("".join(f"{line}\n" for line in lines).encode() + values.T.astype("<f4").tobytes())


def save_mgh(path, values):
    nibabel.save(nibabel.MGHImage(values, AFFINE), path)


def save_npy(path, values):
    np.save(path, values.T)


@pytest.mark.parametrize("read", [read_volume, slabs_of])
@pytest.mark.parametrize(
    ("name", "save"),
    [
        ("organs.nii.gz", saved),
        ("organs.nrrd", save_nrrd),
        ("organs.mha", save_mha),
        ("organs.mgz", save_mgh),
        ("organs-labels.npy", save_npy),
    ],
)
def test_a_float_next_to_a_whole_number_keeps_its_label(tmp_path, name, save, read):
    save(tmp_path / name, nearly(organs()))
    volume = read(tmp_path / name)
    assert volume.kind == "label"
    assert volume.dtype == np.float32
    np.testing.assert_array_equal(volume.values.T, organs())
    assert NEARLY.format("5.99999952", 6) in volume.notes


def test_labels_of_an_spm_pair_come_through_its_scale(tmp_path):
    stored = np.rint(organs() / 0.4588).astype(np.int16)
    pytest.importorskip("scipy", reason="nibabel writes .mat with it")
    image = nibabel.Spm2AnalyzeImage(stored, AFFINE)
    nibabel.save(image, tmp_path / "organs.hdr")
    header = bytearray((tmp_path / "organs.hdr").read_bytes())
    header[112:116] = np.float32(0.4588).tobytes()  # funused1, where SPM keeps its scale
    (tmp_path / "organs.hdr").write_bytes(header)
    volume = read_volume(tmp_path / "organs.hdr")
    assert volume.kind == "label"
    np.testing.assert_array_equal(volume.values.T, organs())


@pytest.mark.parametrize("read", [read_volume, slabs_of])
@pytest.mark.parametrize(("slope", "inside"), [("0.003921568627", 1), ("0.3", 1), ("1", 255)])
def test_a_dicom_mask_with_a_scale_is_a_mask(tmp_path, save_slice, read, slope, inside):
    top = round(inside / float(slope))
    mask = np.zeros((5, 6, 7), np.uint16)
    mask[1:4, 2:5, 3:6] = top
    for z, stored in enumerate(mask):
        save_slice(tmp_path / f"{z}.dcm", stored, (0, 0, z), RescaleSlope=slope, RescaleIntercept=0)
    volume = read(tmp_path)
    assert volume.kind == "label"
    np.testing.assert_array_equal(volume.values, np.where(mask, inside, 0))


@pytest.mark.parametrize("read", [read_volume, slabs_of])
def test_labels_in_dicom_images_with_a_scale_are_found_where_they_are_asked_for(tmp_path, save_slice, read):
    labels = organs().T
    for z, stored in enumerate(np.rint(labels / 0.4588).astype(np.uint16)):
        save_slice(tmp_path / f"{z}.dcm", stored, (0, 0, z), Modality="MR", RescaleSlope="0.4588", RescaleIntercept=0)
    volume = read(tmp_path)
    assert volume.kind == "gray value"
    assert list(finish(label_extents_steps(volume))) == [1, 6, 117]
    np.testing.assert_array_equal(volume.as_labels.values, labels)


@pytest.mark.parametrize("kind", [nibabel.Nifti1Image, nibabel.Nifti2Image, nibabel.Nifti1Pair])
@pytest.mark.parametrize("dtype", [np.int16, np.float32, np.float64])
def test_a_file_that_says_that_it_holds_labels_does(tmp_path, kind, dtype):
    labels = np.where(organs() == 117, 1024, organs()).astype(dtype)  # more than 8 bits, which the name does not tell
    ends = ".hdr" if kind is nibabel.Nifti1Pair else ".nii"
    volume = read_volume(saved(tmp_path / f"with{ends}", labels, intent=LABEL_INTENT, kind=kind))
    assert (volume.kind, volume.dtype) == ("label", dtype)
    np.testing.assert_array_equal(volume.values.T, labels)
    assert read_volume(saved(tmp_path / f"without{ends}", labels, kind=kind)).kind == "gray value"


def test_a_file_that_says_labels_and_holds_shares_has_gray_values_and_a_note(tmp_path):
    values = organs() / 117
    volume = read_volume(saved(tmp_path / "organs.nii", values, intent=LABEL_INTENT))
    assert volume.kind == "gray value"
    text = "The file says that it has labels, but its value 0.00854701 is not within 8.55e-06 of a whole number: gray"
    assert any(note.startswith(text) for note in volume.notes)


KINDS = [
    ("few whole numbers", lambda values: values % 117, "label"),
    ("many whole numbers", lambda values: values % 256, "gray value"),
    ("more than 8 bits", lambda values: np.where(values % 3 == 0, 1024, 0), "gray value"),
    ("some below 0", lambda values: values % 3 - 1, "gray value"),
    ("as low as air", lambda values: values % 3 - 1000, "HU"),
    ("one value", lambda values: 0 * values, "label"),
]


@pytest.mark.parametrize(("name", "of", "kind"), KINDS, ids=[name for name, *_ in KINDS])
@pytest.mark.parametrize("save", [saved, save_nrrd, save_mgh])
def test_whole_numbers_mean_the_same_as_integers_and_as_floats(tmp_path, name, of, kind, save):
    values = of(np.random.default_rng(3).permutation(12 * 11 * 10).reshape(12, 11, 10))
    suffix = {saved: ".nii", save_nrrd: ".nrrd", save_mgh: ".mgz"}[save]
    for dtype in (np.int16, np.float32):
        save(tmp_path / f"{dtype.__name__}{suffix}", values.astype(dtype))
        assert read_volume(tmp_path / f"{dtype.__name__}{suffix}").kind == kind, dtype
        assert slabs_of(tmp_path / f"{dtype.__name__}{suffix}").kind == kind, dtype


@pytest.mark.parametrize("name", ["organs.nii", "organs-mask.nii"])
def test_probabilities_are_gray_values_and_no_labels(tmp_path, name):
    values = np.linspace(0, 1, 12 * 11 * 10, dtype=np.float32).reshape(12, 11, 10)
    volume = read_volume(saved(tmp_path / name, values))
    assert volume.kind == "gray value"
    np.testing.assert_array_equal(volume.values.T, values)
    with pytest.raises(LabelError, match=r"^organs.* cannot be read as labels: its value 0\.\d+ is not within"):
        finish(label_extents_steps(volume))


def test_nan_in_labels_has_no_label_and_a_note(tmp_path):
    values = np.where(organs() == 0, np.nan, organs()).astype(np.float32)
    volume = read_volume(saved(tmp_path / "organs.nii", values))
    assert volume.kind == "label"
    np.testing.assert_array_equal(volume.values.T, organs())
    assert "Voxels whose value is NaN were read as having no label." in volume.notes


@pytest.mark.parametrize("scale", [0.9998, 1 / 255])
@pytest.mark.parametrize("kind", ["scaled", "float"])
def test_a_folder_of_masks_whose_values_are_nearly_whole_is_read(tmp_path, scale, kind):
    for name, label in (("a", 1), ("b", 6), ("c", 117)):
        mask = (organs() == label) * (1 if kind == "float" else round(1 / scale))
        image = nibabel.Nifti1Image(mask.astype(np.int16), AFFINE)
        if kind == "scaled":
            image.header.set_slope_inter(scale, 0)
        else:
            noise = np.random.default_rng(label).choice([0.9998, 1.0, 1.0001], mask.shape)
            image = nibabel.Nifti1Image((mask * noise).astype(np.float32), AFFINE)
        nibabel.save(image, tmp_path / f"{name}.nii")
    volume = read_volume(tmp_path)
    assert volume.label_names == {1: "a", 2: "b", 3: "c"}
    for number, label in enumerate((1, 6, 117), 1):
        np.testing.assert_array_equal(label_mask(volume, number).T, organs() == label)
    if kind == "float":
        assert NEARLY.format("0.9998", 1) in volume.notes


def test_labels_in_an_ome_zarr_are_labels_as_floats_too(tmp_path):
    pytest.importorskip("zarr")
    about = {"image-label": {"properties": [{"label-value": 6, "name": "liver"}]}}
    labels = np.where(organs() == 117, 1024, organs()).astype(np.float32).T
    volume = read_volume(save_store(tmp_path / "organs", labels, "0.4", about=about))
    assert (volume.kind, volume.label_names) == ("label", {6: "liver"})
    np.testing.assert_array_equal(volume.values, labels)
