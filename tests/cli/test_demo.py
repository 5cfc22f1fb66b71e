# SPDX-License-Identifier: GPL-3.0-or-later
import importlib.util
import json
from pathlib import Path

import pytest

pytestmark = pytest.mark.usefixtures("scene")
DEMO = Path(__file__).resolve().parents[2] / "tools" / "demo.py"


@pytest.fixture(scope="module")
def demo():
    spec = importlib.util.spec_from_file_location("demo", DEMO)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.once
def test_the_demo_leaves_its_files_and_tells_the_truth(demo, tmp_path, capfd):
    demo.demo(tmp_path / "out", slices=15, size=128)
    told, progress = capfd.readouterr()
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "dicom", "png", "report.json", "segmentation-0.nii.gz", "truth.json", "tumour.blend", "tumour.png",
        "tumour.stl", "volume-0.nii.gz",
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
    assert "Rendering tumour.png" in progress


def test_the_demo_s_own_phantom_loses_less_than_4_per_cent(demo):
    from ctmc_addon.core import reconstruct
    from ctmc_addon.core.phantom.phantom import phantom

    made = phantom()
    error = demo.against(made, reconstruct(made.labels, demo.SETTINGS).mesh.volume)
    assert -4 < error < 0
