# SPDX-License-Identifier: GPL-3.0-or-later
"""A user's day with the extension, in a Blender of its own: `live_through_extension.py ZIP` prints what it saw.

Run by test_extension.py with `python -S`, so that the libraries can only come from the zip.
"""

from __future__ import annotations

import importlib
import io
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

MODULE = "bl_ext.user_default.ctmc"
ROUNDS = 20


def registered() -> set[str]:
    """Everything an add-on may leave behind: types, properties, handlers, menu entries."""
    import bpy

    names = {f"type {name}" for name in dir(bpy.types)}
    for owner in ("Scene", "Object", "Mesh", "WindowManager", "Collection", "Material"):
        properties = getattr(bpy.types, owner).bl_rna.properties
        names |= {f"property {owner}.{item.identifier}" for item in properties}
    for kind in dir(bpy.app.handlers):
        handlers = getattr(bpy.app.handlers, kind)
        if isinstance(handlers, list):
            names |= {f"handler {kind} {handler.__module__}.{handler.__name__}" for handler in handlers}
    for name in dir(bpy.types):
        draw = getattr(getattr(bpy.types, name), "draw", None)
        names |= {f"draw {name} {entry.__module__}" for entry in getattr(draw, "_draw_funcs", ())}
    return names


def where_from(modules: list[str]) -> dict[str, str]:
    """The file of each module that the zip should have brought."""
    return {name: str(importlib.import_module(name).__file__) for name in modules}


def decode_both_jpegs() -> dict[str, float]:
    """Greatest error of a picture sent through each compiled decoder; they meet Blender's own NumPy here."""
    import libjpeg
    from openjpeg.utils import decode, encode_array
    from PIL import Image

    ramp = np.add.outer(np.arange(64), 2 * np.arange(64)).astype(np.uint8)
    stream = io.BytesIO()
    Image.fromarray(ramp).save(stream, "JPEG", quality=100)
    lossy = libjpeg.decode(stream.getvalue())
    lossless = decode(encode_array(ramp))
    return {
        "libjpeg": float(np.abs(lossy.astype(int) - ramp).max()),
        "openjpeg": float(np.abs(lossless.astype(int) - ramp).max()),
    }


def reconstruct_a_box(folder: Path) -> dict[str, Any]:
    """A box of 6 x 8 x 10 mm, loaded and reconstructed as the panel's buttons do it."""
    import bpy

    values = np.zeros((14, 12, 10), np.uint8)
    values[2:12, 2:10, 2:8] = 255
    np.save(folder / "box.npy", values)
    scene = bpy.context.scene
    steps = [bpy.ops.ctmc.load(filepath=str(folder / "box.npy"), spacing=(1.0, 1.0, 1.0))]
    scene.ctmc.threshold = 127.5
    steps.append(bpy.ops.ctmc.reconstruct())
    thing = bpy.context.view_layer.objects.active
    mesh = importlib.import_module(f"{MODULE}.ctmc_addon.blender.surface").evaluated_triangles(thing)
    return {"steps": [sorted(step) for step in steps], "name": thing.name, "volume": mesh.volume, "euler": mesh.euler}


def repository() -> int:
    """Index of the repository for the user's own extensions."""
    import bpy

    modules = [repo.module for repo in bpy.context.preferences.extensions.repos]
    return modules.index("user_default")


def main(package: str, modules: list[str]) -> dict[str, Any]:
    """Install, use, disable and enable, uninstall; what was seen on the way."""
    import bpy

    profile = Path(bpy.utils.resource_path("USER"))
    before = registered()
    bpy.ops.extensions.package_install_files(
        filepath=package, repo="user_default", enable_on_install=True, overwrite=True
    )
    enabled = registered()
    seen: dict[str, Any] = {"profile": str(profile), "enabled": MODULE in bpy.context.preferences.addons}
    seen["files"] = where_from(modules)
    seen["decoded"] = decode_both_jpegs()
    seen["box"] = reconstruct_a_box(profile)
    rounds: list[list[str]] = []
    seen["rounds"] = rounds
    addon_utils = importlib.import_module("addon_utils")  # is there once bpy is
    for _ in range(ROUNDS):
        addon_utils.disable(MODULE)
        rounds.append(sorted(registered() ^ before))
        addon_utils.enable(MODULE)
        rounds.append(sorted(registered() ^ enabled))
    bpy.ops.preferences.addon_disable(module=MODULE)
    seen["left when disabled"] = sorted(registered() ^ before)
    bpy.ops.extensions.package_uninstall(repo_index=repository(), pkg_id="ctmc")
    seen["left registered"] = sorted(registered() ^ before)
    mesh = bpy.data.objects[seen["box"]["name"]].data
    seen["vertices kept"] = len(mesh.vertices)
    seen["left on disk"] = [str(path) for path in profile.rglob("*") if path.name in {"ctmc", "pydicom"}]
    return seen


if __name__ == "__main__":
    report = main(sys.argv[1], sys.argv[3:])
    Path(sys.argv[2]).write_text(json.dumps(report), encoding="utf-8")
