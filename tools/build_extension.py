# SPDX-License-Identifier: GPL-3.0-or-later
"""Pack the extension: one zip for each platform, with the wheels of the libraries it reads CT with.

Wheels are gathered by pip into wheels/ and stay there between builds. tools/wheels.txt pins them by version and hash;
`--pin` writes the hashes anew after a version has changed. Each zip is staged in a temporary folder,
then built and validated by Blender's own tool, which the bpy wheel brings along.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
REQUIREMENTS = ROOT / "tools" / "wheels.txt"
WHEELS = ROOT / "wheels"
PACKED = ("__init__.py", "LICENSE", "ctmc_addon")


class Platform(NamedTuple):
    """The wheel tags that run on a platform, and the Pythons of the Blenders there."""

    tags: tuple[str, ...]
    pythons: tuple[str, ...] = ("3.11", "3.13", "3.14")


PLATFORMS = {
    # Blender asks for glibc 2.28 and macOS 11; pip finds older macOS tags by itself, but not older glibc ones.
    "linux-x64": Platform(tuple(f"manylinux_2_{minor}_x86_64" for minor in range(28, 16, -1))),
    "windows-x64": Platform(("win_amd64",)),
    "macos-arm64": Platform(("macosx_11_0_arm64",)),
    "macos-x64": Platform(("macosx_11_0_x86_64",), ("3.11", "3.13")),
}


class BuildError(Exception):
    """A sentence for the person who builds."""


def run(command: list[str], failure: str) -> None:
    """Run a command quietly; what it printed is part of the error."""
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
    if done.returncode:
        raise BuildError(f"{failure}:\n{done.stdout}{done.stderr}")


def gather_wheels(name: str) -> list[Path]:
    """Return the wheels of one platform, from wheels/ or by pip; one per library and Python, pure ones once.

    pip refuses a wheel whose hash is not in tools/wheels.txt.
    """
    wheels = {}
    for python in PLATFORMS[name].pythons:
        folder = WHEELS / f"{name}-{python}"
        stamp = folder / "wheels.txt"
        if not stamp.is_file() or stamp.read_bytes() != REQUIREMENTS.read_bytes():
            print(f"Gathering wheels for {name}, Python {python}", flush=True)
            part = folder.with_name(f"{folder.name}.{os.getpid()}")  # another build may gather them at the same time
            command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--only-binary=:all:"]
            command += [f"--platform={tag}" for tag in PLATFORMS[name].tags]
            command += [f"--python-version={python}", f"--dest={part}", f"--requirement={REQUIREMENTS}"]
            run(command, f"pip found no wheels for {name} and Python {python}")
            shutil.copyfile(REQUIREMENTS, part / stamp.name)
            if stamp.is_file() and stamp.read_bytes() == REQUIREMENTS.read_bytes():
                shutil.rmtree(part)
            else:
                shutil.rmtree(folder, ignore_errors=True)
                part.rename(folder)
        wheels.update({wheel.name: wheel for wheel in folder.glob("*.whl")})
    return [wheels[key] for key in sorted(wheels)]


def pin_wheels() -> None:
    """Write the hashes of the wheels of all platforms behind the versions in tools/wheels.txt."""
    pinned = [line for line in REQUIREMENTS.read_text(encoding="utf-8").splitlines() if "--hash" not in line]
    pinned = [line.removesuffix(" \\") for line in pinned]
    REQUIREMENTS.write_text("\n".join(pinned) + "\n", encoding="utf-8")
    hashes: dict[str, set[str]] = {}
    for wheel in {wheel for name in PLATFORMS for wheel in gather_wheels(name)}:
        library = wheel.name.partition("-")[0].replace("_", "-").lower()
        hashes.setdefault(library, set()).add(hashlib.sha256(wheel.read_bytes()).hexdigest())
    lines = []
    for line in pinned:
        library = line.partition("==")[0].replace("_", "-").lower()
        digests = sorted(hashes.get(library, ()))
        lines.append(" \\\n".join([line, *(f"    --hash=sha256:{digest}" for digest in digests)]))
    REQUIREMENTS.write_text("\n".join(lines) + "\n", encoding="utf-8")


def blender_scripts() -> Path:
    """Return the scripts folder of the installed bpy wheel, without starting Blender."""
    spec = importlib.util.find_spec("bpy")
    folders = spec.submodule_search_locations if spec else None
    if not folders:
        raise BuildError(f"{sys.executable} has no bpy, whose tool packs extensions; run make setup")
    return next(Path(folders[0]).glob("*/scripts"))


def blender_tool(*arguments: str) -> None:
    """Run Blender's own extension tool as plain Python."""
    tool = blender_scripts() / "addons_core" / "bl_pkg" / "cli" / "blender_ext.py"
    run([sys.executable, str(tool), *arguments], f"Blender's extension tool refused to {arguments[0]}")


def validate(package: Path) -> None:
    """Let Blender check the manifest and the tags of a folder or zip."""
    tags = blender_scripts() / "modules" / "_bpy_internal" / "extensions" / "tags.py"
    blender_tool("validate", f"--valid-tags={tags}", str(package))


def stage(folder: Path, name: str) -> None:
    """Copy one platform's package into a folder: the sources, its wheels, and a manifest with both."""
    for part in PACKED:
        if (ROOT / part).is_dir():
            shutil.copytree(ROOT / part, folder / part, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copyfile(ROOT / part, folder / part)
    (folder / "wheels").mkdir()
    for wheel in (wheels := gather_wheels(name)):
        shutil.copyfile(wheel, folder / "wheels" / wheel.name)
    # JSON's lists of plain strings are TOML's.
    generated = {"platforms": [name], "wheels": [f"./wheels/{wheel.name}" for wheel in wheels]}
    lines = "\n".join(f"{key} = {json.dumps(value)}" for key, value in generated.items())
    manifest = (ROOT / "blender_manifest.toml").read_text(encoding="utf-8")
    manifest = re.sub(r"^platforms = .*$", lines, manifest, flags=re.MULTILINE)
    (folder / "blender_manifest.toml").write_text(manifest, encoding="utf-8")


def build(name: str, output: Path) -> Path:
    """Build and validate one platform's zip in the folder `output`; returns its path."""
    version = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))["version"]
    package = output / f"ctmc-{version}-{name}.zip"
    output.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        stage(Path(folder), name)
        blender_tool("build", f"--source-dir={folder}", f"--output-filepath={package}")
    validate(package)
    return package


def main() -> int:
    """Build the zips that the command line asks for; 1 and one sentence if that fails."""
    parser = argparse.ArgumentParser(description="Pack the extension for Blender.")
    parser.add_argument("--platform", action="append", choices=PLATFORMS, help="only this one (may be repeated)")
    parser.add_argument("--output", type=Path, default=ROOT / "dist", help="folder for the zips (default: dist)")
    parser.add_argument("--pin", action="store_true", help="write the wheels' hashes into tools/wheels.txt, and stop")
    arguments = parser.parse_args()
    try:
        if arguments.pin:
            pin_wheels()
            return 0
        for name in arguments.platform or PLATFORMS:
            package = build(name, arguments.output)
            print(f"{package}  {package.stat().st_size / 1e6:.1f} MB", flush=True)
    except BuildError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
