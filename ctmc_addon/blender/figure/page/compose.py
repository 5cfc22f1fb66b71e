# SPDX-License-Identifier: GPL-3.0-or-later
"""Arrange cells with surfaces on a page in front of one camera.

The camera is orthographic, so cells side by side in one scene are seen from the same side and at the same scale. They
stand far behind each other, so that no shadow of one falls on another.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

from ....core import MeshError, Steps, length_text
from ....core.volume import transform_points
from ...colors import Color
from ...datablocks import remove_render_results, render_results
from ...scene.studio import SUNS, WORLD, Sun, add_light, matrix_of_axes, set_render, sun_axes, swept, view_axes
from ...surface import mesh_data as meshes
from ...surface.evaluate import evaluated_copy
from ...surface.readback import placement_of
from ..letters import CAP
from ..rendering.illustration import (
    FROM_ALL_SIDES,
    KEY,
    OUTLINE_MM,
    SHELL,
    SUNS as FINE_SUNS,
    outline_material,
    outline_shell,
)
from ..rendering.samples import set_samples
from ..rendering.visibility import depth_maps
from ..shared_walls import SETTING_UP, WALL_GAP_MM, open_shared_walls_steps, part_shared_walls, world_positions
from ..spec import WHITE, Cell, FigureStyle, Page, RulerMark, ShownSurface
from ..styles import NAME, assign_materials, require_engine, scale_in_scene, set_engine, shown_color
from .annotations import LEADING, Board, color_bar, legend, round_length, scale_bar
from .axes import orientation_marker, reach_mm
from .callouts import Callout, draw_callouts, seen_at
from .layout import SheetLayout, make_layout
from .ruler_marks import ruler_mark
from .slice_pictures import SlicePictures


@dataclass
class FigureScene:
    """A scene made for a figure, with its contents and everything to remove afterwards.

    Parameters
    ----------
    size : (width, height) int
        Pixels.
    paper : (red, green, blue) float
        Color of the page.
    unit : float
        Blender units of a millimeter on the page.
    scale : float
        Blender units of a millimeter in the patient, in the first surface before it was scaled in the scene.
    copies : list of list of Object
        The surfaces of every cell.
    outlines : list of list of Object
        The shells around them that are their outlines.
    pictures : list of SlicePictures
        The slices of every cell.
    asides : list of (3,) float64
        Offset of every cell, Blender units.
    blocks : list of ID
        Everything that was made, except the scene.
    written_rows : int
        Rows of pixels at the bottom with text and bars only.
    """

    scene: bpy.types.Scene
    size: tuple[int, int] = (0, 0)
    paper: Color = WHITE
    layout: SheetLayout | None = None
    unit: float = 0.0
    scale: float = 0.0
    copies: list[list[bpy.types.Object]] = field(default_factory=list)
    outlines: list[list[bpy.types.Object]] = field(default_factory=list)
    pictures: list[SlicePictures] = field(default_factory=list)
    asides: list[NDArray[np.float64]] = field(default_factory=list)
    blocks: list[bpy.types.ID] = field(default_factory=list)
    written_rows: int = 0
    fonts: frozenset[str] = field(default_factory=lambda: frozenset(font.name for font in bpy.data.fonts))
    renders: frozenset[str] = field(default_factory=render_results)
    removed: bool = False

    def shown(self, cell: int) -> list[bpy.types.Object]:
        """Return the objects of a cell, surfaces first."""
        outlines = self.outlines[cell] if self.outlines else []
        return [*self.copies[cell], *outlines, *self.pictures[cell].anchors.values()]

    def trim_outlines(self) -> None:
        """Drop the triangles of outlines that face away from the camera: they are invisible and slow to render."""
        backward = np.array(self.scene.camera.matrix_world)[:3, 2]
        for shell in [shell for outlines in self.outlines for shell in outlines]:
            positions, faces = world_positions(shell), meshes.read_triangles(shell.data)
            a, b, c = positions[faces].transpose(1, 0, 2)  # (F, 3) each
            sign = 1.0 if shell.matrix_world.determinant() > 0 else -1.0  # A mirrored object reverses its triangles.
            towards = sign * (np.cross(b - a, c - a) * backward).sum(axis=1) > 0.0
            material, whole = shell.data.materials[0], shell.data
            shell.data = meshes.new_mesh(SHELL, meshes.read_positions(whole), faces[towards])
            shell.data.materials.append(material)
            self.blocks.append(shell.data)

    def remove(self) -> None:
        """Remove everything that was made, if that has not been done."""
        if self.removed:
            return
        self.removed = True
        self.scene.render.use_persistent_data = False  # Else the engine keeps its data of the scene.
        bpy.data.batch_remove([*self.blocks, self.scene])
        self.blocks = []
        # Blender brings its own letters with the first text, and leaves them.
        left = [font for font in bpy.data.fonts if font.name not in self.fonts and not font.users]
        bpy.data.batch_remove(left)
        remove_render_results(self.renders)


def compose_steps(
    cells: Sequence[Cell],
    page: Page,
    style: FigureStyle,
    scene: bpy.types.Scene | None = None,
    turning: bool = False,
    even: bool = False,
) -> Steps[FigureScene]:
    """Return a new scene with copies of the cells' objects, camera, light and all writing.

    Parameters
    ----------
    scene : Scene or None
        Scene in which the objects are evaluated; None takes the first scene that holds each.
    turning : bool
        Frame the surfaces for a turn about the z axis.
    even : bool
        Make a picture of even sides, as videos need.

    Raises
    ------
    CtmcError
        If there is nothing to show, or the engine does not work here.
    """
    require_engine(style.engine, style.colors is not None)
    figure = FigureScene(bpy.data.scenes.new(NAME))
    try:
        for cell in cells:
            figure.copies.append([])
            for surface in cell.surfaces:
                figure.copies[-1].append(_add_copy(figure, surface, scene))
                yield SETTING_UP
            yield from open_shared_walls_steps(cell, figure.copies[-1])
            for copy in figure.copies[-1]:
                part_shared_walls(copy, WALL_GAP_MM * figure.scale / scale_in_scene(copy))
                yield SETTING_UP
            figure.pictures.append(SlicePictures(figure.scene, figure.blocks))
            for plane in cell.slices:
                figure.pictures[-1].add_plane(plane, scene)
        points = np.concatenate([all_positions(figure), *(np.array(ruler.points) for ruler in rulers_of(cells))])
        arrange(figure, cells, page, style, swept(points, center_of(points)) if turning else points, even, turning)
        for cell, copies, pictures in zip(cells, figure.copies, figure.pictures, strict=True):
            layers = (
                2 * sum(surface.opacity < 1.0 for surface in cell.surfaces) - 1
            )  # A ray enters and leaves each but the last.
            for surface, copy in zip(cell.surfaces, copies, strict=True):
                yield SETTING_UP
                figure.blocks += assign_materials(copy, surface, style, page, figure.unit, pictures, layers)
        if _has_outlines(style):
            yield from _add_outlines_steps(figure, cells)
    except BaseException:
        figure.remove()
        raise
    return figure


def _add_copy(figure: FigureScene, shown: ShownSurface, scene: bpy.types.Scene | None) -> bpy.types.Object:
    """Return a plain copy of an evaluated object in the figure's scene, moved by its shift."""
    obj = shown.obj
    mesh, evaluated = evaluated_copy(obj, scene)
    figure.blocks.append(mesh)
    if not len(mesh.polygons):
        raise MeshError(f"{obj.name} has no triangles to show; choose another threshold or label")
    copy = bpy.data.objects.new(NAME, mesh)
    figure.blocks.append(copy)
    copy.matrix_world = Matrix.Translation(shown.shift) @ evaluated.matrix_world
    figure.scale = figure.scale or placement_of(obj).scale
    figure.scene.collection.objects.link(copy)
    return copy


