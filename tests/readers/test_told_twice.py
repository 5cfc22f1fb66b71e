# SPDX-License-Identifier: GPL-3.0-or-later
"""Geometry that a header tells twice, or that cannot be: one is taken, and a note says which and what differs."""

from __future__ import annotations

import nibabel
import numpy as np
import pytest

from ctmc_addon.readers import read_volume

VALUES = np.arange(210, dtype=np.int16).reshape(7, 6, 5)
AS_SPM = (
    "Analyze has no orientation: taken as SPM does, columns towards the patient's left, rows towards the front, slices "
    "towards the head; flip x, y or z changes it"
)


def diagonal(*sides, at=(0, 0, 0)):
    affine = np.diag([*sides, 1.0])
    affine[:3, 3] = at
    return affine


def nifti(path, sform, qform, codes=(1, 1), kind=nibabel.Nifti1Image, **fields):
    """A file whose header is written as it is: nibabel itself would keep pixdim and the forms alike."""
    image = kind(VALUES.T, np.eye(4))
    image.set_sform(sform, codes[0])
    image.set_qform(qform, codes[1])
    header = image.header.copy()
    fields = {"vox_offset": 544, "magic": b"n+2" if kind is nibabel.Nifti2Image else b"n+1", **fields}
    for field, value in fields.items():
        header[field] = value
    path.write_bytes(header.binaryblock.ljust(544, b"\0") + VALUES.tobytes())
    return path


@pytest.mark.parametrize("kind", [nibabel.Nifti1Image, nibabel.Nifti2Image])
@pytest.mark.parametrize(
    ("sform", "qform", "words"),
    [
        (diagonal(1, 1, 3), diagonal(1, 1, 2), "sform and qform differ (spacing 1 x 1 x 3 and 1 x 1 x 2 mm)"),
        (
            diagonal(1, 1, 2),
            diagonal(-1, 1, 2),
            "sform and qform differ (axes to RAS, right-handed, and to LAS, left-handed)",
        ),
        (
            diagonal(-1, -1, 2),
            diagonal(1, 1, 2.1),
            "sform and qform differ (spacing 1 x 1 x 2 and 1 x 1 x 2.1 mm; axes to LPS, right-handed, and to RAS, "
            "right-handed)",
        ),
        (diagonal(1, 1, 2), diagonal(1, 1, 2, at=(0, 12, 0)), "sform and qform differ (places up to 12 mm apart)"),
    ],
)
def test_the_sform_is_taken_and_what_differs_in_the_qform_is_said(tmp_path, kind, sform, qform, words):
    path = nifti(tmp_path / "ct.nii", sform, qform, kind=kind)
    volume = read_volume(path)
    np.testing.assert_array_equal(volume.affine, sform)
    np.testing.assert_array_equal(volume.affine, nibabel.load(path).affine)
    assert volume.notes == (f"the file's {words}: sform is taken",)


def test_forms_that_agree_but_for_rounding_are_not_worth_a_note(tmp_path):
    turn = np.radians(180 - 1e-3)
    sform = diagonal(0.7, 0.7, 2, at=(-150, 120, 900))
    sform[:2, :2] = 0.7 * np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    assert read_volume(nifti(tmp_path / "ct.nii", sform, sform)).notes == ()


def test_a_form_that_is_not_in_use_is_not_compared(tmp_path):
    other = diagonal(-1, 1, 3)
    assert read_volume(nifti(tmp_path / "a.nii", other, diagonal(1, 1, 2), (0, 1))).notes == ()
    fields = {"pixdim": [1, 1, 1, 3, 1, 1, 1, 1]}
    assert read_volume(nifti(tmp_path / "b.nii", other, diagonal(1, 1, 2), (1, 0), **fields)).notes == ()


def test_a_broken_qform_beside_an_sform_is_said(tmp_path):
    path = nifti(tmp_path / "ct.nii", np.eye(4), np.eye(4), quatern_b=1, quatern_c=1)
    volume = read_volume(path)
    np.testing.assert_array_equal(volume.affine, np.eye(4))
    (note,) = volume.notes
    assert note.startswith("the file's qform is broken (w2 should be positive, but is -1")
    assert note.endswith(": sform is taken")


