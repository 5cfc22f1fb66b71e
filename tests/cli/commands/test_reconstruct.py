# SPDX-License-Identifier: GPL-3.0-or-later
import json
import re
import struct
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from ctmc_addon import core, readers
from ctmc_addon.cli.commands.reconstruct import needed_steps

ROOT = Path(__file__).resolve().parents[3]
pytestmark = pytest.mark.usefixtures("scene")


def stl_triangles(path):
    content = path.read_bytes()
    (count,) = struct.unpack_from("<I", content, 80)
    assert len(content) == 84 + 50 * count
    triangle = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("pad", "<u2")])
    return np.frombuffer(content, triangle, count, 84)["corners"]


def files_in(folder):
    return sorted(path.name for path in folder.iterdir())


def test_a_label_becomes_the_mesh_that_python_makes(ctmc, phantom_folder, tmp_path):
    out, report = tmp_path / "tumour.stl", tmp_path / "report.json"
    flags = ["--label", "2", "--stride", "2", "2", "1", "--alpha", "0.5", "--soften", "4", "--simplify", "0.5"]
    outcome = ctmc("reconstruct", phantom_folder / "volume-4.nii.gz", "-o", out, *flags, "--report", report)
    assert outcome.code == 0, outcome.errors
    assert outcome.errors == []
    volume = readers.read_volume(phantom_folder / "segmentation-4.nii.gz")
    settings = core.ReconstructionSettings(label=2, stride=(2, 2, 1), alpha=0.5, smoothing_mm=4, reduction=0.5)
    expected = core.reconstruct(volume, settings)
    corners = stl_triangles(out)
    np.testing.assert_allclose(corners, expected.mesh.vertices[expected.mesh.faces], atol=1e-3)
    said = json.loads(report.read_text("utf-8"))
    assert said["faces"] == len(corners) == len(expected.mesh.faces)
    assert said["volume_mm3"] == pytest.approx(expected.mesh.volume)
    assert said["settings"] == settings.to_dict()
    assert set(said) >= {
        "faces", "vertices", "volume_mm3", "area_mm2", "closed", "euler", "components", "parts", "voxels_visited",
        "stages", "settings", "spacing_mm", "notes", "version",
    }  # fmt: skip
    assert next(stage["name"] for stage in said["stages"]) == "Reading"
    assert all(stage["seconds"] >= 0 for stage in said["stages"])
    assert str(tmp_path) not in report.read_text("utf-8")
    assert str(phantom_folder) not in report.read_text("utf-8")


@pytest.mark.parametrize("flags", [[], ["--stride", "2", "2", "1"], ["--region", "10", "20", "4", "60", "50", "15"]])
def test_what_does_not_fit_is_fetched_slab_by_slab_with_the_same_bytes(
    ctmc, phantom_folder, tmp_path, monkeypatch, flags
):
    words = [phantom_folder / "volume-4.nii.gz", "--threshold", "-300", *flags]
    monkeypatch.setattr("ctmc_addon.core.extraction.grid.UNIT_SAMPLES", 1)
    assert ctmc("reconstruct", *words, "-o", tmp_path / "memory.ply").code == 0
    monkeypatch.setattr("ctmc_addon.core.planning.plan.READ_SHARE", 0.0)
    monkeypatch.setattr("ctmc_addon.cli.commands.reconstruct.Budget", partial(core.Budget, slab_bytes=1))
    fetched = []
    fill = readers.result.Volume.samples
    monkeypatch.setattr(
        readers.result.Volume, "samples", lambda volume, *which: fetched.append(which) or fill(volume, *which)
    )
    assert ctmc("reconstruct", *words, "-o", tmp_path / "slabs.ply").code == 0
    assert len(fetched) > 2
    assert (tmp_path / "slabs.ply").read_bytes() == (tmp_path / "memory.ply").read_bytes()


