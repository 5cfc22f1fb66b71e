# SPDX-License-Identifier: GPL-3.0-or-later
"""NIfTI against nibabel's own affine and values."""

from __future__ import annotations

import gzip

import nibabel
import numpy as np
import pytest

from ctmc_addon.core import Budget, CtmcError, SettingsError
from ctmc_addon.readers import open_volume, read_volume, segmentation_sibling

OBLIQUE = np.array([[-0.6, 0.3, 0.1, 12.5], [0.2, 0.7, -0.4, -80], [0.05, 0.4, 2.1, 301.25], [0, 0, 0, 1]])


def saved(path, values, affine=OBLIQUE, slope=None, intercept=None, kind=nibabel.Nifti1Image):
    image = kind(values, affine)
    if slope is not None:
        image.header.set_slope_inter(slope, intercept)
    nibabel.save(image, path)
    return path


def numbers(dtype, shape=(5, 6, 7)):
    limits = (-3000, 3000) if np.dtype(dtype).kind in "if" else (0, 3000)
    high = min(limits[1], np.iinfo(dtype).max) if np.dtype(dtype).kind in "iu" else limits[1]
    low = max(limits[0], np.iinfo(dtype).min) if np.dtype(dtype).kind in "iu" else limits[0]
    return np.random.default_rng(0).integers(low, high, shape).astype(dtype)


@pytest.mark.parametrize("end", [".nii", ".nii.gz"])
@pytest.mark.parametrize("dtype", ["u1", "i1", "i2", "u2", "i4", "u4", "f4", "f8", ">i2", ">f4"])
@pytest.mark.parametrize("kind", [nibabel.Nifti1Image, nibabel.Nifti2Image])
def test_values_type_and_affine_are_nibabels(tmp_path, end, dtype, kind):
    path = tmp_path / f"ct{end}"
    image = kind(numbers(dtype), OBLIQUE)
    image.set_data_dtype(np.dtype(dtype))
    nibabel.save(image, path)
    volume, oracle = read_volume(path), nibabel.load(path)
    np.testing.assert_array_equal(volume.values.transpose(2, 1, 0), oracle.get_fdata())
    np.testing.assert_array_equal(volume.affine, oracle.affine)
    assert volume.values.dtype == np.dtype(dtype).newbyteorder("=")
    assert volume.values.flags.c_contiguous
    assert volume.name == "ct"


@pytest.mark.parametrize("codes", [(0, 1), (1, 0), (2, 2), (0, 0)])
def test_sform_and_qform_are_chosen_as_nibabel_does(tmp_path, codes):
    turned = np.array([[0, -2.0, 0, 5], [1.5, 0, 0, 6], [0, 0, -3.0, 7], [0, 0, 0, 1]])
    image = nibabel.Nifti1Image(numbers("i2"), turned)
    image.set_sform(turned, codes[0])
    turned[:3, 3] += 1
    image.set_qform(turned, codes[1])
    nibabel.save(image, tmp_path / "ct.nii")
    volume = read_volume(tmp_path / "ct.nii")
    np.testing.assert_array_equal(volume.affine, nibabel.load(tmp_path / "ct.nii").affine)
    assert any("no orientation" in note for note in volume.notes) == (codes == (0, 0))


@pytest.mark.parametrize(("slope", "intercept"), [(0.5, 3), (1.0, -1000.5), (0.1, 0)])
@pytest.mark.parametrize("dtype", ["u1", "i2", "i4", "f4"])
def test_a_fractional_scale_gives_nibabels_values_in_float32(tmp_path, dtype, slope, intercept):
    path = tmp_path / "ct.nii"
    array = numbers(dtype)
    scaled = nibabel.Nifti1Image(array, OBLIQUE)
    scaled.header.set_slope_inter(slope, intercept)
    nibabel.save(scaled, path)
    _raw_scale(path, slope, intercept)
    volume = read_volume(path)
    assert volume.values.dtype == np.float32
    np.testing.assert_array_equal(volume.values.T, nibabel.load(path).get_fdata().astype(np.float32))


def _raw_scale(path, slope, intercept):
    """Set the scale in the file itself; nibabel would scale the values back when it saves."""
    content = bytearray(path.read_bytes())
    content[112:120] = np.array([slope, intercept], "<f4").tobytes()
    path.write_bytes(bytes(content))


