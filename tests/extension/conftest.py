# SPDX-License-Identifier: GPL-3.0-or-later
"""The extension's zip, and a Python that has Blender but none of the libraries that the zip carries."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import sysconfig
from importlib import metadata
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SYSTEMS = {"Linux": "linux", "Darwin": "macos", "Windows": "windows"}
MACHINES = {"x86_64": "x64", "AMD64": "x64", "arm64": "arm64", "aarch64": "arm64"}


@pytest.fixture(scope="session")
def carried() -> list[str]:
    """Names of the distributions that the zip carries."""
    lines = (ROOT / "tools" / "wheels.txt").read_text(encoding="utf-8").splitlines()
    return [line.partition("==")[0] for line in lines if "==" in line]


@pytest.fixture(scope="session")
def extension_zip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """This platform's zip, built from the checkout and validated with Blender's list of tags."""
    pytest.importorskip("bpy", reason="packing needs the tool that the bpy wheel brings along")
    name = f"{SYSTEMS[platform.system()]}-{MACHINES[platform.machine()]}"
    output = tmp_path_factory.mktemp("dist")
    command = [sys.executable, str(ROOT / "tools" / "build_extension.py"), f"--platform={name}", f"--output={output}"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    (package,) = output.glob("*.zip")
    return package


@pytest.fixture(scope="session")
def bare_blender(tmp_path_factory: pytest.TempPathFactory, carried: list[str]) -> dict[str, str]:
    """Environment variables for `python -S`: Blender and NumPy as a user has them, and nothing of ours."""
    hidden = {"ctmc", "ctmc_addon"}
    for name in carried:
        try:
            files = metadata.files(name) or []
        except metadata.PackageNotFoundError:
            continue  # importlib_resources, which only older Pythons need
        hidden |= {file.parts[0] for file in files}
    folder = tmp_path_factory.mktemp("site-packages")
    for entry in Path(sysconfig.get_path("platlib")).iterdir():
        if entry.name not in hidden and entry.suffix != ".pth":
            (folder / entry.name).symlink_to(entry)
    kept = {key: value for key, value in os.environ.items() if not key.startswith(("PYTHON", "BLENDER"))}
    profile = tmp_path_factory.mktemp("profile")
    return {**kept, "PYTHONPATH": str(folder), "BLENDER_USER_RESOURCES": str(profile)}
