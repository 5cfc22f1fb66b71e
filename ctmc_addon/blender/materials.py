"""Colours of surfaces."""

from __future__ import annotations

import bpy

Colour = tuple[float, float, float]

RED: Colour = (0.70, 0.03, 0.025)
YELLOW: Colour = (1.0, 0.80, 0.02)

# Linear RGB; a label takes the colour of its number, so the same label looks the same in every file.
PALETTE: tuple[Colour, ...] = (
    (0.55, 0.13, 0.09),
    RED,
    (0.75, 0.55, 0.28),
    (0.10, 0.28, 0.55),
    (0.16, 0.42, 0.18),
    (0.45, 0.16, 0.50),
    (0.80, 0.30, 0.05),
    (0.10, 0.45, 0.45),
)
BONE: Colour = (0.76, 0.68, 0.52)


def colour_of(label: int | None) -> Colour:
    """The colour of a label, or of bone for a surface by threshold."""
    return BONE if label is None else PALETTE[(label - 1) % len(PALETTE)]


def surface_material(name: str, colour: Colour) -> bpy.types.Material:
    """A slightly glossy material of one colour, the same in the viewport and in renders."""
    material = bpy.data.materials.new(name)
    use_nodes(material)
    shader = next(node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    shader.inputs["Base Color"].default_value = (*colour, 1.0)
    shader.inputs["Roughness"].default_value = 0.45
    material.diffuse_color = (*colour, 1.0)
    material.roughness = 0.45
    return material


def edged_material(name: str, face: Colour, edge: Colour, width: float) -> bpy.types.Material:
    """Faces of one colour whose triangles are bordered by lines of another, `width` scene units wide.

    The figures of Su and Ma: the surface of the triangles red, their borders yellow.
    """
    material = surface_material(name, face)
    tree = material.node_tree
    shader = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    output = next(node for node in tree.nodes if node.type == "OUTPUT_MATERIAL")
    shader.inputs["Specular IOR Level"].default_value = 0.15
    line = tree.nodes.new("ShaderNodeBsdfPrincipled")
    # Lines glow a little, so that they are seen in the shade, and are shaded, so that a dense mesh keeps its form.
    for name, value in (("Base Color", (*edge, 1.0)), ("Emission Color", (*edge, 1.0))):
        line.inputs[name].default_value = value
    for name, number in (("Emission Strength", 0.35), ("Roughness", 0.9), ("Specular IOR Level", 0.0)):
        line.inputs[name].default_value = number
    wire = tree.nodes.new("ShaderNodeWireframe")
    wire.inputs["Size"].default_value = width
    mix = tree.nodes.new("ShaderNodeMixShader")
    tree.links.new(wire.outputs[0], mix.inputs[0])
    tree.links.new(shader.outputs[0], mix.inputs[1])
    tree.links.new(line.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], output.inputs["Surface"])
    return material


def use_nodes(block: bpy.types.ID) -> None:
    """Give a material or world its nodes; from Blender 5 it always has them and asking is deprecated."""
    if bpy.app.version < (5, 0, 0):
        block.use_nodes = True