def _has_outlines(style: FigureStyle) -> bool:
    """Return whether surfaces get outlines; Workbench has no material that is transparent from behind."""
    return style.style == "illustration" and style.colors is None and style.engine != "workbench"


def _add_outlines_steps(figure: FigureScene, cells: Sequence[Cell]) -> Steps[None]:
    """Add an outline to every opaque surface."""
    ink = outline_material()
    figure.blocks.append(ink)
    for cell, copies in zip(cells, figure.copies, strict=True):
        figure.outlines.append([])
        for surface, copy in zip(cell.surfaces, copies, strict=True):
            if surface.opacity < 1.0:  # Its far side would show through; its rim is dark anyway.
                continue
            yield SETTING_UP
            shell = bpy.data.objects.new(SHELL, outline_shell(copy, OUTLINE_MM * figure.unit / scale_in_scene(copy)))
            figure.blocks += [shell.data, shell]
            shell.data.materials.append(ink)
            shell.matrix_world = copy.matrix_world
            shell.visible_shadow = shell.visible_diffuse = shell.visible_glossy = shell.visible_transmission = False
            figure.scene.collection.objects.link(shell)
            figure.outlines[-1].append(shell)
    figure.scene.view_layers[0].update()


def all_positions(figure: FigureScene) -> NDArray[np.float64]:
    """Return the vertices of everything that the cells show, (n, 3) in Blender units."""
    every = [obj for cell in range(len(figure.copies)) for obj in figure.shown(cell) if obj.type == "MESH"]
    return np.concatenate([world_positions(obj) for obj in every])


