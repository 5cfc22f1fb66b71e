# SPDX-License-Identifier: GPL-3.0-or-later
"""DICOM segmentations: every frame in its place, of every type, alone and beside the CT."""

from __future__ import annotations

import hashlib

import numpy as np
import pydicom
import pytest
from volumes import label_mask

from ctmc_addon.core import CtmcError
from ctmc_addon.readers import open_volume, read_volume, volume_name

DEFLATED, DEFLATED_FRAMES, RLE = "1.2.840.10008.1.2.1.99", "1.2.840.10008.1.2.8.1", "1.2.840.10008.1.2.5"


def said(volume, text):
    return any(text in note for note in volume.notes)


def rle_frame(content):
    """A frame of literal bytes (PS3.5 annex G)."""
    runs = b"".join(bytes([0, value]) for value in content)
    return (1).to_bytes(4, "little") + (64).to_bytes(4, "little") + bytes(56) + runs


def masks(count, shape=(5, 7), seed=3):
    """Random pixels; 5 x 7 bits do not end with a byte."""
    return np.random.default_rng(seed).integers(0, 2, (count, *shape)).astype(np.uint8)


@pytest.mark.parametrize("undefined", [False, True])
@pytest.mark.parametrize("syntax", ["1.2.840.10008.1.2", "1.2.840.10008.1.2.1", DEFLATED, DEFLATED_FRAMES])
def test_frames_of_one_bit_in_any_order_stand_where_they_belong(tmp_path, save_segmentation, syntax, undefined):
    planes = masks(4)
    order = [2, 0, 3, 1]
    frames = [(1, (-10, -20, 2.5 * z), planes[z]) for z in order]
    save_segmentation(tmp_path / "organs.dcm", frames, syntax=syntax, undefined=undefined)
    volume = read_volume(tmp_path / "organs.dcm")
    np.testing.assert_array_equal(volume.values, planes)
    assert (volume.kind, volume.name, volume.values.dtype) == ("label", "organs", np.uint8)
    assert volume.label_names == {1: "liver", 2: "tumor", 3: "vessel"}
    assert volume.label_colors == {1: (0, 255, 0), 2: (255, 0, 0), 3: (0, 255, 0)}
    np.testing.assert_allclose(
        volume.affine, [[-0.5, 0, 0, 10], [0, -0.8, 0, 20], [0, 0, 2.5, 0], [0, 0, 0, 1]], atol=1e-12
    )
    assert said(volume, "2 of 3 segments are empty: tumor, vessel")


@pytest.mark.parametrize("keyword", ["Rows", "BitsAllocated", "NumberOfFrames", "SegmentSequence"])
def test_an_empty_element_is_refused_in_a_sentence(tmp_path, save_segmentation, keyword):
    frames = [(1, (-10, -20, 2.5 * z), plane) for z, plane in enumerate(masks(3))]
    save_segmentation(tmp_path / "seg.dcm", frames, kind="FRACTIONAL", **{keyword: []})
    with pytest.raises(CtmcError, match=r"^seg\.dcm .*; (copy|copy or export|export) it again$"):
        read_volume(tmp_path / "seg.dcm")


def test_frames_left_out_are_empty_slices_and_the_ct_beside_it_tells_how_many(tmp_path, save_segmentation, save_stack):
    planes = masks(2)
    frames = [(1, (-10, -20, 4), planes[0]), (2, (-10, -20, 10), planes[1])]
    save_segmentation(tmp_path / "seg.dcm", frames, gap=2.0)
    alone = read_volume(tmp_path / "seg.dcm")
    assert alone.values.shape == (4, 5, 7)
    np.testing.assert_array_equal(alone.values[[0, 3]], planes * [[[1]], [[2]]])
    assert not alone.values[1:3].any()
    save_stack(tmp_path / "ct", range(0, 16, 2))
    beside = read_volume(tmp_path / "seg.dcm")
    assert beside.values.shape == (8, 5, 7)
    np.testing.assert_array_equal(beside.values[2:6], alone.values)
    np.testing.assert_allclose(beside.affine, read_volume(tmp_path / "ct").affine)
    assert open_volume(tmp_path / "seg.dcm").series[0].shape == (8, 5, 7)


def test_the_ct_is_found_in_a_folder_beside_that_of_the_segmentation(tmp_path, save_segmentation, save_stack):
    save_segmentation(tmp_path / "study" / "seg" / "1-1.dcm", [(1, (-10, -20, 2), masks(1)[0])])
    save_stack(tmp_path / "study" / "ct", range(0, 10, 2))
    assert read_volume(tmp_path / "study" / "seg" / "1-1.dcm").values.shape == (5, 5, 7)


