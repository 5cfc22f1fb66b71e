"""What is measured of a surface for the panel's results."""

from __future__ import annotations

from dataclasses import dataclass

from ...blender.surface import Closeness, closeness_steps
from ...core import Reconstruction, Steps, within
from ...core.mesh import Measures, measures_steps


@dataclass(frozen=True)
class Result:
    """What the panel shows of a surface: measures, triangles before, distance to the full surface in mm."""

    measures: Measures
    full_faces: int
    closeness: Closeness | None = None


def result_steps(made: Reconstruction, full: Reconstruction) -> Steps[Result]:
    """Measure a surface, and how far simplification has moved it."""
    measures = yield from within(measures_steps(made.mesh), 0.0, 0.4)
    closeness = None
    if len(made.mesh.faces) < len(full.mesh.faces):
        closeness = yield from within(closeness_steps(made.mesh, full.mesh), 0.4, 1.0)
    return Result(measures, made.full_faces, closeness)
