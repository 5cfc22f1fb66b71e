# SPDX-License-Identifier: GPL-3.0-or-later
"""Move objects apart for an exploded view: for a figure, and in a .blend by their delta locations."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import shifts_of
from ..core.volume import transform_points
from .surface import mesh_data as meshes
from .surface.evaluate import evaluated_object
from .surface.placement import matrix_of
from .surface.readback import placement_of

Shift = tuple[float, float, float]


def triangles_in_scene(
    obj: bpy.types.Object, scene: bpy.types.Scene | None
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return the evaluated vertices of an object, (V, 3) in the scene, and its triangles, (F, 3).

    Parameters
    ----------
    scene : Scene or None
        Scene in which it is evaluated; None takes the first that holds it.
    """
    with evaluated_object(obj, scene) as (evaluated, _):
        points = transform_points(matrix_of(evaluated.matrix_world), meshes.read_positions(evaluated.data))
        return points, meshes.read_triangles(evaluated.data)


def scene_shifts(objects: Sequence[Any], triangles: Sequence[tuple[Any, Any]], explode: float) -> list[Shift]:
    """Return the shift of each object in an exploded view, Blender units.

    Parameters
    ----------
    triangles : sequence of (vertices, faces)
        As `triangles_in_scene` has them.
    explode : float
        Shift of the farthest, mm in the patient.
    """
    shifts = shifts_of(triangles, explode * placement_of(objects[0]).scale)
    return [(x, y, z) for x, y, z in shifts.tolist()]


@contextmanager
def moved_apart(objects: Sequence[bpy.types.Object], scene: bpy.types.Scene | None, explode: float) -> Iterator[None]:
    """Move objects apart by their delta locations within the block; their locations and meshes stay in the patient."""
    before = [obj.delta_location.copy() for obj in objects]
    if explode and len(objects) > 1:
        shifts = scene_shifts(objects, [triangles_in_scene(obj, scene) for obj in objects], explode)
        for obj, shift in zip(objects, shifts, strict=True):
            obj.delta_location = [here + part for here, part in zip(obj.delta_location, shift, strict=True)]
    try:
        yield
    finally:
        for obj, delta in zip(objects, before, strict=True):
            obj.delta_location = delta
