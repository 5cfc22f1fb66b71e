"""From a volume to a finished surface: the only place that orders the stages."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from .extraction.grid import make_grid
from .extraction.marching_cubes import extract_steps
from .memory import require
from .mesh.components import keep_components_steps
from .mesh.face_normals import vertex_normals_steps
from .mesh.triangle_mesh import Surface, TriangleMesh
from .progress import Pauses, Step, Steps, finish, said, within
from .settings import ReconstructionSettings
from .simplification.simplify import memory_needed, simplify_steps
from .version import VERSION
from .volume.region import region_box
from .volume.scalar_field import scalar_field_steps
from .volume.volume import Volume, determinant, normals_to_ras, to_ras_mm

T = TypeVar("T")
POINTS_AT_ONCE = 1 << 16  # carried to millimetres in one go, so the float64 in between stays small


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
            "volume_mm3": mesh.enclosed_volume,
            "area_mm2": mesh.area,
            "closed": mesh.closed,
            "euler": mesh.euler,
            "parts": mesh.components,
            "threshold": self.threshold,
            "voxels_visited": self.voxels_visited,
            "stages": [stage._asdict() for stage in self.stages],
            "settings": self.settings.to_dict(),
            "spacing_mm": list(self.spacing_mm),
            "notes": list(self.notes),
        }


def reconstruct(
    volume: Volume,
    settings: ReconstructionSettings,
    threads: int | None = None,
    memory_limit: int | None = None,
) -> Reconstruction:
    """Make a surface from a volume.

    Parameters
    ----------
    volume : Volume
    settings : ReconstructionSettings
    threads : int, optional
        By default one for each processor. The result does not depend on it.
    memory_limit : int, optional
        Bytes the work may take; by default what the machine has available.

    Raises
    ------
    CtmcError
        With one sentence for the user: no surface at these settings, NaN voxels, too little memory.

    Examples
    --------
    >>> ball = np.sqrt((np.indices((24, 24, 24)) - 11.5) ** 2).sum(axis=0) < 9
    >>> result = reconstruct(Volume(ball, np.eye(4)), ReconstructionSettings(threshold=0.5))
    >>> result.mesh.closed
    True
    """
    return finish(reconstruct_steps(volume, settings, threads, memory_limit))


def reconstruct_steps(
    volume: Volume,
    settings: ReconstructionSettings,
    threads: int | None = None,
    memory_limit: int | None = None,
) -> Steps[Reconstruction]:
    """`reconstruct` as steps; closing the generator cancels."""
    full = yield from within(full_steps(volume, settings, threads, memory_limit), 0.0, 0.65)
    result = yield from within(simplified_steps(full, settings, memory_limit), 0.65, 1.0)
    yield Step(1.0, "Surface ready")
    return result


def full_steps(
    volume: Volume,
    settings: ReconstructionSettings,
    threads: int | None = None,
    memory_limit: int | None = None,
) -> Steps[Reconstruction]:
    """The surface before the built-in simplifier, whatever the settings ask of it."""
    stages: list[Stage] = []
    region = region_box(volume, settings)
    visited = make_grid(volume.values, settings.stride, settings.close_border, region).voxels

    field = yield from _timed(
        stages, "Preparing values", within(scalar_field_steps(volume, settings, threads, memory_limit), 0.0, 0.3)
    )
    grid = make_grid(field.values, settings.stride, settings.close_border, field.window_in_values)
    gradient = settings.normals == "gradient"
    surface = yield from _timed(
        stages,
        "Extracting the surface",
        within(extract_steps(grid, field.threshold, gradient, threads, memory_limit, settings.topology), 0.3, 0.9),
    )
    affine = volume.affine.copy()
    affine[:3, 3] = to_ras_mm(volume.affine, np.array([field.origin], np.float64))[0]
    surface = yield from _timed(
        stages, "Placing it in the patient", said(_placed(surface, affine), 0.92, "Placing it in the patient")
    )
    mesh = surface.at(settings.alpha)
    if settings.keep_parts or settings.min_part_mm3:
        surface = yield from _timed(stages, "Keeping parts", _kept(surface, mesh, settings))
        mesh = surface.at(settings.alpha)
    return Reconstruction(
        mesh=mesh,
        surface=surface,
        settings=settings,
        threshold=field.threshold,
        full_faces=len(mesh.faces),
        voxels_visited=visited,
        stages=tuple(stages),
        spacing_mm=volume.spacing,
        notes=volume.notes + field.notes,
        name=volume.name,
    )


def simplified_steps(
    full: Reconstruction, settings: ReconstructionSettings, memory_limit: int | None = None
) -> Steps[Reconstruction]:
    """What `full_steps` found, taken to the goal of `settings`; their other fields are those it was found with."""
    stages, mesh, surface, notes = list(full.stages), full.mesh, full.surface, full.notes
    if settings.simplifies and settings.simplifier == "builtin":
        require(
            memory_needed(full.full_faces, settings.max_error_mm),
            f"simplifying {full.full_faces} triangles",
            "use a larger stride or a region",
            memory_limit,
        )
        goal = simplify_steps(mesh, settings.reduction, settings.target_faces, settings.max_error_mm)
        mesh = yield from _timed(stages, "Simplifying", goal)
        surface = None
        asked = settings.target_faces or round(full.full_faces * (1 - (settings.reduction or 0)))
        if settings.max_error_mm is None and len(mesh.faces) > asked:
            notes += (
                f"{len(mesh.faces)} triangles are left instead of {asked}: no edge can go any more "
                "without moving a border or tearing the surface.",
            )
    if settings.normals == "mesh":
        averaging = vertex_normals_steps(mesh.vertices, mesh.faces)
        mesh = replace(mesh, normals=(yield from said(averaging, 1.0, "Averaging normals")))
    return replace(full, mesh=mesh, surface=surface, settings=settings, stages=tuple(stages), notes=notes)


def _timed(stages: list[Stage], name: str, steps: Steps[T]) -> Steps[T]:
    """The same steps, and their seconds as a stage."""
    start = time.perf_counter()
    result = yield from steps
    stages.append(Stage(name, time.perf_counter() - start))
    return result


def _placed(surface: Surface, affine: NDArray[np.float64]) -> Pauses[Surface]:
    """Carry a surface from index space to RAS+ mm."""
    yield
    # A mirrored affine (slices listed head first) would turn the surface inside out.
    faces = surface.faces if determinant(affine) > 0 else np.ascontiguousarray(surface.faces[:, ::-1])
    placed = []
    for positions in (surface.midpoints, surface.linear):
        for start in range(0, len(positions), POINTS_AT_ONCE):
            part = slice(start, start + POINTS_AT_ONCE)
            positions[part] = to_ras_mm(affine, positions[part])
            yield
        placed.append(positions)
    normals = surface.normals
    if normals is not None:
        for start in range(0, len(normals), POINTS_AT_ONCE):
            part = slice(start, start + POINTS_AT_ONCE)
            normals[part] = normals_to_ras(affine, normals[part])
            yield
    return Surface(placed[0], placed[1], faces, normals)


def _kept(surface: Surface, mesh: TriangleMesh, settings: ReconstructionSettings) -> Steps[Surface]:
    """Drop the parts the settings do not want."""
    keeping = keep_components_steps(surface, mesh, settings.keep_parts, settings.min_part_mm3)
    return (yield from said(keeping, 0.95, "Keeping parts"))
