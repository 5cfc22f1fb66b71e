# SPDX-License-Identifier: GPL-3.0-or-later
"""Make materials that look like tissue; the opacity of a surface is that of its material.

An opacity below 1 holds where the surface faces the camera; towards the rim it is denser, like glass. A translucent
surface shows only faces that face the camera: shared walls, and its own far side, would flicker. It casts no shadow, so
that the objects inside are lit. EEVEE and Cycles read the same nodes; Solid shading the alpha of
the viewport's color.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import bpy

from .colors import Color
from .materials import math_node, surface_material
from .sockets import output_of

CHOSEN = "ctmc_opacity"
"""The material's custom property: an opacity that its anatomical name or a person has chosen."""
NODES = "CTMC Opacity"  # Prefix of the names of the nodes that opacity adds.


class _MaterialFinish(NamedTuple):
    """Settings of a Principled BSDF.

    Parameters
    ----------
    scattered : float
        Share of the light that goes below the surface.
    scatter_mm : (red, green, blue) float
        Distance that this light travels.
    roughness, specular, coat : float
    grain_mm : float
        Size of fine unevenness; 0 for none.
    """

    scattered: float
    scatter_mm: tuple[float, float, float]
    roughness: float
    specular: float
    coat: float
    grain_mm: float


FINISHES = {
    "organ": _MaterialFinish(0.35, (3.0, 1.2, 0.8), 0.42, 0.4, 0.12, 0.0),
    "vessel": _MaterialFinish(0.15, (1.2, 0.5, 0.4), 0.28, 0.5, 0.2, 0.0),
    "bone": _MaterialFinish(0.12, (1.6, 1.2, 0.8), 0.68, 0.18, 0.0, 1.2),
}


def tissue_material(
    name: str, color: Color, finish: str, scale: float, opacity: float | None = None
) -> bpy.types.Material:
    """Return a material of one color that looks like bone, a vessel or an organ.

    Parameters
    ----------
    color : (red, green, blue) float
        Linear.
    finish : {"bone", "vessel", "organ"}
    scale : float
        Blender units of 1 mm.
    opacity : float, optional
        Opacity from 0 to 1; None for an opaque surface without a choice.
    """
    material, about = surface_material(name, color), FINISHES[finish]
    shader = _principled(material)
    shader.inputs["Subsurface Weight"].default_value = about.scattered
    shader.inputs["Subsurface Radius"].default_value = about.scatter_mm
    shader.inputs["Subsurface Scale"].default_value = scale
    for socket, value in (("Roughness", about.roughness), ("Specular IOR Level", about.specular)):
        shader.inputs[socket].default_value = value
    shader.inputs["Coat Weight"].default_value, shader.inputs["Coat Roughness"].default_value = about.coat, 0.15
    material.roughness = about.roughness
    if about.grain_mm:
        _add_grain(material, about.grain_mm * scale)
    if opacity is not None:
        set_material_opacity(material, opacity)
    return material


def _add_grain(material: bpy.types.Material, size: float) -> None:
    """Add fine unevenness of this size, in Blender units, to the surface."""
    tree, shader = material.node_tree, _principled(material)
    place, noise, bump = (
        tree.nodes.new(kind) for kind in ("ShaderNodeTexCoord", "ShaderNodeTexNoise", "ShaderNodeBump")
    )
    noise.inputs["Scale"].default_value, noise.inputs["Detail"].default_value = 1.0 / size, 3.0
    bump.inputs["Strength"].default_value, bump.inputs["Distance"].default_value = 0.25, 0.15 * size
    tree.links.new(place.outputs["Object"], noise.inputs["Vector"])
    tree.links.new(output_of(noise, "Fac"), bump.inputs["Height"])
    tree.links.new(bump.outputs["Normal"], shader.inputs["Normal"])


def chosen_opacity(obj: bpy.types.Object) -> float | None:
    """Return the opacity that a user or the anatomical name has chosen for a surface; None without a choice."""
    for material in obj.data.materials:
        if material is not None and CHOSEN in material:
            return min(1.0, max(0.0, round(float(material.diffuse_color[3]), 3)))
    return None


def set_opacity(obj: bpy.types.Object, opacity: float) -> None:
    """Change the opacity of the material named as the object; other materials stay."""
    for material in obj.data.materials:
        if material is not None and material.name == obj.name and material.library is None:
            set_material_opacity(material, opacity)


def set_material_opacity(material: bpy.types.Material, opacity: float) -> None:
    """Show a material at this opacity in Solid and Material shading and in renders; 1 is opaque.

    A material without a Principled BSDF gets the alpha of its viewport color only.
    """
    material[CHOSEN] = opacity
    material.diffuse_color[3] = opacity
    shader = _principled(material)
    clear = opacity < 1.0
    material.surface_render_method = "BLENDED" if clear else "DITHERED"
    material.use_transparency_overlap = not clear
    material.use_backface_culling = clear
    if shader is None:
        return
    tree = material.node_tree
    least, rise = (tree.nodes.get(f"{NODES} {part}") for part in ("Least", "Rise"))
    if clear:
        if least is None or rise is None:
            least, rise = _add_opacity(tree, shader)
        output_of(least, "Value").default_value, output_of(rise, "Value").default_value = (
            opacity,
            min(opacity, 1.0 - opacity),
        )
        return
    for node in [node for node in tree.nodes if node.name.startswith(NODES)]:
        tree.nodes.remove(node)
    shader.inputs["Alpha"].default_value = 1.0


def _add_opacity(tree: Any, shader: Any) -> tuple[Any, Any]:
    """Link nodes to a shader's alpha; return those that hold the opacity in the middle and the rim's increase."""

    def added(kind: str, part: str) -> Any:
        node = tree.nodes.new(kind)
        node.name = node.label = f"{NODES} {part}"
        return node

    def math(part: str, operation: str, *sockets: Any) -> Any:
        result = math_node(tree, operation, *sockets)
        result.node.name = result.node.label = f"{NODES} {part}"
        return result

    least, rise = added("ShaderNodeValue", "Least"), added("ShaderNodeValue", "Rise")
    weight, side, path = (
        added(kind, part)
        for kind, part in (
            ("ShaderNodeLayerWeight", "Facing"),
            ("ShaderNodeNewGeometry", "Side"),
            ("ShaderNodeLightPath", "Path"),
        )
    )
    weight.inputs["Blend"].default_value = 0.5  # "Facing" is then one less the cosine
    rim = math("Rim", "POWER", weight.outputs["Facing"], 2.0)
    dense = math("Dense", "MULTIPLY_ADD", rim, output_of(rise, "Value"), output_of(least, "Value"))
    front = math("Front", "SUBTRACT", 1.0, side.outputs["Backfacing"])
    lit = math("Lit", "SUBTRACT", 1.0, path.outputs["Is Shadow Ray"])
    seen = math("Seen", "MULTIPLY", front, lit)
    tree.links.new(math("Alpha", "MULTIPLY", dense, seen), shader.inputs["Alpha"])
    return least, rise


def _principled(material: bpy.types.Material) -> Any:
    """Return the first Principled BSDF of a material; None without one."""
    nodes = material.node_tree.nodes if material.node_tree is not None else ()
    return next((node for node in nodes if node.type == "BSDF_PRINCIPLED"), None)
