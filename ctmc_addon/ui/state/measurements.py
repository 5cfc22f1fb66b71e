"""What was measured of a surface, kept with its object: it comes back with undo and with the file.

It holds for the mesh and alpha that were measured; for any other state of the object nothing is shown.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass

import bpy
import numpy as np

from ...core import Stages, Steps, TriangleMesh
from ...core.mesh import Measures, ReferenceSurface, SurfaceDistance, measures_steps, surface_distance_steps

PROPERTY = "ctmc_measurement"
"""The object's custom property that holds it."""
STAGES = {"Measuring": 2, "Measuring the distance to the full surface": 3}


@dataclass(frozen=True)
class Measurement:
    """Measures of a surface, and its distance to the full surface in mm, where it is simplified and that is known."""

    measures: Measures
    distance: SurfaceDistance | None = None


def measurement_steps(mesh: TriangleMesh, full: TriangleMesh | None) -> Steps[Measurement]:
    """Measure a surface, and how far simplification has moved it; both meshes in RAS+ mm."""
    stages = Stages(STAGES)
    measuring, comparing = STAGES
    measures = yield from stages.run(measuring, measures_steps(mesh.vertices, mesh.faces))
    if full is None or len(mesh.faces) >= len(full.faces):
        return Measurement(measures)
    distance = surface_distance_steps(mesh, ReferenceSurface(full))
    return Measurement(measures, (yield from stages.run(comparing, distance)))


def alpha_of(obj: bpy.types.Object) -> float | None:
    """Where the shape key `alpha` of an object stands; None where its alpha is fixed."""
    keys = obj.data.shape_keys
    key = None if keys is None else keys.key_blocks.get("alpha")
    return None if key is None else float(key.value)


def mesh_state(obj: bpy.types.Object, alpha: float | None) -> list[float | None]:
    """What tells one state of an object's mesh from another, as JSON gives it back."""
    return [len(obj.data.polygons), len(obj.data.vertices), None if alpha is None else float(np.float32(alpha))]


def keep(obj: bpy.types.Object, measurement: Measurement, alpha: float | None) -> None:
    """Note on an object what was measured of its mesh at this alpha; None where alpha is fixed."""
    obj[PROPERTY] = json.dumps({"state": mesh_state(obj, alpha), **asdict(measurement)})


def of(obj: bpy.types.Object) -> Measurement | None:
    """What was measured of an object as it is now; None where that is not known."""
    try:
        stored = json.loads(obj[PROPERTY])
        if stored["state"] != mesh_state(obj, alpha_of(obj)):
            return None
        distance = stored["distance"]
        return Measurement(Measures(**stored["measures"]), None if distance is None else SurfaceDistance(**distance))
    except (KeyError, TypeError, ValueError):
        return None  # of an older version, or another add-on's property
