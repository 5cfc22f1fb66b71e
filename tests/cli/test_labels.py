# SPDX-License-Identifier: GPL-3.0-or-later
"""Several labels in one go: by number, by name and all; to a folder, to one file, in a batch and in a figure."""

import csv
import json
import os
import warnings

import numpy as np
import pytest
from batches import page_content
from meshes import read_ply

from ctmc_addon import readers
from ctmc_addon.cli.flags.arguments import label_choices
from ctmc_addon.core import OutputError, ReconstructionSettings, reconstruct

nrrd = pytest.importorskip("nrrd")
NAMES = {1: "Liver", 2: "kidney left", 5: "CON", 6: "a/b: c", 9: "liver"}


@pytest.fixture
def labels_file(tmp_path):
    """Five boxes with names as Slicer writes them, one of them at the border; a label with no voxel; one unnamed."""
    values = np.zeros((30, 24, 20), np.uint8)  # x, y, z as pynrrd has them
    values[2:14, 3:15, 2:12] = 1
    values[18:26, 3:9, 2:9] = 2
    values[2:8, 17:22, 14:18] = 5
    values[20:, 16:20, 4:15] = 6
    values[12:16, 18:22, 3:8] = 9
    values[27, 2, 17] = 11
    header = {"space": "left-posterior-superior", "space directions": np.diag([0.8, 0.8, 1.5])}
    header |= {"space origin": np.zeros(3)}
    for at, (label, name) in enumerate({**NAMES, 7: "nowhere"}.items()):
        header |= {f"Segment{at}_LabelValue": str(label), f"Segment{at}_Name": name, f"Segment{at}_ID": name}
    path = tmp_path / "organs.nrrd"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # pynrrd's own, with the newest Python
        nrrd.write(str(path), values, header)
    return path


def names_in(folder):
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize(
    ("text", "choices"),
    [("3", [3]), ("1,2 5", [1, 2, 5]), ("ALL", ["all"]), ("left kidney; 7", ["left kidney", 7]), ("-4", [-4])],
)
def test_labels_are_numbers_names_or_all(text, choices):
    assert label_choices(text) == choices


def test_all_labels_become_a_file_each_and_a_report(ctmc, labels_file, tmp_path):
    out, report = tmp_path / "out", tmp_path / "report.json"
    words = ("--label", "all", "--interfaces", "separate", "-o", f"{out}/", "--format", "ply", "--report", report)
    done = ctmc("reconstruct", labels_file, *words)
    assert done.code == 0, done.errors
    files = ["CON_.ply", "Liver 1.ply", "a_b_ c.ply", "kidney left.ply", "label 11.ply", "liver 9.ply"]
    assert names_in(out) == files
    said = json.loads(report.read_text("utf-8"))
    assert sorted(said["files"]) == sorted([*files, "report.json"])
    volume = readers.read_volume(labels_file)
    assert [surface["label"] for surface in said["surfaces"]] == [1, 2, 5, 6, 9, 11]
    for surface, name in zip(said["surfaces"], ["Liver 1", "kidney left", "CON", "a/b: c"], strict=False):
        alone = reconstruct(volume, ReconstructionSettings(label=surface["label"]))
        assert surface["name"] == name
        assert (surface["faces"], surface["area_mm2"]) == (len(alone.mesh.faces), alone.mesh.area)
        assert surface["volume_mm3"] == alone.mesh.enclosed_volume
        assert surface["parts"] == 1
    assert said["surfaces"][3]["volume_mm3"] is None  # open at the border
    for word in ("label", "kidney left", "6, 1 of them open", "--close-border"):
        assert word in done.out
    alone = ctmc("reconstruct", labels_file, "--label", "2", "-o", tmp_path / "alone.ply")
    assert alone.code == 0
    assert (tmp_path / "alone.ply").read_bytes() == (out / "kidney left.ply").read_bytes()


def triangles_of(path):
    """The corner positions of every triangle of a PLY, each turned to begin with its lowest, as a set."""
    vertices, _, faces = read_ply(path)
    corners = vertices[faces].tolist()
    return {tuple(map(tuple, turned)) for turned in (lowest_first(triangle) for triangle in corners)}