@pytest.mark.parametrize(("dtype", "result"), [("u1", "i2"), ("i2", "i2"), ("u2", "i2"), ("i4", "i2")])
def test_a_whole_scale_keeps_integers(tmp_path, dtype, result):
    path = saved(tmp_path / "ct.nii", numbers(dtype))
    _raw_scale(path, 2, -1024)
    volume = read_volume(path)
    assert volume.values.dtype == result
    np.testing.assert_array_equal(volume.values.T, nibabel.load(path).get_fdata())


def test_a_slope_of_zero_means_no_scale(tmp_path):
    path = saved(tmp_path / "ct.nii", numbers("i2"))
    _raw_scale(path, 0, 7)
    volume = read_volume(path)
    np.testing.assert_array_equal(volume.values.T, nibabel.load(path).get_fdata())
    assert volume.values.dtype == np.int16


def test_a_fourth_dimension_of_one_is_fine(tmp_path):
    array = numbers("i2", (5, 6, 7, 1))
    np.testing.assert_array_equal(read_volume(saved(tmp_path / "ct.nii", array)).values.T, array[..., 0])


@pytest.mark.parametrize("name", ["ct.nii", "ct.nii.gz"])
@pytest.mark.parametrize("dtype", ["<i2", ">i2", "f4"])
def test_each_time_of_a_fourth_dimension_is_read(tmp_path, name, dtype):
    array = numbers(dtype, (5, 6, 7, 3))
    path = saved(tmp_path / name, array)
    assert open_volume(path).series[0].times == 3
    for time in (1, 2, 3):
        volume = read_volume(path, time=time)
        np.testing.assert_array_equal(volume.values.T, array[..., time - 1])
        assert volume.notes == ()
    first = read_volume(path)
    np.testing.assert_array_equal(first.values.T, array[..., 0])
    assert "3 time points found, showing the first" in first.notes
    with pytest.raises(CtmcError, match=rf"no time 4, because {name} holds 3 times; choose from 1 to 3"):
        read_volume(path, time=4)
    for time in (0, -1):
        with pytest.raises(SettingsError, match=f"time must be 1 or more, not {time}"):
            read_volume(path, time=time)


def test_a_time_of_a_volume_without_time_is_refused(tmp_path):
    path = saved(tmp_path / "ct.nii", numbers("i2", (5, 6, 7)))
    assert read_volume(path, time=1).notes == ()
    with pytest.raises(CtmcError, match=r"no time 2, because .* holds a single time"):
        read_volume(path, time=2)


def test_one_changed_bit_in_another_time_is_noticed(tmp_path):
    path = saved(tmp_path / "ct.nii", numbers("i2", (5, 6, 7, 3)))
    packed = bytearray(gzip.compress(path.read_bytes(), 0))
    packed[-20] ^= 1
    (tmp_path / "ct.nii.gz").write_bytes(packed)
    with pytest.raises(CtmcError, match="truncated or damaged"):
        read_volume(tmp_path / "ct.nii.gz", time=1)


def test_a_real_fifth_dimension_is_refused(tmp_path):
    with pytest.raises(CtmcError, match=r"5 dimensions \(5, 6, 7, 3, 2\).*one channel"):
        read_volume(saved(tmp_path / "ct.nii.gz", numbers("i2", (5, 6, 7, 3, 2))))


def test_rgb_voxels_are_refused(tmp_path):
    color = np.zeros((4, 4, 4), [("R", "u1"), ("G", "u1"), ("B", "u1")])
    with pytest.raises(CtmcError, match="RGB voxels; convert it to gray"):
        read_volume(saved(tmp_path / "ct.nii", color))


def test_complex_voxels_are_refused(tmp_path):
    with pytest.raises(CtmcError, match="complex64; convert"):
        read_volume(saved(tmp_path / "ct.nii", np.zeros((4, 4, 4), np.complex64)))


def test_a_singular_affine_is_refused(tmp_path):
    image = nibabel.Nifti1Image(numbers("i2"), np.eye(4))
    image.set_sform(np.diag([1, 0, 1, 1]), 2)
    image.header["srow_y"] = 0
    nibabel.save(image, tmp_path / "ct.nii")
    content = bytearray((tmp_path / "ct.nii").read_bytes())
    content[280:312] = np.array([1, 1, 0, 0, 0, 0, 0, 0], "<f4").tobytes()  # x and y run the same way
    (tmp_path / "ct.nii").write_bytes(content)
    with pytest.raises(CtmcError, match="affine is singular"):
        read_volume(tmp_path / "ct.nii")


