# SPDX-License-Identifier: GPL-3.0-or-later
"""Show a slice: its gray values as a picture in the file, and a material for it.

The picture holds the values themselves, HU of a CT, in 32 bit floats, and in its alpha what is not air around the body;
window and level are nodes of the material. Where on the picture a point lies is worked out from its place in the
plane's own space, so that the cut through a surface (cut.py) shows the slice with the same material. Solid shading
knows no nodes: it shows the material's active picture, a second one in the grays of window and level, by the UV map.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core.volume import windowed
from ..materials import clear_shader, dot_node, math_node, mixed, use_nodes
from ..sockets import input_of, output_of

VALUES, SOLID, WINDOW = "Values", "Solid Shading", "Window and Level"  # Labels of nodes.
UV = "UVMap"
DISPLAY_GAMMA = 2.2  # Makes grays look as in the sidebar's slice, because a render takes them as linear.


def slice_material(
    name: str,
    values: NDArray[Any],
    obj: bpy.types.Object,
    corners: NDArray[np.float64],
    window: float,
    level: float,
    outside: NDArray[np.bool_] | None = None,
) -> bpy.types.Material:
    """Return a material that shows values (rows, columns) at their position in the plane of `obj`.

    `corners` are those of the picture, (4, 3) in the object's space; samples `outside` the body are transparent. The
    first row is at the picture's bottom.
    """
    rows, columns = values.shape
    material = bpy.data.materials.new(name)
    use_nodes(material)
    tree = material.node_tree
    tree.nodes.clear()
    in_object = tree.nodes.new("ShaderNodeTexCoord")
    in_object.object = obj
    coordinates = tree.nodes.new("ShaderNodeCombineXYZ")
    for axis, weights in zip("XY", picture_coordinates(corners), strict=True):
        share = dot_node(tree, output_of(in_object, "Object"), weights)
        half = math_node(tree, "ADD", share, 0.5)
        tree.links.new(half, input_of(coordinates, axis))
    picture = bpy.data.images.new(name, columns, rows, alpha=True, float_buffer=True, is_data=True)
    picture.alpha_mode = "CHANNEL_PACKED"
    shown = _picture_node(tree, VALUES, picture)
    tree.links.new(output_of(coordinates, "Vector"), input_of(shown, "Vector"))
    gray = tree.nodes.new("ShaderNodeMapRange")
    gray.label = WINDOW
    tree.links.new(shown.outputs["Color"], gray.inputs["Value"])
    light = tree.nodes.new("ShaderNodeGamma")
    light.inputs["Gamma"].default_value = DISPLAY_GAMMA
    tree.links.new(gray.outputs["Result"], light.inputs["Color"])
    shader = tree.nodes.new("ShaderNodeEmission")
    tree.links.new(light.outputs["Color"], shader.inputs["Color"])
    body = math_node(tree, "GREATER_THAN", shown.outputs["Alpha"], 0.5)
    body.node.label = "Not Air"
    mix = mixed(tree, body, clear_shader(tree), output_of(shader, "Emission"))
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(mix, output.inputs["Surface"])
    tree.nodes.active = _picture_node(tree, SOLID, bpy.data.images.new(f"{name} {SOLID}", columns, rows, alpha=True))
    for number, node in enumerate(tree.nodes):
        node.location = (220 * (number // 3), -200 * (number % 3))
    set_window(material, window, level)
    paint(material, values, outside)
    pack(material)
    return material


def _picture_node(tree: Any, label: str, picture: bpy.types.Image) -> Any:
    node = tree.nodes.new("ShaderNodeTexImage")
    node.label, node.image, node.interpolation, node.extension = label, picture, "Linear", "EXTEND"
    return node


def picture_of(material: bpy.types.Material | None, label: str = VALUES) -> bpy.types.Image | None:
    """Return a picture of a slice's material; None where a user has removed it."""
    return getattr(_node_of(material, label), "image", None)


def _node_of(material: bpy.types.Material | None, label: str) -> Any:
    nodes = () if material is None or material.node_tree is None else material.node_tree.nodes
    return next((node for node in nodes if node.label == label), None)


def paint(material: bpy.types.Material, values: NDArray[Any], outside: NDArray[np.bool_] | None = None) -> None:
    """Replace the values of a slice's pictures; they are packed again when the file is saved.

    Parameters
    ----------
    material : bpy.types.Material
    values : (rows, columns) numbers
    outside : (rows, columns) bool, optional
        Air around the body, which is transparent.
    """
    picture = picture_of(material)
    if picture is None:
        return
    pixels = np.ones((*values.shape, 4), np.float32)
    pixels[..., :3] = values[..., None]
    if outside is not None:
        pixels[..., 3] = ~outside
    picture.pixels.foreach_set(pixels.reshape(-1))
    picture.update()
    show_in_solid(material)


def show_in_solid(material: bpy.types.Material) -> None:
    """Update the picture that Solid shading shows from the values, window and level."""
    picture, shown, gray = picture_of(material), picture_of(material, SOLID), _node_of(material, WINDOW)
    if picture is None or shown is None or gray is None or tuple(shown.size) != tuple(picture.size):
        return
    values = np.empty(4 * picture.size[0] * picture.size[1], np.float32)
    picture.pixels.foreach_get(values)
    values = values.reshape(-1, 4)
    low, high = (gray.inputs[name].default_value for name in ("From Min", "From Max"))
    colors = windowed(values[:, 0], high - low, (low + high) / 2)
    colors[:, 3] = values[:, 3]
    shown.pixels.foreach_set(colors.reshape(-1))
    shown.update()


def set_window(material: bpy.types.Material, window: float, level: float) -> None:
    """Change window and level of a slice's material.

    Parameters
    ----------
    material : bpy.types.Material
    window : float
        Width of the gray scale, in the values' unit.
    level : float
        Its middle.
    """
    gray = _node_of(material, WINDOW)
    if gray is not None:
        gray.inputs["From Min"].default_value = level - window / 2
        gray.inputs["From Max"].default_value = level + window / 2


def pack(material: bpy.types.Material) -> None:
    """Pack new and updated pictures into the .blend."""
    for picture in (picture_of(material), picture_of(material, SOLID)):
        if picture is not None and (picture.is_dirty or picture.packed_file is None):
            picture.pack()


def picture_coordinates(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (2, 3) matrix from a point in the plane to its share along columns and rows; 0 is the middle.

    The sides may be oblique to each other, as in the slices of a tilted gantry.

    Examples
    --------
    >>> square = np.array([[-1, -2, 0], [1, -2, 0], [1, 2, 0], [-1, 2, 0.0]])
    >>> picture_coordinates(square).tolist()
    [[0.5, 0.0, 0.0], [0.0, 0.25, 0.0]]
    """
    sides = np.stack([corners[1] - corners[0], corners[3] - corners[0]])  # (2, 3)
    weights: NDArray[np.float64] = np.linalg.pinv(sides).T + 0.0
    return weights
