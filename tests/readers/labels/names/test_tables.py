# SPDX-License-Identifier: GPL-3.0-or-later
"""Label tables beside a volume: Slicer's, FreeSurfer's and ITK-SNAP's, and what is not one."""

from __future__ import annotations

import nibabel
import numpy as np
import pytest

from ctmc_addon.readers import read_volume

SLICER = (
    "# Color table file seg.ctbl\n# 3 values\n0 background 0 0 0 0\n1 tissue 128 174 128 255\n2 left_lung 1 2 3 255\n"
)
FREESURFER = "#$Id: FreeSurferColorLUT.txt\n\n#No. Label Name:                R   G   B   A\n\n0   Unknown   0 0 0 0\n"
FREESURFER += "2   Left-Cerebral-White-Matter              245 245 245 0\n1   Left-Cerebral-Exterior  70  130 180 0\r\n"
ITK_SNAP = "################\n# ITK-SnAP Label Description File\n################\n"
ITK_SNAP += '    0     0    0    0        0  0  0    "Clear Label"\n'
ITK_SNAP += '    1   255    0    0        1  1  1    "Left lung"\n'
ITK_SNAP += '    2     0  255    0     0.35  1  0    "Liver (whole)"\n'


def save(folder, name="seg.nii.gz", high=3):
    values = np.random.default_rng(0).integers(0, high, (6, 7, 8)).astype(np.uint8)
    nibabel.save(nibabel.Nifti1Image(values, np.eye(4)), folder / name)
    return folder / name


@pytest.mark.parametrize(
    ("text", "names", "colors"),
    [
        (SLICER, {1: "tissue", 2: "left_lung"}, {1: (128, 174, 128), 2: (1, 2, 3)}),
        (
            FREESURFER,
            {1: "Left-Cerebral-Exterior", 2: "Left-Cerebral-White-Matter"},
            {1: (70, 130, 180), 2: (245, 245, 245)},
        ),
        (ITK_SNAP, {1: "Left lung", 2: "Liver (whole)"}, {1: (255, 0, 0), 2: (0, 255, 0)}),
    ],
)
@pytest.mark.parametrize("name", ["seg.txt", "seg.ctbl", "seg.nii.txt", "labels.txt", "colors.lut"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig"])
def test_names_and_colors_come_from_the_table_beside_it(tmp_path, text, names, colors, name, encoding):
    path = save(tmp_path)
    (tmp_path / name).write_text(text, encoding)
    (tmp_path / "README.txt").write_text("Labels of the left lung.\n1 and 2 are used.\n")
    volume = read_volume(path)
    assert (dict(volume.label_names), dict(volume.label_colors)) == (names, colors)
    assert f"names and colors of labels are from {name} beside it" in volume.notes


def test_of_two_tables_that_of_the_volumes_name_is_taken_and_else_none(tmp_path):
    path = save(tmp_path)
    (tmp_path / "a.txt").write_text(SLICER)
    (tmp_path / "b.txt").write_text(ITK_SNAP)
    assert read_volume(path).label_names == {}
    (tmp_path / "seg.ctbl").write_text(SLICER)
    assert read_volume(path).label_names[1] == "tissue"


def test_a_table_does_not_make_labels_of_a_ct(tmp_path):
    path = tmp_path / "ct.nii"
    values = np.random.default_rng(0).integers(-1000, 1000, (6, 7, 8)).astype(np.int16)
    nibabel.save(nibabel.Nifti1Image(values, np.eye(4)), path)
    (tmp_path / "ct.txt").write_text(SLICER)
    volume = read_volume(path)
    assert (volume.kind, volume.label_names, volume.notes) == ("HU", {}, read_volume(path).notes)


def test_names_of_the_file_itself_come_before_those_beside_it(tmp_path):
    path = save(tmp_path)
    image = nibabel.load(path)
    xml = '<Caret><LabelTable><Label Key="1" Red="0.2" Green="1" Blue="0">own</Label></LabelTable></Caret>'
    image.header.extensions.append(nibabel.nifti1.Nifti1Extension(0, xml.encode()))
    nibabel.save(image, tmp_path / "own_seg.nii.gz")
    (tmp_path / "own_seg.txt").write_text(SLICER)
    volume = read_volume(tmp_path / "own_seg.nii.gz")
    assert (volume.label_names, volume.label_colors) == ({1: "own"}, {1: (51, 255, 0)})


@pytest.mark.parametrize(
    "text",
    [
        "",
        "1 tissue 128 174 128\n",
        "1 tissue 128 174 300 255\n",
        SLICER + "and a sentence\n",
        "0 background 0 0 0 0\n",
        "\0" * 100,
        "1 " + "x" * (1 << 21) + " 1 2 3 4\n",
        "9" * 5000 + " a 1 2 3 4\n",
    ],
)
def test_a_text_of_something_else_is_no_table(tmp_path, text):
    path = save(tmp_path)
    (tmp_path / "seg.txt").write_text(text)
    assert read_volume(path).label_names == {}


def test_a_long_line_that_almost_is_a_table_takes_no_time(tmp_path):
    path = save(tmp_path)
    (tmp_path / "seg.txt").write_text("1 " + "1 " * 400_000)
    assert read_volume(path).label_names == {}


def test_total_segmentators_names_are_used_where_the_file_is_called_so(tmp_path):
    volume = read_volume(save(tmp_path, "case_TotalSegmentator.nii.gz", 118))
    assert len(volume.label_names) == 117
    places = {1: "spleen", 5: "liver", 26: "vertebrae_S1", 50: "vertebrae_C1", 51: "heart", 79: "spinal_cord"}
    places |= {91: "skull", 92: "rib_left_1", 115: "rib_right_12", 117: "costal_cartilages"}
    assert {label: volume.label_names[label] for label in places} == places
    assert any("TotalSegmentator" in note for note in volume.notes)
    assert read_volume(save(tmp_path, "seg.nii.gz", 118)).label_names == {}


def test_colors_of_anatomical_names_come_before_those_of_the_file_where_they_are_asked_for(tmp_path):
    path = save(tmp_path)
    (tmp_path / "seg.ctbl").write_text("1 liver 0 255 255 255\n2 structure 1 2 3 255\n", "utf-8")
    assert read_volume(path).label_colors == {1: (0, 255, 255), 2: (1, 2, 3)}
    assert read_volume(path, anatomy_colors=True).label_colors == {2: (1, 2, 3)}