def lowest_first(triangle):
    first = triangle.index(min(triangle))
    return triangle[first:] + triangle[:first]


@pytest.mark.parametrize("rate", [[], ["--simplify", "0.8"]])
def test_labels_that_touch_share_their_triangles_and_the_report_says_how_many(ctmc, tmp_path, rate):
    z, y, x = np.indices((14, 40, 40), np.float32)
    inside = (2.5 * (z - 6.5)) ** 2 + (y - 19.5) ** 2 + (x - 19.5) ** 2 < 15**2
    values = np.where(inside, 1 + (x + 2 * np.sin(y / 4) > 20), 0).astype(np.uint8)
    values[2:4, 2:6, 2:6] = 7
    np.save(tmp_path / "labels.npy", values)
    words = ["--label", "all", "--spacing", "1", "1", "2.5", "--format", "ply", "--report", tmp_path / "report.json"]
    done = ctmc("reconstruct", tmp_path / "labels.npy", *words, *rate, "-o", f"{tmp_path / 'out'}/")
    assert done.code == 0, done.errors
    report = json.loads((tmp_path / "report.json").read_text("utf-8"))
    [shared] = report["interfaces"]
    assert shared["labels"] == [1, 2]
    first, second = (triangles_of(tmp_path / "out" / f"label {label}.ply") for label in (1, 2))
    common = {tuple(lowest_first(list(triangle[::-1]))) for triangle in first}
    assert len(common & second) == shared["triangles"] > 100
    assert [surface["closed"] for surface in report["surfaces"]] == [True, True, True]
    assert [surface["neighbors"][0]["label"] for surface in report["surfaces"][:2]] == [2, 1]
    assert report["surfaces"][2]["neighbors"] == []
    for surface, voxels in zip(report["surfaces"][:2], np.bincount(values.ravel())[[1, 2]], strict=True):
        assert surface["volume_mm3"] == pytest.approx(2.5 * voxels, rel=0.02 if rate else 0.005)


def test_labels_are_taken_by_number_and_name(ctmc, labels_file, tmp_path):
    folder = tmp_path / "there"
    folder.mkdir()
    words = ("--label", "KIDNEY_LEFT", "--label", "5", "--interfaces", "separate", "-o", folder)
    assert ctmc("reconstruct", labels_file, *words).code == 0
    assert names_in(folder) == ["CON_.stl", "kidney left.stl"]
    assert ctmc("reconstruct", labels_file, "--label", "kidney left", "-o", tmp_path / "one.stl").code == 0
    assert (tmp_path / "one.stl").read_bytes() == (folder / "kidney left.stl").read_bytes()
    done = ctmc("reconstruct", labels_file, "--label", "kidney left", "-o", f"{tmp_path / 'single'}{os.sep}")
    assert done.code == 0, done.errors
    assert names_in(tmp_path / "single") == ["kidney left.stl"]


def test_what_cannot_be_is_one_sentence_and_leaves_nothing(refused, misused, labels_file, tmp_path):
    out = tmp_path / "new"
    many = ("reconstruct", labels_file, "--label", "1,2", "-o")
    sentence = refused(*many, tmp_path / "x.stl")
    assert "x.stl can hold one surface, and 2 or more are asked for; give a folder" in sentence
    assert "ends in a slash" in refused(*many, out)
    assert "folder does not exist" in refused(*many, f"{out}/deeper/")
    one = ("reconstruct", labels_file, "-o", f"{out}/", "--label")
    assert "'kidny left'; similar names are kidney left" in refused(*one, "kidny left")
    assert "label 4 is empty here; the labels are 1, 2, 5" in refused(*one, "1,4")
    assert "write a whole number" in misused(*one, "1.5")
    assert "all" in misused(*one, "")
    assert names_in(tmp_path) == [labels_file.name]


