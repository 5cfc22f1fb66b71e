# SPDX-License-Identifier: GPL-3.0-or-later
"""Solids from the command line: flags, refusals, names of parts and files. A stub stands for their making."""

from __future__ import annotations

import json
import sys
from dataclasses import replace

import nibabel
import numpy as np
import pytest

from ctmc_addon.cli.batch import process as batch_process
from ctmc_addon.cli.batch.cases import collect
from ctmc_addon.cli.flags import combined, solid as solid_flags
from ctmc_addon.cli.flags.arguments import Parser, UsageError
from ctmc_addon.core import CtmcError, solid as solids
from ctmc_addon.core.solid import Combination, Combining, Cut, Drain, MadeParts, Pegs, SolidRequest
from ctmc_addon.core.surfaces.make import make_surfaces_steps
from ctmc_addon.readers import ReadingOptions

UP = Cut((0, 0, 11), (0, 0, 1))
CUT = ("--cut", "0", "0", "11", "0", "0", "1")


def stub_steps(volume, requests, solid, budget=None, *, labels=None, maps=None, all_needed=False):
    """Make the surfaces of the requests, with the names that parts of a solid have; a merge keeps the first."""
    made = yield from make_surfaces_steps(volume, requests, budget, labels=labels, all_needed=True, maps=maps)
    results = [each.result for each in made]
    if solid.combinations:
        results = [replace(results[0], label_name=solid.combinations[-1].name)]
    parts = []
    for result in results:
        label = result.settings.label
        name = result.label_name or (volume.name if label is None else f"label {label}")
        letters = (" a", " b") if solid.cuts else ("",)
        parts += [replace(result, label_name=f"{name}{letter}", solid=solid) for letter in letters]
    return MadeParts(parts, [])


STUB = f"""
import sys
sys.path[:0] = {sys.path!r}
from test_solid import stub_steps
from ctmc_addon.core import solid
solid.solid_parts_steps = stub_steps
from ctmc_addon.cli.program import run
sys.exit(run(["batch-case"]))
"""


@pytest.fixture
def stub(monkeypatch):
    """Make solids by the stub, also in the processes of a batch."""
    monkeypatch.setattr(solids, "solid_parts_steps", stub_steps)
    script = STUB.replace("sys.path[:0] = [", f"sys.path[:0] = [{__file__.rpartition('test_solid')[0]!r}, ")
    monkeypatch.setattr(batch_process, "command", lambda: [sys.executable, "-c", script])


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    """Labels of two boxes in voxels of 1 x 1 x 2 mm."""
    folder = tmp_path_factory.mktemp("solid")
    labels = np.zeros((12, 20, 24), np.uint8)
    labels[3:9, 4:14, 4:14], labels[3:9, 4:14, 14:20] = 1, 2
    nibabel.save(nibabel.Nifti1Image(labels.T, np.diag([1.0, 1.0, 2.0, 1.0])), folder / "boxes.nii")
    return folder