@pytest.mark.parametrize(
    ("suffix", "flags"), [(".stl", []), (".ply", []), (".stl", ["--keep-parts", "1"]), (".ply", ["--min-part", "50"])]
)
def test_a_file_written_in_pieces_has_the_bytes_and_the_report_of_the_surface_that_is_held(
    ctmc, phantom_folder, tmp_path, monkeypatch, suffix, flags
):
    volume = readers.read_volume(phantom_folder / "volume-4.nii.gz")
    keys = {"--keep-parts": "keep_parts", "--min-part": "min_part_mm3"}
    own = {keys[flags[0]]: int(flags[1])} if flags else {}
    settings = core.ReconstructionSettings(threshold=-300, **own)
    monkeypatch.setattr("ctmc_addon.core.extraction.grid.UNIT_SAMPLES", 1)
    words = [phantom_folder / "volume-4.nii.gz", "--threshold", "-300", *flags]
    held = core.reconstruct(volume, settings)
    held.mesh.save(tmp_path / f"held{suffix}")
    monkeypatch.setattr("ctmc_addon.cli.commands.reconstruct.Budget", partial(core.Budget, slab_bytes=1))
    report = tmp_path / "pieces.json"
    outcome = ctmc("reconstruct", *words, "-o", tmp_path / f"pieces{suffix}", "--report", report)
    assert outcome.code == 0, outcome.errors
    assert (tmp_path / f"pieces{suffix}").read_bytes() == (tmp_path / f"held{suffix}").read_bytes()
    said, expected = json.loads(report.read_text("utf-8")), json.loads(json.dumps(held.report()))
    for own in ("stages", "files"):
        said.pop(own)
        expected.pop(own, None)
    assert said == expected


def test_a_surface_that_must_be_held_and_does_not_fit_is_refused(refused, phantom_folder, tmp_path, monkeypatch):
    words = [phantom_folder / "volume-4.nii.gz", "--threshold", "-300", "-o", tmp_path / "no.stl"]
    small = partial(core.Budget, bytes=20_000, work_bytes=0)
    monkeypatch.setattr("ctmc_addon.cli.commands.reconstruct.Budget", small)
    said = refused("reconstruct", *words, "--figure", tmp_path / "figure.png")
    assert "needs about" in said
    assert "would fit" in said
    assert files_in(tmp_path) == []


def test_a_surface_that_is_open_has_no_volume(ctmc, phantom_folder, tmp_path):
    report = tmp_path / "report.json"
    words = ["--threshold", "-300", "-o", tmp_path / "skin.stl", "--report", report]
    outcome = ctmc("reconstruct", phantom_folder / "dicom", *words)
    said = json.loads(report.read_text("utf-8"))
    assert (said["closed"], said["volume_mm3"]) == (False, None)
    assert "ml" not in outcome.out.split()
    assert [line.split() for line in outcome.out.splitlines() if line.startswith("volume")] == [["volume", "-"]]
    closed = ctmc("reconstruct", phantom_folder / "dicom", *words, "--close-border")
    assert "ml" in closed.out.split()
    assert json.loads(report.read_text("utf-8"))["volume_mm3"] > 1e5


def test_the_sibling_segmentation_is_taken_and_said(ctmc, phantom_folder, tmp_path):
    outcome = ctmc("reconstruct", phantom_folder / "volume-4.nii.gz", "-o", tmp_path / "liver.ply", "--label", "1")
    assert outcome.code == 0, outcome.errors
    assert "labels come from segmentation-4.nii.gz beside it" in outcome.out


def test_one_slice_of_a_folder_takes_no_labels_from_it(ctmc, tmp_path):
    from PIL import Image

    for number in range(4):
        plane = np.zeros((6, 7), np.uint8)
        plane[2:4, 2:5] = 200 * (number in (1, 2))
        Image.fromarray(plane).save(tmp_path / f"s{number}.png")
    outcome = ctmc("reconstruct", tmp_path / "s2.png", "--threshold", "100", "-o", tmp_path / "s.stl")
    assert outcome.code == 0, outcome.errors
    assert "s2.png is one slice: its folder was read, 4 slices" in outcome.out
    assert "labels" not in outcome.out


def test_the_summary_has_stages_counts_and_volume(ctmc, phantom_folder, tmp_path):
    outcome = ctmc("reconstruct", phantom_folder / "segmentation-4.nii.gz", "-o", tmp_path / "t.obj", "--label", "2")
    for word in ("seconds", "Reading", "Writing .obj", "triangles", " ml\n", "cm2", "Euler", "visited", "t.obj"):
        assert word in outcome.out
    assert "Smoothed label" in outcome.out


