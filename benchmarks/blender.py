# SPDX-License-Identifier: GPL-3.0-or-later
"""In Blender: from a DICOM folder to an object, as a process of its own; and alpha moved on a large surface."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

from ctmc_addon.core import ReconstructionSettings, Volume, reconstruct

from . import scenes
from .measuring import Row, Session
from .reading import dicom_folder

FRAME = 1 / 60
OURS = """
import sys, os, bpy
from ctmc_addon import readers
from ctmc_addon.blender.surface import add_reconstruction
from ctmc_addon.core import ReconstructionSettings, reconstruct
volume = readers.read_volume(sys.argv[1])
result = reconstruct(volume, ReconstructionSettings(threshold=float(sys.argv[2])))
thing = add_reconstruction(result, bpy.context.scene)
print(len(thing.data.polygons), flush=True)
os._exit(0)  # Blender as a module may hang while Python shuts down
"""
THEIRS = """
import sys, os, bpy, SimpleITK
from skimage.measure import marching_cubes
reader = SimpleITK.ImageSeriesReader()
reader.SetFileNames(reader.GetGDCMSeriesFileNames(sys.argv[1]))
image = reader.Execute()
values = SimpleITK.GetArrayViewFromImage(image)
vertices, faces, normals, _ = marching_cubes(values, float(sys.argv[2]), spacing=image.GetSpacing()[::-1])
mesh = bpy.data.meshes.new("surface")
mesh.from_pydata(vertices[:, ::-1].tolist(), [], faces.tolist())
thing = bpy.data.objects.new("surface", mesh)
bpy.context.scene.collection.objects.link(thing)
print(len(thing.data.polygons), flush=True)
os._exit(0)
"""


def measure(session: Session) -> None:
    """Measure all rows of this part."""
    folder = dicom_folder(session.scratch)
    for tissue, threshold, target in (("bone", scenes.BONE, 0.5), ("skin", scenes.SKIN, None)):
        session.compare(
            f"DICOM folder (250 slices) to an object in Blender, {tissue}, whole process",
            lambda threshold=threshold: script(OURS, folder, threshold),
            {"SimpleITK + scikit-image + from_pydata": (lambda t=threshold: script(THEIRS, folder, t), target)},
            note="gradient normals and the key alpha included" if target else "",
            repeats=max(1, session.repeats // 3),
        )
    alpha(session)


def script(text: str, folder: Path, threshold: float) -> int:
    """Run a script in a fresh Python; its triangles."""
    command = [sys.executable, "-c", text, str(folder), str(threshold)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(done.stderr)
    return int(done.stdout.split()[-1])


def alpha(session: Session) -> None:
    """Time a change of the shape key `alpha` on a million vertices until the evaluated mesh is ready."""
    import bpy

    from ctmc_addon.blender.surface import add_reconstruction

    values = scenes.abdomen(session.scratch)
    volume = Volume(values, scenes.affine(), kind="HU")
    result = reconstruct(volume, ReconstructionSettings(threshold=scenes.DENSE_THRESHOLD))
    thing = add_reconstruction(result, bpy.context.scene)
    key = thing.data.shape_keys.key_blocks["alpha"]
    at = [0.0]

    def move() -> Any:
        at[0] = (at[0] + 0.37) % 1.0
        key.value = at[0]
        depsgraph = bpy.context.evaluated_depsgraph_get()
        return thing.evaluated_get(depsgraph).data.vertices[0].co.x

    runs = session.race({"CTMC": move}, 3 * session.repeats)["CTMC"]
    session.add(
        Row(
            session.part,
            f"alpha changed on {len(thing.data.vertices) / 1e6:.2f}M vertices, evaluated mesh ready",
            "one frame at 60 Hz",
            session.typical(runs),
            FRAME,
            1.0,
            runs={"CTMC": runs},
        )
    )
