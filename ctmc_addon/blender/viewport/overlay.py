# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw temporary pictures, lines and letters over a 3D viewport.

Places are Blender units in world space. `gpu` and `blf` exist only where Blender draws, so they are imported where
something is drawn.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

Color = tuple[float, float, float, float]
Box = tuple[float, float, float, float]
FONT = 0
# Pixels; a letter nearer to the middle than this would say nothing.
NEAREST_LETTER = 24.0
PLATE = 4.0  # Border in pixels of a dark box around letters.
FAINT = 0.25  # Opacity of the hidden part of a line.


NEARER = 5e-4  # Share of the distance to the eye, more than the steps of the depth buffer.

# Before Blender 5 a viewport's draw handlers write linear light, since then the colors as they appear.
FORMAT = "RGBA8" if bpy.app.version >= (5, 0, 0) else "SRGB8_A8"


class OverlayPicture:
    """A picture on the graphics card, standing in space.

    Parameters
    ----------
    colors : (rows, columns, 4) float32
        Display colors.
    corners : (4, 3)
        Corners at row and column 0, the last column, the last column and row, the last row.
    """

    def __init__(self, colors: NDArray[np.float32], corners: NDArray[Any]) -> None:
        import gpu
        from gpu_extras.batch import batch_for_shader

        rows, columns = colors.shape[:2]
        pixels = gpu.types.Buffer("FLOAT", colors.size, np.ascontiguousarray(colors, np.float32).ravel())
        self.texture = gpu.types.GPUTexture((columns, rows), format=FORMAT, data=pixels)
        self.shader = gpu.shader.from_builtin("IMAGE")
        attributes = {
            "pos": [tuple(map(float, corner)) for corner in corners],
            "texCoord": [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)],
        }
        self.batch = batch_for_shader(self.shader, "TRIS", attributes, indices=[(0, 1, 2), (0, 2, 3)])

    def draw(self, view: Any, above: int = 0) -> None:
        """Draw the picture among the scene's objects; nearer objects hide it.

        It is moved towards the eye by less than can be seen, or it would flicker through an object at its position.

        Parameters
        ----------
        view : bpy.types.RegionView3D
        above : int
            Number of pictures below it at the same position; if any, it is translucent and hides nothing behind it.
        """
        import gpu

        gpu.state.depth_test_set("LESS_EQUAL")
        gpu.state.depth_mask_set(not above)
        gpu.state.blend_set("ALPHA" if above else "NONE")
        self.shader.bind()
        self.shader.uniform_sampler("image", self.texture)
        with gpu.matrix.push_pop():
            gpu.matrix.multiply_matrix(nearer(view, above + 1))
            self.batch.draw(self.shader)
        gpu.state.blend_set("NONE")
        gpu.state.depth_mask_set(False)
        gpu.state.depth_test_set("NONE")


def nearer(view: Any, steps: int = 1) -> Matrix:
    """Return a matrix that moves points in world space towards the eye of a viewport without moving them on screen."""
    eye, share = view.view_matrix.inverted(), NEARER * steps
    if not view.is_perspective:
        return Matrix.Translation(eye.col[2].xyz * view.view_distance * share)
    return Matrix.Translation(eye.translation) @ Matrix.Scale(1 - share, 4) @ Matrix.Translation(-eye.translation)


def draw_lines(
    points: NDArray[Any], pairs: Iterable[tuple[int, int]], color: Color, size: tuple[float, float], width: float
) -> None:
    """Draw lines between points in a viewport, faint where an object hides them.

    Parameters
    ----------
    points : (n, 3) float
        World space.
    pairs : iterable of (int, int)
        Points that each line joins.
    color : Color
    size : (width, height) float
        Size of the viewport, pixels.
    width : float
        Pixels.
    """
    import gpu
    from gpu_extras.batch import batch_for_shader

    shader = gpu.shader.from_builtin("POLYLINE_UNIFORM_COLOR")
    ends = [tuple(map(float, points[end])) for pair in pairs for end in pair]
    batch = batch_for_shader(shader, "LINES", {"pos": ends})
    gpu.state.blend_set("ALPHA")
    shader.bind()
    shader.uniform_float("viewportSize", size)
    shader.uniform_float("lineWidth", width)
    for test, share in (("LESS_EQUAL", 1.0), ("GREATER", FAINT)):
        gpu.state.depth_test_set(test)
        shader.uniform_float("color", (*color[:3], color[3] * share))
        batch.draw(shader)
    gpu.state.blend_set("NONE")
    gpu.state.depth_test_set("NONE")


def draw_fill(corners: NDArray[Any], color: Color) -> None:
    """Fill a flat shape whose corners (n, 3) bulge outward, world space; nearer objects hide it."""
    import gpu
    from gpu_extras.batch import batch_for_shader

    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    fan = [(0, corner, corner + 1) for corner in range(1, len(corners) - 1)]
    batch = batch_for_shader(shader, "TRIS", {"pos": [tuple(map(float, corner)) for corner in corners]}, indices=fan)
    gpu.state.blend_set("ALPHA")
    gpu.state.depth_test_set("LESS_EQUAL")
    shader.bind()
    shader.uniform_float("color", color)
    batch.draw(shader)
    gpu.state.depth_test_set("NONE")
    gpu.state.blend_set("NONE")


