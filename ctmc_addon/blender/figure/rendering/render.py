# SPDX-License-Identifier: GPL-3.0-or-later
"""Render figures: surfaces on a page as a PNG of a size in millimeters, with the .blend that made it.

Rendered in a scene of its own; the user's scene and settings are left as they are.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import bpy

from ....core import OutputError, Step, Steps
from ....core.files.atomic_write import whole_file
from ....core.files.temporary_names import remove_leftovers
from ..page.compose import compose_steps
from ..shown import shown_surfaces
from ..spec import AZIMUTH, ELEVATION, MM_PER_INCH, Cell, ColorScale, FigureStyle, Page
from ..styles import EDGE_MM, NAME
from .picture import RenderRequest, pillow
from .renderer import renderer_of, write_scene

PICTURE_SAMPLES = 9
LETTERS_PT = 4.5  # Size of letters at the bar of a map, because the picture is small.
PICTURE_SIZE = (1200, 900)  # Size of the plain picture next to a reconstruction, pixels.
PICTURE_DPI = 2.0 / EDGE_MM * MM_PER_INCH  # Makes triangle edges two pixels wide.


def figure_steps(
    cells: Sequence[Cell],
    path: str | os.PathLike[str],
    page: Page | None = None,
    style: FigureStyle | None = None,
    blend: str | os.PathLike[str] | None = None,
    scene: bpy.types.Scene | None = None,
    own_process: bool = False,
) -> Steps[tuple[int, int]]:
    """Render cells to a PNG on a page, and write the .blend that made it; returns the picture's size in pixels.

    Both files or none: work that is stopped leaves neither.

    Parameters
    ----------
    blend : path, optional
        A .blend with the figure's own scene; nothing else of the present file goes in.
    scene : Scene or None
        Scene in which the objects are evaluated; None takes the first scene that holds each.
    own_process : bool
        Render in a Blender of its own, which closing the steps ends at any moment.

    Raises
    ------
    CtmcError
        If there is nothing to show, a file cannot be written, or the engine does not work here.
    """
    page, style, target = page or Page(), style or FigureStyle(), Path(path)
    require_png(target)
    if blend is not None:
        require_own_blend(Path(blend))
    for file in (target, Path(blend or target)):
        remove_leftovers(file.resolve().parent)
    yield Step(0.0, "Setting up the figure")
    figure = yield from compose_steps(cells, page, style, scene)
    try:
        with ExitStack() as files:
            if blend is not None:
                write_scene(figure, files.enter_context(whole_file(Path(blend))))
            figure.trim_outlines()
            path = str(files.enter_context(whole_file(target)))
            picture = RenderRequest(path, target.name, page.dpi, figure.paper, figure.written_rows)
            with renderer_of(figure, target, own_process) as renderer:
                yield from renderer.make_steps(picture, Step(0.1, f"Rendering {target.name}"))
        yield Step(1.0, f"{target.name} written")
        return figure.size
    finally:
        figure.remove()


def render_figure_steps(
    objects: Sequence[bpy.types.Object],
    scene: bpy.types.Scene | None,
    path: str | os.PathLike[str],
    size: tuple[int, int] = PICTURE_SIZE,
    style: str = "illustration",
    azimuth: float = AZIMUTH,
    elevation: float = ELEVATION,
    names: Sequence[str] = (),
    opacities: Sequence[float | None] = (),
    own_process: bool = False,
    colors: ColorScale | None = None,
    explode: float = 0.0,
) -> Steps[tuple[int, int]]:
    """Render the plain picture next to a reconstruction, with nothing written on it but the bar of a map.

    Returns its size in pixels.

    Parameters
    ----------
    scene : Scene or None
        Scene in which the objects are evaluated; None takes the first scene that holds each.
    size : (width, height) int
        Pixels.
    style : str
        One of `STYLES`.
    azimuth, elevation : float
        Camera position, degrees.
    names : sequence of str
        Names of the objects, to find those that hide a tumor; by default their own.
    opacities : sequence of float or None
        The opacity that the user has set for each object; None for none.
    own_process : bool
        Render in a Blender of its own, which closing the steps ends at any moment.
    colors : ColorScale, optional
        Colors of a map of the objects.
    explode : float
        Shift of the farthest of several objects in an exploded view, mm.

    Raises
    ------
    OutputError
        If `path` is not a .png or cannot be written to, or this Blender has no Cycles.
    """
    dpi = PICTURE_DPI * max(size) / max(PICTURE_SIZE)
    page = Page(size[0] / dpi * MM_PER_INCH, dpi, size[1] / dpi * MM_PER_INCH, font_pt=LETTERS_PT)
    look = FigureStyle(
        style=style,
        azimuth=azimuth,
        elevation=elevation,
        scale_bar=False,
        orientation=False,
        samples=None if style == "illustration" else PICTURE_SAMPLES,
        colors=colors,
    )
    apart = shown_surfaces(objects, scene, look, names, opacities, explode=explode)
    shown = [replace(surface, name="") for surface in apart]
    cell = Cell(tuple(shown))
    return (yield from figure_steps([cell], path, page, look, scene=scene, own_process=own_process))


def require_png(path: Path) -> None:
    """Raise `OutputError` for a path that is not a .png, or a Python without the library that writes it."""
    if path.suffix.lower() != ".png":
        raise OutputError(f"{path.name} is not a .png; figures are written as .png")
    pillow()


def require_own_blend(path: Path) -> None:
    """Raise `OutputError` for an existing .blend that is not a figure's: it may be somebody's work."""
    if path.exists() and path.stat().st_size:
        try:
            with bpy.data.libraries.load(str(path)) as (there, _):
                own = any(name.startswith(NAME) for name in there.scenes)
        except (OSError, ValueError):  # Not a .blend, or the open one.
            own = False
        if not own:
            raise OutputError(f"{path.name} already exists and is not a figure; move it, or choose another name")
