"""How a figure looks: styles, engines, and the materials of its surfaces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy

from ...core import OutputError
from ..materials import RED, YELLOW, Colour, edged_material, surface_material
from ..rotation.offscreen import can_draw

GREY: Colour = (0.52, 0.52, 0.52)
INK: Colour = (0.02, 0.02, 0.02)
ENGINES = ("cycles", "eevee", "workbench")
SEE_THROUGH_SAMPLES = 36  # a ray that passes or stays by chance needs more of them


@dataclass(frozen=True)
class Style:
    """A style: the colour of faces (None is the surface's own) and of triangle edges (None draws none)."""

    text: str
    face: Colour | None
    edge: Colour | None


STYLES: dict[str, Style] = {
    "paper": Style("red faces, yellow triangle edges", RED, YELLOW),
    "clinical": Style("every surface smooth in its own colour", None, None),
    "print": Style("grey faces, dark triangle edges, for black and white", GREY, INK),
}


def require_engine(engine: str, heat: bool = False) -> None:
    """Raise `OutputError` for an engine that does not work here, before Blender would end the process.

    `heat` asks for one that shows a map of distances.
    """
    if engine == "workbench" and heat:
        raise OutputError("workbench shows no map of distances; take cycles or eevee")
    if engine == "cycles":
        if not hasattr(bpy.types.Scene, "cycles"):
            raise OutputError(
                "a figure needs Blender's Cycles; enable 'Cycles Render Engine' in the add-on preferences"
            )
    elif not can_draw():
        raise OutputError(f"{engine} needs EGL, which this machine lacks; install libegl1, or take cycles")


def set_engine(scene: bpy.types.Scene, engine: str, see_through: bool) -> None:
    """Give a staged scene its engine; Cycles is already set up."""
    if engine == "eevee":
        scene.render.engine = "BLENDER_EEVEE" if bpy.app.version >= (5, 0, 0) else "BLENDER_EEVEE_NEXT"
        scene.eevee.taa_render_samples = 16
        scene.eevee.use_shadows = False
    elif engine == "workbench":
        scene.render.engine = "BLENDER_WORKBENCH"
        shading = scene.display.shading
        shading.light, shading.color_type, shading.show_specular_highlight = "STUDIO", "MATERIAL", False
        shading.show_object_outline = False
        scene.display.render_aa = "16"
        shading.background_type = "WORLD"
        scene.view_settings.exposure = 0.7  # its studio is darker than the others' sun; white stays white
        scene.world.color = (1.0, 1.0, 1.0)
    elif see_through:
        scene.cycles.samples = SEE_THROUGH_SAMPLES


def flat_material(name: str, colour: Colour) -> bpy.types.Material:
    """One colour, whatever the light: for letters and bars."""
    material = surface_material(name, colour)
    tree = material.node_tree
    output = next(node for node in tree.nodes if node.type == "OUTPUT_MATERIAL")
    glow = tree.nodes.new("ShaderNodeEmission")
    glow.inputs["Color"].default_value = (*colour, 1.0)
    tree.links.new(glow.outputs[0], output.inputs["Surface"])
    return material


def figure_material(
    name: str, face: Colour, edge: Colour | None, width: float, opacity: float, engine: str
) -> bpy.types.Material:
    """The material of a surface in a figure; `width` of its edges in scene units."""
    drawn = edge is not None and engine == "cycles"  # the others have geometry for edges
    material = edged_material(name, face, edge, width) if edge and drawn else surface_material(name, face)
    if opacity < 1.0:
        see_through(material, opacity)
    return material


def see_through(material: bpy.types.Material, opacity: float) -> None:
    """Let the front of a surface be seen through, more where it faces the camera, and its back not be seen at all.

    Without the back, the walls of a liver's hollows do not cover the tumours that fill them.
    """
    tree = material.node_tree
    output = next(node for node in tree.nodes if node.type == "OUTPUT_MATERIAL")
    solid = output.inputs["Surface"].links[0].from_socket
    clear = tree.nodes.new("ShaderNodeBsdfTransparent")
    mix = tree.nodes.new("ShaderNodeMixShader")
    tree.links.new(opacity_socket(tree, opacity), mix.inputs[0])
    tree.links.new(clear.outputs[0], mix.inputs[1])
    tree.links.new(solid, mix.inputs[2])
    tree.links.new(mix.outputs[0], output.inputs["Surface"])
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


def edge_geometry(thing: bpy.types.Object, edge: Colour, width: float) -> bpy.types.Material:
    """Triangle edges as bars of their own material; returns that.

    For Workbench, which has no nodes, and for EEVEE, whose wireframe node leaves dark stains from Blender 5.0 on.
    """
    material = surface_material("CTMC Edges", edge)
    thing.data.materials.append(material)
    wire = thing.modifiers.new("CTMC Edges", "WIREFRAME")
    wire.thickness, wire.use_replace, wire.material_offset, wire.use_even_offset = 2 * width, False, 1, False
    return material
