# SPDX-License-Identifier: GPL-3.0-or-later
"""Structure sets: contours filled on their CT, what is left out said, what cannot be refused."""

from __future__ import annotations

import numpy as np
import pytest
from volumes import label_mask

from ctmc_addon.core import CtmcError
from ctmc_addon.readers import open_volume, read_volume
from ctmc_addon.readers.dicom.labels.elements import Damaged
from ctmc_addon.readers.dicom.labels.label_file import whole

CLOSED, XOR = "CLOSED_PLANAR", "CLOSEDPLANAR_XOR"


def said(volume, text):
    return any(text in note for note in volume.notes)


def rectangle(left, top, right, bottom, z):
    """Positions in mm on the CT of `save_stack`: pixels of 0.5 x 0.8 mm from (-10, -20)."""
    corners = [(left, top), (right, top), (right, bottom), (left, bottom)]
    return [(-10 + 0.5 * x, -20 + 0.8 * y, z) for x, y in corners]


@pytest.fixture
def ct(tmp_path, save_stack):
    save_stack(tmp_path / "ct", range(0, 12, 2), (40, 50))
    return tmp_path


@pytest.mark.parametrize("syntax", ["1.2.840.10008.1.2", "1.2.840.10008.1.2.1", "1.2.840.10008.1.2.1.99"])
def test_contours_are_filled_where_they_lie_with_names_and_colors(ct, save_structures, syntax):
    regions = {
        "GTV": [(CLOSED, rectangle(10.5, 5.5, 20.5, 9.5, z)) for z in (4, 6)],
        "Lunge rechts ä": [(CLOSED, rectangle(30.5, 5.5, 40.5, 9.5, 2))],
    }
    save_structures(ct / "rt.dcm", regions, syntax)
    volume = read_volume(ct / "rt.dcm")
    expected = np.zeros((6, 40, 50), np.uint8)
    expected[2:4, 6:10, 11:21] = 1
    expected[1, 6:10, 31:41] = 2
    np.testing.assert_array_equal(volume.values, expected)
    assert (volume.kind, volume.name, volume.notes) == ("label", "rt", ())
    assert volume.label_names == {1: "GTV", 2: "Lunge rechts ä"}
    assert volume.label_colors == {1: (255, 0, 0), 2: (255, 10, 0)}
    np.testing.assert_allclose(volume.affine, read_volume(ct / "ct").affine)
    assert open_volume(ct / "rt.dcm").series[0].text == "series 1: 6 slices of 50 x 40, RTSTRUCT"


@pytest.mark.parametrize("kind", [CLOSED, XOR])
def test_a_contour_within_another_is_a_hole_and_one_drawn_twice_is_not(ct, save_structures, kind):
    ring = [(kind, rectangle(5.5, 5.5, 25.5, 25.5, 4)), (kind, rectangle(10.5, 10.5, 20.5, 20.5, 4))]
    save_structures(ct / "rt.dcm", {"ring": ring, "twice": [(kind, rectangle(30.5, 5.5, 35.5, 9.5, 4))] * 2})
    volume = read_volume(ct / "rt.dcm")
    assert (volume.values == 1).sum() == 20 * 20 - 10 * 10
    assert (volume.values == 2).sum() == 5 * 4
    assert said(volume, "copies of contours: 1 left out")


def test_regions_that_overlap_are_whole(ct, save_structures):
    regions = {
        name: [(CLOSED, rectangle(*box, 4))]
        for name, box in {
            "PTV": (5.5, 5.5, 25.5, 25.5),
            "GTV": (10.5, 10.5, 15.5, 15.5),
            "body": (1.5, 1.5, 45.5, 35.5),
        }.items()
    }
    save_structures(ct / "rt.dcm", regions)
    volume = read_volume(ct / "rt.dcm")
    assert [int(label_mask(volume, label).sum()) for label in (1, 2, 3)] == [400, 25, 44 * 34]
    assert said(volume, "they share PTV and body 400, PTV and GTV 25, GTV and body 25 voxels")


def test_points_and_open_lines_enclose_nothing_and_are_said(ct, save_structures):
    box = rectangle(1, 1, 9, 9, 4)
    contours = [
        ("POINT", [(0, 0, 4)]),
        ("OPEN_PLANAR", box),
        (CLOSED, box[:2]),
        (CLOSED, rectangle(1, 1, 9, 9, 90)),
        (CLOSED, [(x, y, z) for (x, y, _), z in zip(box, (0, 0, 9, 9), strict=True)]),
    ]
    save_structures(ct / "rt.dcm", {"lines": contours, "box": [(CLOSED, rectangle(0.5, 0.5, 9.5, 9.5, 4))]})
    volume = read_volume(ct / "rt.dcm")
    for text in (
        "contours of type POINT, which enclose nothing: 1 left out (lines 1)",
        "type OPEN_PLANAR",
        "less than 3 points: 1",
        "above or below all slices: 1",
        "do not lie in the plane of the slices: 1",
        "1 of 2 regions is empty: lines",
    ):
        assert said(volume, text), (text, volume.notes)


