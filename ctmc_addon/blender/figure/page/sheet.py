# SPDX-License-Identifier: GPL-3.0-or-later
"""Make sheets: one volume reconstructed with several settings, side by side; and distance maps.

Every cell is a reconstruction of its own, timed as a whole. Errors are distances to the surface of full resolution:
a stride of one pixel, no simplification, and alpha 1 where alphas are compared.
"""

from __future__ import annotations

import os
import statistics
import string
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ....core import (
    Budget,
    Reconstruction,
    ReconstructionSettings,
    SettingsError,
    Stages,
    Steps,
    Volume,
    distance_phrases,
    equal_part,
    length_text,
    one_way_text,
    reconstruct_steps,
    specks_text,
    volume_text,
)
from ....core.mesh import ReferenceSurface, SurfaceDistance, surface_distance_steps
from ...maps.stored import write_values
from ...surface.objects import temporary_surfaces
from ..distance_map import DISTANCE, DistanceMap, color_scale, distance_map_steps
from ..rendering.render import figure_steps
from ..spec import Cell, Comparison, FigureStyle, Page, ShownSurface
from .annotations import NO_BREAK

SHORT_SECONDS = 1.0
STAGES = {"Reconstructing in full resolution": 10, "Comparing": 50, "Rendering": 40}
MEASURING = {"Measuring the error": 10, "Measuring the map": 20}
CELL_STAGES = {"Reconstructing": 10, **MEASURING}


@dataclass(frozen=True)
class Compared:
    """A cell of a sheet: letter, title, surface, and its distance to full resolution, mm.

    `seconds` are those of the reconstruction, from gray values to triangles: the median of three if one is short.
    With `volume` the caption has the surface's volume, and the distance is to the surface that is not smoothed.
    """

    letter: str
    title: str
    result: Reconstruction
    seconds: float
    distance: SurfaceDistance
    volume: bool = False

    @property
    def lines(self) -> tuple[str, ...]:
        """Return the lines of the caption."""
        reference, volume = "full", ""
        if self.volume:
            reference, mesh = "bare", self.result.mesh
            volume = f"{_unbroken(volume_text(mesh.volume))}, " if mesh.closed else ""
        distance, lost = self.distance, self.distance.lost
        errors = ["error 0 mm"]
        if distance.largest > 0:
            errors = [
                f"error {_unbroken(length_text(distance.mean, 3))} on average",
                f"to the {reference} surface at most {_unbroken(one_way_text(distance.to_full))}",
                f"from the {reference} surface at most {_unbroken(one_way_text(distance.from_full))}",
            ]
        if lost.count:
            errors.append(specks_text(lost.count, lost.volume))
        title = self.title
        for unit in (" × ", " px", " mm", " = ", " %"):
            title = title.replace(unit, unit.replace(" ", NO_BREAK))
        return (
            f"({self.letter}) {title}",
            f"{volume}{len(self.result.mesh.faces):,} triangles, {self.seconds:.2f}{NO_BREAK}s",
            *errors,
        )


def _unbroken(text: str) -> str:
    """Return a text with no-break spaces, so that it stays on one line."""
    return text.replace(" ", NO_BREAK)


def sheet_steps(
    volume: Volume,
    settings: ReconstructionSettings,
    comparison: Comparison,
    path: str | os.PathLike[str],
    page: Page,
    style: FigureStyle,
    blend: str | os.PathLike[str] | None = None,
    deviation: bool = False,
    limit_mm: float | None = None,
    budget: Budget | None = None,
    own_process: bool = False,
) -> Steps[tuple[tuple[int, int], list[Compared]]]:
    """Reconstruct, measure and render every cell; returns the picture's size in pixels and the cells.

    Parameters
    ----------
    deviation : bool
        Color every surface by its distance to full resolution.
    limit_mm : float, optional
        End of the color bar.
    own_process : bool
        Render in a Blender of its own, which closing the steps ends at any moment.

    Raises
    ------
    CtmcError
        If there is no surface at some settings, alpha does nothing, or a file cannot be written.
    """
    _require_measurable(settings, limit_mm)
    budget = budget or Budget()
    if comparison.alphas and not comparison.smoothings and not settings.alpha_matters:
        raise SettingsError(
            "alpha has no effect on a label that is not smoothed: choose a threshold, or smooth the "
            "label (--threshold T, or --label N without --smoothing none)"
        )
    stages = Stages(STAGES)
    bare = settings.unsmoothed if comparison.smoothings else settings
    full = _reference_steps(volume, bare, bool(comparison.alphas), budget)
    reference = yield from stages.run("Reconstructing in full resolution", full)
    comparing = _cells_steps(volume, comparison.variants(settings, volume.spacing), reference, deviation, budget)
    compared, maps = yield from stages.run("Comparing", comparing)
    compared = [replace(cell, volume=bool(comparison.smoothings)) for cell in compared]
    colors = color_scale(maps, limit_mm) if deviation else None
    style = replace(style, columns=style.columns or comparison.columns, colors=colors)
    results = [(cell.result, cell.lines) for cell in compared]
    size = yield from stages.run("Rendering", _rendered_steps(results, maps, path, page, style, blend, own_process))
    return size, compared


