# SPDX-License-Identifier: GPL-3.0-or-later
"""Make the world of the studio: one color or a gradient behind the surfaces, and a soft light from all sides."""

from __future__ import annotations

from typing import Any, NamedTuple

import bpy

from ..colors import Color
from ..materials import math_node, mixed, use_nodes
from ..sockets import input_of, output_of

NAME = "CTMC Studio"
LIGHTEST = 1.1  # White that stays white after the denoiser, which darkens the border of a picture.
CORNER = 0.75  # Distance from the middle at which a gradient ends, as a share of the picture.


class _Background(NamedTuple):
    """A background.

    Parameters
    ----------
    middle, edge : (red, green, blue) float
        Linear colors in the middle and in the corners of the picture.
    ambient : float
        Strength of the light from all sides.
    transparent : bool
        Whether the picture has no background at all.
    """

    middle: Color
    edge: Color
    ambient: float
    transparent: bool = False


BACKGROUNDS = {
    "GRADIENT": _Background((0.11, 0.125, 0.15), (0.012, 0.014, 0.018), 0.22),
    "DARK": _Background((0.012, 0.013, 0.016), (0.012, 0.013, 0.016), 0.22),
    "WHITE": _Background((LIGHTEST,) * 3, (LIGHTEST,) * 3, 0.4),
    "TRANSPARENT": _Background((0.1, 0.1, 0.1), (0.1, 0.1, 0.1), 0.3, transparent=True),
}


def is_studio_world(world: bpy.types.World | None) -> bool:
    """Return whether a world is the studio's."""
    return world is not None and world.name.partition(".")[0] == NAME


def show_background(scene: bpy.types.Scene, name: str) -> None:
    """Give a scene the world of a background, instead of an earlier one of the studio."""
    old = scene.world
    scene.world = studio_world(name)
    scene.render.film_transparent = BACKGROUNDS[name].transparent
    if old is not None and is_studio_world(old) and not old.users:
        bpy.data.worlds.remove(old)
        scene.world.name = NAME


def studio_world(name: str) -> bpy.types.World:
    """Return a world of a background's colors to the camera, and a soft white light to what it lights."""
    background, world = BACKGROUNDS[name], bpy.data.worlds.new(NAME)
    use_nodes(world)
    tree = world.node_tree
    tree.nodes.clear()
    output, path = (tree.nodes.new(kind) for kind in ("ShaderNodeOutputWorld", "ShaderNodeLightPath"))
    light, seen = (_even(tree, color) for color in ((background.ambient,) * 3, background.middle))
    if background.middle != background.edge:
        seen = mixed(tree, _distance_from_middle(tree), seen, _even(tree, background.edge))
    tree.links.new(mixed(tree, path.outputs["Is Camera Ray"], light, seen), output.inputs["Surface"])
    world.color = background.middle
    return world


def _even(tree: Any, color: Color) -> Any:
    """Return the socket of a background of one color."""
    node = tree.nodes.new("ShaderNodeBackground")
    node.inputs["Color"].default_value = (*color, 1.0)
    return output_of(node, "Background")


def _distance_from_middle(tree: Any) -> Any:
    """Return the socket of a number that rises from 0 in the middle of the picture to 1 in its corners."""
    place = tree.nodes.new("ShaderNodeTexCoord")
    parts = tree.nodes.new("ShaderNodeSeparateXYZ")
    tree.links.new(place.outputs["Window"], parts.inputs["Vector"])
    shifts = [math_node(tree, "SUBTRACT", parts.outputs[axis], middle) for axis, middle in (("X", 0.5), ("Y", 0.55))]
    squares = [math_node(tree, "MULTIPLY", shift, shift) for shift in shifts]
    ramp = tree.nodes.new("ShaderNodeMapRange")
    ramp.interpolation_type = "SMOOTHSTEP"
    input_of(ramp, "From Max").default_value = CORNER
    tree.links.new(math_node(tree, "SQRT", math_node(tree, "ADD", *squares)), input_of(ramp, "Value"))
    return output_of(ramp, "Result")
