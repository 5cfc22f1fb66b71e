# SPDX-License-Identifier: GPL-3.0-or-later
"""A spacing that no CT has is refused in every format with its limits, and the way out that is named works."""

from __future__ import annotations

import json

import nibabel
import numpy as np
import pytest
import tifffile
from refusals import refused

from ctmc_addon.core import SettingsError
from ctmc_addon.core.errors import VolumeError
from ctmc_addon.core.volume import Volume, is_spacing, spacing_of
from ctmc_addon.readers import read_volume

VALUES = np.arange(4 * 6 * 7, dtype=np.int16).reshape(4, 6, 7)
LIMITS = "from 1e-06 to 10000 mm; give the spacing x, y, z in mm"


def nifti(image):
    def save(folder, sides):
        header = image.header_class()
        header.set_data_shape(VALUES.shape[::-1])
        header.set_data_dtype(VALUES.dtype)
        header["sform_code"] = 1
        header["srow_x"], header["srow_y"], header["srow_z"] = np.diag([*sides, 1.0])[:3]
        header["magic"], header["vox_offset"] = header.single_magic, header.single_vox_offset
        content = header.binaryblock.ljust(header.single_vox_offset, b"\0") + VALUES.tobytes()
        (folder / "ct.nii").write_bytes(content)
        return folder / "ct.nii"

    return save


def nrrd(folder, sides):
    words = " ".join("(" + ",".join(repr(float(word)) for word in axis) + ")" for axis in np.diag(sides))
    head = "NRRD0004\ntype: short\ndimension: 3\nsizes: 7 6 4\nencoding: raw\nendian: little\nspace: LPS\n"
    text = f"{head}space directions: {words}\nspace origin: (0,0,0)\n\n"
    (folder / "ct.nrrd").write_bytes(text.encode() + VALUES.tobytes())
    return folder / "ct.nrrd"


def metaimage(folder, sides):
    words = " ".join(map(repr, sides))
    text = f"ObjectType = Image\nNDims = 3\nDimSize = 7 6 4\nElementType = MET_SHORT\nElementSpacing = {words}\n"
    (folder / "ct.mha").write_bytes(text.encode() + b"ElementDataFile = LOCAL\n" + VALUES.tobytes())
    return folder / "ct.mha"


def analyze(folder, sides):
    image = nibabel.AnalyzeImage(VALUES.T, np.eye(4))
    nibabel.save(image, folder / "ct.img")
    content = bytearray((folder / "ct.hdr").read_bytes())
    content[80:92] = np.array(sides, "<f4").tobytes()
    (folder / "ct.hdr").write_bytes(content)
    return folder / "ct.hdr"


def ome_tiff(folder, sides):
    words = {f"PhysicalSize{axis}": side for axis, side in zip("XYZ", sides, strict=True)}
    words |= {f"PhysicalSize{axis}Unit": "mm" for axis in "XYZ"}
    tifffile.imwrite(folder / "ct.ome.tif", VALUES.astype(np.uint16), metadata={"axes": "ZYX", **words})
    return folder / "ct.ome.tif"


def zarr(folder, sides):
    pytest.importorskip("zarr")
    zarr_stores = pytest.importorskip("zarr_stores")
    store = zarr_stores.save_by_hand(folder / "ct.ome.zarr", VALUES, VALUES.shape)
    about = json.loads((store / ".zattrs").read_text())
    about["multiscales"][0]["datasets"][0]["coordinateTransformations"][0]["scale"] = list(sides[::-1])
    (store / ".zattrs").write_text(json.dumps(about))
    return store


FORMATS = {
    "nifti-1": nifti(nibabel.Nifti1Image),
    "nifti-2": nifti(nibabel.Nifti2Image),
    "nrrd": nrrd,
    "metaimage": metaimage,
    "analyze": analyze,
    "ome-tiff": ome_tiff,
    "ome-zarr": zarr,
}


@pytest.mark.parametrize("sides", [(1e-7, 1e-7, 1e-7), (0.5, 0.5, 2e4), (3e-30, 0.5, 2.0)], ids=str)
@pytest.mark.parametrize("name", FORMATS)
def test_a_spacing_that_no_ct_has_is_refused_until_one_is_given(tmp_path, name, sides):
    path = FORMATS[name](tmp_path, sides)
    shown = " x ".join(f"{side:.4g}" for side in sides)
    assert refused(path) == f"{path.name} has a spacing of {shown} mm, and it must be {LIMITS}"
    volume = read_volume(path, spacing=(0.5, 0.75, 2.0))
    assert volume.spacing == pytest.approx((0.5, 0.75, 2.0))
    assert any(note.startswith("spacing 0.5 x 0.75 x 2 mm as asked") for note in volume.notes)


@pytest.mark.parametrize("side", [3e-150, 1e-200, 1e6])
@pytest.mark.parametrize("name", ["nifti-2", "nrrd", "metaimage", "ome-tiff", "ome-zarr"])
def test_lengths_whose_squares_are_no_numbers_are_refused_as_well(tmp_path, name, side):
    path = FORMATS[name](tmp_path, (side, side, side))
    refused(path, LIMITS)
    assert read_volume(path, spacing=2).spacing == pytest.approx((2, 2, 2))


