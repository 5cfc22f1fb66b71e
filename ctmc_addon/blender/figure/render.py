"""Figures: surfaces on a page as a PNG of a size in millimetres, with the .blend that made it.

Rendered in a scene of its own; the user's scene and settings are left as they are. `render_figure` makes the plain
picture of one surface in the paper's colours that stands beside a reconstruction.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import bpy

from ...core import OutputError, Step, Steps, within
from ..datablocks import remove_blocks
from ..materials import RED, YELLOW, edged_material
from ..output_files import require_room, written_whole
from ..studio import AZIMUTH, ELEVATION, SIZE, prepare_scene
from ..surface.evaluate import evaluated_copy
from .compose import NAME as STAGE
from .compose import Cell, Look, Stage, mean_edge, staged
from .page import Page, finished_png
from .styles import require_engine
from .tiles import render_steps

LINE_PIXELS = 2.0
LINE_SHARE = 0.08  # of an edge: finer meshes get finer lines, or nothing red would be left


def figure_steps(
    cells: Sequence[Cell],
    path: str | os.PathLike[str],
    page: Page | None = None,
    look: Look | None = None,
    blend: str | os.PathLike[str] | None = None,
    scene: bpy.types.Scene | None = None,
) -> Steps[tuple[int, int]]:
    """Render cells to a PNG on a page, and write the .blend that made it; returns the picture's size in pixels.

    Both files or none: work that is stopped leaves neither.

    Parameters
    ----------
    blend : path, optional
        A .blend with the figure's own scene; nothing else of the present file goes in.
    scene : Scene or None
        Where the objects are evaluated; None takes the first scene that holds each.

    Raises
    ------
    CtmcError
        If there is nothing to show, a file cannot be written, or the engine does not work here.
    """
    page, look, target = page or Page(), look or Look(), Path(path)
    require_png(target)
    if blend is not None:
        require_own_blend(Path(blend))
    yield Step(0.0, "Setting up the figure")
    stage = staged(cells, page, look, scene)
    try:
        with ExitStack() as files:
            if blend is not None:
                yield Step(0.1, f"Writing {Path(blend).name}")
                write_stage(stage, files.enter_context(written_whole(Path(blend))))
            beside = files.enter_context(written_whole(target))
            require_room(beside, 4 * stage.size[0] * stage.size[1] + 10_000)
            yield from within(render_steps(stage.scene, beside, target.name), 0.2, 1.0)
            beside.write_bytes(finished_png(beside.read_bytes(), target.name, page.dpi))
        yield Step(1.0, f"{target.name} written")
        return stage.size
    finally:
        stage.take_down()


def require_png(path: Path) -> None:
    """Raise `OutputError` for a path that is no .png."""
    if path.suffix.lower() != ".png":
        raise OutputError(f"{path.name} is no .png; figures are written as .png")


def require_own_blend(path: Path) -> None:
    """Raise `OutputError` for a .blend that is there already and is not a figure's: it may be somebody's work."""
    if path.exists() and path.stat().st_size:
        try:
            with bpy.data.libraries.load(str(path)) as (there, _):
                own = any(name.startswith(STAGE) for name in there.scenes)
        except (OSError, ValueError):  # no .blend, or the one that is open
            own = False
        if not own:
            raise OutputError(f"{path.name} is there already and is no figure's; move it, or give another name")


def write_stage(stage: Stage, path: Path) -> None:
    """Write the figure's scene to a .blend that is there and empty."""
    stage.scene.render.filepath = "//"
    vertices = sum(len(copy.data.vertices) for copies in stage.copies for copy in copies)
    require_room(path, 500_000 + 120 * vertices)
    bpy.data.libraries.write(str(path), {stage.scene}, path_remap="RELATIVE_ALL")


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
    require_png(target)
    require_engine("cycles")
    with written_whole(target) as beside:
        require_room(beside, 4 * size[0] * size[1] + 10_000)
        render(thing, scene, beside, size, azimuth, elevation, edges)
        beside.write_bytes(finished_png(beside.read_bytes(), target.name))


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