def test_one_slice_only_is_refused(tmp_path):
    with pytest.raises(CtmcError, match=r"only one slice \(5 x 6\).*at least 2"):
        read_volume(saved(tmp_path / "ct.nii", numbers("i2", (5, 6, 1))))


@pytest.mark.parametrize("end", [".nii", ".nii.gz"])
@pytest.mark.parametrize("share", [0.02, 0.3, 0.95])
def test_a_truncated_file_is_refused(tmp_path, end, share):
    path = saved(tmp_path / f"ct{end}", numbers("i2", (20, 20, 20)))
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * share)])
    with pytest.raises(CtmcError, match=r"ct.nii.*copy it again"):
        read_volume(path)


def test_a_damaged_gzip_is_refused(tmp_path):
    path = saved(tmp_path / "ct.nii.gz", numbers("i2", (20, 20, 20)))
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 255
    path.write_bytes(content)
    with pytest.raises(CtmcError, match=r"truncated or damaged.*copy it again"):
        read_volume(path)


@pytest.mark.parametrize("name", ["noise.nii", "noise.nii.gz"])
def test_noise_is_refused(tmp_path, name):
    (tmp_path / name).write_bytes(np.random.default_rng(0).bytes(4000))
    with pytest.raises(CtmcError, match=r"noise\.nii.* is not a readable NIfTI file .*export or copy it again"):
        read_volume(tmp_path / name)


def test_a_wrong_suffix_for_gzip_is_forgiven(tmp_path):
    array = numbers("i2")
    plain = saved(tmp_path / "plain.nii", array)
    (tmp_path / "packed.nii").write_bytes(gzip.compress(plain.read_bytes()))
    (tmp_path / "unpacked.nii.gz").write_bytes(plain.read_bytes())
    for name in ("packed.nii", "unpacked.nii.gz"):
        np.testing.assert_array_equal(read_volume(tmp_path / name).values.T, array)


def test_positions_in_other_units_become_millimeters(tmp_path):
    image = nibabel.Nifti1Image(numbers("i2"), np.diag([1e-3, 1e-3, 2e-3, 1]))
    image.header.set_xyzt_units("meter")
    nibabel.save(image, tmp_path / "ct.nii")
    volume = read_volume(tmp_path / "ct.nii")
    assert volume.spacing == pytest.approx((1, 1, 2))
    assert any("in meter and were converted" in note for note in volume.notes)


def test_label_names_come_from_the_header_extension(tmp_path):
    image = nibabel.Nifti1Image(numbers("u1") % 3, OBLIQUE)
    xml = '<x><LabelTable><Label Key="1"><![CDATA[Leber ä]]></Label><Label Key="2">tumour</Label></LabelTable></x>'
    image.header.extensions.append(nibabel.nifti1.Nifti1Extension("comment", xml.encode()))
    nibabel.save(image, tmp_path / "organs.nii.gz")
    volume = read_volume(tmp_path / "organs.nii.gz")
    assert volume.label_names == {1: "Leber ä", 2: "tumour"}
    assert volume.kind == "label"


def save_with_colors(path, colors):
    """A label volume whose header names and colors labels; `colors` has a name and an sRGB color by number."""
    image = nibabel.Nifti1Image(np.resize(np.array(sorted(colors), np.uint8), (4, 3, 2)), np.eye(4))
    labels = "".join(
        f'<Label Key="{number}" Red="{red / 255}" Green="{green / 255}" Blue="{blue / 255}">{name}</Label>'
        for number, (name, (red, green, blue)) in colors.items()
    )
    xml = f"<x><LabelTable>{labels}</LabelTable></x>"
    image.header.extensions.append(nibabel.nifti1.Nifti1Extension("comment", xml.encode()))
    nibabel.save(image, path)


LIVER, SPLEEN, OTHER = ("liver", (0, 255, 255)), ("spleen", (0, 255, 0)), ("structure 2", (0, 0, 255))
COLON, AORTA = ("colon", (255, 255, 0)), ("aorta", (255, 0, 255))
PALETTE = {1: SPLEEN, 2: OTHER, 3: COLON, 4: AORTA, 5: LIVER}  # TotalSegmentator's colors of these numbers


