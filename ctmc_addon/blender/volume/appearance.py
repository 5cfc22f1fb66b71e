# SPDX-License-Identifier: GPL-3.0-or-later
"""Make materials of a Volume object, with ramps in the volume's own values, HU of a CT.

Below the threshold nothing is seen; above it the volume grows dense within a few HU. The color follows window and
level, so threshold, window and level of the sidebar are all there is to turn.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy

from ..colors import BONE, Color
from ..materials import math_node, use_nodes
from ..sockets import input_of, output_of
from .vdb import GRID

THRESHOLD, WINDOW, LEVEL = "Threshold", "Window", "Level"
"""Labels of the nodes that hold them."""
GLOW = 0.22  # Largest share of the light that a part scatters.
BACK = -0.3  # Anisotropy: more light returns to the eye, as from a surface.


@dataclass(frozen=True)
class Appearance:
    """Preset for the look of a volume object.

    Parameters
    ----------
    label, text : str
    threshold : float
        HU below which nothing is seen.
    width : float
        HU from the threshold to the full density.
    density_per_mm : float
        Share hidden by 1 mm at full density.
    window, level : float
        HU of the dark to the light end of the colors.
    colors : two linear colors
        Colors of the dark and the light end.
    """

    label: str
    text: str
    threshold: float
    width: float
    density_per_mm: float
    window: float
    level: float
    colors: tuple[Color, Color]


APPEARANCES = {
    "bone": Appearance("Bone", "Bone, spongy bone included", 180.0, 150.0, 2.0, 500.0, 430.0, ((0.6, 0.45, 0.3), BONE)),
    "vessels": Appearance(
        "Vessels",
        "Vessels with contrast medium in red, bone in white",
        150.0,
        80.0,
        1.5,
        240.0,
        270.0,
        ((0.55, 0.02, 0.01), (0.85, 0.78, 0.62)),
    ),
    "soft": Appearance(
        "Soft Tissue",
        "Muscle and organs, half transparent",
        -10.0,
        80.0,
        0.12,
        350.0,
        90.0,
        ((0.35, 0.06, 0.03), (0.9, 0.7, 0.55)),
    ),
    "skin": Appearance(
        "Skin",
        "The body's surface against air",
        -400.0,
        250.0,
        1.0,
        500.0,
        -150.0,
        ((0.62, 0.34, 0.22), (0.9, 0.64, 0.5)),
    ),
}


def volume_material(name: str, appearance: Appearance, scale: float) -> bpy.types.Material:
    """Return a material for a volume.

    Parameters
    ----------
    name : str
    appearance : Appearance
    scale : float
        Blender units a millimeter.
    """
    material = bpy.data.materials.new(name)
    use_nodes(material)
    tree = material.node_tree
    tree.nodes.clear()
    numbers = {
        THRESHOLD: appearance.threshold,
        "Width": appearance.width,
        WINDOW: appearance.window,
        LEVEL: appearance.level,
        "Density": appearance.density_per_mm / scale,
    }
    value_of = {label: _number(tree, label, value) for label, value in numbers.items()}
    values = tree.nodes.new("ShaderNodeAttribute")
    values.attribute_name = GRID
    opacity = _share(tree, output_of(values, "Fac"), value_of[THRESHOLD], value_of["Width"])
    dark = math_node(tree, "SUBTRACT", value_of[LEVEL], math_node(tree, "MULTIPLY", value_of[WINDOW], 0.5))
    shade = _share(tree, output_of(values, "Fac"), dark, value_of[WINDOW])
    ramp = tree.nodes.new("ShaderNodeValToRGB")
    tree.links.new(shade, input_of(ramp, "Fac"))
    for element, color in zip(ramp.color_ramp.elements, appearance.colors, strict=True):
        element.color = (*color, 1.0)
    shader = tree.nodes.new("ShaderNodeVolumePrincipled")
    shader.inputs["Density Attribute"].default_value = ""
    shader.inputs["Anisotropy"].default_value = BACK
    density = math_node(tree, "MULTIPLY", opacity, value_of["Density"])
    tree.links.new(density, shader.inputs["Density"])
    # Light is scattered once in EEVEE and by Cycles' defaults, which leaves dense parts dark: they glow a little.
    tree.links.new(math_node(tree, "MULTIPLY", density, GLOW), shader.inputs["Emission Strength"])
    for taken in ("Color", "Emission Color"):
        tree.links.new(ramp.outputs["Color"], shader.inputs[taken])
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(shader.outputs["Volume"], output.inputs["Volume"])
    for number, node in enumerate(tree.nodes):
        node.location = (220 * (number // 4), -180 * (number % 4))
    return material


def adjust(material: bpy.types.Material, **numbers: float) -> None:
    """Set threshold, window or level of a volume's material, by the nodes' labels in lower case."""
    for node in material.node_tree.nodes:
        value = numbers.get(node.label.lower())
        if node.type == "VALUE" and value is not None:
            output_of(node, "Value").default_value = value


def _number(tree: Any, label: str, value: float) -> Any:
    node = tree.nodes.new("ShaderNodeValue")
    node.label = label
    output_of(node, "Value").default_value = value
    return output_of(node, "Value")


def _share(tree: Any, value: Any, low: Any, width: Any) -> Any:
    """Return the socket of (value - low) / width, 0 below and 1 above."""
    share = math_node(tree, "DIVIDE", math_node(tree, "SUBTRACT", value, low), width)
    share.node.use_clamp = True
    return share