def test_a_smaller_segmentation_is_put_into_its_place_in_the_ct(tmp_path, save_segmentation, save_stack):
    plane = masks(1, (3, 2))[0]
    save_segmentation(tmp_path / "seg.dcm", [(1, (-10 + 2 * 0.5, -20 + 0.8, 2), plane)])
    save_stack(tmp_path / "ct", range(0, 10, 2))
    volume = read_volume(tmp_path / "seg.dcm")
    expected = np.zeros((5, 5, 7), np.uint8)
    expected[1, 1:4, 2:4] = plane
    np.testing.assert_array_equal(volume.values, expected)


def test_a_ct_of_another_grid_is_said_and_the_frames_make_their_own(tmp_path, save_segmentation, save_stack):
    frames = [(1, (-10.25, -20, z), plane) for z, plane in zip((0, 2, 4), masks(3), strict=True)]
    save_segmentation(tmp_path / "seg.dcm", frames)
    save_stack(tmp_path / "ct", range(0, 10, 2))
    volume = read_volume(tmp_path / "seg.dcm")
    assert volume.values.shape == (3, 5, 7)
    assert said(volume, "its frames do not lie on the slices")


def test_labels_of_a_resampled_ct_take_the_nearest_slice(tmp_path, save_segmentation, save_stack):
    heights = (0, 2, 4, 5, 6)
    planes = masks(5) + np.arange(5, dtype=np.uint8)[:, None, None] * 0
    frames = [(1, (-10, -20, z), plane) for z, plane in zip(heights, planes, strict=True)]
    save_segmentation(tmp_path / "seg.dcm", frames)
    save_stack(tmp_path / "ct", heights)
    volume = read_volume(tmp_path / "seg.dcm")
    np.testing.assert_array_equal(volume.values, planes[[0, 1, 1, 2, 2, 3, 4]][: len(volume.values)])
    assert volume.values.shape == read_volume(tmp_path / "ct").values.shape


def test_segments_that_overlap_are_whole_in_layers_in_any_order(tmp_path, save_segmentation):
    first, second = np.zeros((2, 5, 7), np.uint8)
    first[1:4, 1:4], second[2:5, 2:5] = 1, 1
    frames = [(segment, (0, 0, z), plane) for z in (0, 1) for segment, plane in ((1, first), (2, second))]
    for order in (frames, frames[::-1]):
        save_segmentation(tmp_path / "seg.dcm", order)
        volume = read_volume(tmp_path / "seg.dcm")
        for layer, expected in zip(volume.each_layer, (first, 2 * second), strict=True):
            np.testing.assert_array_equal(layer.values, [expected, expected])
        assert said(volume, "segments overlap and each is kept whole; they share")
        assert said(volume, " 8 voxels")


def test_a_fraction_of_a_half_or_more_is_inside(tmp_path, save_segmentation):
    plane = np.arange(35, dtype=np.uint8).reshape(5, 7)
    frames = [(3, (0, 0, z), plane) for z in (0, 1)]
    save_segmentation(tmp_path / "seg.dcm", frames, "FRACTIONAL", MaximumFractionalValue=20)
    np.testing.assert_array_equal(read_volume(tmp_path / "seg.dcm").values[1], 3 * (plane >= 10))
    save_segmentation(tmp_path / "seg.dcm", frames, "FRACTIONAL", MaximumFractionalValue=21)
    np.testing.assert_array_equal(read_volume(tmp_path / "seg.dcm").values[1], 3 * (plane >= 11))


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("compress", [None, RLE])
def test_a_label_map_keeps_its_numbers_and_padding_is_background(tmp_path, save_segmentation, bits, compress):
    plane = np.random.default_rng(0).choice([0, 1, 2, 5], (5, 7)).astype(np.uint8)
    frames = [(None, (0, 0, z), plane) for z in (0, 2)]
    save_segmentation(tmp_path / "seg.dcm", frames, "LABELMAP", gap=1.0, bits=bits, PixelPaddingValue=5)
    if compress:
        dataset = pydicom.dcmread(tmp_path / "seg.dcm")
        dataset.compress(compress, generate_instance_uid=False)
        dataset.save_as(tmp_path / "seg.dcm")
    volume = read_volume(tmp_path / "seg.dcm")
    labels = np.where(plane == 5, 0, plane)
    np.testing.assert_array_equal(volume.values, [labels, 0 * labels, labels])
    assert volume.values.dtype == (np.uint8 if bits == 8 else np.uint16)