def asked(*words):
    parser = Parser()
    parser.add_argument("input", nargs="?")
    solid_flags.add_solid(parser)
    return solid_flags.asked_solid(parser.parse_args(words))


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ((), SolidRequest()),
        (("--thicken", "-0.5"), SolidRequest(thicken=-0.5)),
        (("--hollow", "2", "--drain", "auto"), SolidRequest(hollow=2, drains=(Drain(4),))),
        (("--drain", "-1", "-2.5", "-1e1", "4", "in"), SolidRequest(drains=(Drain(4, (-1, -2.5, -10)),))),
        (
            ("--hollow", "2", "--drain", "auto", "in", "--drain", "1", "2", "3", "4"),
            SolidRequest(hollow=2, drains=(Drain(4), Drain(4, (1, 2, 3)))),
        ),
        ((*CUT, "in", "--cut=1 2 3 -1 0 0"), SolidRequest(cuts=(UP, Cut((1, 2, 3), (-1, 0, 0))))),
        (
            (*CUT, "--pegs", "2", "--peg-mm", "6", "8", "--clearance", "0.1"),
            SolidRequest(cuts=(UP,), pegs=Pegs(2, 6, 8, 0.1)),
        ),
        ((*CUT, "--pegs", "0", "--clearance", "0.1"), SolidRequest(cuts=(UP,))),
        (
            ("--merge", "both=left  leg,2", "--subtract", "rest=both,3", "--merge", "all three=rest;4;5"),
            SolidRequest(
                combinations=(
                    Combination(Combining.MERGE, "both", ("left leg", "2")),
                    Combination(Combining.SUBTRACT, "rest", ("both", "3")),
                    Combination(Combining.MERGE, "all three", ("rest", "4", "5")),
                )
            ),
        ),
        (
            ("--intersect", "x=1,2", "--base", "3", "--least-wall", "1.2", "--bed", "220", "220", "250"),
            SolidRequest(
                combinations=(Combination(Combining.INTERSECT, "x", ("1", "2")),),
                base=3,
                least_wall=1.2,
                bed=(220, 220, 250),
            ),
        ),
    ],
)
def test_flags_become_a_request(words, expected):
    assert asked(*words) == expected


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--thicken", "thick"), "argument --thicken: write a number, not 'thick'"),
        (("--hollow", "-1"), "argument --hollow: must be from 0 to 1000, not -1"),
        (("--drain", "1", "2", "3"), "argument --drain: write X Y Z and a diameter, such as 0 0 -40 4, or auto, not"),
        (("--drain", "1", "2", "3", "0"), "argument --drain: the diameter of a drain is above 0 and at most 1000 mm"),
        (("--drain", "auto"), "a drain without a point opens a hollow; give the wall of a hollow above 0"),
        (("--cut", "1", "2", "3", "0", "0"), "argument --cut: write X Y Z of a point and NX NY NZ of a normal"),
        (("--cut", "1", "2", "3", "0", "0", "0"), "argument --cut: the normal of a cut is 0 0 0; give its direction"),
        (("--pegs", "2"), "pegs join the two sides of a cut; add a cut"),
        (("--pegs", "many"), "argument --pegs: write a whole number, not 'many'"),
        (("--pegs", "99"), "argument --pegs: 99 pegs on a cut are not possible; give 1 to 64"),
        ((*CUT, "--clearance", "0.1"), "--clearance describe pegs; add --pegs with their number"),
        (("--peg-mm", "8", "3"), "argument --peg-mm: a peg of 3 mm is shorter than its round end; give it a length"),
        (("--merge", "left,right"), "argument --merge: write NAME=A,B with labels by name or number, not 'left,right'"),
        (("--subtract", "rest=left"), "argument --subtract: subtract takes a name and two structures or more, such"),
        (("--bed", "220", "220"), "argument --bed: write 3 numbers separated by spaces"),
        (("--simplify", "0.5", "--simplifier", "decimate", "--hollow", "2"), "leave out --simplifier decimate"),
        (("--simplify", "0.5", "--simplifier", "decimate", "--bed", "9", "9", "9"), "leave out --simplifier decimate"),
        (("--hollow", "2", "--scheduler", "tcp://host:8786"), "leave out --scheduler, and give a single --time"),
        (("--hollow", "2", "--explode", "9"), "--explode moves several surfaces of one time apart, and there is one"),
        (("--hollow", "2", "--time", "all"), "leave out --scheduler, and give a single --time"),
        (("--threshold", "1", "--merge", "a=1,2"), "--merge combines labels, and a threshold has a single structure"),
    ],
)
def test_flags_that_make_no_solid_are_misuse(misused, case, tmp_path, words, sentence):
    assert sentence in misused("reconstruct", case / "boxes.nii", *words, "-o", tmp_path / "a.stl")
    assert list(tmp_path.iterdir()) == []


def test_every_command_that_makes_surfaces_has_the_flags(ctmc):
    flags = ("thicken", "hollow", "drain", "cut", "pegs", "peg-mm", "clearance", "merge", "subtract", "intersect")
    for command in (("reconstruct",), ("measure",), ("batch",), ("figure",), ("figure", "turntable")):
        words = ctmc(*command, "--help").out
        for flag in (*flags, "base", "least-wall", "bed"):
            assert f"--{flag} " in words, (command, flag)


