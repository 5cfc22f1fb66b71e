# SPDX-License-Identifier: GPL-3.0-or-later
"""From a volume to a finished surface: the only place that orders, weighs and names the stages."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import MemoryLimitError
from .extraction.grid import check_stride, make_grid
from .extraction.marching_cubes import extract_steps
from .memory import give_back, refusal
from .mesh.components import keep_components_steps
from .mesh.face_normals import vertex_normals_steps
from .mesh.faces_shown import face_notes
from .mesh.triangle_mesh import Surface, TriangleMesh
from .progress import PAUSE, Stages, Steps, finish
from .reconstruction import Reconstruction, Stage
from .settings import ReconstructionSettings
from .simplification.component_removal import RemovedComponents
from .simplification.simplify import Simplification, simplification_steps
from .simplification.streaming.reduce_pieces import reduce_pieces_steps
from .streaming import (
    FieldSlabs,
    PieceMeasures,
    SlabWorkers,
    SurfaceFacts,
    field_pieces_steps,
    field_steps,
    in_memory,
    slab_surface_steps,
)
from .volume.affine import transform_faces, transform_normals, transform_points
from .volume.region import Box, region_box
from .volume.scalar_field import ScalarField, refinement_of
from .volume.slabs import SlabVolume
from .volume.volume import Volume

# What report.json and a user read, and the usual share of the time.
EXTRACTION_STAGES = {
    "Preparing values": 20,
    "Extracting the surface": 39,
    "Placing it in the patient": 3,
    "Keeping components": 3,
}
SIMPLIFICATION_STAGES = {"Simplifying": 33, "Averaging normals": 2}
STREAMED_NOTE = "The full surface does not fit in memory: it was simplified as it was extracted."
STREAMED_REMEDY = "ask for fewer triangles, or use a larger stride or a region"
POINTS_AT_ONCE = 1 << 16  # moved to millimeters in one go, so the float64 in between stays small


def reconstruct(
    volume: Volume | SlabVolume,
    settings: ReconstructionSettings,
    threads: int | None = None,
    memory_limit: int | None = None,
) -> Reconstruction:
    """Make a surface from a volume.

    Parameters
    ----------
    volume : Volume or SlabVolume
        Values that are fetched are read into memory if they fit there, else they are fetched a slab at a time. The
        surface has the same bytes.
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
    >>> distance = np.sqrt(((np.indices((24, 24, 24)) - 11.5) ** 2).sum(axis=0))
    >>> result = reconstruct(Volume(-distance, np.eye(4)), ReconstructionSettings(threshold=-9))
    >>> result.mesh.closed, round(result.mesh.volume / (4 / 3 * np.pi * 9**3), 2)
    (True, 0.99)
    """
    return finish(reconstruct_steps(volume, settings, threads, memory_limit))


def reconstruct_steps(
    volume: Volume | SlabVolume,
    settings: ReconstructionSettings,
    threads: int | None = None,
    memory_limit: int | None = None,
    workers: SlabWorkers | None = None,
    normals: bool = True,
    streams: bool = True,
) -> Steps[Reconstruction]:
    """`reconstruct` as steps; closing the generator cancels.

    `workers` extract slabs of a volume that is fetched, with the same bytes. Without `normals` streaming makes none.
    Without `streams` a surface that does not fit in memory is refused, and not simplified as it is extracted.
    """
    stages = Stages(_extraction_of(settings) | _simplification_of(settings))
    field = yield from _field_steps(stages, volume, settings, threads, memory_limit, workers is not None)
    streams = streams and _simplifies(settings)
    # Values in memory whose smoothed copy does not fit come as slabs too: their surface is held where it fits.
    holds = not (streams and isinstance(field, FieldSlabs)) or isinstance(volume, Volume)
    if isinstance(field, FieldSlabs) and workers is not None:  # what fits is not streamed on one machine either
        holds = holds or in_memory(field.volume, settings, field.window, memory_limit)
    making = _result_and_full_steps(
        stages, field, volume, settings, threads, memory_limit, workers, normals, holds, streams
    )
    return (yield from making)[0]


def result_and_full_steps(
    volume: Volume | SlabVolume,
    settings: ReconstructionSettings,
    threads: int | None = None,
    memory_limit: int | None = None,
    streams: bool = True,
) -> Steps[tuple[Reconstruction, Reconstruction | None]]:
    """`reconstruct_steps`, and what `full_steps` returns where that fits in memory.

    None in its place where it does not: the surface was then simplified as it was extracted.
    """
    stages = Stages(_extraction_of(settings) | _simplification_of(settings))
    field = yield from _field_steps(stages, volume, settings, threads, memory_limit)
    streams = streams and _simplifies(settings)
    making = _result_and_full_steps(
        stages, field, volume, settings, threads, memory_limit, None, normals=True, holds=True, streams=streams
    )
    return (yield from making)


def full_steps(
    volume: Volume | SlabVolume,
    settings: ReconstructionSettings,
    threads: int | None = None,
    memory_limit: int | None = None,
) -> Steps[Reconstruction]:
    """Return the full surface: all triangles, before the built-in simplifier, whatever the settings ask of it."""
    stages = Stages(_extraction_of(settings))
    field = yield from _field_steps(stages, volume, settings, threads, memory_limit)
    return (yield from _full_steps(stages, field, volume, settings, threads, memory_limit))


def simplified_steps(
    full: Reconstruction, settings: ReconstructionSettings, memory_limit: int | None = None
) -> Steps[Reconstruction]:
    """Return what `full_steps` made, simplified as `settings` ask; their other fields are those it was made with."""
    return (yield from _simplified_steps(Stages(_simplification_of(settings)), full, settings, memory_limit))


def without_small_steps(
    full: Reconstruction, min_part_mm3: float, keep_parts: int | None = None
) -> Steps[Reconstruction]:
    """Return what `full_steps` made, without the components below a volume, as if the setting had asked for that.

    With `keep_parts` so many of the largest are left; None leaves that as it is.
    """
    settings = replace(full.settings, min_part_mm3=min_part_mm3)
    if keep_parts is not None:
        settings = replace(settings, keep_parts=keep_parts)
    mesh = full.mesh
    surface = full.surface or Surface(mesh.vertices, mesh.vertices, mesh.faces, mesh.normals)
    surface = yield from keep_components_steps(surface, mesh, settings.keep_parts, min_part_mm3)
    mesh = surface.at(settings.alpha)
    return replace(
        full,
        mesh=mesh,
        surface=None if full.surface is None else surface,
        settings=settings,
        full_faces=len(mesh.faces),
    )


def _extraction_of(settings: ReconstructionSettings) -> dict[str, int]:
    return {
        name: weight for name, weight in EXTRACTION_STAGES.items() if name != "Keeping components" or _drops(settings)
    }


def _simplification_of(settings: ReconstructionSettings) -> dict[str, int]:
    needed = {"Simplifying": _simplifies(settings), "Averaging normals": settings.normals == "mesh"}
    return {name: weight for name, weight in SIMPLIFICATION_STAGES.items() if needed[name]}


def _drops(settings: ReconstructionSettings) -> bool:
    return bool(settings.keep_parts or settings.min_part_mm3)


def _simplifies(settings: ReconstructionSettings) -> bool:
    return settings.simplifies and settings.simplifier == "builtin"


def _field_steps(
    stages: Stages,
    volume: Volume | SlabVolume,
    settings: ReconstructionSettings,
    threads: int | None,
    memory_limit: int | None,
    by_workers: bool = False,
) -> Steps[ScalarField | FieldSlabs]:
    region = region_box(volume, settings)
    steps = refinement_of(volume.spacing, settings)
    first, last = region[2][0] * steps, (region[2][1] - 1) * steps
    check_stride(settings.stride, (*region[:2], (first, last + 1)))  # before any value is prepared
    preparing = field_steps(volume, settings, threads, memory_limit, by_workers)
    return (yield from stages.run("Preparing values", preparing))


def _result_and_full_steps(
    stages: Stages,
    field: ScalarField | FieldSlabs,
    volume: Volume | SlabVolume,
    settings: ReconstructionSettings,
    threads: int | None,
    memory_limit: int | None,
    workers: SlabWorkers | None,
    normals: bool,
    holds: bool,
    streams: bool,
) -> Steps[tuple[Reconstruction, Reconstruction | None]]:
    """The surface, and the full one: held where it fits and `holds`, simplified as it is extracted if it `streams`."""

    def held_steps() -> Steps[tuple[Reconstruction, Reconstruction]]:
        full = yield from _full_steps(stages, field, volume, settings, threads, memory_limit, workers)
        return (yield from _simplified_steps(stages, full, settings, memory_limit)), full

    if holds:
        try:
            return (yield from held_steps())
        except (MemoryLimitError, MemoryError):
            if not streams:
                raise
        give_back()  # the full surface, which went with its steps
    result = yield from _streamed_steps(stages, field, volume, settings, threads, memory_limit, workers, normals)
    return (replace(result, notes=(*result.notes, STREAMED_NOTE)) if holds else result), None


def _full_steps(
    stages: Stages,
    field: ScalarField | FieldSlabs,
    volume: Volume | SlabVolume,
    settings: ReconstructionSettings,
    threads: int | None,
    memory_limit: int | None,
    workers: SlabWorkers | None = None,
) -> Steps[Reconstruction]:
    gradient = settings.normals == "gradient"
    if isinstance(field, FieldSlabs):
        extracting = slab_surface_steps(field, gradient, settings.topology, threads, memory_limit, workers)
    else:
        grid = make_grid(field.values, settings.stride, settings.close_border, field.window_in_values, settings.upper)
        extracting = extract_steps(
            grid, field.level, gradient, threads, memory_limit, settings.topology, field.kind, field.place
        )
    surface = yield from stages.run("Extracting the surface", extracting)
    placing = _transform_steps(surface, field.affine(volume))
    surface = yield from stages.run("Placing it in the patient", placing)
    mesh = surface.at(settings.alpha)
    if _drops(settings):
        keeping = keep_components_steps(surface, mesh, settings.keep_parts, settings.min_part_mm3)
        surface = yield from stages.run("Keeping components", keeping)
        mesh = surface.at(settings.alpha)
    return replace(
        _described(volume, settings, field, mesh), surface=surface, stages=_seconds_of(stages, EXTRACTION_STAGES)
    )


def _streamed_steps(
    stages: Stages,
    field: ScalarField | FieldSlabs,
    volume: Volume | SlabVolume,
    settings: ReconstructionSettings,
    threads: int | None,
    memory_limit: int | None,
    workers: SlabWorkers | None,
    normals: bool,
) -> Steps[Reconstruction]:
    """Simplify a surface while it is extracted, so that it is never held as a whole."""
    gradient = normals and settings.normals == "gradient"
    pieces = field_pieces_steps(field, field.affine(volume), settings, threads, gradient, True, workers)
    goals = (settings.reduction, settings.target_faces, settings.max_error_mm)
    reducing = reduce_pieces_steps(pieces, *goals, memory_limit, threads)
    with refusal("simplifying the surface as it is extracted", STREAMED_REMEDY, memory_limit):
        streamed = yield from stages.run("Simplifying", reducing)
    full = _described(volume, settings, streamed.info, streamed.simplification.mesh)
    full = replace(full, full_faces=streamed.full_faces, stages=_seconds_of(stages, EXTRACTION_STAGES))
    return (yield from _finished_steps(stages, full, streamed.simplification, settings))


def _described(
    volume: Volume | SlabVolume,
    settings: ReconstructionSettings,
    about: ScalarField | FieldSlabs | SurfaceFacts,
    mesh: TriangleMesh,
) -> Reconstruction:
    """A reconstruction with what is known besides its mesh."""
    return Reconstruction(
        mesh=mesh,
        surface=None,
        settings=settings,
        threshold=about.threshold,
        full_faces=len(mesh.faces),
        voxels_visited=_voxels_visited(region_box(volume, settings), settings.stride, about.slice_steps),
        stages=(),
        spacing_mm=volume.spacing,
        notes=volume.notes + about.notes + face_notes(volume.kind, about.threshold, mesh.vertices),
        name=volume.name,
        slice_steps=about.slice_steps,
        wrong_side=about.wrong_side,
        label_name="" if settings.label is None else volume.label_names.get(settings.label, ""),
        label_color=None if settings.label is None else volume.label_colors.get(settings.label),
    )


def described_pieces_steps(
    volume: Volume | SlabVolume, settings: ReconstructionSettings, facts: SurfaceFacts, pieces: PieceMeasures
) -> Steps[Reconstruction]:
    """What is known of a surface that was written piece by piece."""
    nothing = np.empty((0, 3), np.int32)
    described = _described(volume, settings, facts, TriangleMesh(pieces.sample, nothing))
    measured = yield from pieces.measures_steps()
    mesh = TriangleMesh(np.empty((0, 3), np.float32), nothing)
    return replace(described, mesh=mesh, full_faces=measured.faces, measured=measured)


def _voxels_visited(region: Box, stride: tuple[int, int, int], slice_steps: int) -> int:
    gaps = [stop - 1 - start for start, stop in region]
    gaps[2] *= slice_steps
    return math.prod(-(-gap // side) for gap, side in zip(gaps, stride, strict=True))


def _simplified_steps(
    stages: Stages, full: Reconstruction, settings: ReconstructionSettings, memory_limit: int | None
) -> Steps[Reconstruction]:
    simplification = None
    if _simplifies(settings):
        goals = (settings.reduction, settings.target_faces, settings.max_error_mm)
        simplification = yield from stages.run("Simplifying", simplification_steps(full.mesh, *goals, memory_limit))
    return (yield from _finished_steps(stages, full, simplification, settings))


def _finished_steps(
    stages: Stages, full: Reconstruction, simplification: Simplification | None, settings: ReconstructionSettings
) -> Steps[Reconstruction]:
    """What is known of a surface after simplification, and the mesh's own normals where the settings ask for them."""
    mesh, surface, notes, removed = full.mesh, full.surface, full.notes, RemovedComponents()
    if simplification is not None:
        mesh, removed, surface = simplification.mesh, simplification.removed, None
        if removed.count:
            notes += (f"{removed.sentence('mm3')}.",)
        if simplification.handles_cut:
            notes += (f"Small handles that were cut and capped: {simplification.handles_cut:,}.",)
        target = settings.target_faces or round(full.full_faces * (1 - (settings.reduction or 0)))
        if settings.max_error_mm is None and len(mesh.faces) > target:
            notes += (
                f"{len(mesh.faces)} triangles are left instead of {target}: no further edge can be removed "
                "without moving a border or tearing the surface.",
            )
    if settings.normals == "mesh":
        averaging = vertex_normals_steps(mesh.vertices, mesh.faces)
        mesh = replace(mesh, normals=(yield from stages.run("Averaging normals", averaging)))
    return replace(
        full,
        mesh=mesh,
        surface=surface,
        settings=settings,
        stages=full.stages + _seconds_of(stages, SIMPLIFICATION_STAGES),
        notes=notes,
        removed_components=removed.count,
    )


def _seconds_of(stages: Stages, names: Iterable[str]) -> tuple[Stage, ...]:
    return tuple(Stage(name, stages.seconds[name]) for name in names if name in stages.seconds)


def _transform_steps(surface: Surface, affine: NDArray[np.float64]) -> Steps[Surface]:
    """Move a surface from index space to RAS+ mm, its arrays in place."""
    yield PAUSE
    faces = transform_faces(affine, surface.faces)
    moves: list[tuple[NDArray[np.float32] | None, Callable[..., NDArray[Any]]]] = [
        (surface.midpoints, transform_points),
        (surface.linear, transform_points),
        (surface.normals, transform_normals),
    ]
    for vectors, transform in moves:
        if vectors is None:
            continue
        for start in range(0, len(vectors), POINTS_AT_ONCE):
            part = slice(start, start + POINTS_AT_ONCE)
            vectors[part] = transform(affine, vectors[part])
            yield PAUSE
    return Surface(surface.midpoints, surface.linear, faces, surface.normals)
