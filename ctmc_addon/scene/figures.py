"""The paper's figure of a surface: its triangles red, their borders yellow.

Rendered in a scene of its own; the user's scene and settings are left as they are.
"""

from __future__ import annotations

import os
import struct
from pathlib import Path

import bpy
import numpy as np

from ..core.errors import OutputError
from . import meshes
from .blocks import remove_blocks
from .evaluate import evaluated_copy
from .materials import RED, YELLOW, edged_material
from .outputs import require_room, written_whole
from .stage import AZIMUTH, ELEVATION, SIZE, prepare_scene

LINE_PIXELS = 2.0
LINE_SHARE = 0.08  # of an edge: finer meshes get finer lines, or nothing red would be left

# What a picture needs; the rest is text, times and names.
PNG_CHUNKS = (b"IHDR", b"PLTE", b"tRNS", b"gAMA", b"cHRM", b"sRGB", b"pHYs", b"IDAT", b"IEND")


def render_figure(
    thing: bpy.types.Object,
    scene: bpy.types.Scene | None,
    path: str | os.PathLike[str],
    size: tuple[int, int] = SIZE,
    azimuth: float = AZIMUTH,
    elevation: float = ELEVATION,
    edges: bool = True,
) -> None:
    """Render the evaluated surface to a PNG, red with yellow triangle edges, on white.

    Parameters
    ----------
    scene : Scene or None
        Where the object is evaluated; None takes the first scene that holds it.
    size : (width, height) int
        Pixels.
    azimuth, elevation : float
        Where the camera stands, degrees: from the patient's front towards the left, and up.
    edges : bool
        False keeps the surface's own material, for small pictures in which edges would be noise.

    Raises
    ------
    OutputError
        If `path` is no .png or cannot be written to, or this Blender has no Cycles.
    """
    target = Path(path)
    if target.suffix.lower() != ".png":
        raise OutputError(f"{target.name} is no .png; figures are written as .png")
    if not hasattr(bpy.types.Scene, "cycles"):
        raise OutputError("a figure needs Blender's Cycles; enable 'Cycles Render Engine' in the add-on preferences")
    with written_whole(target) as beside:
        require_room(beside, 4 * size[0] * size[1] + 10_000)
        render(thing, scene, beside, size, azimuth, elevation, edges)
        beside.write_bytes(without_texts(beside.read_bytes(), target.name))


def render(
    thing: bpy.types.Object,
    scene: bpy.types.Scene | None,
    path: Path,
    size: tuple[int, int],
    azimuth: float,
    elevation: float,
    edges: bool,
) -> None:
    """Stage a copy of the evaluated surface, render it to `path`, and take the stage down."""
    mesh, evaluated = evaluated_copy(thing, scene)
    stage = bpy.data.scenes.new("CTMC Figure")
    copy = bpy.data.objects.new("CTMC Figure", mesh)
    blocks: list[bpy.types.ID] = [stage, copy, mesh]
    try:
        copy.matrix_world = evaluated.matrix_world
        stage.collection.objects.link(copy)
        blocks += prepare_scene(stage, copy, size, azimuth, elevation)
        if edges:
            width = min(LINE_PIXELS * stage.camera.data.ortho_scale / max(size), LINE_SHARE * mean_edge(copy))
            material = edged_material("CTMC Figure", RED, YELLOW, width)
            blocks.append(material)
            mesh.materials.clear()
            mesh.materials.append(material)
        stage.render.filepath = str(path.resolve())
        bpy.ops.render.render(write_still=True, scene=stage.name)
    except RuntimeError as error:  # how Blender's operators report what they could not do
        raise OutputError(f"the figure could not be rendered: {str(error).strip()}") from error
    finally:
        remove_blocks(*blocks)


def mean_edge(thing: bpy.types.Object) -> float:
    """Mean length of the triangles' first edges, scene units."""
    faces = meshes.read_triangles(thing.data)
    positions = meshes.read_positions(thing.data)
    edges = positions[faces[:, 1]] - positions[faces[:, 0]]
    scale = abs(thing.matrix_world.determinant()) ** (1 / 3)
    return float(np.sqrt((edges.astype(np.float64) ** 2).sum(axis=1)).mean()) * scale


def without_texts(png: bytes, name: str) -> bytes:
    """The PNG without texts and times, which would name the machine and differ from run to run.

    Raises
    ------
    OutputError
        If it ends before its last chunk (PNG specification, 5.3).
    """
    kept, at = [png[:8]], 8
    while at + 12 <= len(png):
        length, kind = struct.unpack(">I4s", png[at : at + 8])
        if at + 12 + length > len(png):
            break
        if kind in PNG_CHUNKS:
            kept.append(png[at : at + 12 + length])
        at += 12 + length
        if kind == b"IEND":
            return b"".join(kept)
    raise OutputError(f"{name} came out incomplete and was removed; free some space or choose another disk")
