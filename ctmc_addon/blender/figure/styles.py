# SPDX-License-Identifier: GPL-3.0-or-later
"""How a figure looks: its engine, and the materials of its surfaces."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from ...core import OutputError
from ..colors import Color
from ..materials import edged_material, material_color, mixed, surface_input, surface_material
from ..surface import mesh_data as meshes
from ..viewport.shaders import can_draw
from .distance_map import DISTANCE, distance_material
from .spec import ENGINES, STYLES, FigureStyle, ShownSurface

NAME = "CTMC Figure"
TRANSPARENT_SAMPLES = 36  # a ray that passes or stays by chance needs more of them
EDGE_MM = 0.12  # on the page
EDGE_SHARE = 0.08  # of a triangle's side: finer meshes get finer lines, or nothing of the face would be left


def require_engine(engine: str, distances: bool = False) -> None:
    """Raise `OutputError` for an engine that does not work here, before Blender would end the process.

    `distances` asks for one that shows a map of distances.
    """
    if engine == "workbench" and distances:
        raise OutputError("workbench shows no map of distances; take cycles or eevee")
    if engine == "cycles":
        if not hasattr(bpy.types.Scene, "cycles"):
            raise OutputError(
                "a figure needs Blender's Cycles; enable 'Cycles Render Engine' in the add-on preferences"
            )
    elif not can_draw():
        raise OutputError(f"{engine} needs EGL, which this machine lacks; install libegl1, or take cycles")


def set_engine(scene: bpy.types.Scene, engine: str, samples: int, transparent: bool) -> None:
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
        scene.view_settings.exposure = 0.7  # its studio is darker than the others' sun; white stays white
        scene.world.color = (1.0, 1.0, 1.0)
    else:
        scene.cycles.samples = max(samples, TRANSPARENT_SAMPLES) if transparent else samples


def assign_materials(obj: bpy.types.Object, shown: ShownSurface, style: FigureStyle, unit: float) -> list[bpy.types.ID]:
    """Give a surface its material on a page whose millimeter is `unit` scene units; returns what was made for it."""
    face, line = shown_color(obj, shown, style), style.edge if shown.opacity == 1.0 else None
    mesh = obj.data
    mesh.materials.clear()
    if style.distances is not None and DISTANCE in mesh.attributes:
        material = distance_material(style.distances, glow=0.45)
    else:
        obj.visible_shadow = shown.opacity == 1.0  # or walls that touch would speckle each other
        width = min(EDGE_MM * unit, EDGE_SHARE * mean_edge(obj)) if line else 0.0
        if line and style.engine == "cycles":  # the others have geometry for edges
            material = edged_material(NAME, face, line, width)
        else:
            material = surface_material(NAME, face)
        if shown.opacity < 1.0:
            make_transparent(material, shown.opacity)
    mesh.materials.append(material)
    mesh.update()
    added: list[bpy.types.ID] = [material]
    if line and style.engine != "cycles" and style.distances is None:
        added.append(add_edge_geometry(obj, line, width))
    return added


def shown_color(obj: bpy.types.Object, shown: ShownSurface, style: FigureStyle) -> Color:
    """The color a surface is shown in."""
    return shown.color or STYLES[style.style].face or material_color(obj)


def mean_edge(obj: bpy.types.Object) -> float:
    """Mean length of the triangles' first edges, scene units."""
    faces = meshes.read_triangles(obj.data)
    positions = meshes.read_positions(obj.data)
    edges = positions[faces[:, 1]] - positions[faces[:, 0]]
    return float(np.sqrt((edges.astype(np.float64) ** 2).sum(axis=1)).mean()) * scale_in_scene(obj)


def scale_in_scene(obj: bpy.types.Object) -> float:
    """How many times larger an object stands in the scene than its mesh is."""
    return float(abs(obj.matrix_world.determinant()) ** (1 / 3))


def make_transparent(material: bpy.types.Material, opacity: float) -> None:
    """Let the front of a surface be seen through, more where it faces the camera, and its back not be seen at all.

    Without the back, the walls of a liver's hollows do not cover the tumours that fill them.
    """
    tree, surface = material.node_tree, surface_input(material)
    clear = tree.nodes.new("ShaderNodeBsdfTransparent")
    shown = mixed(tree, opacity_socket(tree, opacity), clear.outputs[0], surface.links[0].from_socket)
    tree.links.new(shown, surface)
    material.diffuse_color[3] = opacity
    if hasattr(material, "surface_render_method"):
        material.surface_render_method = "BLENDED"
    material.use_backface_culling = True


def opacity_socket(tree: Any, opacity: float) -> Any:
    """`opacity` where the surface faces the camera, up to twice that at its rim, 0 on its back."""
    facing = tree.nodes.new("ShaderNodeLayerWeight")
    facing.inputs["Blend"].default_value = 0.5
    geometry = tree.nodes.new("ShaderNodeNewGeometry")
    rim = tree.nodes.new("ShaderNodeMath")
    rim.operation = "MULTIPLY_ADD"
    rim.inputs[1].default_value = min(opacity, 1.0 - opacity)
    rim.inputs[2].default_value = opacity
    front = tree.nodes.new("ShaderNodeMath")
    front.operation = "SUBTRACT"
    front.inputs[0].default_value = 1.0
    both = tree.nodes.new("ShaderNodeMath")
    both.operation = "MULTIPLY"
    tree.links.new(facing.outputs["Facing"], rim.inputs[0])
    tree.links.new(geometry.outputs["Backfacing"], front.inputs[1])
    tree.links.new(rim.outputs[0], both.inputs[0])
    tree.links.new(front.outputs[0], both.inputs[1])
    return both.outputs[0]


def add_edge_geometry(obj: bpy.types.Object, edge: Color, width: float) -> bpy.types.Material:
    """Triangle edges as bars of their own material; returns that.

    For Workbench, which has no nodes, and for EEVEE, whose wireframe node leaves dark stains from Blender 5.0 on.
    """
    material = surface_material("CTMC Edges", edge)
    obj.data.materials.append(material)
    wire = obj.modifiers.new("CTMC Edges", "WIREFRAME")
    wire.thickness, wire.use_replace, wire.material_offset, wire.use_even_offset = 2 * width, False, 1, False
    return material