def test_pixdim_that_differs_from_the_sform_is_said(tmp_path):
    fields = {"pixdim": [1, 1, 1, 0, 1, 1, 1, 1]}
    volume = read_volume(nifti(tmp_path / "ct.nii", diagonal(1, 1, 2), np.eye(4), (1, 0), **fields))
    assert volume.spacing == (1, 1, 2)
    assert volume.notes == ("the file's sform and pixdim differ (spacing 1 x 1 x 2 and 1 x 1 x 0 mm): sform is taken",)


@pytest.mark.parametrize("codes", [(0, 1), (0, 0)])
@pytest.mark.parametrize(
    ("pixdim", "spacing", "words"),
    [
        ((1, 1, 0), (1, 1, 1), "1 x 1 x 0: taken as 1 x 1 x 1 mm"),
        ((-2, 1, 3), (2, 1, 3), "-2 x 1 x 3: taken as 2 x 1 x 3 mm"),
    ],
)
def test_distances_of_0_or_below_are_mended_and_said(tmp_path, codes, pixdim, spacing, words):
    path = nifti(tmp_path / "ct.nii", np.eye(4), np.eye(4), codes, pixdim=[1, *pixdim, 1, 1, 1, 1])
    volume = read_volume(path)
    assert volume.spacing == spacing
    assert volume.notes[-1] == f"the file's pixdim is {words}; give the spacing in mm for another"
    given = read_volume(path, spacing=(1, 2, 5))
    assert given.spacing == (1, 2, 5)


def test_distances_of_an_analyze_are_mended_as_nibabel_does(tmp_path):
    pytest.importorskip("scipy", reason="nibabel writes .mat with it")
    image = nibabel.spm2analyze.Spm2AnalyzeImage(VALUES.T, diagonal(-2, 1, 3))
    nibabel.save(image, tmp_path / "ct.img")
    content = bytearray((tmp_path / "ct.hdr").read_bytes())
    content[80:92] = np.array([-2, 1, 0], "<f4").tobytes()
    (tmp_path / "ct.hdr").write_bytes(content)
    (tmp_path / "ct.mat").unlink(missing_ok=True)
    volume = read_volume(tmp_path / "ct.hdr")
    np.testing.assert_array_equal(volume.affine[:3, :3], np.diag([-2, 1, 1]))
    said = "the file's pixdim is -2 x 1 x 0: taken as 2 x 1 x 1 mm; give the spacing in mm for another"
    assert volume.notes == (AS_SPM, said)


@pytest.mark.parametrize(("code", "mm"), [(1, 1000.0), (2, 1.0), (3, 1e-3), (0, 1.0), (5, 1.0)])
def test_a_unit_by_number_is_in_the_same_table(tmp_path, code, mm):
    volume = read_volume(nifti(tmp_path / "ct.nii", diagonal(1, 1, 2), diagonal(1, 1, 2), xyzt_units=code))
    assert volume.spacing == pytest.approx((mm, mm, 2 * mm))
    assert any("unit 'xyzt_units 5' is not a known unit" in note for note in volume.notes) == (code == 5)
    assert any("were converted to mm" in note for note in volume.notes) == (mm != 1)


def nrrd(path, *lines):
    head = [
        "NRRD0005",
        "type: short",
        "endian: little",
        "dimension: 3",
        "sizes: 5 6 7",
        "encoding: raw",
        *lines,
        "",
        "",
    ]
    path.write_bytes("\n".join(head).encode() + VALUES.tobytes())
    return path


AXIAL = (
    "the NRRD has spacings but no orientation: taken as axial, columns towards the patient's left, rows towards the "
    "back, slices towards the head; flip x, y or z changes it"
)
UNCENTERED = "the NRRD has axis mins without centerings: taken as the positions of the first samples"