def test_planes_closer_than_the_slices_are_not_mixed(ct, save_structures):
    save_structures(ct / "rt.dcm", {"r": [(CLOSED, rectangle(0.5, 0.5, 9.5, 9.5, z)) for z in (3.4, 4, 4.6, 5.4, 6)]})
    volume = read_volume(ct / "rt.dcm")
    assert [int(plane.sum()) for plane in volume.values] == [0, 0, 81, 81, 0, 0]
    assert said(volume, "closer than the slices: 3 left out")


@pytest.mark.parametrize(("folder", "found"), [("ct", True), (".", True), ("plan", True), ("plan/deeper", False)])
def test_the_ct_is_found_in_the_same_folder_below_and_beside(ct, save_structures, folder, found):
    path = ct / folder / "rt.dcm"
    save_structures(path, {"r": [(CLOSED, rectangle(0.5, 0.5, 9.5, 9.5, 4))]})
    if found:
        assert read_volume(path).values.sum() == 81
    else:
        with pytest.raises(CtmcError, match=r"rt\.dcm holds contours, and the CT series .* put the two in one folder"):
            open_volume(path)


def test_the_frame_of_reference_finds_a_ct_whose_series_is_not_named(tmp_path, save_stack, save_structures):
    save_stack(tmp_path / "ct", range(4), (20, 20), SeriesInstanceUID="1.9", FrameOfReferenceUID="1.2.3.4.8")
    save_structures(tmp_path / "rt.dcm", {"r": [(CLOSED, rectangle(0.5, 0.5, 9.5, 9.5, 2))]})
    assert read_volume(tmp_path / "rt.dcm").values.sum() == 81


def test_the_frame_of_reference_of_a_region_finds_the_ct_where_the_set_names_none(
    tmp_path, save_stack, save_structures
):
    save_stack(tmp_path / "ct", range(4), (20, 20), SeriesInstanceUID="1.9", FrameOfReferenceUID="1.2.3.4.8")
    save_stack(tmp_path / "more", range(6), (20, 20), SeriesInstanceUID="1.8", FrameOfReferenceUID="1.2.3.4.9")
    regions = {"r": [(CLOSED, rectangle(0.5, 0.5, 9.5, 9.5, 2))]}
    save_structures(tmp_path / "rt.dcm", regions, frame=False, region_frame="1.2.3.4.8")
    volume = read_volume(tmp_path / "rt.dcm")
    assert volume.values.shape == (4, 20, 20)
    assert volume.values.sum() == 81
    save_structures(tmp_path / "rt.dcm", regions, frame=False)
    with pytest.raises(CtmcError, match=r"rt\.dcm holds contours, and the CT series .* put the two in one folder"):
        open_volume(tmp_path / "rt.dcm")


@pytest.mark.parametrize("region_frame", [None, "1.2.3.4.8"])
def test_the_images_of_contours_find_the_ct_among_series_of_one_frame(
    tmp_path, save_stack, save_structures, region_frame
):
    frame = {"FrameOfReferenceUID": "1.2.3.4.8"}
    save_stack(tmp_path / "late", range(6), (20, 20), SeriesInstanceUID="1.8", **frame)
    save_stack(tmp_path / "ct", range(3), (20, 20), SeriesInstanceUID="1.9", **frame)
    save_stack(tmp_path / "ct" / "last", [3], (20, 20), SeriesInstanceUID="1.9", SOPInstanceUID="1.9.3", **frame)
    regions = {"r": [(CLOSED, rectangle(0.5, 0.5, 9.5, 9.5, 3))]}
    save_structures(tmp_path / "rt.dcm", regions, frame=False, region_frame=region_frame, images="1.9.3")
    volume = read_volume(tmp_path / "rt.dcm")
    assert volume.values.shape == (4, 20, 20)
    assert volume.values[3].sum() == volume.values.sum() == 81


@pytest.mark.parametrize(
    ("kind", "reason"),
    [
        ("POINT", "contours of type POINT, which enclose nothing: 2 left out (r 2)"),
        ("CLOSEDPLANAR", "contours in rt.dcm of type 'CLOSEDPLANAR', which DICOM does not define: 2 left out (r 2)"),
        ("", "contours in rt.dcm without a type (ContourGeometricType): 2 left out (r 2)"),
        (CLOSED, "contours above or below all slices: 2 left out (r 2)"),
    ],
)
def test_a_set_without_a_contour_that_fills_a_slice_is_refused_with_the_reason(ct, save_structures, kind, reason):
    contours = [(kind, rectangle(0.5, 0.5, 9.5, 9.5, z)) for z in (50, 52)]
    save_structures(ct / "rt.dcm", {"r": contours, "none": []})
    with pytest.raises(CtmcError) as refused:
        read_volume(ct / "rt.dcm")
    assert str(refused.value) == (f"rt.dcm has no contours to fill on its CT ({reason}); choose another structure set")