def test_without_threshold_or_label_otsu_is_used_and_said(ctmc, phantom_folder, tmp_path):
    report = tmp_path / "skin.json"
    outcome = ctmc("reconstruct", phantom_folder / "dicom", "-o", tmp_path / "skin.glb", "--report", report)
    assert outcome.code == 0, outcome.errors
    assert "Otsu" in outcome.out
    assert -900 < json.loads(report.read_text())["threshold"] < -100


def test_quiet_prints_nothing_but_errors(ctmc, refused, phantom_folder, tmp_path):
    words = ["reconstruct", phantom_folder / "segmentation-4.nii.gz", "-o", tmp_path / "t.stl", "--quiet"]
    outcome = ctmc(*words, "--label", "2")
    assert (outcome.code, outcome.out, outcome.errors) == (0, "", [])
    assert files_in(tmp_path) == ["t.stl"]
    assert "label 9" in refused(*words, "--label", "9")


def test_lps_mirrors_x_and_y_and_keeps_the_outside_out(ctmc, phantom_folder, tmp_path):
    for space in ("ras", "lps"):
        words = ["-o", tmp_path / f"{space}.stl", "--label", "2", "--space", space]
        assert ctmc("reconstruct", phantom_folder / "segmentation-4.nii.gz", *words).code == 0
    ras, lps = (stl_triangles(tmp_path / f"{space}.stl").astype(float) for space in ("ras", "lps"))
    np.testing.assert_allclose(lps, ras * [-1, -1, 1], atol=1e-4)
    signed = (lps[:, 0] * np.cross(lps[:, 1], lps[:, 2])).sum() / 6
    assert signed > 0


def test_decimate_reports_what_was_written(ctmc, phantom_folder, tmp_path):
    out, report = tmp_path / "t.stl", tmp_path / "r.json"
    flags = ["--label", "2", "--simplifier", "decimate", "--simplify", "0.5", "--report", report]
    assert ctmc("reconstruct", phantom_folder / "segmentation-4.nii.gz", "-o", out, *flags).code == 0
    said = json.loads(report.read_text())
    assert said["faces"] == len(stl_triangles(out))
    assert said["faces"] == pytest.approx(said["full_faces"] / 2, abs=4)


@pytest.mark.once
def test_a_figure_is_a_picture_of_the_surface_in_its_color_on_white(ctmc, phantom_folder, small_pictures, tmp_path):
    image = pytest.importorskip("PIL.Image", reason="Pillow is not installed")
    flags = ["--label", "2", "--simplify", "0.9", "--figure", tmp_path / "f.png"]
    outcome = ctmc("reconstruct", phantom_folder / "segmentation-4.nii.gz", "-o", tmp_path / "t.blend", *flags)
    assert outcome.code == 0, outcome.errors
    assert "Saved" not in outcome.out
    with image.open(tmp_path / "f.png") as picture:
        pixels = np.asarray(picture.convert("RGB")).reshape(-1, 3).astype(int)
    red, _, blue = pixels.T
    assert ((blue > red + 40) & (blue < 250)).mean() > 0.02  # the palette's blue of label 2
    assert (pixels == 255).all(axis=1).mean() > 0.3


def test_the_scene_of_a_blend_has_a_plain_name(ctmc, phantom_folder, tmp_path):
    import bpy

    words = ("reconstruct", phantom_folder / "segmentation-4.nii.gz", "-o", tmp_path / "t.blend", "--label", "2")
    assert ctmc(*words).code == 0
    with bpy.data.libraries.load(str(tmp_path / "t.blend")) as (inside, _):
        assert inside.scenes == ["CTMC"]


def test_nothing_is_left_in_blender_afterwards(ctmc, phantom_folder, tmp_path):
    import bpy

    kinds = ("scenes", "objects", "meshes", "cameras", "lights")
    before = [len(getattr(bpy.data, kind)) for kind in kinds]
    assert (
        ctmc("reconstruct", phantom_folder / "segmentation-4.nii.gz", "-o", tmp_path / "t.blend", "--label", "2").code
        == 0
    )
    assert [len(getattr(bpy.data, kind)) for kind in ("scenes", "objects", "meshes", "cameras", "lights")] == before


# What no input could be reconstructed with.


