# SPDX-License-Identifier: GPL-3.0-or-later
"""Run `ctmc experiment alpha`: the smoothness and distortion coefficient in numbers (Su and Ma, figure 8)."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...core import (
    SIMPLIFICATION,
    Reconstruction,
    ReconstructionSettings,
    Stages,
    Step,
    Steps,
    TriangleMesh,
    equal_part,
    simplify_steps,
)
from ...core.mesh import SurfaceDistance, roughness, triangle_shapes
from ..flags.arguments import UsageError, flags_checked
from ..machine.blender_host import objects_of, quiet_steps, require_blender
from .common import MEASURING, Work, distance_cells, distances_steps, facts_of, measured, settings_of, way_cells
from .plot import Plot, series
from .table import MAX_MM, MEAN_MM, TRIANGLES, VOLUME_ML, WAYS, Column, ExperimentTable, Row, figures, plain, unique

STAGES = {"Reading": 1, "Reconstructing": 3, "Measuring": 2, "Rendering": 4}
HELP = "figure 8: alpha"
DESCRIPTION = (
    "Place the vertices of one surface by several alphas, and measure how smooth it is and how far it moves. "
    "Needs --threshold or --label; on a label with --smoothing none alpha has no effect."
)


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags for the alphas and for their pictures."""
    parser.add_argument(
        "--alphas", nargs="+", type=float, default=[0.0, 0.25, 0.75, 1.0], metavar="A", help="(default 0 0.25 0.75 1)"
    )
    parser.add_argument(
        "--pictures",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="render a picture of every alpha (default)",
    )


def table_of(args: argparse.Namespace, work: Work, folder: Path) -> ExperimentTable:
    """Return the table; the pictures of the alphas are written to `folder`."""
    if args.pictures:
        require_blender("rendering pictures")
    settings = settings_of(args)
    if settings.threshold is None and (settings.label is None or not settings.alpha_matters):
        raise UsageError(
            "alpha moves vertices between gray values, and a bare label has none: "
            "give --threshold T, or --label N with --smoothing constrained"
        )
    with flags_checked():
        variants = [replace(settings, alpha=alpha) for alpha in unique(args.alphas)]
    volume = work.read(settings)
    result = work.reconstruct(volume, settings.without(SIMPLIFICATION))
    meshes, distances = work.run("Measuring", _alphas_steps(result, variants))
    alphas = [variant.alpha_number for variant in variants]
    rows = [_row_of(*each) for each in zip(alphas, meshes, distances, strict=True)]
    pictures = work.run("Rendering", _pictures_steps(result, alphas, meshes, folder)) if args.pictures else []
    facts = [
        *facts_of(volume, settings, result.threshold, result.notes),
        ("roughness", "mean angle between neighboring triangles, degrees"),
        ("shape", "mean of 4 sqrt(3) area / sum of squared sides: 1 is equilateral; worst is the 1st percentile"),
        ("below 5 deg", "share of the triangles with an angle below 5 degrees"),
        ("radius ratio", "median of circumradius / (2 inradius): 1 is equilateral"),
        ("compared", "with the linear surface (alpha 1) before any simplification"),
        MEASURING,
    ]
    charts = {
        "Roughness, degrees": series(rows, roughness="roughness_deg"),
        "Triangle shape (1 = equilateral)": series(rows, **{"mean": "shape_mean", "1st percentile": "shape_worst"}),
        "Distance to alpha 1, mm": series(rows, mean="mean_mm", maximum="max_mm"),
    }
    plot = Plot("Roughness, shape and distance over alpha", "alpha", [f"{alpha:g}" for alpha in alphas], charts)
    return ExperimentTable("Alpha", facts, COLUMNS, rows, plot, pictures)


def _alphas_steps(
    result: Reconstruction, variants: Sequence[ReconstructionSettings]
) -> Steps[tuple[list[TriangleMesh], list[SurfaceDistance]]]:
    """Return the surface at each alpha, simplified as the settings say, and its distance to the linear surface."""
    surface = result.surface
    assert surface is not None  # The surface has not been simplified yet.
    stages = Stages({"Simplifying": 1, "Measuring": 1})
    meshes = []
    for at, settings in enumerate(variants):
        mesh = surface.at(settings.alpha_number)
        if settings.simplifies:
            goals = (settings.reduction, settings.target_faces, settings.max_error_mm)
            steps = equal_part(simplify_steps(mesh, *goals), at, len(variants))
            mesh = yield from stages.run("Simplifying", steps)
        meshes.append(mesh)
    distances = yield from stages.run("Measuring", distances_steps(meshes, surface.at(1.0)))
    return meshes, distances


def _row_of(alpha: float, mesh: TriangleMesh, distance: SurfaceDistance) -> Row:
    shapes = triangle_shapes(mesh)
    return {
        "alpha": plain(alpha),
        "roughness_deg": roughness(mesh),
        "shape_mean": float(shapes.mean()),
        "shape_worst": float(np.percentile(shapes, 1)),
        **measured(mesh, "smallest_angle_deg", "below_5_deg", "median_radius_ratio", "faces", "volume_mm3", "area_mm2"),
        **distance_cells(distance),
        **way_cells(distance),
    }


def _pictures_steps(
    result: Reconstruction, alphas: Sequence[float], meshes: Sequence[TriangleMesh], folder: Path
) -> Steps[list[tuple[str, str]]]:
    """Render every alpha in the paper's colors; returns the pictures' names and captions."""
    from ...blender.figure.rendering.render import render_figure_steps

    pictures = []
    for at, (alpha, mesh) in enumerate(zip(alphas, meshes, strict=True)):
        caption, name = f"alpha {alpha:g}", f"alpha-{alpha:g}.png"
        yield Step(at / len(meshes), f"Rendering {caption}")
        with objects_of([replace(result, mesh=mesh, surface=None)]) as (scene, [obj], _):
            rendering = render_figure_steps([obj], scene, folder / name, style="paper", own_process=True)
            yield from equal_part(quiet_steps(rendering), at, len(meshes))
        pictures.append((name, caption))
    return pictures


COLUMNS = (
    Column("alpha", lambda row: f"{row['alpha']:g}"),
    figures("roughness, deg", "roughness_deg", 2),
    figures("shape", "shape_mean", 3),
    figures("worst shape", "shape_worst", 3),
    figures("smallest angle, deg", "smallest_angle_deg", 2),
    figures("below 5 deg, %", "below_5_deg", 2, 0.01),
    figures("radius ratio", "median_radius_ratio", 3),
    TRIANGLES,
    VOLUME_ML,
    figures("area, cm2", "area_mm2", 2, 100),
    MEAN_MM,
    MAX_MM,
    *WAYS,
)