def test_a_contour_of_an_unknown_type_is_said_with_its_file_and_region(ct, save_structures):
    box = rectangle(0.5, 0.5, 9.5, 9.5, 4)
    regions = {"a": [("RING", box), (CLOSED, box)], "b": [("RING", box), ("RING", box), (CLOSED, box)]}
    save_structures(ct / "rt.dcm", regions)
    volume = read_volume(ct / "rt.dcm")
    assert [int(label_mask(volume, label).sum()) for label in (1, 2)] == [81, 81]
    assert said(volume, "contours in rt.dcm of type 'RING', which DICOM does not define: 3 left out (a 1, b 2)")


@pytest.mark.parametrize("words", [b"nan", b"1e300", b"-inf", b"x", b""])
def test_positions_that_are_no_numbers_are_refused_in_a_sentence(ct, save_structures, words):
    path = ct / "rt.dcm"
    save_structures(path, {"r": [(CLOSED, [(1234.5678, -20, 4), (0, 0, 4), (0, -20, 4)])]})
    path.write_bytes(path.read_bytes().replace(b"1234.5678", words.rjust(9)))
    with pytest.raises(CtmcError, match=r"rt\.dcm is truncated or damaged"):
        read_volume(path)


@pytest.mark.parametrize(
    ("words", "color"),
    [
        (b"255.0\\0.0\\0.0", (255, 0, 0)),
        (b"0\\127.6\\300", (0, 128, 255)),
        (b"red\\0\\0", None),
        (b"nan\\0\\0", None),
        (b"1e400\\0\\0", None),
        (b"1\\\\3", None),
        (b"", None),
    ],
)
def test_a_color_in_other_words_is_read_or_left_out_and_refuses_nothing(ct, save_structures, words, color):
    path = ct / "rt.dcm"
    save_structures(path, {"r": [(CLOSED, rectangle(0.5, 0.5, 9.5, 9.5, 4))]}, color=(255, 1000, 1000))
    written = path.read_bytes()
    assert written.count(b"255\\1000\\1000 ") == 1
    path.write_bytes(written.replace(b"255\\1000\\1000 ", words.ljust(14)))
    volume = read_volume(path)
    assert volume.values.sum() == 81
    assert volume.label_colors == ({} if color is None else {1: color})


def test_a_defect_of_our_own_is_not_called_a_damaged_file(ct, save_structures, monkeypatch):
    save_structures(ct / "rt.dcm", {"r": [(CLOSED, rectangle(0.5, 0.5, 9.5, 9.5, 4))]})

    def defect(item):
        raise ValueError("a defect")

    monkeypatch.setattr("ctmc_addon.readers.dicom.labels.structures.contours_of", defect)
    with pytest.raises(ValueError, match="a defect"):
        read_volume(ct / "rt.dcm")


@pytest.mark.parametrize("tag", [b"\x06\x30\x22\0", b"\x06\x30\x84\0"], ids=["region", "contours"])
@pytest.mark.parametrize("words", [b"x1", b"1."])
def test_the_number_of_a_region_that_is_none_is_refused_in_a_sentence(ct, save_structures, tag, words):
    path = ct / "rt.dcm"
    save_structures(path, {"r": [(CLOSED, rectangle(0.5, 0.5, 9.5, 9.5, 4))]})
    number = tag + b"\2\0\0\0" + b"10"
    written = path.read_bytes()
    assert written.count(number) == 1
    path.write_bytes(written.replace(number, number[:-2] + words))
    with pytest.raises(CtmcError) as refused:
        read_volume(path)
    assert str(refused.value) == (
        f"rt.dcm is truncated or damaged ('{words.decode()}' instead of a whole number); copy or export it again"
    )


def test_a_number_of_5000_digits_is_damage():
    with pytest.raises(Damaged, match=r"^'999999[9]*\.\.\.' instead of a whole number$"):
        whole(b"9" * 5000)


def test_contours_that_cross_too_many_rows_are_refused_in_a_sentence(ct, save_structures, monkeypatch):
    monkeypatch.setattr("ctmc_addon.readers.dicom.labels.contour_filling.MOST_CROSSINGS", 10)
    save_structures(ct / "rt.dcm", {"r": [(CLOSED, rectangle(0.5, 0.5, 9.5, 9.5, 4))]})
    with pytest.raises(CtmcError, match="cross rows of pixels more than 10 times"):
        read_volume(ct / "rt.dcm")


def test_a_structure_set_without_contours_is_refused_in_a_sentence(ct, save_structures):
    save_structures(ct / "rt.dcm", {"r": []})
    with pytest.raises(CtmcError, match=r"rt\.dcm has no contours"):
        read_volume(ct / "rt.dcm")


# The voxels of skimage.draw.polygon2mask 0.26 and matplotlib.path.Path 3.11 on the same contours: Dice 1.0000 for all.
@pytest.mark.parametrize(
    ("name", "counts"),
    [
        ("rt", [1443]),
        ("invalid_reference_rt", [4976, 3697, 4519, 6954]),
        ("non_existent_reference_rt", [4976, 3697, 4519, 6954]),
    ],
)
def test_real_contours_are_filled_as_by_others(real, name, counts):
    volume = read_volume(real(f"rtstruct/{name}.dcm"))
    assert np.bincount(volume.values.ravel())[1:].tolist() == counts
