"""Cells with surfaces, laid out on a page before one camera.

The camera is orthographic, so cells side by side in one scene are seen from the same side and at the same scale. They
stand far behind each other, so that no shadow of one falls on another.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core import MeshError, SettingsError
from ..datablocks import remove_render_results, render_results
from ..materials import BONE, Colour
from ..studio import AZIMUTH, ELEVATION, light_up, rotation, set_render, sun_axes, view_axes
from ..surface import mesh_data as meshes
from ..surface.evaluate import evaluated_copy
from ..surface.placement import moved
from ..surface.readback import placement_of
from .annotations import CAP, LEADING, Board, legend, orientation_marker, round_length, scale_bar
from .distance_map import HEAT, Heat, colour_bar, heat_material
from .layout import Layout, laid_out
from .page import Page
from .styles import STYLES, Style, edge_geometry, figure_material, require_engine, set_engine

EDGE_MM = 0.12  # on the page
EDGE_SHARE = 0.08  # of a triangle's side: finer meshes get finer lines, or nothing of the face would be left
REACH_MM = 4.0
COARSE_SAMPLES, FINE_SAMPLES, FINE_DPI = 32, 16, 250.0  # where pixels are seen, they need more samples
NAME = "CTMC Figure"
ELEVATIONS = (-90.0, 90.0)  # degrees
OPACITY, OPACITIES = 0.3, (0.02, 1.0)  # of a surface that is seen through


@dataclass(frozen=True)
class Shown:
    """A surface in a figure.

    Parameters
    ----------
    thing : Object
        A mesh object; its evaluated state is shown.
    name : str
        In the legend; empty for none.
    colour : (red, green, blue) or None
        Linear; None takes the style's, else that of the object's material.
    opacity : float
        Below 1 it is seen through.
    """

    thing: bpy.types.Object
    name: str = ""
    colour: Colour | None = None
    opacity: float = 1.0


@dataclass(frozen=True)
class Cell:
    """What is shown together, and the lines of caption under it."""

    shown: tuple[Shown, ...]
    lines: tuple[str, ...] = ()


@dataclass(frozen=True)
class Look:
    """How a figure is seen and what is written on it.

    Parameters
    ----------
    style : {"paper", "clinical", "print"}
    engine : {"cycles", "eevee", "workbench"}
    azimuth, elevation : float
        Where the camera stands, degrees: from the patient's front towards the left, and up.
    edges : bool or None
        Triangle edges; None leaves that to the style.
    scale_bar, orientation : bool
    caption : str
        Under the whole.
    columns : int or None
        Cells side by side.
    heat : Heat or None
        Colours for the attribute of distances that the surfaces carry, in place of the style's.

    Raises
    ------
    SettingsError
        If the camera would stand head down.
    """

    style: str = "paper"
    engine: str = "cycles"
    azimuth: float = AZIMUTH
    elevation: float = ELEVATION
    edges: bool | None = None
    scale_bar: bool = True
    orientation: bool = True
    caption: str = ""
    columns: int | None = None
    heat: Heat | None = None

    def __post_init__(self) -> None:
        if not ELEVATIONS[0] <= self.elevation <= ELEVATIONS[1]:
            raise SettingsError(f"the camera's elevation must be from -90 to 90 degrees, not {self.elevation:g}")


@dataclass
class Stage:
    """A scene made for a figure: where it is, what is in it, what is to be taken away again."""

    scene: bpy.types.Scene
    size: tuple[int, int] = (0, 0)
    layout: Layout | None = None
    unit: float = 0.0
    scale: float = 0.0  # Blender units of 1 mm in the first surface
    copies: list[list[bpy.types.Object]] = field(default_factory=list)
    made: list[bpy.types.ID] = field(default_factory=list)
    fonts: frozenset[str] = field(default_factory=lambda: frozenset(font.name for font in bpy.data.fonts))
    renders: frozenset[str] = field(default_factory=render_results)

    def take_down(self) -> None:
        """Remove everything that was made."""
        self.scene.render.use_persistent_data = False  # or the engine keeps what it has of the scene
        bpy.data.batch_remove([*self.made, self.scene])
        self.made = []
        # Blender brings its own letters with the first text, and leaves them.
        left = [font for font in bpy.data.fonts if font.name not in self.fonts and not font.users]
        bpy.data.batch_remove(left)
        remove_render_results(self.renders)


def staged(
    cells: Sequence[Cell],
    page: Page,
    look: Look,
    scene: bpy.types.Scene | None = None,
    turning: bool = False,
    even: bool = False,
) -> Stage:
    """A new scene with copies of what the cells show, camera, light and everything that is written.

    Parameters
    ----------
    scene : Scene or None
        Where the objects are evaluated; None takes the first scene that holds each.
    turning : bool
        Frame the surfaces for a turn about the z axis.
    even : bool
        Make a picture of even sides, as films need.

    Raises
    ------
    CtmcError
        If there is nothing to show, or the engine does not work here.
    """
    require_engine(look.engine, look.heat is not None)
    stage = Stage(bpy.data.scenes.new(NAME))
    try:
        for cell in cells:
            stage.copies.append([copied(stage, shown.thing, scene) for shown in cell.shown])
            open_walls(cell, stage.copies[-1])
        points = seen_points(stage, turning)
        place(stage, cells, page, look, points, even)
        dress(stage, cells, look)
    except BaseException:
        stage.take_down()
        raise
    return stage


def copied(stage: Stage, thing: bpy.types.Object, scene: bpy.types.Scene | None) -> bpy.types.Object:
    """A plain copy of an evaluated object, with its memory, on the stage."""
    mesh, evaluated = evaluated_copy(thing, scene)
    stage.made.append(mesh)
    if not len(mesh.polygons):
        raise MeshError(f"{thing.name} has no triangles to show; choose another threshold or label")
    copy = bpy.data.objects.new(NAME, mesh)
    stage.made.append(copy)
    copy.matrix_world = evaluated.matrix_world
    stage.scale = stage.scale or placement_of(thing).scale
    stage.scene.collection.objects.link(copy)
    return copy


def open_walls(cell: Cell, copies: Sequence[bpy.types.Object]) -> None:
    """Take away where a surface that is seen through lies on a solid one: two triangles in one place would flicker."""
    solid = [copy for shown, copy in zip(cell.shown, copies, strict=True) if shown.opacity == 1.0]
    if not solid or len(solid) == len(copies):
        return
    from mathutils.bvhtree import BVHTree

    points, faces, count = [], [], 0
    for copy in solid:
        points.append(world_positions(copy))
        faces.append(meshes.read_triangles(copy.data) + count)
        count += len(points[-1])
    tree = BVHTree.FromPolygons(np.concatenate(points).tolist(), np.concatenate(faces).tolist(), all_triangles=True)
    for shown, copy in zip(cell.shown, copies, strict=True):
        if shown.opacity == 1.0:
            continue
        near = 0.5 * mean_edge(copy)
        on_wall = np.array([tree.find_nearest(point, near)[0] is not None for point in world_positions(copy).tolist()])
        triangles = meshes.read_triangles(copy.data)
        drop_faces(copy.data, np.flatnonzero(on_wall[triangles].all(axis=1)))


def drop_faces(mesh: bpy.types.Mesh, which: NDArray[np.int64]) -> None:
    """Take triangles out of a mesh; what is known of its vertices stays."""
    import bmesh

    work = bmesh.new()
    try:
        work.from_mesh(mesh)
        work.faces.ensure_lookup_table()
        bmesh.ops.delete(work, geom=[work.faces[at] for at in which.tolist()], context="FACES")
        work.to_mesh(mesh)
    finally:
        work.free()


def world_positions(thing: bpy.types.Object) -> NDArray[np.float64]:
    """An object's vertices in Blender units, (V, 3)."""
    matrix = np.array([list(row) for row in thing.matrix_world], np.float64)
    return moved(matrix, meshes.read_positions(thing.data))


