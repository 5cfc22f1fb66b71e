# SPDX-License-Identifier: GPL-3.0-or-later
"""A slice as a plane at its place in the patient, with its gray values as a picture in the file.

The picture holds the values themselves, HU of a CT, in 32 bit floats; window and level are nodes of the material. Where
on the picture a point lies is worked out from its place in the plane's own space, so that the cut through a surface
(cut.py) shows the slice with the same material.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core import Volume
from ...core.volume import SliceIndex, slice_corners, slice_values
from ..ct_box import link_beside_ct
from ..materials import use_nodes

SLICE = "ctmc_slice_of"  # property of the object: the fingerprint of its CT
PLANE = "ctmc_slice_plane"  # which of `PLANES` it was made in
SHOWN = "ctmc_slice_shown"  # where its picture was taken: its corners, RAS+ mm
AIR = -800.0  # HU at and below which a slice of a CT is transparent


def is_slice(obj: bpy.types.Object | None) -> bool:
    """Whether an object was made by `add_slice`."""
    return obj is not None and obj.type == "MESH" and SLICE in obj


def add_slice(
    scene: bpy.types.Scene,
    volume: Volume,
    section: SliceIndex,
    plane: str,
    window: float,
    level: float,
    scale: float,
    fingerprint: str = "",
) -> bpy.types.Object:
    """Add a slice to a scene.

    Parameters
    ----------
    section : SliceIndex
        Which slice.
    plane : str
        What it is called: 'axial', 'coronal' or 'sagittal'.
    window, level : float
        Of its material, in the volume's values.
    scale : float
        Blender units of 1 mm.
    """
    name = f"{volume.name} {plane}"
    corners_mm = slice_corners(volume, section)  # (4, 3): row and column 0; last column; both last; last row
    corners = corners_mm * scale
    middle = corners.mean(axis=0)
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata((corners - middle).tolist(), [], [(0, 1, 2, 3)])
    obj = bpy.data.objects.new(name, mesh)
    obj.location = middle.tolist()
    obj[SLICE], obj[PLANE], obj[SHOWN] = fingerprint, plane, corners_mm.ravel().tolist()
    link_beside_ct(scene, obj, fingerprint)
    picture = slice_picture(name, slice_values(volume, section))
    air = AIR if volume.kind == "HU" else None
    mesh.materials.append(slice_material(name, picture, obj, corners - middle, window, level, air))
    return obj


def slice_picture(name: str, values: NDArray[Any]) -> bpy.types.Image:
    """Values (rows, columns) as a picture of floats inside the .blend, the first row at the bottom."""
    rows, columns = values.shape
    image = bpy.data.images.new(name, columns, rows, alpha=False, float_buffer=True, is_data=True)
    paint(image, values)
    image.pack()
    return image


def paint(image: bpy.types.Image, values: NDArray[Any]) -> None:
    """Give a picture other values; it is packed again when the file is saved."""
    pixels = np.ones((*values.shape, 4), np.float32)
    pixels[..., :3] = values[..., None]
    image.pixels.foreach_set(pixels.reshape(-1))
    image.update()


def slice_material(
    name: str,
    picture: bpy.types.Image,
    obj: bpy.types.Object,
    corners: NDArray[np.float64],
    window: float,
    level: float,
    air: float | None,
) -> bpy.types.Material:
    """A material that shows the picture wherever it is put, as it lies in the plane of `obj`.

    `corners` are those of the picture, (4, 3) in the object's space; what is at or below `air` is transparent.
    """
    material = bpy.data.materials.new(name)
    use_nodes(material)
    tree = material.node_tree
    tree.nodes.clear()
    place = tree.nodes.new("ShaderNodeTexCoord")
    place.object = obj
    coordinates = tree.nodes.new("ShaderNodeCombineXYZ")
    for axis, weights in enumerate(picture_coordinates(corners)):
        share = tree.nodes.new("ShaderNodeVectorMath")
        share.operation = "DOT_PRODUCT"
        share.inputs[1].default_value = weights
        tree.links.new(place.outputs["Object"], share.inputs[0])
        half = tree.nodes.new("ShaderNodeMath")
        half.inputs[1].default_value = 0.5
        tree.links.new(share.outputs["Value"], half.inputs[0])
        tree.links.new(half.outputs[0], coordinates.inputs[axis])
    values = tree.nodes.new("ShaderNodeTexImage")
    values.image, values.interpolation, values.extension = picture, "Linear", "EXTEND"
    tree.links.new(coordinates.outputs[0], values.inputs[0])
    gray = tree.nodes.new("ShaderNodeMapRange")
    gray.label = "Window and Level"
    gray.inputs["From Min"].default_value = level - window / 2
    gray.inputs["From Max"].default_value = level + window / 2
    tree.links.new(values.outputs["Color"], gray.inputs["Value"])
    shader = tree.nodes.new("ShaderNodeEmission")
    tree.links.new(gray.outputs["Result"], shader.inputs["Color"])
    shown = shader.outputs[0]
    if air is not None:
        tissue = tree.nodes.new("ShaderNodeMath")
        tissue.operation = "GREATER_THAN"
        tissue.label = "Not Air"
        tissue.inputs[1].default_value = air
        tree.links.new(values.outputs["Color"], tissue.inputs[0])
        clear, mix = tree.nodes.new("ShaderNodeBsdfTransparent"), tree.nodes.new("ShaderNodeMixShader")
        for socket, source in zip(mix.inputs, (tissue.outputs[0], clear.outputs[0], shown), strict=True):
            tree.links.new(source, socket)
        shown = mix.outputs[0]
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(shown, output.inputs["Surface"])
    for number, node in enumerate(tree.nodes):
        node.location = (220 * (number // 3), -200 * (number % 3))
    return material


def picture_coordinates(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """What to multiply a place in the plane with for its share along the columns and the rows, (2, 3); 0 is the middle.

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
