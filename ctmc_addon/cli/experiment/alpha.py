# SPDX-License-Identifier: GPL-3.0-or-later
"""`ctmc experiment alpha`: the smoothness and distortion coefficient in numbers (Su and Ma, figure 8)."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...core import (
    SIMPLIFICATION,
    Budget,
    Reconstruction,
    ReconstructionSettings,
    Stages,
    Step,
    Steps,
    TriangleMesh,
    equal_part,
    reconstruct_steps,
    simplify_steps,
)
from ...core.mesh import roughness, triangle_shapes
from ..arguments import UsageError, flags_checked
from ..blender_host import objects_of, quiet_steps, require_blender
from ..commands.reconstruct import input_steps
from ..terminal import Progress
from .common import bare_settings_from, distances_steps, facts_of, measuring_fact, require_builtin
from .plot import Panel, panel_of, write_plot
from .table import MAX_MM, MEAN_MM, TRIANGLES, VOLUME_ML, Column, Row, Table, figures, plain, unique

STAGES = {"Reading": 1, "Reconstructing": 3, "Measuring": 2, "Rendering": 4}
HELP = "figure 8: alpha"
DESCRIPTION = (
    "Place the vertices of one surface by several alphas, and measure how smooth it is and how far it moves. "
    "Needs --threshold, or --label with --smoothing: on a bare label alpha does nothing."
)


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags for the alphas and for their pictures."""
    parser.add_argument(
        "--alphas", nargs="+", type=float, default=[0.0, 0.25, 0.75, 1.0], metavar="A", help="(default 0 0.25 0.75 1)"
    )
    parser.add_argument(
        "--pictures", action=argparse.BooleanOptionalAction, default=True, help="a picture of every alpha (default)"
    )


def table_of(args: argparse.Namespace, folder: Path) -> Table:
    """Return the table; its pictures are written to `folder`."""
    if args.pictures:
        require_blender("rendering pictures")
    settings = bare_settings_from(args)
    require_alpha(settings)
    with flags_checked():
        variants = [replace(settings, alpha=alpha) for alpha in unique(args.alphas)]
    stages = Stages(STAGES)
    with Progress() as progress:
        volume = progress.finish(stages.run("Reading", input_steps(args, settings)))
        full = settings.without(SIMPLIFICATION)
        result = progress.finish(stages.run("Reconstructing", reconstruct_steps(volume, full, Budget(args.threads))))
        meshes, rows = progress.finish(stages.run("Measuring", alpha_steps(result, variants)))
        pictures = []
        if args.pictures:
            pictures = progress.finish(stages.run("Rendering", pictures_steps(result, variants, meshes, folder)))
    write_plot(folder / "plot.png", panels(rows))
    facts = [
        *facts_of(volume, settings, result.threshold, result.notes),
        ("roughness", "mean angle between neighboring triangles, degrees"),
        ("shape", "mean of 4 sqrt(3) area / sum of squared sides: 1 is equilateral; worst is the 1st percentile"),
        ("below 5 deg", "share of the triangles with an angle below 5 degrees"),
        ("radius ratio", "median of circumradius / (2 inradius): 1 is equilateral"),
        ("compared", "with the linear surface (alpha 1) before any simplification"),
        measuring_fact(),
    ]
    return Table("Alpha", facts, COLUMNS, rows, [("plot.png", "Roughness, shape and distance over alpha"), *pictures])


def require_alpha(settings: ReconstructionSettings) -> None:
    """Raise `UsageError` where alpha does nothing, or where nobody said what the surface is to be."""
    require_builtin(settings)
    if settings.threshold is None and (settings.label is None or not settings.alpha_matters):
        raise UsageError(
            "alpha moves vertices between gray values, and a bare label has none: "
            "give --threshold T, or --label N with --smoothing constrained"
        )


def alpha_steps(
    result: Reconstruction, variants: Sequence[ReconstructionSettings]
) -> Steps[tuple[list[TriangleMesh], list[Row]]]:
    """Return the surface of `result` at the alpha of each of the settings, simplified as they say, and its measures."""
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
    rows = []
    for settings, mesh, distance in zip(variants, meshes, distances, strict=True):
        shapes, quality = triangle_shapes(mesh), mesh.measures.quality
        assert quality is not None  # A surface has triangles.
        rows.append(
            {
                "alpha": plain(settings.alpha_number),
                "roughness_deg": roughness(mesh),
                "shape_mean": float(shapes.mean()),
                "shape_worst": float(np.percentile(shapes, 1)),
                "smallest_angle_deg": quality.smallest_angle_deg,
                "below_5_deg": quality.below_5,
                "median_radius_ratio": quality.median_radius_ratio,
                "faces": len(mesh.faces),
                "volume_mm3": mesh.enclosed_volume,
                "area_mm2": mesh.area,
                "mean_mm": distance.mean,
                "max_mm": distance.largest,
            }
        )
    return meshes, rows


def pictures_steps(
    result: Reconstruction,
    variants: Sequence[ReconstructionSettings],
    meshes: Sequence[TriangleMesh],
    folder: Path,
) -> Steps[list[tuple[str, str]]]:
    """Render every alpha in the paper's colors; returns the pictures' names and captions."""
    from ...blender.figure.render import render_figure_steps

    pictures = []
    for at, (settings, mesh) in enumerate(zip(variants, meshes, strict=True)):
        caption = f"alpha {settings.alpha_number:g}"
        yield Step(at / len(meshes), f"Rendering {caption}")
        pictures.append((f"{caption.replace(' ', '-')}.png", caption))
        with objects_of([replace(result, mesh=mesh, surface=None)]) as (scene, [obj], _):
            path = folder / pictures[-1][0]
            rendering = render_figure_steps([obj], scene, path, style="paper", own_process=True)
            yield from equal_part(quiet_steps(rendering), at, len(meshes))
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
)


def panels(rows: Sequence[Row]) -> list[Panel]:
    """Roughness, shape and distance over alpha."""
    labels = [f"{row['alpha']:g}" for row in rows]
    shapes = {"mean": "shape_mean", "1st percentile": "shape_worst"}
    return [
        panel_of("Roughness, degrees", "alpha", labels, rows, roughness="roughness_deg"),
        panel_of("Triangle shape (1 = equilateral)", "alpha", labels, rows, **shapes),
        panel_of("Distance to alpha 1, mm", "alpha", labels, rows, mean="mean_mm", maximum="max_mm"),
    ]
