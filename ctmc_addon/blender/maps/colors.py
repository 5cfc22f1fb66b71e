# SPDX-License-Identifier: GPL-3.0-or-later
"""Write the colors of a map to the vertices, which Solid shading shows as Attribute."""

from __future__ import annotations

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core.maps import NO_VALUE, colors_of, linear, rgb_of
from .stored import StoredMap, map_values

COLORS = "ctmc_map"
"""Name of the color attribute of the vertices."""
SHADES = 1024
"""Number of colors along a ramp."""


def paint(mesh: bpy.types.Mesh, stored: StoredMap) -> None:
    """Write the colors of a map to its mesh, and make them the shown color attribute."""
    attribute = mesh.color_attributes.get(COLORS) or mesh.color_attributes.new(COLORS, "FLOAT_COLOR", "POINT")
    colors = vertex_colors(map_values(mesh, stored.name), stored.range, stored.ramp)
    attribute.data.foreach_set("color", colors.ravel())
    mesh.color_attributes.active_color_name = COLORS
    mesh.update()


def unpaint(mesh: bpy.types.Mesh) -> None:
    """Remove the colors of a map from a mesh."""
    attribute = mesh.color_attributes.get(COLORS)
    if attribute is not None:
        mesh.color_attributes.remove(attribute)


def vertex_colors(values: NDArray[np.float32], range_: tuple[float, float], ramp: str) -> NDArray[np.float32]:
    """Return the linear RGBA of values, (V, 4) float32.

    Parameters
    ----------
    values : (V,) float32
    range_ : (low, high) float
    ramp : str
    """
    low, high = range_
    shades = np.empty((SHADES + 1, 4), np.float32)
    along = np.linspace(0.0, 1.0, SHADES).astype(np.float32)
    shades[:SHADES] = [linear(tuple(color / 255)) for color in colors_of(along, (0.0, 1.0), ramp).astype(np.float64)]
    shades[SHADES] = linear(rgb_of(NO_VALUE))
    with np.errstate(invalid="ignore"):
        at = (values - np.float32(low)) * np.float32((SHADES - 1) / (high - low))
    np.clip(at, 0, SHADES - 1, out=at)
    at[np.isnan(at)] = SHADES
    return shades[(at + np.float32(0.5)).astype(np.int32)]
