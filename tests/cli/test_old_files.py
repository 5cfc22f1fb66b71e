# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings files, manifests and batch records of earlier versions mean what they meant.

Each version wrote `settings.toml` with `ctmc settings`, and made the cases of `cases.csv` of two boxes of labels.
"""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from batches import states

from ctmc_addon.cli.batch.cases import collect
from ctmc_addon.cli.flags.arguments import TABLES, read_settings
from ctmc_addon.core import ReconstructionSettings
from ctmc_addon.readers import ReadingOptions

OLD = Path(__file__).parents[1] / "old_files"
VERSIONS = ["0.1", "0.2", "0.3"]


def gaussian_of(version):
    """How each version asks for a Gaussian; 0.1 had one way to smooth, and named it by its width."""
    return "auto" if version == "0.1" else "gaussian"


@pytest.fixture(params=VERSIONS)
def version(request):
    return request.param


@pytest.fixture
def manifest(version, tmp_path):
    """The manifest of a version beside the volume that it names."""
    values = np.zeros((10, 12, 14), np.uint8)
    values[3:7, 3:9, 3:7], values[3:7, 3:9, 7:11] = 1, 2
    np.save(tmp_path / "two.npy", values)
    shutil.copy(OLD / version / "cases.csv", tmp_path)
    return tmp_path / "cases.csv"


def test_a_settings_file_gives_the_settings_it_gave(version):
    read = read_settings(str(OLD / version / "settings.toml"))
    assert ReconstructionSettings(**{name: read[name] for name in read.keys() - set(TABLES)}) == ReconstructionSettings(
        label=1,
        stride=(2, 2, 1),
        alpha=0.25,
        topology="trilinear",
        smoothing=gaussian_of(version),
        smoothing_mm=0.75,
        close_border=True,
        region=(1.0, 1.0, 0.0, 13.0, 11.0, 9.0),
        min_part_mm3=2.5,
        normals="mesh",
        reduction=0.5,
    )


def test_a_settings_file_makes_a_surface(ctmc, version, manifest, tmp_path):
    words = ("--settings", OLD / version / "settings.toml", "-o", tmp_path / "one.stl")
    outcome = ctmc("reconstruct", tmp_path / "two.npy", *words)
    assert outcome.code == 0, outcome.errors
    assert len((tmp_path / "one.stl").read_bytes()) > 84


def test_a_manifest_gives_the_cases_it_gave(version, manifest):
    first, second = collect([str(manifest)], {}, ReadingOptions())
    assert [case.name for case in (first, second)] == ["first", "second"]
    assert first.reading == ReadingOptions(spacing=(1.0, 1.0, 2.0), flip="z")
    assert second.reading == ReadingOptions()
    assert first.outputs[0].settings == ReconstructionSettings(
        label=1,
        stride=(2, 2, 1),
        alpha=0.25,
        smoothing=gaussian_of(version),
        smoothing_mm=1.5,
        region=(1.0, 1.0, 0.0, 13.0, 11.0, 9.0),
    )
    assert second.outputs[0].settings == ReconstructionSettings(label=2)


@pytest.mark.parametrize("version", ["0.1"], indirect=True)
def test_a_folder_of_the_first_version_is_made_again_with_the_fields_it_had(ctmc, version, manifest, tmp_path):
    """Records of 0.2.0 and 0.3.0 have tests of their own, in test_resume.py."""
    before = json.loads((OLD / version / "record.json").read_text("utf-8"))
    (tmp_path / "out").mkdir()
    shutil.copy(OLD / version / "record.json", tmp_path / "out" / "first.json")
    outcome = ctmc("batch", manifest, "-o", tmp_path / "out", "--no-thumbnails", "--resume")
    assert outcome.code == 0, outcome.errors
    assert states(tmp_path / "out") == {"first": "done", "second": "done"}
    after = json.loads((tmp_path / "out" / "first.json").read_text("utf-8"))
    assert before["version"] == f"{version}.0" != after["version"]
    assert before.keys() <= after.keys()
    same = ("case", "faces", "vertices", "full_faces", "closed", "euler", "parts", "threshold", "spacing_mm")
    assert {key: after[key] for key in same} == {key: before[key] for key in same}
    made = (ReconstructionSettings.from_dict(record["settings"]) for record in (before, after))
    assert next(made) == next(made)
