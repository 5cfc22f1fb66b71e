"""`ctmc experiment alpha`: the smoothness and distortion coefficient in numbers (Su and Ma, figure 8)."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...core import (
    Reconstruction,
    ReconstructionSettings,
    SettingsError,
    Step,
    Steps,
    TriangleMesh,
    reconstruct_steps,
    simplify_steps,
    within,
)
from ...core.mesh import ReferenceSurface, roughness, surface_distance_steps, triangle_shapes
from ..blender_host import blender_at_work, load_scene
from .common import add_common, facts_of, measuring_fact, prepared, require_builtin
from .plot import Panel, write_plot
from .table import Column, Row, Table, experiment_folder, number, once, plain

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


def add_parser(commands: Any) -> None:
    """Add the experiment to `ctmc experiment`."""
    parser = commands.add_parser("alpha", help="figure 8: alpha", description=DESCRIPTION, allow_abbrev=False)
    add_common(parser)
    parser.add_argument(
        "--alphas", nargs="+", type=float, default=[0.0, 0.25, 0.75, 1.0], metavar="A", help="(default 0 0.25 0.75 1)"
    )
    parser.add_argument(
        "--pictures", action=argparse.BooleanOptionalAction, default=True, help="a picture of every alpha (default)"
    )
    parser.set_defaults(run=run)


def run(chosen: argparse.Namespace) -> None:
    """Read, measure, render every alpha, write the table, and print it."""
    with experiment_folder(chosen.output, chosen.overwrite) as folder:
        done = table_of(chosen, folder)
        done.write(folder)
    print(done.printed())


def table_of(chosen: argparse.Namespace, folder: Path) -> Table:
    """The table; its pictures are written to `folder`."""
    settings, volume, notes, progress = prepared(chosen, require_alpha)
    every = [replace(settings, alpha=alpha) for alpha in once(chosen.alphas)]  # checks the limits
    with progress:
        full = replace(settings, reduction=None, target_faces=None, max_error_mm=None)
        result = progress.drive(within(reconstruct_steps(volume, full, chosen.threads), 0.1, 0.4))
        measured = progress.drive(within(alpha_steps(result, every), 0.4, 0.6))
        shown = measured if chosen.pictures else []
        pictures = progress.drive(within(pictured_steps(result, shown, folder), 0.6, 1.0))
    rows = rows_of(measured)
    write_plot(folder / "plot.png", panels(rows))
    facts = [
        *facts_of(volume, settings, result.threshold, [*notes, *result.notes]),
        ("roughness", "mean angle between neighbouring triangles, degrees"),
        ("shape", "mean of 4 sqrt(3) area / sum of squared sides: 1 is equilateral; worst is the 1st percentile"),
        ("compared", "with the linear surface (alpha 1) before any simplification"),
        measuring_fact(),
    ]
    return Table("Alpha", facts, COLUMNS, rows, [("plot.png", "Roughness, shape and distance over alpha"), *pictures])


def require_alpha(settings: ReconstructionSettings) -> None:
    """Raise `SettingsError` where alpha does nothing, or where nobody said what the surface is to be."""
    require_builtin(settings)
    if settings.threshold is None and settings.soften_mm == 0:
        raise SettingsError(
            "alpha moves vertices between grey values, and a bare label has none: "
            "give --threshold T, or --label N with --soften MM"
        )


def alpha_steps(result: Reconstruction, every: Sequence[ReconstructionSettings]) -> Steps[list[Measured]]:
    """Measure the surface of `result` at the alpha of each of the settings, simplified as they say."""
    surface = result.surface
    assert surface is not None  # nothing has been simplified yet
    reference = ReferenceSurface(surface.at(1.0))
    measured = []
    for at, settings in enumerate(every):
        low, high = at / len(every), (at + 1) / len(every)
        yield Step(low, f"Measuring alpha {settings.alpha:g}")
        mesh = surface.at(settings.alpha)
        if settings.simplifies:
            goals = (settings.reduction, settings.target_faces, settings.max_error_mm)
            mesh = yield from within(simplify_steps(mesh, *goals), low, (low + high) / 2)
        apart = yield from within(surface_distance_steps(mesh, reference), (low + high) / 2, high)
        measured.append(Measured(settings.alpha, mesh, apart.mean, apart.largest))
    return measured


def pictured_steps(result: Reconstruction, measured: Sequence[Measured], folder: Path) -> Steps[list[tuple[str, str]]]:
    """Render every alpha in the paper's colours; returns the pictures' names and captions."""
    import bpy

    scene = load_scene()
    pictures = []
    for at, one in enumerate(measured):
        yield Step(at / len(measured), f"Rendering alpha {one.alpha:g}")
        name = f"alpha-{one.alpha:g}.png"
        with blender_at_work():
            home = bpy.data.scenes.new("CTMC")
            thing = scene.add_reconstruction(replace(result, mesh=one.mesh, surface=None), home)
            try:
                scene.render_figure(thing, home, folder / name)
            finally:
                bpy.data.meshes.remove(thing.data)  # and the object with it
                bpy.data.scenes.remove(home)
        pictures.append((name, f"alpha {one.alpha:g}"))
    return pictures


def rows_of(measured: Sequence[Measured]) -> list[Row]:
    """What table.json says of every alpha."""
    rows = []
    for one in measured:
        shapes = triangle_shapes(one.mesh)
        rows.append(
            {
                "alpha": plain(one.alpha),
                "roughness_deg": roughness(one.mesh),
                "shape_mean": float(shapes.mean()),
                "shape_worst": float(np.percentile(shapes, 1)),
                "faces": len(one.mesh.faces),
                "volume_mm3": one.mesh.enclosed_volume,
                "area_mm2": one.mesh.area,
                "mean_mm": one.mean_mm,
                "max_mm": one.max_mm,
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