def test_parts_of_a_cut_are_files_of_a_folder(stub, ctmc, case, tmp_path):
    report = tmp_path / "report.json"
    done = ctmc(
        *("reconstruct", case / "boxes.nii", "--label", "1", *CUT, "--pegs", "2", "--report", report),
        *("-o", f"{tmp_path}/out/", "--format", "stl"),
    )
    assert done.code == 0, done.errors
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["label 1 a.stl", "label 1 b.stl"]
    surfaces = json.loads(report.read_text("utf-8"))["surfaces"]
    assert [surface["name"] for surface in surfaces] == ["label 1 a", "label 1 b"]
    for surface in surfaces:
        assert SolidRequest.from_dict(surface["solid"]) == SolidRequest(cuts=(UP,), pegs=Pegs(2))
    assert "settings: --cut 0 0 11 0 0 1 --pegs 2" in done.out


def test_parts_of_a_threshold_are_called_after_the_input(stub, ctmc, case, tmp_path):
    done = ctmc("reconstruct", case / "boxes.nii", "--threshold", "1", *CUT, "-o", f"{tmp_path}/out/")
    assert done.code == 0, done.errors
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["boxes a.stl", "boxes b.stl"]


def test_one_part_has_a_file_of_its_own_without_a_letter(stub, ctmc, case, tmp_path):
    report = tmp_path / "report.json"
    words = ("--threshold", "1", "--hollow", "2", "--drain", "auto", "--report", report, "-o", tmp_path / "a.stl")
    done = ctmc("reconstruct", case / "boxes.nii", *words)
    assert done.code == 0, done.errors
    assert json.loads(report.read_text("utf-8"))["solid"] == {"hollow": 2.0, "drains": [{"diameter": 4.0}]}
    assert (tmp_path / "a.stl").stat().st_size > 84
    assert "--hollow 2 --drain auto" in done.out


def test_a_folder_holds_one_part_by_the_name_of_the_input(stub, ctmc, case, tmp_path):
    done = ctmc("reconstruct", case / "boxes.nii", "--threshold", "1", "--base", "2", "-o", f"{tmp_path}/out/")
    assert done.code == 0, done.errors
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["boxes.stl"]


@pytest.mark.parametrize("suffix", [".glb", ".3mf", ".html", ".obj"])
def test_a_file_of_several_objects_holds_all_parts(stub, ctmc, case, tmp_path, suffix):
    done = ctmc("reconstruct", case / "boxes.nii", "--label", "1", *CUT, "-o", tmp_path / f"a{suffix}")
    assert done.code == 0, done.errors
    assert "label 1 b" in done.out
    assert (tmp_path / f"a{suffix}").stat().st_size > 0


@pytest.mark.parametrize("suffix", [".stl", ".ply"])
def test_a_file_of_one_surface_does_not_hold_the_parts_of_a_cut(refused, case, tmp_path, suffix):
    sentence = refused("reconstruct", case / "boxes.nii", "--label", "1", *CUT, "-o", tmp_path / f"a{suffix}")
    assert f"a{suffix} can hold one surface, and a cut makes two parts; give a folder, such as -o a/" in sentence
    assert list(tmp_path.iterdir()) == []


def test_a_combination_takes_its_labels_and_one_file(stub, ctmc, case, tmp_path):
    report = tmp_path / "report.json"
    words = ("--merge", "both=1,2", "--report", report, "-o", tmp_path / "both.stl")
    done = ctmc("reconstruct", case / "boxes.nii", *words)
    assert done.code == 0, done.errors
    assert json.loads(report.read_text("utf-8"))["label_name"] == "both"
    done = ctmc("reconstruct", case / "boxes.nii", "--merge", "both=1,2", "-o", f"{tmp_path}/out/")
    assert done.code == 0, done.errors
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["both.stl"]


def test_a_combination_of_other_labels_is_refused(stub, refused, case, tmp_path):
    words = ("--label", "1", "--merge", "both=1,2", "-o", tmp_path / "both.stl")
    sentence = refused("reconstruct", case / "boxes.nii", *words)
    assert (
        "--merge both names '2', but the structures are 1; add it with --label if the file has it, or leave out --label"
        in sentence
    )
    assert list(tmp_path.iterdir()) == []


