"""The distance to the full surface on a surface's own vertices, as numbers and as colours."""

from __future__ import annotations

import bpy
import numpy as np
from numpy.typing import NDArray

MILLIMETRES = "deviation_mm"
COLOURS = "deviation"
# From near to far, linear RGB; dark to light, so that it can be read without colour too (after viridis).
STOPS = np.array(
    [(0.06, 0.0, 0.09), (0.05, 0.08, 0.26), (0.02, 0.23, 0.26), (0.10, 0.48, 0.12), (0.98, 0.80, 0.02)], np.float64
)


def paint_deviation(mesh: bpy.types.Mesh, distances_mm: NDArray[np.float64]) -> None:
    """Keep (V,) distances on the mesh, and colours from none to the largest; solid view shows them as Attribute."""
    numbers = mesh.attributes.get(MILLIMETRES) or mesh.attributes.new(MILLIMETRES, "FLOAT", "POINT")
    numbers.data.foreach_set("value", np.ascontiguousarray(distances_mm, np.float32))
    colours = mesh.color_attributes.get(COLOURS) or mesh.color_attributes.new(COLOURS, "FLOAT_COLOR", "POINT")
    colours.data.foreach_set("color", colours_of(distances_mm).ravel())
    mesh.color_attributes.active_color_name = COLOURS


def colours_of(distances_mm: NDArray[np.float64]) -> NDArray[np.float32]:
    """(n, 4) float32 linear RGBA of (n,) distances, from none to the largest of them."""
    share = distances_mm / (float(distances_mm.max(initial=0.0)) or 1.0) * (len(STOPS) - 1)
    low = np.minimum(share.astype(np.int64), len(STOPS) - 2)
    along = (share - low)[:, None]
    out = np.ones((len(distances_mm), 4), np.float32)
    out[:, :3] = STOPS[low] * (1.0 - along) + STOPS[low + 1] * along
    return out
