# SPDX-License-Identifier: GPL-3.0-or-later
import gzip

import nibabel
import numpy as np
import pytest

from ctmc_addon.cli.batch.cases import collect, values_of
from ctmc_addon.cli.batch.command import need_of
from ctmc_addon.cli.flags.arguments import with_flags
from ctmc_addon.core import ReconstructionSettings
from ctmc_addon.core.errors import CtmcError
from ctmc_addon.core.planning.case_plan import (
    BLENDER_PROCESS_BYTES,
    CASE_VOXEL_BYTES,
    PROCESS_BYTES,
    READING_COPIES,
    asks_for_memory,
    case_bytes,
)
from ctmc_addon.readers import ReadingOptions

READING = ReadingOptions()
TASK = {"hu": False, "format": ".stl"}


def touch(folder, *names):
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(b"")


def names(*inputs, **rest):
    return [case.name for case in collect([str(one) for one in inputs], rest, READING)]


def outputs(cases):
    return [(output.name, output.settings.label) for case in cases for output in case.outputs]


def refusal(*inputs, **settings):
    with pytest.raises(CtmcError) as caught:
        collect([str(one) for one in inputs], settings, READING)
    return str(caught.value)


def test_a_folder_of_volumes_gives_one_case_each_in_natural_order(tmp_path):
    touch(tmp_path, "b-10.nii", "b-9.nii.gz", "a.nrrd", "c.npy", "truth.json", ".hidden.nii", "d.nhdr", "d.raw")
    assert names(tmp_path) == ["a", "b-9", "b-10", "c", "d"]


def test_segmentations_belong_to_their_volumes(tmp_path):
    touch(tmp_path, "volume-1.nii", "segmentation-1.nii", "volume-2.nii.gz", "segmentation-2.nii", "segmentation-3.nii")
    assert names(tmp_path) == ["segmentation-3", "volume-1", "volume-2"]
    assert names(tmp_path / "*.nii*") == ["segmentation-3", "volume-1", "volume-2"]
    assert names(tmp_path / "segmentation-*") == ["segmentation-1", "segmentation-2", "segmentation-3"]


def test_a_folder_of_slices_is_one_case_and_a_folder_of_folders_several(tmp_path):
    touch(tmp_path, "p2/slice_1.png", "p10/slice_1.png", "p10/slice_2.png")
    (tmp_path / "p3" / "study" / "series").mkdir(parents=True)
    (tmp_path / "p3" / "study" / "series" / "1.dcm").write_bytes(bytes(128) + b"DICM")
    assert names(tmp_path / "p2") == ["p2"]
    assert names(tmp_path) == ["p2", "p3", "p10"]


def test_a_folder_with_nothing_in_it_is_not_passed_over(tmp_path):
    touch(tmp_path, "p1/a.nii", "p2/notes.txt", "p3/b.nii", "p3/c.nii")
    (tmp_path / "p4").mkdir()
    assert names(tmp_path) == ["p1", "p2", "p3-b", "p3-c", "p4"]


def test_the_output_folder_is_no_case(tmp_path):
    touch(tmp_path, "p1/a.nii", "out/x.json")
    assert [case.name for case in collect([str(tmp_path)], {}, READING, tmp_path / "out")] == ["p1"]


@pytest.mark.parametrize("pattern", ["*", "*/*", "**/*", "[!x]*"])
def test_a_pattern_passes_over_the_output_folder_and_its_pictures(tmp_path, pattern):
    touch(tmp_path, "p1/1.png", "p1/2.png", "out/thumbnails/p1.png", "out/p1.stl")
    cases = collect([str(tmp_path / pattern)], {}, READING, tmp_path / "out")
    assert {case.path.relative_to(tmp_path).parts[0] for case in cases} == {"p1"}


def test_a_pattern_may_begin_in_the_output_folder(tmp_path):
    touch(tmp_path, "a.nii", "b/c.nii")
    for pattern, expected in (("*.nii", ["a"]), ("b/*", ["c"])):
        cases = collect([str(tmp_path / pattern)], {}, READING, tmp_path)
        assert [case.name for case in cases] == expected


def test_a_lone_dicom_slice_is_named_after_its_folder(tmp_path):
    touch(tmp_path, "case 7/1.2.840.dcm")
    (tmp_path / "case 7" / "1.2.840.dcm").write_bytes(bytes(128) + b"DICM")  # an empty file is of no kind
    assert names(tmp_path / "case 7" / "1.2.840.dcm") == ["case 7"]