def test_numbers_that_no_segment_has_are_labels_and_said(tmp_path, save_segmentation):
    plane = np.array([[0, 1, 2, 7], [9, 9, 3, 0]], np.uint8)
    save_segmentation(tmp_path / "seg.dcm", [(None, (0, 0, z), plane) for z in (0, 1)], "LABELMAP")
    volume = read_volume(tmp_path / "seg.dcm")
    np.testing.assert_array_equal(volume.values, [plane, plane])
    assert volume.label_names == {1: "liver", 2: "tumor", 3: "vessel"}
    text = "labels without a described segment were kept: 7, 9"
    assert volume.notes[-1] == text


@pytest.mark.parametrize("bit_packed", [False, True])
@pytest.mark.parametrize("shape", [(5, 7), (4, 8), (2, 2), (30, 40)])
def test_masks_in_rle_have_a_byte_for_a_pixel_or_for_eight(tmp_path, save_segmentation, bit_packed, shape):
    planes = masks(3, shape)
    planes[1] = 0
    planes[2, : shape[0] // 2 + 1] = 1
    frames = [(1, (-10, -20, 2.5 * z), plane) for z, plane in enumerate(planes)]
    save_segmentation(tmp_path / "seg.dcm", frames, syntax=RLE, bit_packed=bit_packed)
    np.testing.assert_array_equal(read_volume(tmp_path / "seg.dcm").values, planes)


@pytest.mark.parametrize("rows", [6, 50, 3])
def test_masks_in_rle_of_another_size_are_refused_in_a_sentence(tmp_path, save_segmentation, rows):
    frames = [(1, (-10, -20, 2.5 * z), plane) for z, plane in enumerate(masks(3, (4, 16)))]
    save_segmentation(tmp_path / "seg.dcm", frames, syntax=RLE, Rows=rows)
    with pytest.raises(CtmcError) as refused:
        read_volume(tmp_path / "seg.dcm")
    assert str(refused.value) == (
        f"seg.dcm is truncated or damaged (8 bytes of a frame of 16 x {rows} pixels); copy or export it again"
    )


def test_fewer_frames_in_rle_than_the_header_says_are_refused_in_a_sentence(tmp_path, save_segmentation):
    from pydicom.encaps import encapsulate

    frames = [(1, (-10, -20, 2.5 * z), plane) for z, plane in enumerate(masks(3))]
    packed = rle_frame(bytes(35))
    save_segmentation(tmp_path / "seg.dcm", frames, syntax=RLE, PixelData=encapsulate([packed, packed]))
    with pytest.raises(CtmcError, match=r"^seg\.dcm is truncated or damaged \(.*\); copy or export it again$"):
        read_volume(tmp_path / "seg.dcm")


def test_an_oblique_segmentation_lies_where_its_positions_say(tmp_path, save_segmentation):
    row, column = np.array([0.8, 0.6, 0.0]), np.array([0.0, 0.0, -1.0])
    normal = np.cross(row, column)
    planes = masks(3)
    start = np.array([3.0, -4.0, 5.0])
    frames = [(1, start + 1.5 * at * normal, planes[at]) for at in (1, 2, 0)]
    save_segmentation(tmp_path / "seg.dcm", frames, orientation=(*row, *column))
    volume = read_volume(tmp_path / "seg.dcm")
    np.testing.assert_array_equal(volume.values, planes)
    expected = (start + 6 * 0.5 * row + 4 * 0.8 * column + 2 * 1.5 * normal) * (-1, -1, 1)
    np.testing.assert_allclose((volume.affine @ (6, 4, 2, 1))[:3], expected, atol=1e-9)


def test_a_single_frame_gets_an_empty_slice_on_both_sides(tmp_path, save_segmentation):
    plane = masks(1)[0]
    save_segmentation(tmp_path / "seg.dcm", [(1, (0, 0, 7), plane)], gap=2.5)
    volume = read_volume(tmp_path / "seg.dcm")
    np.testing.assert_array_equal(volume.values, [0 * plane, plane, 0 * plane])
    assert volume.affine[2, 3] == pytest.approx(4.5)
    assert said(volume, "an empty slice was added on both sides, 2.5 mm away")


def test_names_are_decoded_and_nothing_of_the_patient_is_kept(tmp_path, save_segmentation):
    save_segmentation(tmp_path / "s.dcm", [(1, (0, 0, 7), masks(1)[0])], names=["Leber ä\n肝", ""])
    volume = read_volume(tmp_path / "s.dcm")
    assert volume.label_names == {1: "Leber ä 肝", 2: "segment 2"}
    assert "Muster" not in repr(vars(open_volume(tmp_path / "s.dcm"))) + repr(volume)
    assert volume_name(tmp_path / "s.dcm") == "s"


@pytest.mark.parametrize(
    ("tags", "words"),
    [
        ({"NumberOfFrames": 2_000_000_000}, "bytes of pixels"),
        ({"NumberOfFrames": 0}, "0 frames"),
        ({"Rows": 0}, "0 pixels"),
        ({"BitsAllocated": 32}, "32 bits"),
        ({"SegmentationType": "SURFACE"}, "type 'SURFACE'"),
        ({"SegmentSequence": None}, "describes no segment"),
        ({"PerFrameFunctionalGroupsSequence": None}, "0 functional groups for 3 frames"),
        ({"SharedFunctionalGroupsSequence": None}, "no orientation or no PixelSpacing"),
        ({"PixelData": None}, "no pixels"),
    ],
)
def test_headers_that_cannot_be_are_refused_in_a_sentence(tmp_path, save_segmentation, tags, words):
    frames = [(1, (0, 0, z), plane) for z, plane in enumerate(masks(3))]
    save_segmentation(tmp_path / "seg.dcm", frames, **tags)
    with pytest.raises(CtmcError, match=words):
        read_volume(tmp_path / "seg.dcm")


@pytest.mark.parametrize(
    ("heights", "words"),
    [
        ((0, 1, 2.5), "are not evenly spaced"),
        ((0, 1, 1e9), "numbers such as 0 instead of 3 in mm"),
        ((0, 123456, 1), "instead of 3 in mm"),
        ((0, 1, 1), "2 further frames of a segment|1 further frame of a segment"),
    ],
)
def test_places_that_make_no_grid_are_refused_in_a_sentence(tmp_path, save_segmentation, heights, words):
    frames = [(1, (0, 0, str(z)), plane) for z, plane in zip(heights, masks(3), strict=True)]
    path = tmp_path / "seg.dcm"
    save_segmentation(path, frames)
    path.write_bytes(path.read_bytes().replace(b"123456", b"   nan"))
    with pytest.raises(CtmcError, match=words):
        read_volume(tmp_path / "seg.dcm")


def test_slices_farther_apart_than_memory_holds_are_refused_before_anything_is_made(tmp_path, save_segmentation):
    frames = [(1, (0, 0, z), np.ones((3000, 3000), np.uint8)) for z in (0, 900_000, 900_000 + 14)]
    save_segmentation(tmp_path / "seg.dcm", frames)
    with pytest.raises(CtmcError, match="memory"):
        read_volume(tmp_path / "seg.dcm")


# The pixels of all frames of each segment, counted with pydicom.
@pytest.mark.parametrize(
    ("name", "counts"),
    [
        ("liver", {1: 107098}),
        ("partial_overlaps", {1: 9602, 2: 11888, 3: 10743, 4: 6693, 5: 4713}),
        ("sparse-labelmap-noppv", {1: 630}),
        ("sparse-labelmap-ppv5", {1: 630}),
    ],
)
def test_real_segmentations_have_every_pixel_of_their_frames(real, name, counts):
    volume = read_volume(real(f"seg_dcmqi/{name}.dcm"))
    assert {label: int(label_mask(volume, label).sum()) for label in volume.label_names} == counts


def test_the_real_liver_is_dcmqis_own_export_of_it(real):
    labels = read_volume(real("seg_dcmqi/liver_seg.nrrd"))
    volume = read_volume(real("seg_dcmqi/liver.dcm"))
    assert hashlib.sha256(volume.values).hexdigest() == hashlib.sha256(labels.values.astype(np.uint8)).hexdigest()
    np.testing.assert_allclose(volume.affine, labels.affine, atol=1e-5)
    assert (volume.label_names, volume.label_colors) == ({1: "Liver"}, {1: (221, 130, 101)})


def test_a_folder_is_its_only_segmentation_and_of_several_one_has_to_be_chosen(tmp_path, save_segmentation, save_stack):
    planes = masks(3)
    frames = [(1, (-10, -20, 2 * z), plane) for z, plane in enumerate(planes)]
    save_segmentation(tmp_path / "first.dcm", frames)
    np.testing.assert_array_equal(read_volume(tmp_path).values, planes)
    save_segmentation(tmp_path / "second.dcm", frames)
    with pytest.raises(CtmcError, match=r"2 segmentations or structure sets \(first\.dcm, second\.dcm\); choose one"):
        read_volume(tmp_path)
    hu = save_stack(tmp_path / "ct", range(0, 10, 2))
    np.testing.assert_array_equal(read_volume(tmp_path).values, hu)