def test_a_name_that_an_earlier_combination_makes_may_be_combined_again():
    solid = asked("--merge", "Both=left,2", "--subtract", "rest=both,3")
    assert combined.combined_labels(solid) == ("left", 2, 3)
    named, count = combined.with_structures(solid, [1, 2, 3, 7], {1: "Left"})
    assert [each.of for each in named.combinations] == [("Left", "2"), ("Both", "3")]
    assert count == 2  # rest, and label 7


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--merge", "a=kidney,3"), "--merge a names 'kidney', the name of labels 1 and 2; give a number"),
        (
            ("--merge", "a=1,2", "--intersect", "b=1,3"),
            "--intersect b names '1', which an earlier combination has taken; combine liver, a",
        ),
        (
            ("--subtract", "a=1,spleen"),
            "--subtract a names 'spleen', but the structures are 1, 2, liver; add it with --label",
        ),
    ],
)
def test_a_name_that_is_not_one_structure_is_refused(words, sentence):
    with pytest.raises(CtmcError) as caught:
        combined.with_structures(asked(*words), [1, 2, 3], {1: "kidney", 2: "kidney", 3: "liver"})
    assert str(caught.value).startswith(sentence)


@pytest.mark.parametrize(
    ("asked_labels", "labels"),
    [((), ("left", 2, 3)), (("rest",), ("left", 2, 3)), (("Rest", "liver"), ("left", 2, 3, "liver")), ((1,), (1,))],
)
def test_a_structure_that_combinations_make_may_be_chosen_as_a_label(asked_labels, labels):
    solid = asked("--merge", "both=left,2", "--subtract", "rest=both,3")
    assert combined.labels_of(asked_labels, solid) == labels


def test_a_structure_that_a_later_combination_takes_is_no_label():
    solid = asked("--merge", "both=left,2", "--subtract", "rest=both,3")
    with pytest.raises(UsageError, match="--subtract rest takes; give --label rest"):
        combined.labels_of(["both"], solid)


def test_a_combination_before_the_one_that_it_needs_says_which_to_give_first():
    solid = asked("--subtract", "rest=both,3", "--merge", "both=1,2")
    assert combined.combined_labels(solid) == (3, 1, 2)
    with pytest.raises(UsageError) as caught:
        combined.with_structures(solid, [3, 1, 2], {})
    assert str(caught.value) == "--subtract rest names 'both', which --merge both makes after it; give that one first"
    own = asked("--merge", "liver=liver,tumor", "--subtract", "rest=liver,3")
    assert combined.combined_labels(own) == ("liver", "tumor", 3)


def test_opacity_knows_the_names_of_parts(stub, ctmc, case, tmp_path):
    words = ("--label", "1", *CUT, "--opacity", "label 1 b=0.5", "-o", tmp_path / "a.glb")
    assert ctmc("reconstruct", case / "boxes.nii", *words).code == 0


def test_a_bed_alone_changes_no_surface(ctmc, case, tmp_path):
    words = ("reconstruct", case / "boxes.nii", "--label", "1", "-o")
    assert ctmc(*words, tmp_path / "plain.stl").code == 0
    report = tmp_path / "report.json"
    done = ctmc(*words, tmp_path / "bed.stl", "--bed", "220", "220", "250", "--report", report)
    assert done.code == 0, done.errors
    assert (tmp_path / "bed.stl").read_bytes() == (tmp_path / "plain.stl").read_bytes()
    content = json.loads(report.read_text("utf-8"))
    assert content["solid"] == {"bed": [220.0, 220.0, 250.0]}
    assert content["print"]["fits_bed"] is True
    assert ctmc(*words, tmp_path / "small.stl", "--bed", "220", "8", "250", "--report", report).code == 0
    assert json.loads(report.read_text("utf-8"))["print"]["fits_bed"] is False


def test_measure_has_a_row_for_each_part(stub, ctmc, misused, case, tmp_path):
    done = ctmc("measure", case / "boxes.nii", "--label", "1", "2", *CUT, "-o", tmp_path / "a.csv")
    assert done.code == 0, done.errors
    rows = (tmp_path / "a.csv").read_text("utf-8").splitlines()
    assert [row.partition(",")[0] for row in rows] == ["name", "label 1 a", "label 1 b", "label 2 a", "label 2 b"]
    sentence = misused("measure", case / "boxes.nii", "--label", "1", *CUT, "--ct", case / "boxes.nii")
    assert "gray values and doses are those of labels, which a solid changes; leave out --ct" in sentence
    sentence = misused("measure", case / "boxes.nii", case / "boxes.nii", "--label", "1", "--hollow", "2")
    assert "two volumes are compared by their surfaces; leave out flags of solids" in sentence


