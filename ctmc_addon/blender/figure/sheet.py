"""Sheets: one volume reconstructed with several settings, side by side (Su and Ma, figures 6 to 8); and distance maps.

Every cell is a reconstruction of its own, timed as a whole. Errors are distances to the surface of full resolution:
voxel sides of one pixel, no simplification, and alpha 1 where alphas are compared.
"""

from __future__ import annotations

import itertools
import os
import statistics
import string
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from ...core import (
    Reconstruction,
    ReconstructionSettings,
    SettingsError,
    Steps,
    TriangleMesh,
    Volume,
    reconstruct_steps,
    within,
)
from ...core.mesh import ReferenceSurface, surface_distance_steps
from ..surface.objects import temporary_surfaces
from .annotations import NO_BREAK
from .distance_map import Measured, color_scale, keep_distances, measured_steps
from .render import figure_steps
from .spec import Cell, FigureStyle, Page, ShownSurface

MOST_CELLS = 26
SHORT_SECONDS = 1.0


@dataclass(frozen=True)
class Comparison:
    """What a sheet compares: one of these, or two of them crossed, the first down and the second across.

    Parameters
    ----------
    strides : sequence of (x, y)
        Voxel sides, px.
    alphas : sequence of float
    levels : sequence of float
        Share of the triangles to remove, per cent.

    Raises
    ------
    SettingsError
        If none or all three are given, or they make too many cells.
    """

    strides: Sequence[tuple[int, int]] = ()
    alphas: Sequence[float] = ()
    levels: Sequence[float] = ()

    def __post_init__(self) -> None:
        many = [len(axis) for axis in (self.strides, self.alphas, self.levels) if axis]
        if not 1 <= len(many) <= 2:
            raise SettingsError("a sheet compares strides, alphas or levels, or two of them crossed; give one or two")
        count = many[0] * many[-1] if len(many) == 2 else many[0]
        if count > MOST_CELLS:
            raise SettingsError(f"{count} cells are more than there are letters; compare at most {MOST_CELLS}")
        for level in self.levels:
            if not 0 <= level <= 99:
                raise SettingsError(f"a level must be from 0 to 99 per cent of the triangles to remove, not {level:g}")

    @property
    def columns(self) -> int | None:
        """Cells side by side where two are crossed, else None."""
        many = [len(axis) for axis in (self.strides, self.alphas, self.levels) if axis]
        return many[1] if len(many) == 2 else None

    def variants(self, settings: ReconstructionSettings) -> list[tuple[str, ReconstructionSettings]]:
        """The title and the settings of every cell."""
        axes: list[list[tuple[str, dict[str, Any]]]] = []
        if self.strides:
            z = settings.stride[2]
            axes.append([(f"voxel sides {x} × {y} px", {"stride": (x, y, z)}) for x, y in self.strides])
        if self.alphas:
            axes.append([(f"alpha {alpha:g}", {"alpha": alpha}) for alpha in self.alphas])
        if self.levels:
            free = {"target_faces": None, "max_error_mm": None, "simplifier": "builtin"}
            axes.append(
                [
                    (
                        f"{level:g} % simplified" if level else "not simplified",
                        {**free, "reduction": level / 100 or None},
                    )
                    for level in self.levels
                ]
            )
        out = []
        for choice in itertools.product(*axes):
            changes: dict[str, Any] = {}
            for _, change in choice:
                changes |= change
            out.append((", ".join(title for title, _ in choice), replace(settings, **changes)))
        return out


@dataclass(frozen=True)
class Compared:
    """A cell of a sheet: its letter, title, surface, and how far that is from full resolution, mm.

    `seconds` are those of the reconstruction, from grey values to triangles: the median of three if one is short.
    """

    letter: str
    title: str
    result: Reconstruction
    seconds: float
    mean_mm: float
    max_mm: float

    @property
    def lines(self) -> tuple[str, ...]:
        """The caption."""
        error = "error 0 mm"
        if self.max_mm > 0:
            error = f"error {self.mean_mm:.3g}{NO_BREAK}mm, at{NO_BREAK}most{NO_BREAK}{self.max_mm:.3g}{NO_BREAK}mm"
        title = self.title
        for unit in (" × ", " px", " %"):
            title = title.replace(unit, unit.replace(" ", NO_BREAK))
        return (
            f"({self.letter}) {title}",
            f"{len(self.result.mesh.faces):,} triangles, {self.seconds:.2f}{NO_BREAK}s",
            error,
        )


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
    threads: int | None = None,
) -> Steps[tuple[tuple[int, int], list[Compared]]]:
    """Reconstruct, measure and render every cell; returns the picture's size in pixels and the cells.

    Parameters
    ----------
    deviation : bool
        Color every surface by its distance to full resolution.
    limit_mm : float, optional
        End of the color bar.

    Raises
    ------
    CtmcError
        If there is no surface at some settings, alpha does nothing, or a file cannot be written.
    """
    require_measurable(settings, limit_mm)
    if comparison.alphas and not settings.alpha_matters:
        raise SettingsError(
            "alpha moves vertices between grey values, and a bare label has none: "
            "choose a threshold, or soften the label (--threshold T, or --label N with --soften MM)"
        )
    variants = comparison.variants(settings)
    reference = yield from within(reference_steps(volume, settings, bool(comparison.alphas), threads), 0.0, 0.1)
    compared, maps = [], []
    for at, (title, changed) in enumerate(variants):
        low, width = 0.1 + 0.5 * at / len(variants), 0.5 / len(variants)
        result, seconds = yield from within(timed_steps(volume, changed, threads), low, low + width / 3)
        apart = yield from within(
            surface_distance_steps(result.mesh, reference, threads), low + width / 3, low + 2 * width / 3
        )
        compared.append(Compared(string.ascii_lowercase[at], title, result, seconds, apart.mean, apart.largest))
        if deviation:
            measuring = measured_steps(result.mesh, reference, threads)
            maps.append((yield from within(measuring, low + 2 * width / 3, low + width)))
    distances = color_scale(maps, limit_mm) if deviation else None
    style = replace(style, columns=style.columns or comparison.columns, distances=distances)
    shown = [(one.result, one.lines) for one in compared]
    steps = shown_steps(shown, maps, path, page, style, blend)
    size = yield from within(steps, 0.6, 1.0)
    return size, compared


