# SPDX-License-Identifier: GPL-3.0-or-later
"""Render one picture of a scene, clean its page, and write it as a PNG.

The PNG stores its resolution and nothing of this machine.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any, NamedTuple

import bpy

from ....core import OutputError
from ...colors import Color
from ...output_files import require_room
from .samples import OVERLAP, clean_border, clean_page, is_denoised, without_noise

TILE_PIXELS = 1_000_000  # A large picture is rendered in tiles of this size to limit the denoiser's memory.
WRITTEN_PIXELS = 100_000  # A written part of fewer pixels is not worth a tile of its own.


class RenderRequest(NamedTuple):
    """A picture to render.

    Parameters
    ----------
    path : str
        An existing, empty PNG.
    name : str
        Name in messages.
    dpi : float
    paper : (red, green, blue) float
        Color of the page.
    written_rows : int
        Rows at the bottom of the page with text and bars only.
    pivot : str
        Name of the object that turns; empty where none does.
    angle : float
        Angle of the pivot about the z axis, radians.
    """

    path: str
    name: str
    dpi: float
    paper: Color
    written_rows: int = 0
    pivot: str = ""
    angle: float = 0.0

    def make(self, scene: bpy.types.Scene) -> None:
        """Render the picture.

        Raises
        ------
        OutputError
            If Blender cannot.
        """
        path, render = Path(self.path), scene.render
        size = (render.resolution_x, render.resolution_y)
        require_room(path, 4 * size[0] * size[1] + 10_000)
        if self.pivot:
            scene.objects[self.pivot].rotation_euler.z = self.angle
        picture = pillow().new(render.image_settings.color_mode, size)
        is_sampled = render.engine == "CYCLES" and scene.cycles.use_adaptive_sampling
        written = self.written_rows if is_sampled and size[0] * self.written_rows >= WRITTEN_PIXELS else 0
        tiles = tiles_of(size, written) if render.engine == "CYCLES" else [(0, size[1])]
        if len(tiles) > 1:
            render.use_border = render.use_crop_to_border = render.use_persistent_data = True
        for low, high in tiles:
            first, last = max(low - OVERLAP, 0), min(high + OVERLAP, size[1])
            # A quarter of a row up: right whether Blender rounds or cuts.
            render.border_min_y, render.border_max_y = ((row + 0.25) / size[1] for row in (first, last))
            with without_noise(scene, self.dpi) if high <= written else nullcontext():
                denoised = is_denoised(scene)
                render_to(scene, path)
            with opened_png(path, self.name) as tile:
                if tile.size != (size[0], last - first):
                    raise OutputError(f"Blender rendered {tile.size} of {self.name}, not its rows {first} to {last}")
                rows = tile.crop((0, last - high, size[0], last - low))
            picture.paste(clean_page(rows, self.paper) if denoised else rows, (0, size[1] - high))
        if is_denoised(scene):
            clean_border(picture, self.paper)
        picture.save(path, "PNG", dpi=(self.dpi, self.dpi))


def tiles_of(size: tuple[int, int], written: int = 0) -> list[tuple[int, int]]:
    """Return the first row and the row after the last of every tile, from the bottom up; none mixes picture and text.

    Examples
    --------
    >>> tiles_of((1000, 1000)), tiles_of((1000, 2000))
    ([(0, 1000)], [(0, 1000), (1000, 2000)])
    >>> tiles_of((1000, 2000), 600)
    [(0, 600), (600, 1300), (1300, 2000)]
    """
    edges = [0]
    for end in (written, size[1]):
        start = edges[-1]
        count = math.ceil(size[0] * (end - start) / TILE_PIXELS)
        edges += [start + round((end - start) * (at + 1) / count) for at in range(count)]
    return list(itertools.pairwise(edges))


def pillow() -> Any:
    """Return the module `PIL.Image`, or raise an `OutputError`."""
    try:
        from PIL import Image
    except ImportError as error:
        raise OutputError(f"a figure needs Pillow ({error}); install the Python package pillow") from error
    return Image


@contextmanager
def opened_png(path: Path, name: str) -> Iterator[Any]:
    """Return a PNG with all of its pixels, or raise an `OutputError`."""
    try:
        with pillow().open(path) as picture:
            picture.load()
            yield picture
    except (OSError, SyntaxError) as error:  # Pillow raises these for a truncated file.
        raise OutputError(f"{name} came out incomplete; free some space or choose another disk") from error


def render_to(scene: bpy.types.Scene, path: Path) -> None:
    """Render a scene to a file, or raise an `OutputError`."""
    scene.render.filepath = str(path.resolve())
    try:
        bpy.ops.render.render(write_still=True, scene=scene.name)
    except RuntimeError as error:  # Blender's operators report their failures so.
        raise OutputError(f"the figure could not be rendered: {str(error).strip()}") from error
