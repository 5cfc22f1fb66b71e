# SPDX-License-Identifier: GPL-3.0-or-later
"""What the experiments share: flags, reading, and what their tables say of input and settings."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace

from ...core import (
    Budget,
    Reconstruction,
    ReconstructionSettings,
    Steps,
    TriangleMesh,
    Volume,
    equal_part,
    reconstruct_steps,
)
from ...core.mesh import SAMPLES, SEED, ReferenceSurface, SurfaceDistance, surface_distance_steps
from ..arguments import UsageError, add_input, add_settings, add_work, command_of, settings_from
from ..terminal import dimensions
from .table import plain, unique

FETCHED = "The file was read again for every surface, which times include."


def add_common(parser: argparse.ArgumentParser) -> None:
    """INPUT, the folder, the settings and what every experiment knows."""
    add_input(parser)
    parser.add_argument(
        "-o", "--output", required=True, metavar="DIR", help="folder for table and pictures; made with its parents"
    )
    parser.add_argument("--overwrite", action="store_true", help="replace an older experiment in that folder")
    add_work(parser)
    add_settings(parser)


def bare_settings_from(args: argparse.Namespace) -> ReconstructionSettings:
    """Return the settings of file and flags; a label is not smoothed unless they say so, as in the paper."""
    settings = settings_from(args)
    automatic = settings.smoothing == "auto" and settings.smoothing_mm is None
    return replace(settings, smoothing="none") if automatic else settings


def add_levels(parser: argparse.ArgumentParser, default: Sequence[float]) -> None:
    """Add the flag for levels of simplification, per cent."""
    parser.add_argument(
        "--levels",
        nargs="+",
        type=level,
        default=list(default),
        metavar="PERCENT",
        help=f"share of the triangles to remove, 0 to 99 (default {' '.join(f'{percent:g}' for percent in default)})",
    )


def level(word: str) -> float | int:
    """Return a share of the triangles, per cent."""
    percent = float(word)
    if not 0 <= percent <= 99:
        raise argparse.ArgumentTypeError(f"a level is from 0 to 99 per cent of the triangles to remove, not {word}")
    return plain(percent)


def require_builtin(settings: ReconstructionSettings) -> None:
    """Raise `UsageError` for a simplifier that works in Blender, after the stages that an experiment measures."""
    if settings.simplifies and settings.simplifier == "decimate":
        raise UsageError(
            "this experiment simplifies with the built-in simplifier; leave --simplifier decimate out "
            "(`ctmc experiment simplify` compares the two)"
        )


def facts_of(
    volume: Volume, settings: ReconstructionSettings, threshold: float, notes: Sequence[str]
) -> list[tuple[str, str]]:
    """Return input, settings and notes, by name."""
    spacing = [round(gap, 4) for gap in volume.spacing]
    facts = [
        ("input", f"{volume.name}, {dimensions(volume.size)} voxels of {dimensions(spacing)} mm"),
        ("settings", f"{command_of(settings) or 'the defaults'} (surface at {threshold:.6g})"),
    ]
    if volume.reader.own_bytes:
        notes = [*notes, FETCHED]
    return facts + [("note", note) for note in unique(notes)]


def measuring_fact() -> tuple[str, str]:
    """Return in words how distances are measured."""
    return (
        "distance",
        f"exact from point to surface, both ways: {SAMPLES} points on each surface, even by area, seed {SEED}; "
        "the maximum also at all vertices",
    )


def distances_steps(meshes: Sequence[TriangleMesh], reference: TriangleMesh) -> Steps[list[SurfaceDistance]]:
    """Measure the distance of every surface to the reference.

    Parameters
    ----------
    meshes : sequence of TriangleMesh
    reference : TriangleMesh
    """
    surface = ReferenceSurface(reference)
    distances = []
    for at, mesh in enumerate(meshes):
        distances.append((yield from equal_part(surface_distance_steps(mesh, surface), at, len(meshes))))
    return distances


def variants_steps(
    volume: Volume, variants: Sequence[ReconstructionSettings], budget: Budget
) -> Steps[list[Reconstruction]]:
    """Return a surface for each of the settings.

    Parameters
    ----------
    volume : Volume
    variants : sequence of ReconstructionSettings
    budget : Budget
    """
    results = []
    for at, settings in enumerate(variants):
        results.append((yield from equal_part(reconstruct_steps(volume, settings, budget), at, len(variants))))
    return results