@pytest.mark.parametrize("side", [1e-6, 1e4])
@pytest.mark.parametrize("name", FORMATS)
def test_the_limits_themselves_are_read(tmp_path, name, side):
    volume = read_volume(FORMATS[name](tmp_path, (side, side, side)))
    assert volume.spacing == pytest.approx((side, side, side), rel=1e-6)


@pytest.mark.parametrize("name", ["nifti-1", "nifti-2", "nrrd", "metaimage"])
def test_an_axis_without_length_takes_the_spacing_that_is_given(tmp_path, name):
    path = FORMATS[name](tmp_path, (0.5, 0.75, 0.0))
    refused(path, "a spacing of 0.5 x 0.75 x 0 mm", LIMITS)
    volume = read_volume(path, spacing=(0.5, 0.75, 2.0))
    np.testing.assert_allclose(np.abs(np.diag(volume.affine)), [0.5, 0.75, 2.0, 1.0])
    assert np.linalg.det(volume.affine) > 0
    assert any(note.startswith("spacing 0.5 x 0.75 x 2 mm as asked") for note in volume.notes)


def test_a_file_whose_axes_have_no_length_is_taken_as_axial(tmp_path):
    path = metaimage(tmp_path, (0.0, 0.0, 0.0))
    refused(path, "a spacing of 0 x 0 x 0 mm", LIMITS)
    volume = read_volume(path, spacing=(0.5, 0.75, 2.0))
    np.testing.assert_array_equal(volume.affine, np.diag([-0.5, -0.75, 2.0, 1.0]))
    assert any(note.startswith("spacing 0.5 x 0.75 x 2 mm as asked") for note in volume.notes)


@pytest.mark.parametrize("spacing", [1e-7, 1e5, 0.0, (1, 1, 3e-150)])
def test_a_spacing_that_is_asked_for_has_the_same_limits(tmp_path, spacing):
    np.save(tmp_path / "ct.npy", VALUES)
    with pytest.raises(SettingsError, match=r"must be from 1e-06 to 10000 mm, not .*; measure it or leave it out"):
        read_volume(tmp_path / "ct.npy", spacing=spacing)
    assert read_volume(tmp_path / "ct.npy", spacing=(1e-6, 1, 1e4)).spacing == (1e-6, 1, 1e4)


@pytest.mark.parametrize("side", ["1e-7", "3e-150", "1e-200", "20000", "1e300"])
def test_a_pixel_spacing_that_no_ct_has_is_refused_until_one_is_given(tmp_path, save_stack, side):
    save_stack(tmp_path, range(3), PixelSpacing=[side, side])
    shown = f"{float(side):g}"
    assert refused(tmp_path) == f"the series has a PixelSpacing of {shown} mm, and it must be {LIMITS}"
    volume = read_volume(tmp_path, spacing=(0.5, 0.75, 2.0))
    assert volume.spacing == pytest.approx((0.5, 0.75, 2.0))
    assert any(f"where the series has a PixelSpacing of {shown} mm" in note for note in volume.notes)


def test_slices_too_far_apart_are_refused_until_a_spacing_is_given(tmp_path, save_stack):
    save_stack(tmp_path, (0, 20000, 40000))
    refused(tmp_path, "has a spacing of 0.5 x 0.8 x 2e+04 mm", LIMITS)
    assert read_volume(tmp_path, spacing=(0.5, 0.8, 2)).spacing == pytest.approx((0.5, 0.8, 2))


def test_slices_nearer_than_their_positions_tell_are_one_place(tmp_path, save_stack):
    save_stack(tmp_path, (0, 0.0005, 0.001), SpacingBetweenSlices=0.0005)
    refused(tmp_path, "all 3 slices (such as 0.dcm) are at one position to within 0.001 mm")


def test_an_array_given_to_python_needs_axes_with_a_length():
    for side in (3e-150, 1e-200, 0.0):
        with pytest.raises(VolumeError, match="singular"):
            Volume(VALUES, np.diag([side, side, side, 1]))
    assert Volume(VALUES, np.diag([1e-6, 1e-6, 1e-6, 1])).spacing == (1e-6, 1e-6, 1e-6)


def test_lengths_are_those_of_the_plain_formula_bit_for_bit():
    random = np.random.default_rng(0)
    for exponent in (-30, -3, 0, 3, 30):
        affine = np.eye(4)
        affine[:3, :3] = random.normal(size=(3, 3)) * 10.0**exponent
        assert (spacing_of(affine) == np.sqrt((affine[:3, :3] ** 2).sum(axis=0))).all()
    assert spacing_of(np.diag([3e-200, 4e-320, 5e200, 1])).tolist() == [3e-200, 4e-320, 5e200]


@pytest.mark.parametrize("length", [0.0, -1.0, float("nan"), float("inf"), 9e-7, 1.1e4])
def test_what_is_no_spacing_is_outside_the_limits(length):
    assert not is_spacing((1.0, length))
