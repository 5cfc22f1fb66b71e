# SPDX-License-Identifier: GPL-3.0-or-later
import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest

from ctmc_addon.core import Volume
from ctmc_addon.core.volume import ValueKind

pytestmark = pytest.mark.usefixtures("scene")
DEMO = Path(__file__).resolve().parents[2] / "tools" / "demo.py"


@pytest.fixture(scope="module")
def demo():
    spec = importlib.util.spec_from_file_location("demo", DEMO)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.once
@pytest.mark.usefixtures("small_pictures")
def test_the_demo_leaves_its_files_and_tells_the_truth(demo, tmp_path, capfd):
    demo.demo(tmp_path / "out", slices=15, size=128)
    told, progress = capfd.readouterr()
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "dicom", "png", "report.json", "segmentation-0.nii.gz", "truth.json", "tumor.blend", "tumor.png",
        "tumor.stl", "volume-0.nii.gz",
    ]  # fmt: skip
    report = json.loads((tmp_path / "out" / "report.json").read_text("utf-8"))
    truth = json.loads((tmp_path / "out" / "truth.json").read_text("utf-8"))
    assert report["true_volume_mm3"] == truth["tumour_volume_mm3"]
    assert report["settings"]["stride"] == [2, 2, 1]
    assert report["closed"]
    assert [row["stride"] for row in report["voxel_sides"]] == [[1, 1, 1], [2, 2, 1], [3, 3, 1]]
    for row in report["voxel_sides"]:
        assert row["faces"] == pytest.approx(row["full_faces"] / 10, abs=2)
        error = 100 * (row["volume_mm3"] / report["true_volume_mm3"] - 1)
        assert row["volume_error_percent"] == pytest.approx(error)
        assert f"{error:+.1f} %" in told
        assert -25 < error < 0  # pixels of 3 mm: every simplification here makes round shapes smaller
    for word in ("2 x 2 px", "--simplify 0.9", "Simplifying, s", "triangles kept", "against the truth"):
        assert word in told
    assert "Rendering tumor.png" in progress


def test_the_demo_s_own_phantom_loses_less_than_4_per_cent(demo):
    from ctmc_addon.core import reconstruct
    from ctmc_addon.core.phantom.phantom import phantom

    made = phantom()
    error = demo.against(sum(made.tumour_volumes_mm3), reconstruct(made.labels, demo.SETTINGS).mesh.volume)
    assert -4 < error < 0


@pytest.mark.once
def test_the_demo_chooses_the_largest_label_or_bone_or_what_otsu_divides(demo):
    values = np.zeros((4, 4, 4), np.int16)
    values[0], values[1, :2], values[2, 0, 0] = 1000, 300, 7
    hu, gray = (Volume(values, np.eye(4), kind=kind) for kind in (ValueKind.HU, ValueKind.GRAY))
    labels = Volume(values, np.eye(4), kind=ValueKind.LABEL, label_names={300: "liver", 1000: "skin"})
    bone, otsu, skin = map(demo.chosen_subject, (hu, gray, labels))
    assert (bone.settings.threshold, bone.settings.label) == (200, None)
    assert (otsu.settings.threshold, otsu.settings.label) == (None, None)
    assert (skin.settings.threshold, skin.settings.label, skin.chosen) == (None, 1000, "skin, the largest of 3 labels")


@pytest.mark.once
def test_the_demo_of_a_ct_says_what_it_chose(demo, ctmc, tmp_path, capfd, monkeypatch):
    assert ctmc("phantom", tmp_path, "--slices", 5, "--size", 64, "--format", "nifti", "--quiet").code == 0
    outputs = demo.Outputs
    monkeypatch.setattr(demo, "Outputs", lambda paths, figure: outputs(paths[1:]))  # no .blend, no picture
    demo.demo_of_ct(tmp_path / "out", tmp_path / "volume-0.nii.gz")
    told, _ = capfd.readouterr()
    assert "bone, 200 HU and more, without the table, without components below 500 mm3" in told
    assert "against 1 x 1 px" in told
    report = json.loads((tmp_path / "out" / "report.json").read_text("utf-8"))
    assert report["files"] == ["surface.stl"]
    assert report["voxel_sides"][0]["volume_error_percent"] == 0
    assert "true_volume_mm3" not in report
