# SPDX-License-Identifier: GPL-3.0-or-later
"""The wheel in empty environments without Blender: what `pip install ctmc-addon` gives on a plain Python."""

import importlib.util
import json
import os
import struct
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import numpy as np
import pytest

pytestmark = pytest.mark.packaging
ROOT = Path(__file__).resolve().parents[2]
PYTHONS = ("3.11", "3.12", "3.13", "3.14")


def run(*command, **options):
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(
        [str(word) for word in command],
        capture_output=True,
        text=True,
        check=False,
        timeout=600,
        env=environment,
        **options,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def archives(tmp_path_factory):
    """The wheel and the source archive, the wheel made from it."""
    folder = tmp_path_factory.mktemp("dist")
    run(sys.executable, "-m", "build", "--outdir", folder, ROOT, cwd=folder)
    [wheel], [source] = folder.glob("*.whl"), folder.glob("*.tar.gz")
    return wheel, source


def found_python(version):
    """The path of this Python; None where there is none."""
    spec = importlib.util.spec_from_file_location("setup_environment", ROOT / "tools" / "setup_environment.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    try:
        return module.find_python((version,), "")[0]
    except module.SetupError:
        return None


def python_of(version):
    return found_python(version) or pytest.skip(f"there is no Python {version} here")


@pytest.fixture(scope="module", params=PYTHONS)
def environment(request, archives, tmp_path_factory):
    """The folder of programs of an empty environment with the wheel in it."""
    python = python_of(request.param)
    folder = tmp_path_factory.mktemp(f"python{request.param}")
    run(python, "-m", "venv", folder)
    programs = folder / ("Scripts" if os.name == "nt" else "bin")
    run(programs / "python", "-m", "pip", "install", "--quiet", "--no-input", archives[0], cwd=folder)
    return programs


def test_wheel_and_source_hold_the_package_and_its_data(archives):
    wheel, source = archives
    assert wheel.name.startswith("ctmc_addon-")
    data = {
        path.relative_to(ROOT).as_posix()
        for path in (ROOT / "ctmc_addon").rglob("*")
        if path.is_file() and path.suffix != ".pyc"
    }
    assert {"ctmc_addon/py.typed", "ctmc_addon/ui/languages/de_DE.toml", "ctmc_addon/ui/presets/ctmc/bone.py"} <= data
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
        [entry_points] = [name for name in names if name.endswith("entry_points.txt")]
        assert "ctmc = ctmc_addon.cli:main" in archive.read(entry_points).decode()
    assert {name for name in names if ".dist-info/" not in name} == data
    with tarfile.open(source) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert {*data, "pyproject.toml", "README.md", "LICENSE"} <= names


def test_every_command_that_needs_no_blender_works(environment, tmp_path):
    def ctmc(*words):
        return run(environment / "ctmc", *words, cwd=tmp_path)

    assert "bpy" not in run(environment / "python", "-m", "pip", "list")
    assert ctmc("--version").startswith("ctmc ")
    ctmc("phantom", "ct", "--slices", "9", "--size", "64", "--seed", "4")
    for name in ("dicom", "png", "volume-4.nii.gz", "segmentation-4.nii.gz"):
        assert "64 x 64 x 9" in ctmc("info", f"ct/{name}")
    (tmp_path / "case.toml").write_text(ctmc("settings", "--label", "2"))
    for suffix in ("stl", "ply"):
        words = ["-o", f"tumor.{suffix}", "--settings", "case.toml", "--report", "report.json"]
        ctmc("reconstruct", "ct/volume-4.nii.gz", *words, "--simplify", "0.5")
    faces = json.loads((tmp_path / "report.json").read_text("utf-8"))["faces"]
    assert struct.unpack_from("<I", (tmp_path / "tumor.stl").read_bytes(), 80)[0] == faces > 10
    ctmc("batch", "ct", "-o", "out", "--label", "1", "2", "--output-format", "ply")
    rows = json.loads((tmp_path / "out" / "summary.json").read_text("utf-8"))
    assert [row["status"] for row in rows] == ["done", "done"]
    assert sorted(path.name for path in (tmp_path / "out").glob("*.ply")) == [
        "volume-4-label-1.ply", "volume-4-label-2.ply",
    ]  # fmt: skip
    ctmc("experiment", "voxels", "ct/segmentation-4.nii.gz", "--label", "1", "--repeats", "1", "-o", "voxels")
    assert len(json.loads((tmp_path / "voxels" / "table.json").read_text("utf-8"))) == 3


def test_a_dicom_segmentation_has_the_voxels_the_patient_and_the_images(archives, tmp_path):
    python = next(path for path in map(found_python, reversed(PYTHONS)) if path)
    run(python, "-m", "venv", tmp_path / "own")
    programs = tmp_path / "own" / ("Scripts" if os.name == "nt" else "bin")
    run(programs / "python", "-m", "pip", "install", "--quiet", "--no-input", f"{archives[0]}[dicom-seg]", cwd=tmp_path)

    def ctmc(*words):
        return run(programs / "ctmc", *words, cwd=tmp_path)

    ctmc("phantom", "ct", "--slices", "9", "--size", "64", "--seed", "4")
    words = ["--seed", "liver", "80", "26", "-2", "--seed", "tumor", "40.5", "14.8", "2.8"]
    ctmc("segment", "ct/dicom", "-o", "one.seg.nrrd", *words)
    # Both grown by 30 mm overlap.
    words = ["--from", "one.seg.nrrd", "--margin", "tumor", "30", "--margin", "liver", "30"]
    ctmc("segment", "ct/dicom", "-o", "both.seg.nrrd", *words)
    ctmc("segment", "ct/dicom", "-o", "both.dcm", *words, "--with-identity")
    script = (
        "import json, pydicom\n"
        "from pathlib import Path\n"
        "import numpy as np\n"
        "from ctmc_addon.readers import read_volume\n"
        "nrrd, dicom = (read_volume(name) for name in ('both.seg.nrrd', 'both.dcm'))\n"
        "count = lambda volume: [sum(int((one.values == n).sum()) for one in volume.each_layer) for n in (1, 2)]\n"
        "place = lambda volume: [sum(((one.values == n).sum() and volume.affine[:3] @ np.append(np.argwhere("
        "one.values == n)[:, ::-1].mean(axis=0), 1) for one in volume.each_layer)).tolist() for n in (1, 2)]\n"
        "seg, source = pydicom.dcmread('both.dcm'), pydicom.dcmread(next(Path('ct/dicom').glob('*.dcm')))\n"
        "print(json.dumps({'voxels': [count(nrrd), count(dicom)], 'layers': len(list(nrrd.each_layer)),\n"
        "    'far_mm': float(np.abs(np.subtract(place(nrrd), place(dicom))).max()), 'names': dicom.label_names,\n"
        "    'same': [seg[k].value == source[k].value for k in ('PatientID', 'StudyInstanceUID')],\n"
        "    'kind': seg.SegmentSequence[1].SegmentedPropertyTypeCodeSequence[0].CodeMeaning,\n"
        "    'images': len(seg.ReferencedSeriesSequence[0].ReferencedInstanceSequence)}))\n"
    )
    found = json.loads(run(programs / "python", "-c", script, cwd=tmp_path))
    assert found["voxels"][0] == found["voxels"][1]
    assert min(found["voxels"][0]) > 0
    assert found["far_mm"] < 1e-3
    assert found["layers"] == 2
    assert found["names"] == {"1": "liver", "2": "tumor"}
    assert (found["same"], found["kind"], found["images"]) == ([True, True], "Lesion", 9)


def test_python_knows_the_types_and_makes_a_surface(environment, tmp_path):
    np.save(tmp_path / "cube.npy", np.pad(np.ones((4, 4, 4), np.float32), 2))
    script = (
        "from ctmc_addon.core import ReconstructionSettings, reconstruct\n"
        "from ctmc_addon.readers import read_volume\n"
        "mesh = reconstruct(read_volume('cube.npy'), ReconstructionSettings(threshold=0.5)).mesh\n"
        "print(mesh.closed, len(mesh.faces) > 0)\n"
    )
    assert run(environment / "python", "-c", script, cwd=tmp_path) == "True True\n"


def test_what_needs_blender_says_what_to_install(environment, tmp_path):
    command = [str(environment / "ctmc"), "reconstruct", "in", "-o", "x.blend"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 1
    assert "pip install 'ctmc-addon[blender]'" in done.stderr
    assert len(done.stderr.splitlines()) == 1
