# SPDX-License-Identifier: GPL-3.0-or-later
"""Apply the style of a figure: its engine, and the materials of its surfaces."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core import OutputError
from ...core.volume import finish_of
from ..colors import Color
from ..maps.material import blocks_of, map_material
from ..materials import (
    add_edges,
    clear_shader,
    headlight,
    material_color,
    math_node,
    mixed,
    principled,
    show_flat,
    surface_material,
)
from ..surface import mesh_data as meshes
from ..surface.provenance import read_provenance, settings_of
from ..viewport.shaders import can_draw
from .page.slice_pictures import SlicePictures
from .rendering.illustration import glass_material, opaque_material
from .spec import ENGINES, STYLES, FigureStyle, Page, ShownSurface

NAME = "CTMC Figure"
LEAST_EDGE = 3.0  # Shortest visible edge, pixels.
LAYERS = 256  # Transparent surfaces that a ray passes: a rim of terraces has many, and the rest would be black.
FAR_SIDE = 0.35  # Density of a translucent organ's far side relative to its near side, in illustrations.
RIM_SHADE = 0.6  # Lightness of a transparent surface at its rim.
EDGE_MM = 0.12  # Width of an edge on the page.
EDGE_WIDTH = "ctmc_edge_width"  # Attribute of the triangles.
# Width of lines as a share of the radius of a triangle's inscribed circle, by this radius on the page, mm. Triangles
# too small to be seen one by one keep the color of their faces.
RADII_MM, SHARES = (0.08, 0.45), (0.04, 0.3)


def require_engine(engine: str, colors: bool = False) -> None:
    """Raise `OutputError` for an engine that does not work here; Blender would end the process.

    With `colors` the engine must show a map.
    """
    if engine == "workbench" and colors:
        raise OutputError("workbench shows no map; choose cycles or eevee")
    if engine == "cycles":
        if not hasattr(bpy.types.Scene, "cycles"):
            raise OutputError(
                "Blender's Cycles is switched off; enable 'Cycles Render Engine' in the add-on preferences"
            )
    elif not can_draw():
        raise OutputError(f"{engine} needs EGL, which this machine lacks; install libegl1, or choose cycles")


def set_engine(scene: bpy.types.Scene, engine: str, paper: Color) -> None:
    """Give a figure's scene its engine; Cycles is already set up."""
    if engine == "eevee":
        scene.render.engine = ENGINES[engine].identifier if bpy.app.version >= (5, 0, 0) else "BLENDER_EEVEE_NEXT"
        scene.eevee.taa_render_samples = 16
        scene.eevee.use_shadows = False
    elif engine == "workbench":
        scene.render.engine = ENGINES[engine].identifier
        shading = scene.display.shading
        shading.light, shading.color_type, shading.show_specular_highlight = "STUDIO", "MATERIAL", False
        shading.show_object_outline = False
        scene.display.render_aa = "16"
        shading.background_type = "WORLD"
        scene.view_settings.exposure = 0.7  # Workbench's studio is darker than the suns; white stays white.
        scene.world.color = paper
    else:
        scene.cycles.transparent_max_bounces = LAYERS
        scene.cycles.min_transparent_bounces = LAYERS  # Else Cycles ends them at random, which is noise.