def test_several_labels_give_several_outputs_of_one_case(tmp_path):
    touch(tmp_path, "a.nii")
    [case] = collect([str(tmp_path)], {"label": [1, 2]}, READING)
    assert outputs([case]) == [("a-label-1", 1), ("a-label-2", 2)]
    assert outputs(collect([str(tmp_path)], {"label": [2]}, READING)) == [("a", 2)]


def test_a_manifest_gives_names_and_settings_case_by_case(tmp_path):
    touch(tmp_path, "ct/a.nii", "ct/b.nii", "c, d.nii")
    (tmp_path / "cases.csv").write_text(
        "\ufeffinput,case,label,stride,soften,close_border,region,spacing,threshold\r\n"
        'ct/a.nii,first,1 2,2 2 1,,yes,,0.5,\r\n\r\n"c, d.nii",,,3,1.5,,0 0 0 9 9 9,1 1 2,-300\r\nct/b.nii\r\n',
        "utf-8",
        newline="",
    )
    first, second, third = collect([str(tmp_path / "cases.csv")], {"label": [7], "alpha": 0.5}, READING)
    assert outputs([first]) == [("first-label-1", 1), ("first-label-2", 2)]
    one, two = (case.outputs[0].settings for case in (first, second))
    assert (one.stride, one.close_border, one.alpha, one.smoothing_mm) == ((2, 2, 1), True, 0.5, None)
    assert first.reading.spacing == (0.5, 0.5, 0.5)
    assert (two.stride, two.smoothing_mm, two.region) == ((3, 3, 3), 1.5, (0, 0, 0, 9, 9, 9))
    assert (two.threshold, two.label) == (-300, None)  # a row's threshold takes the place of everyone's label
    assert second.reading.spacing == (1, 1, 2)
    assert second.path == tmp_path / "c, d.nii"
    assert outputs([third]) == [("b", 7)]


def test_semicolons_part_columns_where_spreadsheets_write_them(tmp_path):
    touch(tmp_path, "a.nii")
    (tmp_path / "m.csv").write_text("input;--max-error\na.nii;0.25\n")
    [case] = collect([str(tmp_path / "m.csv")], {"reduction": 0.5}, READING)
    assert (case.outputs[0].settings.max_error_mm, case.outputs[0].settings.reduction) == (0.25, None)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("input,color\na.nii,red\n", ["m.csv, line 1", "unknown column 'color'", "input, case, threshold"]),
        ("case,label\na,2\n", ["m.csv, line 1", "no column 'input'"]),
        ("input,soften,smoothing_mm\n", ["line 1", "'smoothing-mm' appears twice"]),
        ("input,label\na.nii,1\n\nno.nii,2\n", ["m.csv, line 4", "no file or folder 'no.nii'"]),
        ("input,label\n,2\n", ["m.csv, line 2", "input is missing"]),
        ("input,alpha\na.nii,much\n", ["m.csv, line 2", "alpha cannot be 'much'; write a number or auto, not 'much'"]),
        ("input,label\na.nii,1 two\n", ["m.csv, line 2", "label cannot be '1 two'; write a whole number", "not 'two'"]),
        ("input,keep_parts\na.nii,1.5\n", ["m.csv, line 2", "keep-parts cannot be '1.5'; write a whole number"]),
        (
            "input,alpha\na.nii,0.1\na.nii,7\n",
            ["m.csv, line 3", "alpha cannot be '7'; must be from 0 to 1 or auto, not 7"],
        ),
        ("input,close_border\na.nii,perhaps\n", ["line 2", "write true or false"]),
        ("input,stride\na.nii,1 2\n", ["line 2", "write 3 numbers"]),
        ("input,spacing\na.nii,0\n", ["line 2", "from 1e-06 to 10000 mm"]),
        ("input,label,threshold\na.nii,1,5\n", ["line 2", "choose one"]),
        ("input\na.nii,5\n", ["line 2", "2 cells", "1 column"]),
        ("input,spacing\na.nii,0.7 a 2\n", ["m.csv, line 2", "spacing cannot be '0.7 a 2'; write a number, not 'a'"]),
        ("input,case\na.nii,x/y\n", ["'x/y' is not a valid file name on every system: '/' is not allowed"]),
        ("input,case\na.nii,con\n", ["m.csv, line 2: 'con' is not a valid file name", "Windows keeps it for a device"]),
        ("input,case\na.nii,x.\n", ["it begins or ends with '.'"]),
        ("input,case\na.nii,Summary\n", ["the summary's own file"]),
        ("input,case\na.nii,\u00c4\na.nii,a\u0308\n", ["two cases would write the same file"]),
        ("input\n", ["names no case"]),
        ("", ["names no case"]),
    ],
)
def test_a_bad_manifest_is_refused_with_its_line(tmp_path, text, words):
    touch(tmp_path, "a.nii")
    (tmp_path / "m.csv").write_text(text, "utf-8")
    sentence = refusal(tmp_path / "m.csv")
    for word in words:
        assert word in sentence