def seen_points(stage: Stage, turning: bool) -> NDArray[np.float64]:
    """What the camera must frame, (n, 3) in Blender units: the vertices, or what they sweep in a turn."""
    points = np.concatenate([world_positions(copy) for copies in stage.copies for copy in copies])
    return swept(points) if turning else points


def middle_of(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """The middle of the box around points."""
    return (points.min(axis=0) + points.max(axis=0)) / 2


def swept(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points around what (n, 3) points sweep when they turn about the vertical axis through their middle."""
    middle = middle_of(points)
    away = points - middle
    reach = float(np.sqrt((away[:, :2] ** 2).sum(axis=1).max()))
    around = np.radians(np.arange(0, 360, 5))
    ring = np.stack([reach * np.cos(around), reach * np.sin(around)], axis=1)
    heights = (away[:, 2].min(), away[:, 2].max())
    return np.concatenate([np.column_stack([ring, np.full(len(ring), height)]) for height in heights]) + middle


def place(stage: Stage, cells: Sequence[Cell], page: Page, look: Look, points: NDArray[np.float64], even: bool) -> None:
    """Lay the page out, put the camera before it, every cell in its place, and write what is to be written."""
    scene, axes = stage.scene, view_axes(look.azimuth, look.elevation)
    seen = np.stack([(points * axes[:, axis]).sum(axis=1) for axis in range(3)], axis=1)  # right, up, backward
    low, high = seen.min(axis=0), seen.max(axis=0)
    extent, middle = high - low, (low + high) / 2
    extent = np.maximum(extent, 1e-6 * max(extent.max(), 1e-6))
    board = Board(scene, 1.0, (page.width_mm, page.width_mm), 1.0, page.font_mm, stage.made)
    layout = laid_out(cells, page, look, (extent[0], extent[1]), board, REACH_MM)
    stage.layout, stage.unit = layout, layout.unit
    stage.size = page.pixels(layout.height_mm, even)
    unit, size_mm = layout.unit, (page.width_mm, layout.height_mm)

    camera = bpy.data.cameras.new("CTMC Camera")
    eye = bpy.data.objects.new("CTMC Camera", camera)
    stage.made += [eye, camera]
    room = 30.0 * unit  # what is written stands in it
    first = layout.centre(0)
    at = [middle[axis] + (size_mm[axis] / 2 - first[axis]) * unit for axis in range(2)]
    eye.matrix_world = rotation(axes, axes @ np.array([*at, high[2] + room]))
    camera.type = "ORTHO"
    camera.ortho_scale = unit * max(stage.size) / page.pixels_per_mm
    sun = sun_axes(look.azimuth, look.elevation)[:, 2]
    step_back = shadow_free_step(axes, sun, (size_mm[0] * unit, size_mm[1] * unit), extent[2])
    camera.clip_start, camera.clip_end = unit, room + (len(cells) - 1) * step_back + 2.0 * extent[2] + unit
    scene.collection.objects.link(eye)
    scene.camera = eye
    for which, copies in enumerate(stage.copies):
        centre = layout.centre(which)
        aside = np.array([(centre[axis] - first[axis]) * unit for axis in range(2)] + [0.0])
        aside[2] = -which * step_back
        for copy in copies:
            copy.location = [here + there for here, there in zip(copy.location, axes @ aside, strict=True)]
    scene.view_layers[0].update()
    stage.made += light_up(scene, look.azimuth, look.elevation)
    set_render(scene, stage.size)
    scene.cycles.samples = COARSE_SAMPLES if page.dpi < FINE_DPI else FINE_SAMPLES
    set_engine(scene, look.engine, any(shown.opacity < 1 for cell in cells for shown in cell.shown))
    scene.render.film_transparent = page.transparent
    scene.render.image_settings.color_mode = "RGBA" if page.transparent else "RGB"
    board.unit, board.size_mm, board.depth = unit, size_mm, 4.0 * unit
    write(stage, cells, look, board)


def shadow_free_step(
    axes: NDArray[np.float64], sun: NDArray[np.float64], size: tuple[float, float], depth: float
) -> float:
    """How far behind each other things must stand on a page of this size so that none shades another.

    Parameters
    ----------
    axes : (3, 3) float64
        The camera's right, up and backward axis as columns.
    sun : (3,) float64
        Towards the sun.
    size : (width, height)
        Blender units.
    depth : float
        Of the deepest thing, Blender units.

    Examples
    --------
    The sun stands to the right, at 45 degrees: a shadow moves left as far as it falls back.

    >>> round(shadow_free_step(np.eye(3), np.array([0.5, 0.0, 0.5]) ** 0.5, (2.0, 1.0), 0.5), 3)
    2.7
    """
    right, up, back = (axes * sun[:, None]).sum(axis=0)
    # Off the page to the side, or off it at the bottom, whichever comes first; a tenth more, as the sun is no point.
    ways = [side * back / abs(across) for side, across in zip(size, (right, up), strict=True) if abs(across) > 1e-6]
    return float(depth + 1.1 * min(ways))


def write(stage: Stage, cells: Sequence[Cell], look: Look, board: Board) -> None:
    """Captions, scale bar, legend or colour bar, and the patient's axes."""
    layout = stage.layout
    assert layout is not None
    down = LEADING * board.font_mm
    for which, text in enumerate(layout.texts):
        x, y = layout.caption_at(which)
        for at, line in enumerate(text):
            board.text(line, x, y - at * down, "CENTER")
    for at, line in enumerate(layout.caption):
        board.text(line, layout.margin, layout.caption_top - CAP * board.font_mm - at * down)
    x, y = layout.margin, layout.footer_bottom
    if look.scale_bar:
        thing = stage.copies[0][0]
        # The object itself may have been scaled in the scene.
        scale = stage.scale * abs(thing.matrix_world.determinant()) ** (1 / 3)
        left, _, right, _ = layout.pictures[0]
        longest = min(0.25 * board.size_mm[0], 0.45 * (right - left)) * stage.unit / scale
        length = round_length(longest)
        page_mm = length * scale / stage.unit
        scale_bar(board, length, page_mm, x, y)
        x += max(page_mm, board.width_of(f"{length:g} mm")) + 5.0
    named = [(shown, copy) for shown, copy in zip(cells[0].shown, stage.copies[0], strict=True) if shown.name]
    if look.heat is not None:
        right = board.size_mm[0] - layout.margin - (2 * REACH_MM + 6.0 if look.orientation else 0.0)
        stage.made += colour_bar(board, look.heat, (x, y, right, y + layout.footer_mm))
    elif named:
        legend(board, [(shown.name, colour_of(shown, copy, STYLES[look.style])) for shown, copy in named], x, y)
    if look.orientation:
        off = REACH_MM + board.font_mm / 2
        turned = stage.copies[0][0].matrix_world.to_quaternion().to_matrix()
        orientation_marker(board, board.size_mm[0] - layout.margin - off, y + off, REACH_MM, turned)


def colour_of(shown: Shown, copy: bpy.types.Object, style: Style) -> Colour:
    """The colour a surface is shown in."""
    if shown.colour is not None:
        return shown.colour
    if style.face is not None:
        return style.face
    return material_colour(copy)


def material_colour(thing: bpy.types.Object) -> Colour:
    """The colour of an object's first material; that of bone if it has none."""
    materials = [material for material in thing.data.materials if material is not None]
    if not materials:
        return BONE
    red, green, blue, _ = materials[0].diffuse_color
    return red, green, blue


def dress(stage: Stage, cells: Sequence[Cell], look: Look) -> None:
    """Give every surface its material."""
    style = STYLES[look.style]
    edge = style.edge or STYLES["print"].edge
    if look.edges is False or (look.edges is None and style.edge is None):
        edge = None
    for cell, copies in zip(cells, stage.copies, strict=True):
        for shown, copy in zip(cell.shown, copies, strict=True):
            face = colour_of(shown, copy, style)
            copy.data.materials.clear()
            if look.heat is not None and HEAT in copy.data.attributes:
                stage.made.append(put_on(copy, heat_material(look.heat, glow=0.45)))
                continue
            line = edge if shown.opacity == 1.0 else None
            copy.visible_shadow = shown.opacity == 1.0  # or walls that touch would speckle each other
            width = min(EDGE_MM * stage.unit, EDGE_SHARE * mean_edge(copy)) if line else 0.0
            stage.made.append(put_on(copy, figure_material(NAME, face, line, width, shown.opacity, look.engine)))
            if line and look.engine != "cycles":
                stage.made.append(edge_geometry(copy, line, width))


def put_on(thing: bpy.types.Object, material: bpy.types.Material) -> bpy.types.Material:
    """Make a material the object's only one, and return it."""
    thing.data.materials.append(material)
    thing.data.update()
    return material


def mean_edge(thing: bpy.types.Object) -> float:
    """Mean length of the triangles' first edges, scene units."""
    faces = meshes.read_triangles(thing.data)
    positions = meshes.read_positions(thing.data)
    edges = positions[faces[:, 1]] - positions[faces[:, 0]]
    scale = abs(thing.matrix_world.determinant()) ** (1 / 3)
    return float(np.sqrt((edges.astype(np.float64) ** 2).sum(axis=1)).mean()) * scale
