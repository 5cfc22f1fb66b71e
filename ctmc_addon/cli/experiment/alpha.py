"""`ctmc experiment alpha`: the smoothness and distortion coefficient in numbers (Su and Ma, figure 8)."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...core import (
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
from ...core.mesh import ReferenceSurface, roughness, surface_distance_steps, triangle_shapes
from ..arguments import UsageError, flags_checked, settings_from
from ..blender_host import blender_at_work, objects_of, require_blender
from ..terminal import Progress
from .common import facts_of, input_steps, measuring_fact, require_builtin
from .plot import Panel, write_plot
from .table import Column, Row, Table, number, plain, unique

STAGES = {"Reading": 1, "Reconstructing": 3, "Measuring": 2, "Rendering": 4}
HELP = "figure 8: alpha"
DESCRIPTION = (
    "Place the vertices of one surface by several alphas, and measure how smooth it is and how far it moves. "
    "Needs --threshold, or --label with --soften: on a bare label alpha does nothing."
)


@dataclass
class Measured:
    """The surface at one alpha."""

    alpha: float
    mesh: TriangleMesh
    mean_mm: float
    max_mm: float


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Which alphas, and whether to show them."""
    parser.add_argument(
        "--alphas", nargs="+", type=float, default=[0.0, 0.25, 0.75, 1.0], metavar="A", help="(default 0 0.25 0.75 1)"
    )
    parser.add_argument(
        "--pictures", action=argparse.BooleanOptionalAction, default=True, help="a picture of every alpha (default)"
    )


def table_of(args: argparse.Namespace, folder: Path) -> Table:
    """The table; its pictures are written to `folder`."""
    settings = settings_from(args)
    require_alpha(settings)
    with flags_checked():
        variants = [replace(settings, alpha=alpha) for alpha in unique(args.alphas)]
    if args.pictures:
        require_blender("rendering pictures")
    stages = Stages(STAGES)
    with Progress() as progress:
        volume = progress.finish(stages.run("Reading", input_steps(args, settings)))
        full = replace(settings, reduction=None, target_faces=None, max_error_mm=None)
        result = progress.finish(stages.run("Reconstructing", reconstruct_steps(volume, full, args.threads)))
        measured = progress.finish(stages.run("Measuring", alpha_steps(result, variants)))
        shown = measured if args.pictures else []
        pictures = progress.finish(stages.run("Rendering", pictures_steps(result, shown, folder)))
    rows = rows_of(measured)
    write_plot(folder / "plot.png", panels(rows))
    facts = [
        *facts_of(volume, settings, result.threshold, result.notes),
        ("roughness", "mean angle between neighbouring triangles, degrees"),
        ("shape", "mean of 4 sqrt(3) area / sum of squared sides: 1 is equilateral; worst is the 1st percentile"),
        ("compared", "with the linear surface (alpha 1) before any simplification"),
        measuring_fact(),
    ]
    return Table("Alpha", facts, COLUMNS, rows, [("plot.png", "Roughness, shape and distance over alpha"), *pictures])


def require_alpha(settings: ReconstructionSettings) -> None:
    """Raise `UsageError` where alpha does nothing, or where nobody said what the surface is to be."""
    require_builtin(settings)
    if settings.threshold is None and settings.soften_mm == 0:
        raise UsageError(
            "alpha moves vertices between grey values, and a bare label has none: "
            "give --threshold T, or --label N with --soften MM"
        )


def alpha_steps(result: Reconstruction, variants: Sequence[ReconstructionSettings]) -> Steps[list[Measured]]:
    """Measure the surface of `result` at the alpha of each of the settings, simplified as they say."""
    surface = result.surface
    assert surface is not None  # nothing has been simplified yet
    reference = ReferenceSurface(surface.at(1.0))
    measured = []
    for at, settings in enumerate(variants):
        stages = Stages({"Simplifying": 1, f"Measuring alpha {settings.alpha:g}": 1})
        mesh = surface.at(settings.alpha)
        if settings.simplifies:
            goals = (settings.reduction, settings.target_faces, settings.max_error_mm)
            steps = stages.run("Simplifying", simplify_steps(mesh, *goals))
            mesh = yield from equal_part(steps, at, len(variants))
        measuring = stages.run(f"Measuring alpha {settings.alpha:g}", surface_distance_steps(mesh, reference))
        distance = yield from equal_part(measuring, at, len(variants))
        measured.append(Measured(settings.alpha, mesh, distance.mean, distance.largest))
    return measured


def pictures_steps(result: Reconstruction, measured: Sequence[Measured], folder: Path) -> Steps[list[tuple[str, str]]]:
    """Render every alpha in the paper's colors; returns the pictures' names and captions."""
    from ...blender.figure.render import render_figure

    pictures = []
    for at, item in enumerate(measured):
        yield Step(at / len(measured), f"Rendering alpha {item.alpha:g}")
        name = f"alpha-{item.alpha:g}.png"
        with objects_of([replace(result, mesh=item.mesh, surface=None)]) as (scene, [obj], _), blender_at_work():
            render_figure(obj, scene, folder / name)
        pictures.append((name, f"alpha {item.alpha:g}"))
    return pictures


def rows_of(measured: Sequence[Measured]) -> list[Row]:
    """What table.json says of every alpha."""
    rows = []
    for item in measured:
        shapes = triangle_shapes(item.mesh)
        rows.append(
            {
                "alpha": plain(item.alpha),
                "roughness_deg": roughness(item.mesh),
                "shape_mean": float(shapes.mean()),
                "shape_worst": float(np.percentile(shapes, 1)),
                "faces": len(item.mesh.faces),
                "volume_mm3": item.mesh.enclosed_volume,
                "area_mm2": item.mesh.area,
                "mean_mm": item.mean_mm,
                "max_mm": item.max_mm,
            }
        )
    return rows


COLUMNS = (
    Column("alpha", lambda row: f"{row['alpha']:g}"),
    Column("roughness, deg", lambda row: number(row["roughness_deg"], 2)),
    Column("shape", lambda row: number(row["shape_mean"], 3)),
    Column("worst shape", lambda row: number(row["shape_worst"], 3)),
    Column("triangles", lambda row: str(row["faces"])),
    Column("volume, ml", lambda row: number(None if row["volume_mm3"] is None else row["volume_mm3"] / 1000, 3)),
    Column("area, cm2", lambda row: number(row["area_mm2"] / 100, 2)),
    Column("mean, mm", lambda row: number(row["mean_mm"], 4)),
    Column("max, mm", lambda row: number(row["max_mm"], 3)),
)


def panels(rows: Sequence[Row]) -> list[Panel]:
    """Roughness, shape and distance over alpha."""
    labels = [f"{row['alpha']:g}" for row in rows]
    shapes = {"mean": [row["shape_mean"] for row in rows], "1st percentile": [row["shape_worst"] for row in rows]}
    distances = {"mean": [row["mean_mm"] for row in rows], "maximum": [row["max_mm"] for row in rows]}
    return [
        Panel("Roughness, degrees", "alpha", labels, {"roughness": [row["roughness_deg"] for row in rows]}),
        Panel("Triangle shape (1 = equilateral)", "alpha", labels, shapes),
        Panel("Distance to alpha 1, mm", "alpha", labels, distances),
    ]