def test_a_letter_of_a_manifest_that_is_not_utf_8_is_named_with_its_place(tmp_path):
    (tmp_path / "m.csv").write_bytes("input,case\na.nii,Ä Müller\n".encode().replace(b"\xc3\xbc", b"\xfc"))
    assert (
        refusal(tmp_path / "m.csv")
        == "m.csv, line 2: the byte 0xfc behind 'a.nii,Ä M' is not UTF-8; save it as 'CSV UTF-8'"
    )


def test_a_name_that_is_too_long_for_a_file_is_refused_before_the_work(tmp_path):
    touch(tmp_path, "a.nii")
    for name, label, size in (("é" * 120, 1, 240), ("é" * 120 + "n", 1, 241), ("n" * 232, "1 22", 241)):
        (tmp_path / "m.csv").write_text(f"input,case,label\na.nii,{name},{label}\n", "utf-8")
        if size <= 240:
            [case] = collect([str(tmp_path / "m.csv")], {}, READING)
            (tmp_path / f"{case.name}.blend.json").touch()  # the disk agrees
        else:
            assert f"has {size} bytes and may have 240" in refusal(tmp_path / "m.csv")


def test_a_manifests_refusal_names_columns_and_no_flags(tmp_path):
    touch(tmp_path, "a.nii")
    for text in ("input,color\n", "input,soften,smoothing_mm\n", "input,smoothing_mm\na.nii,much\n"):
        (tmp_path / "m.csv").write_text(text, "utf-8")
        assert "--" not in with_flags(refusal(tmp_path / "m.csv"))  # as the command says it
    (tmp_path / "m.csv").write_text("input,color\n", "utf-8")
    names = refusal(tmp_path / "m.csv").partition("the columns are ")[2].split(", ")
    (tmp_path / "m.csv").write_text(",".join(names) + "\na.nii\n", "utf-8")
    assert names[:2] == ["input", "case"]
    assert len(collect([str(tmp_path / "m.csv")], {}, READING)) == 1  # and all of them are taken


def test_an_open_quote_in_a_long_manifest_is_refused_with_its_line(tmp_path):
    (tmp_path / "m.csv").write_text('input,case\na.nii,b\na.nii,"c\n' + "a.nii,d\n" * 20000)
    touch(tmp_path, "a.nii")
    assert refusal(tmp_path / "m.csv").startswith("m.csv, line 3: the row cannot be read (")


def test_a_manifest_in_another_coding_is_said(tmp_path):
    (tmp_path / "m.csv").write_bytes("input\nJürgen.nii\n".encode("cp1252"))
    assert "CSV UTF-8" in refusal(tmp_path / "m.csv")


@pytest.mark.parametrize("other", ["y/a.nii", "y/A.nii.gz", "y/a.npy"])
def test_two_cases_that_would_write_the_same_file_are_refused(tmp_path, other):
    touch(tmp_path, "x/a.nii", other)
    sentence = refusal(tmp_path / "x" / "a.nii", tmp_path / other)
    assert "two cases would write the same file" in sentence
    assert "x/a.nii" in sentence
    assert other in sentence


def test_a_label_may_not_collide_with_another_case(tmp_path):
    touch(tmp_path, "a.nii", "a-label-2.nii")
    (tmp_path / "m.csv").write_text("input,label\na.nii,1 2\na-label-2.nii,\n")
    assert "a-label-2" in refusal(tmp_path / "m.csv")


def test_missing_paths_and_patterns_without_a_file_are_refused(tmp_path):
    assert "there is no file or folder" in refusal(tmp_path / "none")
    assert "no file or folder fits" in refusal(tmp_path / "*.nii")


