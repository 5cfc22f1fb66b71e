# SPDX-License-Identifier: GPL-3.0-or-later
"""Add a slice of the CT as a plane at its position in the patient."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core import Volume
from ...core.volume import SliceIndex, ValueKind, ends_of_body, outside_air, slice_corners, slice_values
from ..scene.ct_box import link_beside_ct
from .material import UV, slice_material

SLICE = "ctmc_slice_of"  # Custom property of the object: the fingerprint of its CT.
PLANE = "ctmc_slice_plane"  # Custom property: the plane of `PLANES` in which it was made.
SHOWN = "ctmc_slice_shown"  # Custom property: the corners of its picture, RAS+ mm.
CORNERS_UV = (0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 1.0)


def is_slice(obj: bpy.types.Object | None) -> bool:
    """Return whether an object was made by `add_slice`."""
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
        Name: 'axial', 'coronal' or 'sagittal'.
    window, level : float
        Window and level of its material, in the volume's values.
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
    mesh.uv_layers.new(name=UV).uv.foreach_set("vector", CORNERS_UV)
    values = slice_values(volume, section)
    outside = outside_body(volume, values, corners_mm)
    mesh.materials.append(slice_material(name, values, obj, corners - middle, window, level, outside))
    return obj


def outside_body(volume: Volume, values: NDArray[Any], corners_mm: NDArray[np.float64]) -> NDArray[np.bool_] | None:
    """Return which samples of a slice are air around the body; None where the values are not HU.

    Parameters
    ----------
    volume : Volume
    values : (rows, columns) numbers
    corners_mm : (4, 3) float64
        Corners of the slice, RAS+.

    Returns
    -------
    (rows, columns) bool, or None
    """
    return outside_air(values, ends_of_body(corners_mm)) if volume.kind == ValueKind.HU else None