def test_help_and_version_have_exit_code_0(ctmc):
    assert ctmc("--help").code == 0
    assert ctmc("reconstruct", "--help").code == 0
    assert ctmc("--version").out.startswith("ctmc 0.")


def test_the_module_runs_in_a_process_of_its_own(phantom_folder, tmp_path):
    command = [sys.executable, "-m", "ctmc_addon", "reconstruct", str(phantom_folder / "volume-4.nii.gz")]
    command += ["--label", "2", "-o", str(tmp_path / "Lösung 結果.stl"), "--report", str(tmp_path / "r.json")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, check=False, timeout=120)
    assert done.returncode == 0, done.stderr
    assert b"triangles" in done.stdout
    assert b"Traceback" not in done.stderr
    said = json.loads((tmp_path / "r.json").read_text("utf-8"))
    assert said["faces"] == len(stl_triangles(tmp_path / "Lösung 結果.stl"))


WITHOUT_BLENDER = "import sys; sys.modules['bpy'] = None; from ctmc_addon.cli import main; sys.exit(main(sys.argv[1:]))"


def without_blender(*words):
    command = [sys.executable, "-c", WITHOUT_BLENDER, *map(str, words)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=120)


@pytest.mark.parametrize(
    "flags",
    [
        ["reconstruct", "in", "-o", "x.blend"],
        ["reconstruct", "in", "-o", "x.stl", "--figure", "x.png"],
        ["reconstruct", "in", "-o", "x.stl", "--simplifier", "decimate"],
        ["figure", "in", "-o", "x.png"],
        ["experiment", "alpha", "in", "-o", "x"],  # and not first that the threshold is missing
        ["figure", "sheet", "in", "-o", "x.png", "--levels", "0"],
        ["figure", "turntable", "in", "-o", "x.mp4"],
        ["experiment", "rotation", "in", "-o", "out"],
    ],
    ids=" ".join,
)
def test_what_only_blender_does_says_what_to_install(tmp_path, monkeypatch, flags):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    command = [sys.executable, "-c", WITHOUT_BLENDER, *flags]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert (done.returncode, done.stdout) == (1, "")
    assert len(done.stderr.splitlines()) == 1
    assert "pip install 'ctmc-addon[blender]'" in done.stderr
    assert files_in(tmp_path) == []


@pytest.mark.once
@pytest.mark.parametrize("suffix", ["stl", "ply"])
def test_stl_and_ply_need_no_blender_and_are_the_same_bytes(ctmc, phantom_folder, small_pictures, tmp_path, suffix):
    words = ["reconstruct", phantom_folder / "volume-4.nii.gz", "--label", "2", "--space", "lps"]
    done = without_blender(*words, "-o", tmp_path / f"without.{suffix}", "--report", tmp_path / "without.json")
    assert (done.returncode, done.stderr) == (0, "")
    figure = ["--figure", tmp_path / "f.png"]  # brings Blender in
    assert ctmc(*words, "-o", tmp_path / f"with.{suffix}", *figure).code == 0
    assert (tmp_path / f"without.{suffix}").read_bytes() == (tmp_path / f"with.{suffix}").read_bytes()


def test_a_stl_does_not_load_blender(phantom_folder, tmp_path):
    script = "import sys; from ctmc_addon.cli import main; main(sys.argv[1:]); assert 'bpy' not in sys.modules"
    words = ["reconstruct", phantom_folder / "volume-4.nii.gz", "--label", "2", "-o", tmp_path / "x.stl"]
    subprocess.run([sys.executable, "-c", script, *map(str, words)], cwd=ROOT, check=True, timeout=120)


def test_many_small_components_are_counted_with_the_flag_that_removes_them(ctmc, tmp_path):
    values = np.zeros((16, 40, 40), np.int16)
    values[4:12, 14:26, 14:26] = 200
    values[1:15:3, 1:10:3, 1:39:3] = 200
    np.save(tmp_path / "noise.npy", values)
    words = ["reconstruct", tmp_path / "noise.npy", "--spacing", "1", "1", "1", "--threshold", "100"]
    outcome = ctmc(*words, "-o", tmp_path / "all.stl")
    assert outcome.code == 0, outcome.errors
    assert "195 of 196 components are smaller than 1 mm3; --min-part 1 removes them" in outcome.out
    outcome = ctmc(*words, "-o", tmp_path / "one.stl", "--min-part", "1")
    assert "smaller than" not in outcome.out
    assert ["components", "1"] in [line.split() for line in outcome.out.splitlines()]


