# SPDX-License-Identifier: GPL-3.0-or-later
"""Set the direction of a 3D viewport: framed on a box, from a side of the patient.

RAS axes are Blender's axes, so a side of the patient is an axis of the scene.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix, Vector
from numpy.typing import NDArray

# The eye stands there; what points up in the picture. From the head and the feet the patient's front is up.
SIDES = {
    "A": ((0, 1, 0), (0, 0, 1)),
    "P": ((0, -1, 0), (0, 0, 1)),
    "L": ((-1, 0, 0), (0, 0, 1)),
    "R": ((1, 0, 0), (0, 0, 1)),
    "S": ((0, 0, 1), (0, 1, 0)),
    "I": ((0, 0, -1), (0, 1, 0)),
}
SENSOR = 36.0  # Half of the length in mm that a viewport's lens sees along its longer side at its own focal length.
FAR = 20_000  # Pixels beyond any usual zoom.
NEAR = 1e-4  # Objects within this many Blender units of the plane are shown.
AIR = 1.08  # Room around a framed box.
LETTERS = 1.2  # Room around a framed box with letters around it.
# Where a bar lies on a viewport: right and up.
BARS = {"RIGHT": (1.0, 0.0), "LEFT": (-1.0, 0.0), "TOP": (0.0, 1.0), "BOTTOM": (0.0, -1.0)}
MOST = 0.6  # Bars may cover this share of a view on one side; more is not compensated.


def _rotation_from(side: str) -> Any:
    """Return the rotation of a viewport that looks from a side, one letter of A P L R S I."""
    back, up = (Vector(axis) for axis in SIDES[side])
    right = up.cross(back)
    return Matrix((right, up, back)).transposed().to_quaternion()


def is_held(space: Any, view: Any) -> bool:
    """Return whether a camera, an object or the cursor holds a viewport, which then moves only on request."""
    return bool(view.view_perspective == "CAMERA" or space.lock_object is not None or space.lock_cursor)


def region_of(area: Any, view: Any) -> Any:
    """Return the region of a viewport that shows this view: one of four in quad view."""
    regions = [region for region in area.regions if region.type == "WINDOW"]
    return next((region for region in regions if region.data == view), regions[0])


def clip(window: Any, area: Any, view: Any) -> None:
    """Enable Blender's clipping of a view, with planes beyond everything; `show_from` moves one."""
    if not view.use_clip_planes:  # The property by itself clips nothing.
        with bpy.context.temp_override(window=window, area=area, region=region_of(area, view)):
            bpy.ops.view3d.clip_border(xmin=-FAR, xmax=FAR, ymin=-FAR, ymax=FAR)


def show_from(view: Any, point: Sequence[float]) -> None:
    """Hide everything between the eye and the plane through a point, in Solid and Wireframe of a view that clips."""
    away = view.view_rotation @ Vector((0.0, 0.0, -1.0))
    view.clip_planes = [(*away, NEAR - away.dot(Vector(point)))] * 6


def _covered_in(area: Any, region: Any) -> dict[str, float]:
    """Return how many pixels of a region sidebars and headers cover on each side that `BARS` names."""
    covered = dict.fromkeys(BARS, 0.0)
    for bar in area.regions if bpy.context.preferences.system.use_region_overlap else ():
        if bar.type not in ("UI", "TOOLS", "HEADER", "TOOL_HEADER") or bar.alignment not in BARS:
            continue
        x = min(region.x + region.width, bar.x + bar.width) - max(region.x, bar.x)
        y = min(region.y + region.height, bar.y + bar.height) - max(region.y, bar.y)
        if min(bar.width, bar.height) > 1 and min(x, y) > 0:
            is_vertical = BARS[bar.alignment][0] != 0
            covered[bar.alignment] += min(x, MOST * region.width) if is_vertical else min(y, MOST * region.height)
    return covered


def frame(area: Any, space: Any, view: Any, corners: NDArray[np.float64], side: str = "") -> None:
    """Frame a box in the part of a viewport that no bar covers, from `side` or from the present direction.

    Parameters
    ----------
    area, space, view : bpy.types.Area, bpy.types.SpaceView3D, bpy.types.RegionView3D
    corners : (8, 3) float64
        Corners of the box, Blender units.
    """
    if side and not view.lock_rotation:
        view.view_rotation = _rotation_from(side)
    if view.view_perspective == "CAMERA":
        view.view_perspective = "PERSP"
    region = region_of(area, view)
    covered = _covered_in(area, region)
    width = max(region.width - covered["LEFT"] - covered["RIGHT"], 1.0)
    height = max(region.height - covered["TOP"] - covered["BOTTOM"], 1.0)
    longer = max(region.width, region.height, 1)
    low, high = corners.min(axis=0), corners.max(axis=0)
    if view.lock_rotation:  # A view of quad view: move as near as the box fits.
        right_up = np.array([view.view_rotation @ Vector(axis) for axis in ((1, 0, 0), (0, 1, 0))])
        sides = np.maximum(np.ptp(corners @ right_up.T, axis=0), 1e-6) * LETTERS
        distance = float((sides / (width, height)).max()) * longer * space.lens / (2 * SENSOR)
    else:
        # As far away as the shorter free side needs it for the sphere about the box.
        slope = SENSOR / space.lens * min(width, height) / longer
        radius = max(float(np.linalg.norm(corners - (low + high) / 2, axis=1).max()), 1e-6) * AIR
        distance = radius / (slope if view.view_perspective == "ORTHO" else math.sin(math.atan(slope)))
    unit = 2 * distance * SENSOR / space.lens / longer  # Size of a pixel.
    right, up = np.array([np.array(BARS[way]) * pixels for way, pixels in covered.items()]).sum(axis=0) / 2 * unit
    view.view_location = Vector((low + high) / 2) + view.view_rotation @ Vector((right, up, 0.0))
    view.view_distance = distance