def rulers_of(cells: Sequence[Cell]) -> list[RulerMark]:
    """Return the rulers of all cells."""
    return [ruler for cell in cells for ruler in cell.rulers]


def center_of(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the middle of the box around points, (3,).

    Parameters
    ----------
    points : (n, 3) float64
    """
    return (points.min(axis=0) + points.max(axis=0)) / 2


def arrange(
    figure: FigureScene,
    cells: Sequence[Cell],
    page: Page,
    style: FigureStyle,
    points: NDArray[np.float64],
    even: bool,
    turning: bool = False,
) -> None:
    """Lay the page out, place camera and cells, and add all writing."""
    page = page.wide(sum(bool(surface.name) for surface in cells[0].surfaces))
    scene, axes = figure.scene, view_axes(style.azimuth, style.elevation)
    seen = np.stack([(points * axes[:, axis]).sum(axis=1) for axis in range(3)], axis=1)  # Right, up, backward.
    low, high = seen.min(axis=0), seen.max(axis=0)
    extent, middle = high - low, (low + high) / 2
    extent = np.maximum(extent, 1e-6 * max(extent.max(), 1e-6))
    board = Board(scene, 1.0, (page.printed_width_mm, page.printed_width_mm), 1.0, page.font_mm, figure.blocks)
    board.pen, board.paper = page.pen, page.paper
    layout = make_layout(cells, page, style, (extent[0], extent[1]), board, reach_mm(page.font_mm), turning)
    figure.layout, figure.unit = layout, layout.unit
    figure.size, figure.paper = page.pixels(layout.height_mm, even), page.paper
    figure.written_rows = int(min(bottom for _, bottom, _, _ in layout.pictures) * page.pixels_per_mm)
    unit, size_mm = layout.unit, (page.printed_width_mm, layout.height_mm)

    camera = bpy.data.cameras.new("CTMC Camera")
    eye = bpy.data.objects.new("CTMC Camera", camera)
    figure.blocks += [eye, camera]
    room = 30.0 * unit  # Room for the writing.
    first = layout.center(0)
    at = [middle[axis] + (size_mm[axis] / 2 - first[axis]) * unit for axis in range(2)]
    eye.matrix_world = matrix_of_axes(axes, axes @ np.array([*at, high[2] + room]))
    camera.type = "ORTHO"
    camera.ortho_scale = unit * max(figure.size) / page.pixels_per_mm
    suns, world = _lights_of(style, single_cell=len(cells) == 1)
    sun = next(iter(suns.values()))
    towards = sun_axes(sun, style.azimuth, style.elevation)[:, 2]
    step_back = _shadow_free_step(axes, towards, (size_mm[0] * unit, size_mm[1] * unit), extent[2], sun.angle)
    camera.clip_start, camera.clip_end = unit, room + (len(cells) - 1) * step_back + 2.0 * extent[2] + unit
    scene.collection.objects.link(eye)
    scene.camera = eye
    for which in range(len(cells)):
        center = layout.center(which)
        aside = np.array([(center[axis] - first[axis]) * unit for axis in range(2)] + [0.0])
        aside[2] = -which * step_back
        figure.asides.append(axes @ aside)
        for obj in figure.shown(which):
            obj.location = [here + there for here, there in zip(obj.location, figure.asides[-1], strict=True)]
    scene.view_layers[0].update()
    figure.blocks += add_light(scene, style.azimuth, style.elevation, suns, world, page.paper)
    set_render(scene, figure.size)
    set_engine(scene, style.engine, page.paper)
    set_samples(scene, style, page.dpi)
    scene.render.film_transparent = page.transparent
    scene.render.image_settings.color_mode = "RGBA" if page.transparent else "RGB"
    board.unit, board.size_mm, board.depth = unit, size_mm, 4.0 * unit
    _annotate(figure, layout, cells, style, board)


def _lights_of(style: FigureStyle, single_cell: bool) -> tuple[Mapping[str, Sun], float]:
    """Return the suns of a style, the one with a shadow first, and the strength of the light from all sides.

    A rim light stands behind the surfaces, so other cells behind one would shade it.
    """
    if style.style != "illustration" or style.colors is not None:
        return SUNS, WORLD
    suns = {name: sun if single_cell or name == KEY else sun._replace(shadow=False) for name, sun in FINE_SUNS.items()}
    return suns, FROM_ALL_SIDES


def _shadow_free_step(
    axes: NDArray[np.float64], sun: NDArray[np.float64], size: tuple[float, float], depth: float, angle: float
) -> float:
    """Return how far behind each other objects must stand on a page of this size so that none shades another.

    Parameters
    ----------
    axes : (3, 3) float64
        The camera's right, up and backward axis as columns.
    sun : (3,) float64
        Direction to the sun.
    size : (width, height)
        Blender units.
    depth : float
        Depth of the deepest object, Blender units.
    angle : float
        Width of the sun, degrees.

    Examples
    --------
    The sun stands to the right, at 45 degrees: a shadow moves left as far as it falls back.

    >>> round(_shadow_free_step(np.eye(3), np.array([0.5, 0.0, 0.5]) ** 0.5, (2.0, 1.0), 0.5, 12.0), 3)
    2.97
    """
    right, up, back = (axes * sun[:, None]).sum(axis=0)
    # Off the page to the side, or off it at the bottom, whichever comes first.
    # The sun's nearest edge stands closer to the camera's axis than its middle.
    tilts = [math.atan2(abs(across), back) - math.radians(angle) / 2 for across in (right, up)]
    ways = [side / math.tan(tilt) for side, tilt in zip(size, tilts, strict=True) if tilt > 1e-6]
    return float(depth + min(ways))


def _annotate(
    figure: FigureScene, layout: SheetLayout, cells: Sequence[Cell], style: FigureStyle, board: Board
) -> None:
    """Draw captions, scale bar, legend or color bar, and the patient's axes."""
    down = LEADING * board.font_mm
    for which, text in enumerate(layout.texts):
        x, y = layout.caption_at(which)
        for at, line in enumerate(text):
            board.text(line, x, y - at * down, "CENTER")
    for at, line in enumerate(layout.caption):
        board.text(line, layout.margin, layout.caption_top - CAP * board.font_mm - at * down)
    eye = np.array(figure.scene.camera.matrix_world.inverted())[:2]
    for cell, aside in zip(cells, figure.asides, strict=True):
        for ruler in cell.rulers:
            seen = np.array([[*(np.array(point) + aside), 1.0] for point in ruler.points]) @ eye.T
            ruler_mark(board, (seen / figure.unit + np.array(board.size_mm) / 2).tolist(), ruler.text)
    x, y = layout.margin, layout.footer_bottom
    if style.scale_bar:
        # The object itself may have been scaled in the scene.
        scale = figure.scale * scale_in_scene(figure.copies[0][0])
        left, _, right, _ = layout.pictures[0]
        longest = min(0.25 * board.size_mm[0], 0.45 * (right - left)) * figure.unit / scale
        length = round_length(longest)
        page_mm = length * scale / figure.unit
        scale_bar(board, length, page_mm, x, y)
        x += max(page_mm, board.width_of(length_text(length))) + 5.0
    named = [(shown, copy) for shown, copy in zip(cells[0].surfaces, figure.copies[0], strict=True) if shown.name]
    if style.colors is not None:
        right = board.size_mm[0] - layout.margin - (2 * reach_mm(board.font_mm) + 6.0 if style.orientation else 0.0)
        color_bar(board, style.colors, (x, y, right, y + layout.footer_mm))
    elif layout.has_name_columns:
        draw_callouts(board, layout, _callouts_of(figure, cells[0], style, board))
    elif named:
        entries = [(shown.name, shown_color(copy, shown, style)) for shown, copy in named]
        above = layout.legend_above_mm
        legend(board, entries, layout.margin if above else x, y + above, layout.legend_columns)
    if style.orientation:
        off = reach_mm(board.font_mm) + board.font_mm / 2
        rotation = figure.copies[0][0].matrix_world.to_quaternion().to_matrix()
        flat, clear = style.engine == "workbench", figure.scene.render.film_transparent
        orientation_marker(board, board.size_mm[0] - layout.margin - off, y + off, rotation, flat, clear)


def _callouts_of(figure: FigureScene, cell: Cell, style: FigureStyle, board: Board) -> list[Callout]:
    """Return the names of the first cell's surfaces and their positions on the page, looking past transparent ones."""
    into_camera = np.array(figure.scene.camera.matrix_world.inverted())
    copies = figure.copies[0]
    maps = depth_maps(
        [(transform_points(into_camera, world_positions(copy)), meshes.read_triangles(copy.data)) for copy in copies]
    )
    solid = [at for at, surface in enumerate(cell.surfaces) if surface.opacity == 1.0]
    callouts = []
    for at, (surface, copy) in enumerate(zip(cell.surfaces, copies, strict=True)):
        seen = seen_at(maps, at, [occluder for occluder in solid if occluder != at])
        if surface.name:
            place = None
            if seen is not None:
                x, y = (part / figure.unit + size / 2 for part, size in zip(seen, board.size_mm, strict=True))
                place = (x, y)
            callouts.append(Callout(surface.name, shown_color(copy, surface, style), place))
    return callouts
