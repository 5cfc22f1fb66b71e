# SPDX-License-Identifier: GPL-3.0-or-later
"""The zip as a user meets it: built, installed into an empty profile, used, switched off and on, taken out."""

from __future__ import annotations

import json
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path, PurePosixPath
from typing import Any

import pytest

DRIVER = Path(__file__).with_name("live_through_extension.py")
MODULES = ["PIL", "imageio", "libjpeg", "nibabel", "nrrd", "openjpeg", "pydicom", "pylibjpeg", "tifffile"]


@pytest.fixture(scope="module")
def seen(extension_zip: Path, bare_blender: dict[str, str], tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What the driver saw; it must also end by itself and in peace."""
    report = tmp_path_factory.mktemp("report") / "report.json"
    command = [sys.executable, "-S", str(DRIVER), str(extension_zip), str(report), *MODULES]
    done = subprocess.run(command, env=bare_blender, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    result: dict[str, Any] = json.loads(report.read_text(encoding="utf-8"))
    return result


def test_the_zip_holds_the_package_its_wheels_and_nothing_else(extension_zip, carried):
    with zipfile.ZipFile(extension_zip) as package:
        names = [PurePosixPath(name) for name in package.namelist()]
        manifest = tomllib.loads(package.read("blender_manifest.toml").decode())
    assert {name.parts[0] for name in names} == {
        "__init__.py",
        "LICENSE",
        "blender_manifest.toml",
        "ctmc_addon",
        "wheels",
    }
    wheels = {name.name for name in names if name.suffix == ".whl"}
    assert {PurePosixPath(wheel).name for wheel in manifest["wheels"]} == wheels
    assert {wheel.partition("-")[0].lower() for wheel in wheels} == {name.replace("-", "_") for name in carried}
    compiled = {wheel.split("-")[2] for wheel in wheels if not wheel.endswith("-any.whl")}
    assert compiled == {"cp311", "cp313", "cp314"}
    assert all(name.suffix != ".pyc" for name in names)


def test_it_is_enabled_after_installation(seen):
    assert seen["enabled"] is True


def test_every_library_comes_from_the_zip(seen):
    assert set(seen["files"]) == set(MODULES)
    for file in seen["files"].values():
        assert Path(file).is_relative_to(seen["profile"])


def test_the_compiled_decoders_work_with_this_blenders_numpy(seen):
    assert seen["decoded"]["openjpeg"] == 0
    assert seen["decoded"]["libjpeg"] <= 2


def test_the_installed_operators_load_and_reconstruct(seen):
    assert seen["box"]["steps"] == [["FINISHED"], ["FINISHED"]]
    assert seen["box"]["euler"] == 2
    # Half a voxel is cut off along the twelve edges and at the eight corners of 6 x 8 x 10.
    assert 440 < seen["box"]["volume"] < 480


def test_twenty_rounds_of_off_and_on_leave_nothing_behind(seen):
    assert len(seen["rounds"]) == 40
    assert not any(seen["rounds"])
    assert seen["left when disabled"] == []


def test_uninstalling_leaves_nothing_registered_and_nothing_on_disk(seen):
    assert seen["left registered"] == []
    assert seen["left on disk"] == []


def test_a_surface_outlives_the_extension(seen):
    # A box of 6 x 8 x 10 samples: each sample on a face has one crossed edge out of that face.
    assert seen["vertices kept"] == 2 * (6 * 8 + 8 * 10 + 6 * 10)