def assign_materials(
    obj: bpy.types.Object,
    shown: ShownSurface,
    style: FigureStyle,
    page: Page,
    unit: float,
    pictures: SlicePictures,
    layers: int = 1,
) -> list[bpy.types.ID]:
    """Assign a surface its material on a page whose millimeter is `unit` scene units; return new data-blocks.

    The caps of a surface that was cut open keep their `pictures`. A ray sees the first `layers` transparent surfaces.
    A transparent surface shows no map.
    """
    face, line = shown_color(obj, shown, style), style.edge if shown.opacity == 1.0 else None
    mesh = obj.data
    width = 0.0
    colors = style.colors if style.colors is not None and style.colors.name in mesh.attributes else None
    if colors is not None and shown.opacity == 1.0:
        material = map_material(colors)
    elif shown.opacity < 1.0:
        obj.visible_shadow = False  # or walls that touch would speckle each other
        material = transparent_material(face, shown.opacity, layers, style)
    elif style.style == "illustration":
        material = opaque_material(NAME, face, finish_of(label_of(shown.obj), shown.name or shown.obj.name))
    else:
        material = surface_material(NAME, face)
        _make_matte(material)
    if line and colors is None:
        widths = edge_widths(obj, unit, unit / page.pixels_per_mm)
        width = float(np.median(widths))
        if style.engine == "cycles":  # The other engines have geometry for edges.
            mesh.attributes.new(EDGE_WIDTH, "FLOAT", "FACE").data.foreach_set("value", widths)
            add_edges(material, line, EDGE_WIDTH)
    pictures.keep_caps(mesh, material, shown.shift)
    mesh.update()
    added: list[bpy.types.ID] = [material] if colors is None or shown.opacity < 1.0 else blocks_of(material)
    if line and width and style.engine != "cycles":
        added.append(_add_edge_geometry(obj, line, width))
    return added


def label_of(obj: bpy.types.Object) -> int | None:
    """Return the label that a surface was made from, or None for a threshold."""
    return None if read_provenance(obj) is None else settings_of(obj).label


def edge_widths(obj: bpy.types.Object, unit: float, pixel: float) -> NDArray[np.float32]:
    """Return the line width of the edges of each face, (F,) scene units; 0 where edges are too short to be seen.

    Edges that are on average shorter than `LEAST_EDGE` pixels would look like grain.

    Parameters
    ----------
    unit, pixel : float
        A millimeter and a pixel of the page, scene units.
    """
    mesh = obj.data
    scale = scale_in_scene(obj)
    positions, faces = meshes.read_positions(mesh), meshes.read_triangles(mesh)
    radii, edges = _inscribed_radii(positions, faces) * scale, mean_edges(positions, faces) * scale
    if len(radii) != len(mesh.polygons):  # Polygons of a modifier count by their smallest triangle.
        owners = np.empty(len(radii), np.int32)
        mesh.loop_triangles.foreach_get("polygon_index", owners)
        radii, edges = (_smallest_of(values, owners, len(mesh.polygons)) for values in (radii, edges))
    share = np.where(edges >= LEAST_EDGE * pixel, np.interp(radii / unit, RADII_MM, SHARES), 0.0)
    return np.minimum(share * radii, EDGE_MM * unit).astype(np.float32)


def _smallest_of(values: NDArray[np.float64], owners: NDArray[np.int32], count: int) -> NDArray[np.float64]:
    """Return the smallest value of each owner, (count,)."""
    smallest = np.full(count, np.inf)
    np.minimum.at(smallest, owners, values)
    return smallest


def mean_edges(positions: NDArray[np.float32], faces: NDArray[np.int32]) -> NDArray[np.float64]:
    """Return the mean length of the edges of each triangle, (F,).

    Examples
    --------
    >>> corners = np.array([[0, 0, 0], [3, 0, 0], [0, 4, 0]], np.float32)
    >>> mean_edges(corners, np.array([[0, 1, 2]], np.int32)).tolist()
    [4.0]
    """
    corners = positions[faces].astype(np.float64)  # (F, 3, 3)
    lengths: NDArray[np.float64] = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean(axis=1)
    return lengths


def _inscribed_radii(positions: NDArray[np.float32], faces: NDArray[np.int32]) -> NDArray[np.float64]:
    """Return the radius of the circle inside each triangle, (F,).

    Examples
    --------
    >>> corners = np.array([[0, 0, 0], [3, 0, 0], [0, 4, 0]], np.float32)
    >>> _inscribed_radii(corners, np.array([[0, 1, 2]], np.int32)).tolist()
    [1.0]
    """
    a, b, c = np.moveaxis(positions[faces].astype(np.float64), 1, 0)  # (F, 3) each
    twice_area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    around = sum(np.linalg.norm(side, axis=1) for side in (b - a, c - b, a - c))
    radii: NDArray[np.float64] = twice_area / np.maximum(around, 1e-30)
    return radii