def draw_letters(
    region: Any, view: Any, letters: Mapping[str, NDArray[Any]], middle: NDArray[Any], size: float
) -> None:
    """Draw letters at points in space, `size` pixels high, upright on the screen.

    Parameters
    ----------
    region, view : bpy.types.Region, bpy.types.RegionView3D
    middle : (3,)
        Center of the letters; a letter that would cover it is left out.
    """
    import blf
    from bpy_extras.view3d_utils import location_3d_to_region_2d
    from mathutils import Vector

    center = location_3d_to_region_2d(region, view, Vector(middle))
    blf.size(FONT, size)
    blf.color(FONT, 1.0, 0.85, 0.35, 1.0)
    for letter, position in letters.items():
        at = location_3d_to_region_2d(region, view, Vector(position))
        if at is None or (center is not None and (at - center).length < NEAREST_LETTER):
            continue
        width, height = blf.dimensions(FONT, letter)
        x, y = at.x - width / 2, at.y - height / 2
        _draw_plate(_plate_of(x, y, width, height))
        blf.position(FONT, x, y, 0.0)
        blf.draw(FONT, letter)


def _plate_of(x: float, y: float, width: float, height: float) -> Box:
    """Return the box behind letters that begin at (x, y), pixels: left, bottom, right, top."""
    return x - PLATE, y - PLATE, x + width + PLATE, y + height + PLATE


def _draw_plate(box: Box) -> None:
    """Darken a box of the screen, so that light letters are legible on any ground."""
    import gpu
    from gpu_extras.batch import batch_for_shader

    left, bottom, right, top = box
    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    corners = [(left, bottom), (right, bottom), (right, top), (left, top)]
    batch = batch_for_shader(shader, "TRIS", {"pos": corners}, indices=[(0, 1, 2), (0, 2, 3)])
    gpu.state.blend_set("ALPHA")
    shader.bind()
    shader.uniform_float("color", (0.0, 0.0, 0.0, 0.6))
    batch.draw(shader)
    gpu.state.blend_set("NONE")


def apart(boxes: Sequence[Box]) -> list[Box]:
    """Return boxes without overlaps: a box that would overlap earlier ones is moved up past them.

    Examples
    --------
    >>> apart([(0.0, 0.0, 9.0, 4.0), (5.0, 1.0, 14.0, 5.0), (20.0, 0.0, 29.0, 4.0)])
    [(0.0, 0.0, 9.0, 4.0), (5.0, 4.0, 14.0, 8.0), (20.0, 0.0, 29.0, 4.0)]
    """
    placed: list[Box] = []
    for left, bottom, right, top in boxes:
        height = top - bottom
        neighbors = sorted((box for box in placed if box[0] < right and left < box[2]), key=lambda box: box[1])
        for _, low, _, high in neighbors:
            if low < bottom + height and bottom < high:
                bottom = high
        placed.append((left, bottom, right, bottom + height))
    return placed


def draw_labels(region: Any, view: Any, labels: Iterable[tuple[str, Any]], size: float) -> None:
    """Draw texts next to points in space, `size` pixels high, on top of everything and without overlaps.

    Parameters
    ----------
    region, view : bpy.types.Region, bpy.types.RegionView3D
    labels : iterable of (text, (3,))
    """
    import blf
    from bpy_extras.view3d_utils import location_3d_to_region_2d
    from mathutils import Vector

    blf.size(FONT, size)
    blf.color(FONT, 1.0, 0.85, 0.35, 1.0)
    texts, boxes = [], []
    for text, point in labels:
        at = location_3d_to_region_2d(region, view, Vector(point))
        if at is not None:
            texts.append(text)
            boxes.append(_plate_of(at.x + size / 2, at.y + size / 2, *blf.dimensions(FONT, text)))
    for text, box in zip(texts, apart(boxes), strict=True):
        _draw_plate(box)
        blf.position(FONT, box[0] + PLATE, box[1] + PLATE, 0.0)
        blf.draw(FONT, text)


def draw_path(places: Sequence[tuple[float, float]], color: Color = (1.0, 1.0, 1.0, 0.9)) -> None:
    """Draw a line through points on the screen, pixels, with a dark border that shows on any ground."""
    import gpu
    from gpu_extras.batch import batch_for_shader

    if len(places) < 2:
        return
    shader = gpu.shader.from_builtin("POLYLINE_UNIFORM_COLOR")
    batch = batch_for_shader(shader, "LINE_STRIP", {"pos": [(x, y, 0.0) for x, y in places]})
    gpu.state.blend_set("ALPHA")
    shader.bind()
    shader.uniform_float("viewportSize", gpu.state.viewport_get()[2:])
    for width, shade in ((3.0, (0.0, 0.0, 0.0, 0.6)), (1.2, color)):
        shader.uniform_float("lineWidth", width)
        shader.uniform_float("color", shade)
        batch.draw(shader)
    gpu.state.blend_set("NONE")