@pytest.mark.parametrize(
    ("lines", "spacing", "first", "notes"),
    [
        (("spacings: 0.5 1 2", "axis mins: 10 20 30"), (0.5, 1, 2), (-10, -20, 30), (AXIAL, UNCENTERED)),
        (
            ("spacings: 0.5 1 2", "axismins: 10 nan 30", "centerings: node node node"),
            (0.5, 1, 2),
            (-10, 0, 30),
            (AXIAL,),
        ),
        (
            ("spacings: 0.5 1 2", "axis mins: 10 20 30", "centerings: cell cell node"),
            (0.5, 1, 2),
            (-10.25, -20.5, 30),
            (AXIAL,),
        ),
        (("axis mins: 0 0 0", "axis maxs: 4 10 12", "centerings: node node node"), (1, 2, 2), (0, 0, 0), (AXIAL,)),
        (("axis mins: 0 0 0", "axis maxs: 5 12 14", "centerings: cell cell cell"), (1, 2, 2), (-0.5, -1, 1), (AXIAL,)),
        (
            ("space: right-anterior-superior", "spacings: 0.5 1 2", "space origin: (10,20,30)"),
            (0.5, 1, 2),
            (10, 20, 30),
            (AXIAL,),
        ),
        (
            ("space dimension: 3", "spacings: 0.5 1 2", "space origin: (10,20,30)"),
            (0.5, 1, 2),
            (-10, -20, 30),
            (AXIAL,),
        ),
        (("spacings: 0.5 1 2",), (0.5, 1, 2), (0, 0, 0), (AXIAL,)),
    ],
)
def test_a_nrrd_without_directions_keeps_its_position(tmp_path, lines, spacing, first, notes):
    volume = read_volume(nrrd(tmp_path / "ct.nrrd", *lines))
    np.testing.assert_allclose(volume.affine[:3, :3], np.diag(spacing * np.array([-1, -1, 1])))
    np.testing.assert_allclose(volume.affine[:3, 3], first)
    assert volume.notes == notes


def test_spacings_beside_other_directions_of_a_nrrd_are_said(tmp_path):
    lines = "space: right-anterior-superior", "space directions: (1,0,0) (0,1,0) (0,0,3)"
    volume = read_volume(nrrd(tmp_path / "ct.nrrd", *lines, "spacings: 1 1 2"))
    assert volume.spacing == (1, 1, 3)
    assert volume.notes == (
        "the file has spacings 1 x 1 x 2 and space directions of the lengths 1 x 1 x 3: the directions are taken",
    )
    assert read_volume(nrrd(tmp_path / "ct.nrrd", *lines, "spacings: 1 1 3")).notes == ()


TURNED = "the file has {} 1 x 1 x -2: an axis below 0 runs backwards; flip x, y or z changes it"


def test_a_spacing_below_0_turns_its_axis_and_is_said(tmp_path):
    volume = read_volume(nrrd(tmp_path / "ct.nrrd", "spacings: 1 1 -2"))
    np.testing.assert_array_equal(volume.affine[:3, :3], np.diag([-1, -1, -2]))
    assert volume.notes == (AXIAL, TURNED.format("spacings"))
    head = "NDims = 3\nDimSize = 5 6 7\nElementType = MET_SHORT\nElementSpacing = 1 1 -2\nElementDataFile = LOCAL\n"
    (tmp_path / "ct.mha").write_bytes(head.encode() + VALUES.tobytes())
    volume = read_volume(tmp_path / "ct.mha")
    np.testing.assert_array_equal(volume.affine[:3, :3], np.diag([-1, -1, -2]))
    assert volume.notes == (TURNED.format("ElementSpacing"),)


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ("ElementSpacing = 1 1 2\nElementSize = 1 1 3\n", "ElementSpacing 1 1 2 and ElementSize 1 1 3: ElementSpacing"),
        ("ElementSpacing = 1 1 2\nOffset = 0 0 1\nPosition = 0 0 9\n", "Offset 0 0 1 and Position 0 0 9: Offset"),
        ("ElementSpacing = 1 1 2\nPosition = 0 0 1\nOrigin = 0 0 9\n", "Position 0 0 1 and Origin 0 0 9: Position"),
        (
            "ElementSpacing = 1 1 2\nTransformMatrix = 1 0 0 0 1 0 0 0 1\nRotation = 1 0 0 0 -1 0 0 0 1\n",
            "TransformMatrix 1 0 0 0 1 0 0 0 1 and Rotation 1 0 0 0 -1 0 0 0 1: TransformMatrix",
        ),
        ("ElementSpacing = 1 1 2\nElementSize = 1.0 1 2\nOffset = 0 0 0\nOrigin = 0 0 0\n", ""),
    ],
)
def test_fields_of_a_metaimage_under_two_names_are_said(tmp_path, lines, words):
    head = f"NDims = 3\nDimSize = 5 6 7\nElementType = MET_SHORT\n{lines}ElementDataFile = LOCAL\n"
    (tmp_path / "ct.mha").write_bytes(head.encode() + VALUES.tobytes())
    volume = read_volume(tmp_path / "ct.mha")
    assert volume.spacing == (1, 1, 2)
    assert volume.notes == ((f"the file has {words} is taken",) if words else ())