def test_need_of_memory_grows_with_the_volume_that_is_read(tmp_path):
    np.save(tmp_path / "a.npy", np.zeros((4, 50, 60), np.int16))
    header = bytearray(348)
    header[0:4] = (348).to_bytes(4, "little")
    header[40:50] = np.array([3, 70, 80, 9, 1], "<i2").tobytes()
    header[70:74] = np.array([4, 16], "<i2").tobytes()
    header[108:112] = np.float32(352).tobytes()
    header[344:348] = b"n+1\0"
    (tmp_path / "b.nii.gz").write_bytes(gzip.compress(bytes(header) + bytes(4)))
    touch(tmp_path, "broken.nii")
    values = [values_of(case.path, allow_outside=False) for case in collect([str(tmp_path)], {}, READING)]
    assert values == [(4 * 50 * 60, 2), (70 * 80 * 9, 2), (0, 8)]
    voxels = 4 * 50 * 60
    assert case_bytes(voxels) == BLENDER_PROCESS_BYTES + CASE_VOXEL_BYTES * voxels
    assert case_bytes(voxels, thumbnails=False) == PROCESS_BYTES + CASE_VOXEL_BYTES * voxels
    assert case_bytes(voxels, 2, thumbnails=False) == PROCESS_BYTES + READING_COPIES * 2 * voxels


def test_need_of_memory_counts_values_outside_the_folder_where_they_may_be_read(tmp_path):
    touch(tmp_path, "a.raw")
    (tmp_path / "in").mkdir()
    header = "NDims = 3\nDimSize = 6 5 4\nElementType = MET_SHORT\nElementDataFile = ../a.raw\n"
    (tmp_path / "in" / "a.mhd").write_text(header)
    (tmp_path / "a.raw").write_bytes(bytes(2 * 6 * 5 * 4))
    for allowed, values in ((True, 6 * 5 * 4), (False, 0)):
        [case] = collect([str(tmp_path / "in")], {}, ReadingOptions(allow_outside=allowed))
        assert need_of(TASK.copy(), case, thumbnails=False) == PROCESS_BYTES + CASE_VOXEL_BYTES * values


def test_need_of_memory_counts_the_ct_beside_labels_for_its_hu_where_the_case_does_not_ask(tmp_path):
    for name, kind in (("volume-1", np.int16), ("segmentation-1", np.uint8)):
        nibabel.save(nibabel.Nifti1Image(np.zeros((6, 5, 4), kind), np.eye(4)), tmp_path / f"{name}.nii")
    voxels = 6 * 5 * 4
    for label, hu, ct_bytes in ((1, True, 2 * voxels), (1, False, 0), ("all", True, 2 * voxels), (None, True, 0)):
        settings = {"smoothing": "none", "label": label} if label else {"threshold": 200}
        [case] = collect([str(tmp_path)], settings, READING)
        assert need_of(TASK | {"hu": hu}, case, thumbnails=False) == (
            PROCESS_BYTES + CASE_VOXEL_BYTES * voxels + ct_bytes
        )
    task = TASK | {"hu": True}
    [case] = collect([str(tmp_path)], {"label": 1}, READING)
    assert need_of(task, case, thumbnails=False) == PROCESS_BYTES + READING_COPIES * voxels
    assert task["asks"]


def test_a_solid_asks_for_the_memory_of_its_parts_once_its_surface_is_known(tmp_path):
    np.save(tmp_path / "a.npy", np.zeros((4, 5, 6), np.int16))
    for solid, asks in (({}, False), ({"hollow": 2.0}, True)):
        task = TASK.copy()
        [case] = collect([str(tmp_path)], {"threshold": 200}, READING, solid=solid)
        assert need_of(task, case, thumbnails=False) == PROCESS_BYTES + CASE_VOXEL_BYTES * 4 * 5 * 6
        assert task["asks"] == asks


def test_smoothed_labels_ask_for_memory_and_all_else_is_counted_by_voxels():
    for several in (False, True):
        assert asks_for_memory(ReconstructionSettings(label=2), several)
        assert not asks_for_memory(ReconstructionSettings(label=2, smoothing="none"), several)
    assert asks_for_memory(ReconstructionSettings(), several=True)
    assert not asks_for_memory(ReconstructionSettings(threshold=200), several=False)