def test_all_of_a_single_label_fits_into_one_file_and_of_several_does_not(ctmc, refused, labels_file, tmp_path):
    values = np.zeros((6, 7, 8), np.uint8)
    values[2:4, 2:5, 2:6] = 1
    np.save(tmp_path / "mask.npy", values)
    assert ctmc("reconstruct", tmp_path / "mask.npy", "--label", "all", "-o", tmp_path / "x.ply").code == 0
    assert (tmp_path / "x.ply").stat().st_size > 1000
    sentence = refused("reconstruct", labels_file, "--label", "all", "-o", tmp_path / "y.ply")
    assert "y.ply can hold one surface, and there are 6; give a folder, such as -o y/" in sentence
    assert not (tmp_path / "y.ply").exists()


def test_when_one_file_of_a_folder_fails_none_is_left(refused, labels_file, tmp_path, monkeypatch):
    from ctmc_addon.core.sinks import write as sink

    out = tmp_path / "out"
    out.mkdir()
    (out / "Liver 1.stl").write_bytes(b"older")
    write_steps, done = sink.write_pieces_steps, []

    def fails_steps(path, *args):
        done.append(path)
        if len(done) == 4:
            raise OutputError("the disk is full")
        return (yield from write_steps(path, *args))

    monkeypatch.setattr(sink, "write_pieces_steps", fails_steps)
    words = ("--label", "all", "--interfaces", "separate", "-o", out)
    assert "disk is full" in refused("reconstruct", labels_file, *words)
    assert names_in(out) == ["Liver 1.stl"]
    assert (out / "Liver 1.stl").read_bytes() == b"older"


def test_one_blend_holds_all_with_names_and_colors(ctmc, labels_file, tmp_path, scene):
    from ctmc_addon.blender.colors import color_of

    scene.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    target = tmp_path / "organs.blend"
    done = ctmc("reconstruct", labels_file, "--label", "all", "-o", target)
    assert done.code == 0, done.errors
    scene.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    with scene.data.libraries.load(str(target)) as (stored, loaded):
        loaded.collections = stored.collections
    (collection,) = (folder for folder in loaded.collections if folder.name != "CTMC Studio")
    assert collection.name == "organs"
    assert [obj.name for obj in collection.objects] == [
        "Liver 1", "kidney left", "CON", "a/b: c", "liver 9", "label 11",
    ]  # fmt: skip
    for obj in collection.objects:
        label = json.loads(obj["ctmc"]["settings"])["label"]
        assert np.allclose(obj.data.materials[0].diffuse_color[:3], color_of(label, None, NAMES.get(label, "")))


def test_a_glb_and_an_obj_hold_several_by_their_names(ctmc, labels_file, tmp_path, scene):
    scene.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    for suffix in (".glb", ".obj"):
        done = ctmc("reconstruct", labels_file, "--label", "2,5,9", "-o", tmp_path / f"o{suffix}")
        assert done.code == 0, done.errors
    content = (tmp_path / "o.glb").read_bytes()
    nodes = json.loads(content[20 : 20 + int.from_bytes(content[12:16], "little")])["nodes"]
    assert sorted(node["name"] for node in nodes) == ["CON", "kidney left", "liver"]
    lines = (tmp_path / "o.obj").read_text("utf-8").splitlines()
    assert [line for line in lines if line.startswith("o ")] == ["o kidney_left", "o CON", "o liver"]


