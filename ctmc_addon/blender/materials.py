# SPDX-License-Identifier: GPL-3.0-or-later
"""Make materials of surfaces, the same in the viewport and in renders."""

from __future__ import annotations

from typing import Any

import bpy

from .colors import BONE, Color
from .sockets import MATH, input_of, output_of


def surface_material(name: str, color: Color) -> bpy.types.Material:
    """Return a slightly glossy material of one color."""
    material = bpy.data.materials.new(name)
    use_nodes(material)
    shader = principled(material)
    shader.inputs["Base Color"].default_value = (*color, 1.0)
    shader.inputs["Roughness"].default_value = 0.45
    material.diffuse_color = (*color, 1.0)
    material.roughness = 0.45
    return material


def principled(material: bpy.types.Material) -> Any:
    """Return the shader that a new material has."""
    return next(node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED")


def surface_input(material: bpy.types.Material) -> Any:
    """Return the surface socket of a material's output node."""
    return next(node for node in material.node_tree.nodes if node.type == "OUTPUT_MATERIAL").inputs["Surface"]


def mixed(tree: Any, share: Any, first: Any, second: Any) -> Any:
    """Return the socket of a mix of two shaders' sockets; `share`, a number or a socket, is the second's."""
    mix = tree.nodes.new("ShaderNodeMixShader")
    if isinstance(share, float):
        input_of(mix, "Fac").default_value = share
    else:
        tree.links.new(share, input_of(mix, "Fac"))
    tree.links.new(first, input_of(mix, "Shader"))
    tree.links.new(second, input_of(mix, "Shader_001"))
    return output_of(mix, "Shader")


def add_edges(material: bpy.types.Material, edge: Color, widths: str) -> None:
    """Draw the triangle edges of a material of `surface_material` as lines of a color.

    The figures of Su and Ma have red triangles with yellow edges.

    Parameters
    ----------
    widths : str
        The attribute of the triangles that holds the width of their lines, in the units of the mesh in the scene.
    """
    tree, shader = material.node_tree, principled(material)
    line = tree.nodes.new("ShaderNodeBsdfPrincipled")
    # Lines glow a little, so that they are seen in the shade, and are shaded, so that a dense mesh keeps its form.
    for name, value in (("Base Color", (*edge, 1.0)), ("Emission Color", (*edge, 1.0))):
        line.inputs[name].default_value = value
    for name, number in (("Emission Strength", 0.35), ("Roughness", 0.9), ("Specular IOR Level", 0.0)):
        line.inputs[name].default_value = number
    width = tree.nodes.new("ShaderNodeAttribute")
    width.attribute_name = widths
    wire = tree.nodes.new("ShaderNodeWireframe")
    tree.links.new(output_of(width, "Fac"), input_of(wire, "Size"))
    shown = mixed(tree, output_of(wire, "Fac"), output_of(shader, "BSDF"), output_of(line, "BSDF"))
    tree.links.new(shown, surface_input(material))
    lights_nothing(material)


def math_node(tree: Any, operation: str, *values: Any) -> Any:
    """Return the socket of an operation on numbers and sockets."""
    node = tree.nodes.new("ShaderNodeMath")
    node.operation = operation
    for called, value in zip(MATH, values, strict=False):
        if isinstance(value, int | float):
            input_of(node, called).default_value = value
        else:
            tree.links.new(value, input_of(node, called))
    return output_of(node, "Value")


def dot_node(tree: Any, socket: Any, vector: Any) -> Any:
    """Return the socket of the dot product of a socket's vector and a constant one."""
    node = tree.nodes.new("ShaderNodeVectorMath")
    node.operation = "DOT_PRODUCT"
    tree.links.new(socket, input_of(node, "Vector"))
    input_of(node, "Vector_001").default_value = tuple(float(part) for part in vector)
    return output_of(node, "Value")


def clear_shader(tree: Any) -> Any:
    """Return the socket of a shader that is fully transparent."""
    return output_of(tree.nodes.new("ShaderNodeBsdfTransparent"), "BSDF")


def flat_material(name: str, color: Color) -> bpy.types.Material:
    """Return a material of one color in any light, for letters and bars."""
    material = surface_material(name, color)
    show_flat(material, emission(material, color))
    return material


def emission(material: bpy.types.Material, color: Color | Any) -> Any:
    """Return the socket of an emission shader with this color, a value or a socket."""
    glow = material.node_tree.nodes.new("ShaderNodeEmission")
    if isinstance(color, tuple):
        glow.inputs["Color"].default_value = (*color, 1.0)
    else:
        material.node_tree.links.new(color, glow.inputs["Color"])
    return output_of(glow, "Emission")


def show_flat(material: bpy.types.Material, shown: Any) -> None:
    """Show a socket's color in a material, the same in any light."""
    material.node_tree.links.new(shown, surface_input(material))
    lights_nothing(material)


def lights_nothing(material: bpy.types.Material) -> None:
    """Keep a glowing object on a page from lighting other objects."""
    if hasattr(material, "cycles"):
        material.cycles.emission_sampling = "NONE"


def headlight(material: bpy.types.Material, color: Any, dimmest: float) -> Any:
    """Return the socket of a color lit from the camera without shadows: `dimmest` times as light at the rim."""
    tree = material.node_tree
    weight = tree.nodes.new("ShaderNodeLayerWeight")
    weight.inputs["Blend"].default_value = 0.5  # "Facing" is then one less the cosine
    shade = tree.nodes.new("ShaderNodeMapRange")
    shade.inputs["To Min"].default_value, shade.inputs["To Max"].default_value = 1.0, dimmest
    tree.links.new(weight.outputs["Facing"], shade.inputs["Value"])
    light = emission(material, color)
    tree.links.new(shade.outputs["Result"], light.node.inputs["Strength"])
    return light


def material_color(obj: bpy.types.Object) -> Color:
    """Return the color of an object's first material; bone without one."""
    materials = [material for material in obj.data.materials if material is not None]
    if not materials:
        return BONE
    red, green, blue, _ = materials[0].diffuse_color
    return red, green, blue


def material_opacity(obj: bpy.types.Object) -> float:
    """Return the opacity of an object's first material; 1 without one."""
    material = next((material for material in obj.data.materials if material is not None), None)
    return 1.0 if material is None else min(1.0, max(0.0, round(float(material.diffuse_color[3]), 3)))


def recolor(obj: bpy.types.Object, color: Color) -> None:
    """Change the color of the material named as the object, unless its shader was replaced."""
    for material in obj.data.materials:
        if material is not None and material.name == obj.name and material.library is None:
            for node in material.node_tree.nodes:
                if node.type == "BSDF_PRINCIPLED":
                    node.inputs["Base Color"].default_value = (*color, 1.0)
            material.diffuse_color = (*color, 1.0)


def use_nodes(block: bpy.types.ID) -> None:
    """Enable the nodes of a material or world; from Blender 5 they are always enabled and asking is deprecated."""
    if bpy.app.version < (5, 0, 0):
        block.use_nodes = True
