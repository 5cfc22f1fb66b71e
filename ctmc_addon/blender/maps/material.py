# SPDX-License-Identifier: GPL-3.0-or-later
"""Make the material that shows a map; its node group has the name of the map, its ramp, its range and its unit."""

from __future__ import annotations

from typing import Any, Protocol

import bpy
import numpy as np

from ...core.maps import NO_VALUE, RAMPS, colors_of, linear, rgb_of
from ..materials import headlight, math_node, show_flat, use_nodes
from ..sockets import input_of, output_of

MAP = "ctmc_map"
"""Custom property of the material that holds the name of its map."""
MOST_STOPS = 32  # Blender's limit.
ENDLESS = 1e30  # Every value except NaN lies between this and its negative.
RIM = 0.72  # The rim has this share of the lightness, which shows form in colors outside of the ramp.


class ShownMap(Protocol):
    """The properties of a map that its material needs."""

    @property
    def name(self) -> str:
        """The attribute."""

    @property
    def unit(self) -> str:
        """The unit of the range."""

    @property
    def range(self) -> tuple[float, float]:
        """Values of the first and the last color."""

    @property
    def ramp(self) -> str:
        """The color ramp, a key of `RAMPS`."""


def map_material(shown: ShownMap) -> bpy.types.Material:
    """Return a material in the colors of a map, unlit but slightly darker at the rim."""
    material = bpy.data.materials.new(f"CTMC {shown.name}")
    material[MAP] = shown.name
    use_nodes(material)
    tree = material.node_tree
    group = tree.nodes.new("ShaderNodeGroup")
    group.node_tree = map_nodes(shown)
    group.name = MAP
    show_flat(material, headlight(material, output_of(group, "Color"), RIM))
    red, green, blue, _ = linear(rgb_of(RAMPS[shown.ramp].split()[len(RAMPS[shown.ramp].split()) // 2]))
    material.diffuse_color = (red, green, blue, 1.0)
    set_colors(material, shown)
    return material


def blocks_of(material: bpy.types.Material) -> list[bpy.types.ID]:
    """Return a material of `map_material` and its node group."""
    return [material, material.node_tree.nodes[MAP].node_tree]


def set_colors(material: bpy.types.Material, shown: ShownMap) -> None:
    """Give a material of `map_material` the present range and ramp of a map."""
    group = material.node_tree.nodes[MAP]
    for called, value in zip(_range_names(shown.unit), shown.range, strict=True):
        input_of(group, called).default_value = value
    _set_stops(next(node for node in group.node_tree.nodes if node.type == "VALTORGB").color_ramp, shown.ramp)


def _range_names(unit: str) -> tuple[str, str]:
    behind = f" [{unit}]" if unit else ""
    return f"Low{behind}", f"High{behind}"


def map_nodes(shown: ShownMap) -> bpy.types.NodeTree:
    """Return a new node group that gives the color of a map's value between two inputs, gray without a value."""
    tree: Any = bpy.data.node_groups.new(shown.name, "ShaderNodeTree")
    low, high = (
        tree.interface.new_socket(called, in_out="INPUT", socket_type="NodeSocketFloat").name
        for called in _range_names(shown.unit)
    )
    tree.interface.new_socket("Color", in_out="OUTPUT", socket_type="NodeSocketColor")
    inputs, attribute = tree.nodes.new("NodeGroupInput"), tree.nodes.new("ShaderNodeAttribute")
    attribute.attribute_name = shown.name
    value = output_of(attribute, "Fac")
    ramp = tree.nodes.new("ShaderNodeValToRGB")
    above_low = math_node(tree, "SUBTRACT", value, output_of(inputs, low))
    width = math_node(tree, "SUBTRACT", output_of(inputs, high), output_of(inputs, low))
    share = math_node(tree, "DIVIDE", above_low, width)
    share.node.use_clamp = True
    tree.links.new(share, input_of(ramp, "Fac"))
    # NaN fails these comparisons in Cycles and in EEVEE; a comparison with itself holds in EEVEE.
    below = math_node(tree, "LESS_THAN", value, ENDLESS)
    above = math_node(tree, "GREATER_THAN", value, -ENDLESS)
    mix: Any = tree.nodes.new("ShaderNodeMix")
    mix.data_type = "RGBA"
    tree.links.new(math_node(tree, "MULTIPLY", below, above), input_of(mix, "Factor_Float"))
    input_of(mix, "A_Color").default_value = linear(rgb_of(NO_VALUE))
    tree.links.new(ramp.outputs["Color"], input_of(mix, "B_Color"))
    tree.links.new(output_of(mix, "Result_Color"), input_of(tree.nodes.new("NodeGroupOutput"), "Color"))
    for number, node in enumerate(tree.nodes):
        node.location = (220 * (number // 3), -260 * (number % 3))
    return tree


def _set_stops(color_ramp: Any, ramp: str) -> None:
    """Give a color ramp the stops of a ramp and more between them, because Blender mixes linear light and core sRGB."""
    steps = len(RAMPS[ramp].split()) - 1
    count = steps * ((MOST_STOPS - 1) // steps) + 1
    along = np.linspace(0.0, 1.0, count)
    stops = color_ramp.elements
    while len(stops) < count:
        stops.new(1.0)
    while len(stops) > count:
        stops.remove(stops[-1])
    for stop, at, color in zip(stops, along, colors_of(along.astype(np.float32), (0.0, 1.0), ramp) / 255, strict=True):
        stop.position = at
        stop.color = linear(tuple(color))
