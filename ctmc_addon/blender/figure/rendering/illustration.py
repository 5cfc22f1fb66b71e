# SPDX-License-Identifier: GPL-3.0-or-later
"""Render the style illustration: a soft key light, a rim light, light from all sides, outlines, glassy organs.

Light from all sides reaches what is open and not what is recessed, so recesses are shaded (ambient occlusion). An
outline is a shell around the surface, one line wide, of which only the side that faces away is seen: it looks out
around whatever stands before something else, and has the same width everywhere, as the camera is orthographic. A
translucent organ is lit by nodes that know where the lights stand, not by rays, so it is free of noise.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from ...colors import Color
from ...materials import (
    clear_shader,
    dot_node,
    emission,
    flat_material,
    lights_nothing,
    math_node,
    mixed,
    principled,
    show_flat,
    surface_material,
)
from ...scene.studio import Sun, view_axes
from ...sockets import output_of
from ...surface import mesh_data as meshes
from ...tissue import FINISHES

KEY = "CTMC Key"
SUNS = {
    KEY: Sun(34.0, 30.0, 0.68, 30.0, True, (1.0, 0.97, 0.92)),
    "CTMC Fill": Sun(-40.0, 0.0, 0.10, 0.0, False, (0.90, 0.95, 1.0)),
    "CTMC Rim": Sun(-152.0, 32.0, 0.75, 8.0, True, (0.96, 0.98, 1.0)),
}
FROM_ALL_SIDES = 0.44  # Strength of the white light from all sides.
OUTLINE_MM = 0.14  # Width of an outline on the page.
OUTLINE: Color = (0.012, 0.010, 0.012)
TINT = 0.4  # Share of a translucent organ's color in everything seen through it.
SHELL = "CTMC Outline"


def outline_shell(obj: bpy.types.Object, width: float) -> bpy.types.Mesh:
    """Return a mesh around an object's surface with reversed normals, `width` units of the object away from it."""
    mesh = obj.data
    normals = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertex_normals.foreach_get("vector", normals)
    shell = mesh.copy()
    shell.name = SHELL
    shell.materials.clear()
    positions = meshes.read_positions(mesh) + width * normals.reshape(-1, 3)
    shell.attributes["position"].data.foreach_set("vector", positions.ravel())
    shell.flip_normals()
    return shell


def outline_material() -> bpy.types.Material:
    """Return dark ink that is transparent from behind."""
    material = flat_material(SHELL, OUTLINE)
    tree = material.node_tree
    clear = clear_shader(tree)
    back = tree.nodes.new("ShaderNodeNewGeometry").outputs["Backfacing"]
    show_flat(material, mixed(tree, back, emission(material, OUTLINE), clear))
    material.use_backface_culling = True
    return material


def opaque_material(name: str, color: Color, finish: str) -> bpy.types.Material:
    """Return a material with the gloss of bone, a vessel or an organ."""
    material, about = surface_material(name, color), FINISHES[finish]
    shader = principled(material)
    shader.inputs["Roughness"].default_value, shader.inputs["Specular IOR Level"].default_value = (
        max(about.roughness, 0.38),
        about.specular,
    )
    material.roughness = about.roughness
    return material


def glass_material(
    name: str, color: Color, seen: Any, opacity: float, azimuth: float, elevation: float
) -> bpy.types.Material:
    """Return a material of clear, glossy tissue, denser and darker towards the rim, with a highlight of the key light.

    Parameters
    ----------
    seen : callable
        Returns, for a node tree, the socket of 0 or 1: whether the surface is visible.
    opacity : float
        Opacity where the surface faces the camera.
    azimuth, elevation : float
        Angles of the camera, degrees.
    """
    material = surface_material(name, color)
    tree = material.node_tree
    key = SUNS[KEY]
    back = view_axes(azimuth, elevation)[:, 2]
    light = view_axes(azimuth + key.turn, elevation + key.rise)[:, 2]
    half = (back + light) / np.linalg.norm(back + light)
    normal = tree.nodes.new("ShaderNodeNewGeometry").outputs["Normal"]
    lit = math_node(tree, "MAXIMUM", dot_node(tree, normal, light), 0.0)
    facing = tree.nodes.new("ShaderNodeLayerWeight")
    facing.inputs["Blend"].default_value = 0.5  # "Facing" is then one less the cosine
    rim = math_node(tree, "POWER", facing.outputs["Facing"], 2.2)
    shine = math_node(tree, "POWER", math_node(tree, "MAXIMUM", dot_node(tree, normal, half), 0.0), 90.0)
    form = math_node(tree, "MULTIPLY_ADD", lit, 1.1, 0.8)
    level = math_node(tree, "SUBTRACT", form, math_node(tree, "MULTIPLY", rim, 0.8))
    body = emission(material, color)
    tree.links.new(level, body.node.inputs["Strength"])
    gloss = math_node(tree, "MULTIPLY", shine, 0.65)
    shown = mixed(tree, gloss, body, emission(material, (1.0, 0.98, 0.95)))
    share = math_node(tree, "MULTIPLY_ADD", rim, min(1.4 * opacity, 1.0 - opacity), opacity)
    near = seen(tree)
    dense = math_node(tree, "MULTIPLY", math_node(tree, "MAXIMUM", share, gloss), near)
    tinted = tree.nodes.new("ShaderNodeBsdfTransparent")
    # What lies behind is seen in the light that the tissue lets through, as through colored glass.
    tinted.inputs["Color"].default_value = (*(1.0 - TINT * (1.0 - part / max(color)) for part in color), 1.0)
    behind = mixed(tree, near, clear_shader(tree), output_of(tinted, "BSDF"))
    show_flat(material, mixed(tree, dense, behind, shown))
    lights_nothing(material)
    return material
