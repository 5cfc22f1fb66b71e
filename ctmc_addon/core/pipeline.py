"""From a volume to a finished surface: the only place that orders the stages."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

from .mesh import Surface, TriangleMesh
from .settings import ReconstructionSettings
from .version import VERSION


class Stage(NamedTuple):
    """A stage's name and how long it took, seconds."""

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
        As asked for.
    threshold : float
        The grey value that was used: the setting, Otsu's, or half of a label's 0 and 1.
    full_faces : int
        Triangles before simplification.
    voxels_visited : int
        Cells of the strided grid inside the region, skipped or not.
    stages : tuple of Stage
        In the order they ran.
    spacing_mm : (x, y, z) float
        Of the volume.
    notes : tuple of str
        What was assumed, by the reader and here.
    name : str
        The volume's name.
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

    def report(self) -> dict[str, Any]:
        """The counts and measures as plain data for JSON."""
        mesh = self.mesh
        return {
            "name": self.name,
            "version": VERSION,
            "faces": len(mesh.faces),
            "vertices": len(mesh.vertices),
            "full_faces": self.full_faces,
            "volume_mm3": mesh.volume,
            "area_mm2": mesh.area,
            "closed": mesh.closed,
            "euler": mesh.euler,
            "parts": mesh.parts,
            "threshold": self.threshold,
            "voxels_visited": self.voxels_visited,
            "stages": [stage._asdict() for stage in self.stages],
            "settings": self.settings.to_dict(),
            "spacing_mm": list(self.spacing_mm),
            "notes": list(self.notes),
        }
