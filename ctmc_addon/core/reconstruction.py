# SPDX-License-Identifier: GPL-3.0-or-later
"""A finished surface, and how it came about."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

from .mesh.label_complex import ComplexSurface, Interface
from .mesh.measures import Measures
from .mesh.triangle_mesh import Surface, TriangleMesh
from .settings import ReconstructionSettings
from .version import VERSION

OPEN_NOTE = "The surface is open and encloses no volume; close_border closes it at the border of the volume or region."


class Stage(NamedTuple):
    """The name of a stage and the seconds that it took."""

    name: str
    seconds: float


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """A finished surface and how it came about; carries no patient identifiers.

    Parameters
    ----------
    mesh : TriangleMesh
        In RAS+ mm, at the alpha of the settings; simplified if the built-in simplifier was asked for.
    surface : Surface or None
        In RAS+ mm, both ends of alpha; None after the built-in simplifier, which fixes alpha.
    settings : ReconstructionSettings
    threshold : float
        The gray value that was used: the setting, Otsu's, or half of a label's 0 and 1.
    full_faces : int
        Triangles before simplification.
    voxels_visited : int
        Cells of the strided grid inside the region, skipped or not.
    stages : tuple of Stage
        The stages in the order in which they ran.
    spacing_mm : (x, y, z) float
        Spacing of the volume, millimeters.
    notes : tuple of str
        What the reader and the reconstruction assumed, in sentences.
    name : str
        The volume's name.
    removed_components : int
        Small components that the built-in simplifier removed as a whole.
    slice_steps : int
        Steps from slice to slice of a label that was smoothed as constrained.
    wrong_side : int or None
        Samples of the label on the wrong side of the surface at stride 1, before simplification; None for a threshold.
    label_name : str
        What the volume calls the label; empty where it has no name.
    label_color : (red, green, blue) int or None
        sRGB from 0 to 255, where the volume has one for the label.
    measured : Measures or None
        Measures of a surface that was written piece by piece, whose mesh is empty.
    """

    mesh: TriangleMesh
    surface: Surface | None
    settings: ReconstructionSettings
    threshold: float
    full_faces: int
    voxels_visited: int
    stages: tuple[Stage, ...]
    spacing_mm: tuple[float, float, float]
    notes: tuple[str, ...]
    name: str
    removed_components: int = 0
    slice_steps: int = 1
    wrong_side: int | None = None
    label_name: str = ""
    label_color: tuple[int, int, int] | None = None
    measured: Measures | None = None

    @property
    def measures(self) -> Measures:
        """Measures of the mesh, or of the pieces that were written."""
        return self.measured or self.mesh.measures

    def report(self) -> dict[str, Any]:
        """Return counts, measures and settings as plain data for JSON."""
        measures = self.measures
        return {
            "name": self.name,
            "version": VERSION,
            "label": self.settings.label,
            "label_name": self.label_name,
            "faces": measures.faces,
            "vertices": measures.vertices,
            "full_faces": self.full_faces,
            "volume_mm3": measures.enclosed_volume,
            "area_mm2": measures.area,
            "closed": measures.closed,
            "euler": measures.euler,
            "components": measures.components,
            "parts": measures.components,  # the name in reports of 0.2
            "removed_components": self.removed_components,
            "threshold": self.threshold,
            "voxels_visited": self.voxels_visited,
            "smoothing": self.settings.smoothing_method,
            "slice_steps": self.slice_steps,
            "wrong_side": self.wrong_side,
            "stages": [stage._asdict() for stage in self.stages],
            "settings": self.settings.to_dict(),
            "spacing_mm": list(self.spacing_mm),
            "notes": [*self.notes, *(() if measures.closed else (OPEN_NOTE,))],
        }


@dataclass(frozen=True, eq=False)
class LabelComplex:
    """The surfaces of several labels as one complex, and how they were made.

    Parameters
    ----------
    surface : ComplexSurface
        In RAS+ mm; its sides are the labels' values.
    settings : ReconstructionSettings
    labels : tuple of int
        That have a surface, rising.
    left_out : tuple of str
        A sentence for each label without one.
    thresholds : dict of int to float
        Of every label's field.
    notes : dict of int to tuple of str
        Of every label.
    wrong_side : dict of int to int
        Samples of the grid that are a label's and not its owner's, or the other way round.
    volumes_mm3, label_mm3 : dict of int to float
        What a label's surface encloses at alpha 1, closed at the border, and what its samples do in the same space.
    constants_mm : dict of int to float
        Added to a label's field beside those that it touches.
    slice_steps : int
    """

    surface: ComplexSurface
    settings: ReconstructionSettings
    labels: tuple[int, ...]
    left_out: tuple[str, ...]
    thresholds: dict[int, float]
    notes: dict[int, tuple[str, ...]]
    wrong_side: dict[int, int]
    volumes_mm3: dict[int, float]
    label_mm3: dict[int, float]
    constants_mm: dict[int, float]
    slice_steps: int

    @cached_property
    def interfaces(self) -> tuple[Interface, ...]:
        """Where labels meet, each other or nothing, at the settings' alpha in mm2."""
        return self.surface.at(self.settings.alpha).interfaces
