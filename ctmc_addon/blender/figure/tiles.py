"""A large picture rendered in bands, so that it can be watched and cancelled on its way."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import bpy

from ...core import OutputError, Step, Steps

BAND_PIXELS = 100_000  # so few that Esc is soon heard; the pixels are those of one go


def bands_of(size: tuple[int, int]) -> list[tuple[int, int]]:
    """First row and row after the last of every band, from the bottom up.

    Examples
    --------
    >>> bands_of((400, 200)), bands_of((500, 400))
    ([(0, 200)], [(0, 200), (200, 400)])
    """
    width, height = size
    count = max(1, math.ceil(width * height / BAND_PIXELS))
    edges = [round(height * at / count) for at in range(count + 1)]
    return list(itertools.pairwise(edges))


def render_steps(scene: bpy.types.Scene, path: Path, name: str) -> Steps[None]:
    """Render a scene to a PNG, whose name for people is `name`; one with Cycles in bands.

    Raises
    ------
    OutputError
        If Blender cannot.
    """
    render = scene.render
    bands = bands_of((render.resolution_x, render.resolution_y))
    if len(bands) == 1 or render.engine != "CYCLES" or not has_pillow():
        yield Step(0.0, f"Rendering {name}")
        render_to(scene, path)
        return
    from PIL import Image

    whole = Image.new(render.image_settings.color_mode, (render.resolution_x, render.resolution_y))
    part = path.with_name(f"{path.stem}-band.png")
    render.use_border = render.use_crop_to_border = render.use_persistent_data = True
    render.border_min_x, render.border_max_x = 0.0, 1.0
    try:
        for at, (low, high) in enumerate(bands):
            yield Step(at / len(bands), f"Rendering {name}, {at / len(bands):.0%}")
            # A quarter of a row up: right whether Blender rounds or cuts.
            render.border_min_y = (low + 0.25) / render.resolution_y
            render.border_max_y = min((high + 0.25) / render.resolution_y, 1.0)
            render_to(scene, part)
            with Image.open(part) as band:
                if band.size != (render.resolution_x, high - low):
                    raise OutputError(f"Blender rendered {band.size} of {name} where {high - low} rows were asked for")
                whole.paste(band, (0, render.resolution_y - high))
        whole.save(path, "PNG")
    finally:
        part.unlink(missing_ok=True)


def has_pillow() -> bool:
    """Whether the library that joins the bands is there."""
    try:
        from PIL import Image
    except ImportError:
        return False
    return bool(Image)


def render_to(scene: bpy.types.Scene, path: Path) -> None:
    """Render a scene to a file, or an `OutputError`."""
    scene.render.filepath = str(path.resolve())
    try:
        bpy.ops.render.render(write_still=True, scene=scene.name)
    except RuntimeError as error:  # how Blender's operators report what they could not do
        raise OutputError(f"the figure could not be rendered: {str(error).strip()}") from error