def timed_steps(
    volume: Volume, settings: ReconstructionSettings, threads: int | None
) -> Steps[tuple[Reconstruction, float]]:
    """A reconstruction and its seconds, the median of three if one is short."""
    runs: list[float] = []
    while not runs or (len(runs) < 3 and runs[0] < SHORT_SECONDS):
        steps = reconstruct_steps(volume, settings, threads)
        result = yield from within(steps, len(runs) / 3, (len(runs) + 1) / 3)
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
    threads: int | None = None,
) -> Steps[tuple[int, int]]:
    """A figure of one surface colored by its distance to the surface of full resolution."""
    require_measurable(result.settings, limit_mm)
    reference = yield from within(reference_steps(volume, result.settings, False, threads), 0.0, 0.2)
    apart = yield from within(surface_distance_steps(result.mesh, reference, threads), 0.2, 0.3)
    measured = yield from within(measured_steps(result.mesh, reference, threads), 0.3, 0.5)
    caption = style.caption or (
        f"Distance to the surface of full resolution: mean {apart.mean:.3g}{NO_BREAK}mm, "
        f"at most {apart.largest:.3g}{NO_BREAK}mm; "
        f"{len(result.mesh.faces):,} triangles instead of {len(reference.mesh.faces):,}"
    )
    style = replace(style, distances=color_scale([measured], limit_mm), caption=caption)
    return (yield from within(shown_steps([(result, ())], [measured], path, page, style, blend), 0.5, 1.0))


def require_measurable(settings: ReconstructionSettings, limit_mm: float | None) -> None:
    """Raise `SettingsError` for a simplifier that works in Blender, or a color bar that ends nowhere."""
    if settings.simplifies and settings.simplifier == "decimate":
        raise SettingsError(
            "distances are measured with the built-in simplifier; choose that one (leave --simplifier decimate out)"
        )
    if limit_mm is not None and not 0 < limit_mm <= 1000:
        raise SettingsError(f"the color bar must end between 0 and 1000 mm, not at {limit_mm:g}")


def reference_steps(
    volume: Volume, settings: ReconstructionSettings, straight: bool, threads: int | None
) -> Steps[ReferenceSurface]:
    """The surface of full resolution, at alpha 1 if it is to be `straight`."""
    full = replace(
        settings,
        stride=(1, 1, 1),
        alpha=1.0 if straight else settings.alpha,
        reduction=None,
        target_faces=None,
        max_error_mm=None,
    )
    result = yield from reconstruct_steps(volume, full, threads)
    return ReferenceSurface(result.mesh)


def shown_steps(
    results: Sequence[tuple[Reconstruction, tuple[str, ...]]],
    maps: Sequence[Measured],
    path: str | os.PathLike[str],
    page: Page,
    style: FigureStyle,
    blend: str | os.PathLike[str] | None,
) -> Steps[tuple[int, int]]:
    """Make an object for every surface, or for its map, in a scene of its own, and render them as cells."""
    surfaces = [
        replace(result, mesh=maps[at].mesh if maps else result.mesh, surface=None)
        for at, (result, _) in enumerate(results)
    ]
    with temporary_surfaces(surfaces) as (scene, objects):
        for obj, distance_map in zip(objects, maps, strict=False):
            keep_distances(obj.data, distance_map.distances_mm)
        cells = [Cell((ShownSurface(obj),), lines) for obj, (_, lines) in zip(objects, results, strict=True)]
        return (yield from figure_steps(cells, path, page, style, blend, scene))


def holds_others(mesh: TriangleMesh, every: Sequence[TriangleMesh]) -> bool:
    """Whether the box around a surface holds those of all the others, and there are others."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    others = [other.vertices for other in every if other is not mesh]
    return bool(others) and all(
        (low <= points.min(axis=0)).all() and (points.max(axis=0) <= high).all() for points in others
    )