def test_a_batch_has_a_row_and_a_folder_for_each_case(ctmc, labels_file, tmp_path):
    out = tmp_path / "out"
    words = ("batch", labels_file, "-o", out, "--label", "all", "--no-thumbnails", "--jobs", "1")
    done = ctmc(*words)
    assert done.code == 0, done.errors
    assert names_in(out) == ["labels.csv", "organs", "organs.json", "summary.csv", "summary.html", "summary.json"]
    assert len(names_in(out / "organs")) == 6
    (row,) = json.loads((out / "summary.json").read_text("utf-8"))
    assert [surface["name"] for surface in row["surfaces"]][:2] == ["Liver 1", "kidney left"]
    assert row["faces"] == sum(surface["faces"] for surface in row["surfaces"])
    with (out / "labels.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [line["label"] for line in rows] == ["1", "2", "5", "6", "9", "11"]
    assert all(line["case"] == "organs" and line["components"] == "1" for line in rows)
    record = json.loads((out / "organs.json").read_text("utf-8"))
    assert "label" not in record["settings"]
    before = (out / "organs" / "liver 9.stl").stat().st_mtime_ns
    assert "1 done before" in ctmc(*words, "--resume").out
    assert (out / "organs" / "liver 9.stl").stat().st_mtime_ns == before
    fewer = ("batch", labels_file, "-o", out, "--label", "Liver,kidney left", "--no-thumbnails", "--overwrite")
    assert ctmc(*fewer).code == 0
    assert names_in(out / "organs") == ["Liver 1.stl", "kidney left.stl", "liver 9.stl"]


@pytest.mark.parametrize("labels", ["CON,nowhere,unknown", "nowhere,unknown"])
def test_a_case_that_lacks_some_of_its_labels_keeps_the_others(ctmc, labels_file, tmp_path, labels):
    out = tmp_path / "out"
    done = ctmc("batch", labels_file, "-o", out, "--label", labels, "--no-thumbnails", "--jobs", "1")
    assert done.code == 0, done.errors
    record = json.loads((out / "organs.json").read_text("utf-8"))
    if "CON" in labels:
        assert names_in(out / "organs") == ["CON_.stl"]
        assert (record["status"], record["absent_labels"]) == ("done", ["nowhere", "unknown"])
        assert "organs,5,CON," in (out / "labels.csv").read_text("utf-8")
    else:
        assert record["status"] == "absent"
        assert not (out / "organs").exists()


def test_a_batch_has_a_page_for_each_case_and_links_it(ctmc, labels_file, tmp_path):
    out = tmp_path / "out"
    words = (
        "batch",
        labels_file,
        "-o",
        out,
        "--label",
        "Liver,kidney left",
        "--no-thumbnails",
        "--jobs",
        "1",
        "--html",
    )
    done = ctmc(*words)
    assert done.code == 0, done.errors
    assert names_in(out / "organs") == ["Liver 1.stl", "kidney left.stl", "liver 9.stl"]
    page = (out / "organs.html").read_text("utf-8")
    assert page.count('class="structure"') == 3
    assert page_content((out / "summary.html").read_text("utf-8"))["rows"][0]["page"] == "organs.html"
    record = json.loads((out / "organs.json").read_text("utf-8"))
    assert record["file_bytes"]["organs.html"] == (out / "organs.html").stat().st_size
    assert "1 done before" in ctmc(*words, "--resume").out
    assert "1 done before" in ctmc(*words[:-1], "--resume").out  # a page more than asked for
    assert ctmc(*words[:-1], "--overwrite").code == 0
    assert not (out / "organs.html").exists()
    assert page_content((out / "summary.html").read_text("utf-8"))["rows"][0]["page"] is None
    assert "1 done before" not in ctmc(*words, "--resume").out
    assert (out / "organs.html").exists()


@pytest.mark.usefixtures("scene")
def test_a_figure_shows_all_labels_with_their_names(ctmc, labels_file, tmp_path):
    words = ("--label", "all", "--dpi", 40, "--width-mm", 60, "--no-blend", "-o", tmp_path / "a.png")
    done = ctmc("figure", labels_file, *words)
    assert done.code == 0, done.errors
    assert (tmp_path / "a.png").exists()


def test_settings_files_and_manifests_choose_labels_too(ctmc, labels_file, tmp_path):
    settings = tmp_path / "s.toml"
    made = ctmc("settings", "--label", "liver", "--label", "5", "--stride", "2")
    assert made.code == 0, made.errors
    settings.write_text(made.out, "utf-8")
    assert 'label = ["liver", 5]' in made.out
    out = tmp_path / "out"
    assert ctmc("reconstruct", labels_file, "--settings", settings, "-o", f"{out}/").code == 0
    assert names_in(out) == ["CON_.stl", "Liver 1.stl", "liver 9.stl"]
    (tmp_path / "cases.csv").write_text(f"input,case,label\n{labels_file.name},a,all\n", "utf-8")
    done = ctmc("batch", tmp_path / "cases.csv", "-o", tmp_path / "b", "--no-thumbnails", "--stride", "2")
    assert done.code == 0, done.errors
    assert len(names_in(tmp_path / "b" / "a")) >= 5