def _cells_steps(
    volume: Volume,
    variants: Sequence[tuple[str, ReconstructionSettings]],
    reference: ReferenceSurface,
    deviation: bool,
    budget: Budget,
) -> Steps[tuple[list[Compared], list[DistanceMap]]]:
    """Return every cell of a sheet, with its distance map if requested."""
    compared, maps = [], []
    for number, (title, settings) in enumerate(variants):
        stages = Stages(CELL_STAGES if deviation else {name: CELL_STAGES[name] for name in list(CELL_STAGES)[:2]})
        extracting = stages.run("Reconstructing", timed_steps(volume, settings, budget))
        result, seconds = yield from equal_part(extracting, number, len(variants))
        measuring = stages.run("Measuring the error", surface_distance_steps(result.mesh, reference, budget.threads))
        distance = yield from equal_part(measuring, number, len(variants))
        compared.append(Compared(string.ascii_lowercase[number], title, result, seconds, distance))
        if deviation:
            mapping = stages.run("Measuring the map", distance_map_steps(result.mesh, reference, budget.threads))
            maps.append((yield from equal_part(mapping, number, len(variants))))
    return compared, maps


def timed_steps(
    volume: Volume, settings: ReconstructionSettings, budget: Budget
) -> Steps[tuple[Reconstruction, float]]:
    """Reconstruct; return the result and its seconds, the median of three if one is short."""
    runs: list[float] = []
    while not runs or (len(runs) < 3 and runs[0] < SHORT_SECONDS):
        result = yield from equal_part(reconstruct_steps(volume, settings, budget), len(runs), 3)
        runs.append(sum(stage.seconds for stage in result.stages))
    return result, statistics.median(runs)


def deviation_figure_steps(
    volume: Volume,
    result: Reconstruction,
    path: str | os.PathLike[str],
    page: Page,
    style: FigureStyle,
    blend: str | os.PathLike[str] | None = None,
    limit_mm: float | None = None,
    budget: Budget | None = None,
    own_process: bool = False,
) -> Steps[tuple[int, int]]:
    """Render a figure of one surface colored by its distance to the surface of full resolution."""
    _require_measurable(result.settings, limit_mm)
    budget = budget or Budget()
    stages = Stages({"Reconstructing in full resolution": 20, **MEASURING, "Rendering": 50})
    full = _reference_steps(volume, result.settings, False, budget)
    reference = yield from stages.run("Reconstructing in full resolution", full)
    measuring = surface_distance_steps(result.mesh, reference, budget.threads)
    distance = yield from stages.run("Measuring the error", measuring)
    mapping = distance_map_steps(result.mesh, reference, budget.threads)
    distance_map = yield from stages.run("Measuring the map", mapping)
    caption = (
        style.caption
        if style.caption is not None
        else (
            f"Distance {', '.join(map(_unbroken, distance_phrases(distance)))}; "
            f"{len(result.mesh.faces):,} triangles instead of {len(reference.mesh.faces):,}"
        )
    )
    style = replace(style, colors=color_scale([distance_map], limit_mm), caption=caption)
    rendering = _rendered_steps([(result, ())], [distance_map], path, page, style, blend, own_process)
    return (yield from stages.run("Rendering", rendering))


def _require_measurable(settings: ReconstructionSettings, limit_mm: float | None) -> None:
    """Raise `SettingsError` for a simplifier that works in Blender, or a color bar without a positive end."""
    if settings.simplifies and settings.simplifier == "decimate":
        raise SettingsError("distances need the built-in simplifier; choose it (leave out --simplifier decimate)")
    if limit_mm is not None and not 0 < limit_mm <= 1000:
        raise SettingsError(f"the color bar must end between 0 and 1000 mm, not at {limit_mm:g}")


def _reference_steps(
    volume: Volume, settings: ReconstructionSettings, straight: bool, budget: Budget
) -> Steps[ReferenceSurface]:
    """Return the surface of full resolution, at alpha 1 if it is to be `straight`."""
    full = replace(
        settings,
        stride=(1, 1, 1),
        alpha=1.0 if straight else settings.alpha,
        reduction=None,
        target_faces=None,
        max_error_mm=None,
    )
    result = yield from reconstruct_steps(volume, full, budget)
    return ReferenceSurface(result.mesh)


def _rendered_steps(
    results: Sequence[tuple[Reconstruction, tuple[str, ...]]],
    maps: Sequence[DistanceMap],
    path: str | os.PathLike[str],
    page: Page,
    style: FigureStyle,
    blend: str | os.PathLike[str] | None,
    own_process: bool,
) -> Steps[tuple[int, int]]:
    """Make an object of every surface or map in a separate scene, and render them as cells."""
    surfaces = [
        replace(result, mesh=maps[at].mesh if maps else result.mesh, surface=None)
        for at, (result, _) in enumerate(results)
    ]
    with temporary_surfaces(surfaces) as (scene, objects):
        for obj, distance_map in zip(objects, maps, strict=False):
            write_values(obj.data, DISTANCE, distance_map.distances_mm.astype(np.float32))
        cells = [Cell((ShownSurface(obj),), lines) for obj, (_, lines) in zip(objects, results, strict=True)]
        return (yield from figure_steps(cells, path, page, style, blend, scene, own_process))
