# SPDX-License-Identifier: GPL-3.0-or-later
"""Make the file of three.js that pages of structures hold: the parts that the viewer uses, minified, with licenses.

Needs npm and its registry: three and fflate, packed by esbuild, at the versions below. Run it where one of them
changes, and look at a page afterwards.

    python tools/make_viewer.py
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from pathlib import Path

VERSIONS = {"three": "0.187.0", "fflate": "0.8.3", "esbuild": "0.28.2"}
TARGET = Path(__file__).resolve().parents[1] / "ctmc_addon/core/files/structures/viewer/three.min.js"
ENTRY = """
export { BackSide, Box3, BufferAttribute, BufferGeometry, Color, DirectionalLight, DoubleSide, FrontSide, Group,
  HemisphereLight, Mesh, MeshBasicMaterial, MeshStandardMaterial, NeutralToneMapping, OrthographicCamera, Plane, Scene,
  Vector3, WebGLRenderer } from "three";
export { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
export { unzlibSync } from "fflate";
"""


def main() -> None:
    """Install and pack the modules, and put their licenses first."""
    npm = shutil.which("npm")
    if npm is None:
        raise SystemExit("npm is missing; install Node.js")
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        packages = [f"{name}@{version}" for name, version in VERSIONS.items()]
        subprocess.run([npm, "install", "--no-save", "--prefix", folder, *packages], check=True)
        (place / "entry.js").write_text(ENTRY, "utf-8")
        esbuild = place / "node_modules" / ".bin" / "esbuild"
        flags = [
            "--bundle",
            "--minify",
            "--format=iife",
            "--global-name=CTMC3",
            "--target=es2020",
            "--legal-comments=none",
        ]
        subprocess.run([str(esbuild), "entry.js", *flags, "--outfile=packed.js"], cwd=place, check=True)
        heads = []
        for name in ("three", "fflate"):
            license_text = (place / "node_modules" / name / "LICENSE").read_text("utf-8").strip()
            heads.append(f"/*\n{name} {VERSIONS[name]}\n\n{license_text}\n*/\n")
        packed = (place / "packed.js").read_text("utf-8")
        if "</script" in packed:
            raise SystemExit("what was packed would end the page's script; escape it")
        TARGET.write_text("".join(heads) + packed, "utf-8", newline="\n")
    print(f"{TARGET.name}: {TARGET.stat().st_size} bytes")


if __name__ == "__main__":
    main()