@pytest.mark.parametrize(
    ("colors", "options", "kept"),
    [
        (PALETTE, {}, {2: (0, 0, 255)}),
        (PALETTE, {"file_colors": True}, None),
        ({1: SPLEEN, 2: OTHER, 5: LIVER}, {}, None),  # three colors may be alike by chance
        ({**PALETTE, 6: LIVER}, {}, None),  # label 6 of the palette is orange
        ({**PALETTE, 6: LIVER}, {"anatomy_colors": True}, {2: (0, 0, 255)}),
        ({label: (SPLEEN, OTHER, LIVER)[label % 3] for label in range(1, 10)}, {}, dict.fromkeys((1, 4, 7), OTHER[1])),
        ({label: (SPLEEN, OTHER, LIVER)[label % 3] for label in range(1, 7)}, {}, None),  # left and right alike
    ],
)
def test_a_programs_palette_gives_way_to_the_colors_of_anatomical_names(tmp_path, colors, options, kept):
    save_with_colors(tmp_path / "organs.nii.gz", colors)
    volume = read_volume(tmp_path / "organs.nii.gz", **options)
    assert volume.label_colors == ({label: rgb for label, (_, rgb) in colors.items()} if kept is None else kept)
    said = any(note.startswith("colors follow the anatomical names") for note in volume.notes)
    assert said == (kept is not None and "anatomy_colors" not in options)


@pytest.mark.parametrize(
    ("name", "values", "kind"),
    [
        ("volume-3.nii", numbers("i2"), "HU"),
        ("segmentation-3.nii", (numbers("i2") % 3), "label"),
        ("segmentation-3.nii", (numbers("i2") % 3).astype(np.float64), "label"),
        ("organs.nii", (numbers("i2") % 117), "label"),
        ("gray.nii", (numbers("i2", (12, 12, 12)) % 256).astype(np.uint8), "gray value"),
        ("window.nii", np.clip(numbers("f4"), -100, 240), "gray value"),
        ("nan.nii", np.full((3, 3, 3), np.nan, np.float32), "gray value"),
    ],
)
def test_the_kind_of_values_is_told_by_name_and_range(tmp_path, name, values, kind):
    assert read_volume(saved(tmp_path / name, values)).kind == kind


def test_the_series_of_a_file_is_its_size(tmp_path):
    (one,) = open_volume(saved(tmp_path / "ct.nii.gz", numbers("i2"))).series
    assert (one.number, one.uid, one.slices, one.size, one.modality) == (1, "", 7, (5, 6), "")


def test_the_lits_sibling_is_found_beside_its_volume(tmp_path):
    for name in ("volume-12.nii", "volume-3.nii.gz", "segmentation-12.nii.gz", "segmentation-3.nii.gz", "volume-4.nii"):
        (tmp_path / name).touch()
    assert segmentation_sibling(tmp_path / "volume-12.nii") == tmp_path / "segmentation-12.nii.gz"
    assert segmentation_sibling(str(tmp_path / "volume-3.nii.gz")) == tmp_path / "segmentation-3.nii.gz"
    assert segmentation_sibling(tmp_path / "volume-4.nii") is None
    assert segmentation_sibling(tmp_path / "segmentation-3.nii.gz") is None


def test_a_volume_beyond_the_memory_is_refused_before_it_is_read(tmp_path):
    path = saved(tmp_path / "ct.nii", numbers("i2"))
    path.write_bytes(path.read_bytes()[:400])  # reading on would be a truncation
    with pytest.raises(CtmcError, match=r"ct.nii \(5 x 6 x 7\) needs about.*memory"):
        read_volume(path, budget=Budget(bytes=100))


@pytest.mark.parametrize(
    ("dtype", "slope", "bytes_asked"), [("uint8", 2, [2]), ("int16", 1, [2]), ("int16", 200, [2, 4])]
)
def test_scaled_values_ask_for_the_memory_that_they_take(tmp_path, monkeypatch, dtype, slope, bytes_asked):
    path = tmp_path / "ct.nii"
    saved(path, np.arange(100, 220).reshape(4, 5, 6).astype(dtype))
    _raw_scale(path, slope, 100 * slope)
    asked = []
    monkeypatch.setattr("ctmc_addon.core.Budget.require", lambda _, size, *__: asked.append(size / 120))
    values = read_volume(path).values
    assert asked == bytes_asked
    np.testing.assert_array_equal(values.T, np.arange(100, 220).reshape(4, 5, 6) * slope + 100 * slope)
