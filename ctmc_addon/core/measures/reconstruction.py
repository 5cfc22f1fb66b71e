# SPDX-License-Identifier: GPL-3.0-or-later
"""A finished surface, and how it came about."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...version import VERSION
from ..maps.surface_map import SurfaceMap
from ..mesh.measures import Measures
from ..mesh.triangle_mesh import Surface, TriangleMesh
from ..settings import ReconstructionSettings
from .measures import FinishedSurface, Place, values_in

if TYPE_CHECKING:
    from ..maps.surface_map import SurfaceMap
    from ..mesh.angles.alpha_choice import AlphaChoice
    from ..mesh.labels.label_complex import Neighbor
    from ..solid.printing.print_facts import PrintFacts
    from ..solid.request import SolidRequest

OPEN_NOTE = "The surface is open, so it has no volume; close_border closes it at the border of the volume or region."


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
        Assumptions of the reader and the reconstruction, in sentences.
    name : str
        The volume's name.
    removed_components : int
        Small components that the settings asked to remove (`keep_parts`, `min_part_mm3`), cavities among them.
    collapsed_components : int
        Small components that the built-in simplifier removed as a whole.
    collapsed_mm3 : float
        Volume that these enclosed when they went; in a surface of millions of triangles they shrank before.
    slice_steps : int
        Steps from slice to slice that smoothing has made.
    wrong_side : int or None
        Samples of the label on the wrong side of the surface at stride 1, before simplification; None for a threshold.
    label_name : str
        Name of the label in the volume; empty if it has none.
    label_color : (red, green, blue) int or None
        sRGB from 0 to 255, where the volume has one for the label.
    self_intersections : int or None
        Pairs of triangles of the surface that cross, touch or overlap each other beyond common vertices and edges; None
        where that is not known. A full surface has none: every triangle lies in its own cell, on edges that vertices
        never leave, and cells meet only in faces, which both cut alike. They were counted after simplification, and of
        labels that share interfaces, where a pair of two labels counts for both.
    measured : Measures or None
        Measures of a surface that was written piece by piece, whose mesh is empty.
    beyond : (F,) int32 or None
        The label in front of each triangle of the mesh, 0 for none, where neighbors share their interfaces.
    components : (F,) int32 or None
        The component of each triangle of the mesh, if it was looked for.
    neighbors : tuple of Neighbor
        The labels that the surface borders on, with triangles and area.
    sharing_labels : tuple of int
        The labels that were made at once with it, its own among them, and share walls where they touch; empty for a
        surface made by itself.
    alpha_choice : AlphaChoice or None
        Choice of alpha from the surface; None if alpha was given.
    maps : tuple of SurfaceMap
        Values on the vertices of the mesh.
    solid : SolidRequest or None
        Request that the surface is a part of; None for a surface as it was extracted.
    part_number : int
        Of the part among those of its structure, from 0; it decides the shade of the structure's color.
    printing : PrintFacts or None
        Facts for a print lab, of a part for print.
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
    collapsed_components: int = 0
    collapsed_mm3: float = 0.0
    slice_steps: int = 1
    wrong_side: int | None = None
    label_name: str = ""
    label_color: tuple[int, int, int] | None = None
    self_intersections: int | None = None
    measured: Measures | None = None
    beyond: NDArray[np.int32] | None = None
    components: NDArray[np.int32] | None = None
    neighbors: tuple[Neighbor, ...] = ()
    sharing_labels: tuple[int, ...] = ()
    alpha_choice: AlphaChoice | None = None
    maps: tuple[SurfaceMap, ...] = ()
    solid: SolidRequest | None = None
    part_number: int = 0
    printing: PrintFacts | None = None

    @property
    def measures(self) -> Measures:
        """Measures of the mesh, or of the pieces that were written."""
        return self.measured or self.mesh.measures

    @property
    def finished(self) -> FinishedSurface:
        """Return the known measures of the surface."""
        return FinishedSurface(
            measures=self.measures,
            full_faces=self.full_faces,
            removed_components=self.removed_components,
            collapsed_components={"count": self.collapsed_components, "mm3": self.collapsed_mm3},
            self_intersections=self.self_intersections,
            maps={each.name: each for each in self.maps},
            printing=self.printing,
        )

    def report(self) -> dict[str, Any]:
        """Return counts, measures and settings as plain data for JSON."""
        return {
            "name": self.name,
            "version": VERSION,
            "label": self.settings.label,
            "label_name": self.label_name,
            **values_in(Place.REPORT, self.finished),
            "alpha": self.settings.alpha,
            "alpha_choice": None if self.alpha_choice is None else self.alpha_choice.report(),
            "threshold": self.threshold,
            "voxels_visited": self.voxels_visited,
            "smoothing": self.settings.smoothing_method,
            "slice_steps": self.slice_steps,
            "wrong_side": self.wrong_side,
            "neighbors": [neighbor._asdict() for neighbor in self.neighbors],
            "stages": [stage._asdict() for stage in self.stages],
            "settings": self.settings.to_dict(),
            "spacing_mm": list(self.spacing_mm),
            "maps": [each.about() for each in self.maps],
            "solid": None if self.solid is None else self.solid.to_dict(),
            "print": None if self.printing is None else self.printing.report(),
            "notes": [*self.notes, *(() if self.measures.closed else (OPEN_NOTE,))],
        }