def _make_matte(material: bpy.types.Material) -> None:
    """Remove the gloss, which leaves white spots on light surfaces."""
    shader = principled(material)
    shader.inputs["Roughness"].default_value, shader.inputs["Specular IOR Level"].default_value = 0.6, 0.15


def shown_color(obj: bpy.types.Object, shown: ShownSurface, style: FigureStyle) -> Color:
    """Return the color a surface is shown in."""
    return shown.color or STYLES[style.style].face or material_color(obj)


def mean_edge(obj: bpy.types.Object) -> float:
    """Return the mean length of the triangles' first edges, scene units."""
    faces = meshes.read_triangles(obj.data)
    positions = meshes.read_positions(obj.data)
    edges = positions[faces[:, 1]] - positions[faces[:, 0]]
    return float(np.sqrt((edges.astype(np.float64) ** 2).sum(axis=1)).mean()) * scale_in_scene(obj)


def scale_in_scene(obj: bpy.types.Object) -> float:
    """Return the scale of an object in the scene relative to its mesh."""
    return float(abs(obj.matrix_world.determinant()) ** (1 / 3))


def transparent_material(color: Color, opacity: float, layers: int, style: FigureStyle) -> bpy.types.Material:
    """Return a veil of a color: `opacity` where it faces the camera, more at the rim, the same in any light.

    A ray sees the first `layers` transparent surfaces; behind the first one, only those that face the camera. All
    further ones are invisible: at a rim, a ray passes many small ones, which would show as shards and moire. No light
    falls on the material, because random shadow rays are noise; the illustration's is shaded by its nodes.
    """

    def seen(tree: Any) -> Any:
        path, geometry = tree.nodes.new("ShaderNodeLightPath"), tree.nodes.new("ShaderNodeNewGeometry")
        first = math_node(tree, "LESS_THAN", path.outputs["Transparent Depth"], 0.5)
        among = math_node(tree, "LESS_THAN", path.outputs["Transparent Depth"], layers - 0.5)
        front = math_node(tree, "SUBTRACT", 1.0, geometry.outputs["Backfacing"])
        if style.style == "illustration":  # Rays pass outlines too, so layers cannot be counted.
            return math_node(tree, "MULTIPLY_ADD", front, 1.0 - FAR_SIDE, FAR_SIDE)
        return math_node(tree, "MAXIMUM", first, math_node(tree, "MULTIPLY", among, front))

    if style.style == "illustration":
        material = glass_material(NAME, color, seen, opacity, style.azimuth, style.elevation)
    else:
        material = surface_material(NAME, color)
        tree = material.node_tree
        facing = tree.nodes.new("ShaderNodeLayerWeight")
        facing.inputs["Blend"].default_value = 0.5
        rim = math_node(tree, "POWER", facing.outputs["Facing"], 2.0)
        share = math_node(tree, "MULTIPLY_ADD", rim, min(opacity, 1.0 - opacity), opacity)
        clear = clear_shader(tree)
        veil = headlight(material, color, RIM_SHADE)
        show_flat(material, mixed(tree, math_node(tree, "MULTIPLY", share, seen(tree)), clear, veil))
    material.diffuse_color[3] = opacity
    material.surface_render_method, material.use_transparency_overlap = "BLENDED", False
    return material


def _add_edge_geometry(obj: bpy.types.Object, edge: Color, width: float) -> bpy.types.Material:
    """Add triangle edges as bars with their own material; return the material.

    Workbench has no nodes, and EEVEE's wireframe node leaves dark stains from Blender 5.0 on.
    """
    material = surface_material("CTMC Edges", edge)
    obj.data.materials.append(material)
    wire = obj.modifiers.new("CTMC Edges", "WIREFRAME")
    wire.thickness, wire.use_replace, wire.use_even_offset = 2 * width, False, False
    wire.material_offset = len(obj.data.materials) - 1
    return material