@pytest.mark.parametrize(("spacing", "said"), [("0.1", "0.001 mm3"), ("0.02", "9000 um3"), ("2", "9 mm3")])
def test_the_minimum_volume_that_is_proposed_leaves_the_largest_component(ctmc, tmp_path, spacing, said):
    values = np.zeros((16, 40, 40), np.int16)
    values[4:12, 14:26, 14:26] = 200
    values[1:15:3, 1:10:3, 1:39:3] = 200
    np.save(tmp_path / "noise.npy", values)
    words = ["reconstruct", tmp_path / "noise.npy", "--spacing", spacing, spacing, spacing, "--threshold", "100"]
    outcome = ctmc(*words, "-o", tmp_path / "all.stl")
    found = re.search(r"195 of 196 components are smaller than (\S+ \S+); (--min-part) (\S+) removes them", outcome.out)
    assert found[1] == said
    outcome = ctmc(*words, "-o", tmp_path / "one.stl", found[2], found[3])
    assert outcome.code == 0, outcome.errors
    assert ["components", "1"] in [line.split() for line in outcome.out.splitlines()]
    assert "smaller than" not in outcome.out


def test_a_given_name_takes_the_place_of_the_files(ctmc, misused, tmp_path):
    values = np.zeros((8, 8, 8), np.uint8)
    values[2:6, 2:6, 2:6] = 200
    np.save(tmp_path / "Muster_Erika.npy", values)
    words = ["reconstruct", tmp_path / "Muster_Erika.npy", "--threshold", "100", "--name", "case 7"]
    outcome = ctmc(*words, "-o", tmp_path / "a.ply", "--report", tmp_path / "a.json")
    assert outcome.code == 0
    assert outcome.out.startswith("case 7: ")
    assert json.loads((tmp_path / "a.json").read_text("utf-8"))["name"] == "case 7"
    assert "Erika" not in outcome.out + (tmp_path / "a.json").read_text("utf-8")
    assert "name" in misused(*words[:-1], " ", "-o", tmp_path / "a.ply")


@pytest.mark.parametrize(
    "flags",
    [
        ["--threshold", "0.5"],
        ["--threshold", "0.5", "--stride", "2", "3", "1"],
        ["--region", "3", "2", "4", "18", "20", "17", "--normals", "gradient"],
        [
            "--threshold",
            "0.5",
            "--region",
            "-12",
            "-19",
            "3",
            "-4",
            "-2",
            "18",
            "--region-unit",
            "mm",
            "--smoothing-mm",
            "1",
        ],
    ],
)
def test_a_surface_of_values_that_are_fetched_has_the_bytes_of_one_in_memory(ctmc, tmp_path, monkeypatch, flags):
    np.save(tmp_path / "ct.npy", np.random.default_rng(0).random((22, 23, 24)).astype(np.float32))
    words = ["reconstruct", tmp_path / "ct.npy", *flags, "-o"]
    assert ctmc(*words, tmp_path / "memory.ply").code == 0
    monkeypatch.setattr("ctmc_addon.core.planning.plan.READ_SHARE", 0.0)
    monkeypatch.setattr("ctmc_addon.readers.VolumeSource.read_steps", lambda *_, **__: pytest.fail("read whole"))
    assert ctmc(*words, tmp_path / "fetched.ply").code == 0
    assert (tmp_path / "fetched.ply").read_bytes() == (tmp_path / "memory.ply").read_bytes()


@pytest.mark.parametrize(("share", "whole"), [(3.9, False), (4.1, True)])
def test_a_budgets_own_memory_decides_whether_values_are_read_at_once(tmp_path, share, whole):
    path, options = tmp_path / "ct.npy", readers.ReadingOptions()
    np.save(path, np.zeros((5, 6, 7), np.int16))
    budget = core.Budget(bytes=int(share * 2 * 5 * 6 * 7))
    steps = needed_steps(
        readers.open_volume(path), path, options, core.ReconstructionSettings(threshold=1), budget=budget
    )
    assert (core.finish(steps).reader.own_bytes == 0) == whole
