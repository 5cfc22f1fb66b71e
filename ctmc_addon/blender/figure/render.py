# SPDX-License-Identifier: GPL-3.0-or-later
"""Figures: surfaces on a page as a PNG of a size in millimeters, with the .blend that made it.

Rendered in a scene of its own; the user's scene and settings are left as they are. A large picture is rendered in
tiles, so that it can be watched and cancelled on its way.
"""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy

from ...core import OutputError, Step, Steps, finish
from ...core.files.atomic_write import whole_file
from ..output_files import require_room
from .compose import FigureScene, compose
from .samples import OVERLAP, clean_border, clean_page, is_denoised
from .shown import shown_surfaces
from .spec import AZIMUTH, ELEVATION, MM_PER_INCH, Cell, FigureStyle, Page
from .styles import EDGE_MM, NAME

PICTURE_SAMPLES = 9
TILE_PIXELS = 100_000  # so few that Esc is soon heard; the pixels are those of one go
PICTURE_SIZE = (1200, 900)  # of the plain picture beside a reconstruction
PICTURE_DPI = 2.0 / EDGE_MM * MM_PER_INCH  # its triangle edges are two pixels wide


def figure_steps(
    cells: Sequence[Cell],
    path: str | os.PathLike[str],
    page: Page | None = None,
    style: FigureStyle | None = None,
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
    page, style, target = page or Page(), style or FigureStyle(), Path(path)
    require_png(target)
    if blend is not None:
        require_own_blend(Path(blend))
    yield Step(0.0, "Setting up the figure")
    figure = compose(cells, page, style, scene)
    try:
        with ExitStack() as files:
            if blend is not None:
                write_scene(figure, files.enter_context(whole_file(Path(blend))))
            temporary_path = files.enter_context(whole_file(target))
            yield from png_steps(figure, temporary_path, target.name, page.dpi)
        yield Step(1.0, f"{target.name} written")
        return figure.size
    finally:
        figure.remove()


def render_figure(
    objects: Sequence[bpy.types.Object],
    scene: bpy.types.Scene | None,
    path: str | os.PathLike[str],
    size: tuple[int, int] = PICTURE_SIZE,
    style: str = "illustration",
    azimuth: float = AZIMUTH,
    elevation: float = ELEVATION,
    names: Sequence[str] = (),
    chosen: Sequence[float | None] = (),
) -> None:
    """Render the plain picture that stands beside a reconstruction, with nothing written on it.

    Parameters
    ----------
    scene : Scene or None
        Where the objects are evaluated; None takes the first scene that holds each.
    size : (width, height) int
        Pixels.
    style : str
        One of `STYLES`.
    azimuth, elevation : float
        Where the camera stands, degrees.
    names : sequence of str
        What the objects are, for what hides a tumor; by default their own.
    chosen : sequence of float or None
        The opacity that a person has chosen for each.

    Raises
    ------
    OutputError
        If `path` is not a .png or cannot be written to, or this Blender has no Cycles.
    """
    dpi = PICTURE_DPI * max(size) / max(PICTURE_SIZE)
    page = Page(size[0] / dpi * MM_PER_INCH, dpi, size[1] / dpi * MM_PER_INCH)
    look = FigureStyle(
        style=style,
        azimuth=azimuth,
        elevation=elevation,
        scale_bar=False,
        orientation=False,
        samples=None if style == "illustration" else PICTURE_SAMPLES,
    )
    shown = [replace(surface, name="") for surface in shown_surfaces(objects, scene, look, names, chosen)]
    finish(figure_steps([Cell(tuple(shown))], path, page, look, scene=scene))


def require_png(path: Path) -> None:
    """Raise `OutputError` for a path that is not a .png, or a Python without the library that writes it."""
    if path.suffix.lower() != ".png":
        raise OutputError(f"{path.name} is not a .png; figures are written as .png")
    pillow()


def pillow() -> Any:
    """Return the module `PIL.Image`, or an `OutputError`."""
    try:
        from PIL import Image
    except ImportError as error:
        raise OutputError(f"a figure needs Pillow ({error}); install the Python package pillow") from error
    return Image


def require_own_blend(path: Path) -> None:
    """Raise `OutputError` for a .blend that is there already and is not a figure's: it may be somebody's work."""
    if path.exists() and path.stat().st_size:
        try:
            with bpy.data.libraries.load(str(path)) as (there, _):
                own = any(name.startswith(NAME) for name in there.scenes)
        except (OSError, ValueError):  # not a .blend, or the one that is open
            own = False
        if not own:
            raise OutputError(f"{path.name} is there already and is not a figure's; move it, or give another name")


def write_scene(figure: FigureScene, path: Path) -> None:
    """Write the figure's scene to a .blend that is there and empty."""
    figure.scene.render.filepath = "//"
    vertices = sum(len(copy.data.vertices) for copies in figure.copies for copy in copies)
    require_room(path, 500_000 + 120 * vertices)
    bpy.data.libraries.write(str(path), {figure.scene}, path_remap="RELATIVE_ALL")


def png_steps(figure: FigureScene, path: Path, name: str, dpi: float, tiled: bool = True) -> Steps[None]:
    """Render a figure to a PNG that is there and empty, and whose name for people is `name`; with Cycles in tiles.

    The PNG knows its resolution and nothing of this machine.

    Raises
    ------
    OutputError
        If Blender cannot.
    """
    width, height = figure.size
    require_room(path, 4 * width * height + 10_000)
    render = figure.scene.render
    rows = tile_rows(figure.size) if tiled and render.engine == "CYCLES" else [(0, height)]
    denoised = is_denoised(figure.scene)
    picture = pillow().new(render.image_settings.color_mode, figure.size)
    if len(rows) > 1:
        render.use_border = render.use_crop_to_border = render.use_persistent_data = True
        render.border_min_x, render.border_max_x = 0.0, 1.0
    part = path.with_name(f"{path.stem}-tile.png")
    try:
        for number, (low, high) in enumerate(rows):
            yield Step(number / len(rows), f"Rendering {name}" + (f", {number / len(rows):.0%}" if number else ""))
            more = OVERLAP if denoised else 0
            first, last = max(low - more, 0), min(high + more, height)
            # A quarter of a row up: right whether Blender rounds or cuts.
            render.border_min_y = (first + 0.25) / height
            render.border_max_y = min((last + 0.25) / height, 1.0)
            render_to(figure.scene, part)
            with opened_png(part, name) as tile:
                if tile.size != (width, last - first):
                    raise OutputError(f"Blender rendered {tile.size} of {name}, not its rows {first} to {last}")
                rows_of_tile = tile.crop((0, last - high, width, last - low))
            picture.paste(clean_page(rows_of_tile, figure.paper) if denoised else rows_of_tile, (0, height - high))
        if denoised:
            clean_border(picture, figure.paper)
        picture.save(path, "PNG", dpi=(dpi, dpi))
    finally:
        part.unlink(missing_ok=True)


def tile_rows(size: tuple[int, int]) -> list[tuple[int, int]]:
    """First row and row after the last of every tile, from the bottom up.

    Examples
    --------
    >>> tile_rows((400, 200)), tile_rows((500, 400))
    ([(0, 200)], [(0, 200), (200, 400)])
    """
    width, height = size
    count = max(1, math.ceil(width * height / TILE_PIXELS))
    edges = [round(height * at / count) for at in range(count + 1)]
    return list(itertools.pairwise(edges))


@contextmanager
def opened_png(path: Path, name: str) -> Iterator[Any]:
    """A PNG with all of its pixels, or an `OutputError`."""
    try:
        with pillow().open(path) as picture:
            picture.load()
            yield picture
    except (OSError, SyntaxError) as error:  # what Pillow raises for a file that ends too early
        raise OutputError(f"{name} came out incomplete; free some space or choose another disk") from error


def render_to(scene: bpy.types.Scene, path: Path) -> None:
    """Render a scene to a file, or an `OutputError`."""
    scene.render.filepath = str(path.resolve())
    try:
        bpy.ops.render.render(write_still=True, scene=scene.name)
    except RuntimeError as error:  # how Blender's operators report what they could not do
        raise OutputError(f"the figure could not be rendered: {str(error).strip()}") from error