def test_parts_of_a_cut_may_be_moved_apart(stub, ctmc, case, tmp_path):
    words = ("reconstruct", case / "boxes.nii", "--label", "1", *CUT)
    assert ctmc(*words, "--explode", "20", "-o", tmp_path / "a.html").code == 0


def test_the_diameter_of_drains_follows_the_wall():
    assert asked("--drain", "auto", "--hollow", "12").drains == (Drain(6),)


def test_a_deviation_map_does_not_fit_a_solid(misused, case, tmp_path):
    words = ("--label", "1", "--hollow", "2", "--deviation", "-o", tmp_path / "a.png")
    assert "leave out --deviation, or flags of solids" in misused("figure", case / "boxes.nii", *words)


def test_a_batch_puts_parts_in_a_folder_and_makes_them_again_for_other_flags(stub, ctmc, case, tmp_path):
    out = tmp_path / "out"
    words = ("batch", case / "boxes.nii", "-o", out, "--label", "1", "--no-thumbnails", "--quiet")
    assert ctmc(*words, *CUT).code == 0
    assert sorted(path.name for path in (out / "boxes").iterdir()) == ["label 1 a.stl", "label 1 b.stl"]
    first = (out / "boxes.json").read_text("utf-8")
    assert json.loads(first)["solid"] == SolidRequest(cuts=(UP,)).to_dict()
    assert ctmc(*words, *CUT, "--resume").code == 0
    assert (out / "boxes.json").read_text("utf-8") == first
    assert ctmc(*words, *CUT, "--hollow", "2", "--resume").code == 0
    assert json.loads((out / "boxes.json").read_text("utf-8"))["solid"]["hollow"] == 2
    assert ctmc(*words, "--resume").code == 0
    assert json.loads((out / "boxes.json").read_text("utf-8"))["solid"] is None
    assert (out / "boxes.stl").exists()
    assert not (out / "boxes").exists()


def test_columns_of_a_manifest_win_over_flags(case, tmp_path):
    manifest = case / "cases.csv"
    manifest.write_text(
        "input,case,hollow,drain,merge,pegs,least-wall\n"
        "boxes.nii,one,,,,,\n"
        'boxes.nii,two,3,0 0 -4 5|auto,"both=1,2",2,1.5\n'
        "boxes.nii,three,,none,,0,\n",
        "utf-8",
    )
    common = {"hollow": 2.0, "drain": [None], "cut": [UP], "pegs": 1}
    one, two, three = collect([str(manifest)], {"label": [1]}, ReadingOptions(), solid=common)
    assert one.solid == SolidRequest(hollow=2, drains=(Drain(4),), cuts=(UP,), pegs=Pegs(1))
    assert two.solid == SolidRequest(
        hollow=3,
        drains=(Drain(5, (0, 0, -4)), Drain(4)),
        cuts=(UP,),
        pegs=Pegs(2),
        combinations=(Combination(Combining.MERGE, "both", ("1", "2")),),
        least_wall=1.5,
    )
    assert three.solid == SolidRequest(hollow=2, cuts=(UP,))
    [case_] = collect([str(case / "boxes.nii")], {}, ReadingOptions(), solid={"combinations": two.solid.combinations})
    assert [output.labels for output in case_.outputs] == [(1, 2)]


@pytest.mark.parametrize(
    ("columns", "cells", "sentence"),
    [
        ("hollow", "-1", "line 2: hollow cannot be '-1'; must be from 0 to 1000, not -1"),
        ("least-wall", "thin", "line 2: least-wall cannot be 'thin'; write a number, not 'thin'"),
        ("pegs", "2", "line 2: pegs join the two sides of a cut; add a cut, or leave out the pegs"),
        ("drain", "1 2 3", "line 2: drain cannot be '1 2 3'; write X Y Z and a diameter"),
        ("merge", "both", "line 2: merge cannot be 'both'; write NAME=A,B"),
    ],
)
def test_a_cell_that_makes_no_solid_is_refused_with_its_line(refused, case, tmp_path, columns, cells, sentence):
    manifest = tmp_path / "cases.csv"
    manifest.write_text(f"input,{columns}\n{case / 'boxes.nii'},{cells}\n", "utf-8")
    assert sentence in refused("batch", manifest, "-o", tmp_path / "out")
    assert not (tmp_path / "out").exists()
