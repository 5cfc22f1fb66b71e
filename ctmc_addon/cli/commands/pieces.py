# SPDX-License-Identifier: GPL-3.0-or-later
"""A surface that does not fit in memory, written to STL or PLY as it is extracted."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from ...core import (
    Reconstruction,
    ReconstructionSettings,
    Stage,
    Steps,
    Volume,
    described_pieces_steps,
    memory_refusal,
)
from ...core.files import mesh_files
from ...core.files.atomic_write import whole_files, write_json
from ...core.files.piece_files import write_pieces_steps
from ...core.streaming import surface_pieces_steps
from ...core.volume import SlabVolume
from ..outputs import Outputs

REMEDY = "use a larger stride or a region"
NOT_HELD = "The surface does not fit in memory: it was written as it was extracted."


def written_in_pieces(outputs: Outputs, settings: ReconstructionSettings, choices: Sequence[int | str]) -> bool:
    """Whether a surface with these settings can be written that is never there as a whole."""
    one_file = len(outputs.surfaces) == 1 and outputs.surfaces[0].suffix.lower() in mesh_files.SUFFIXES
    return one_file and not outputs.figure and not settings.simplifies and is_only_choice(settings, choices)


def is_only_choice(settings: ReconstructionSettings, choices: Sequence[int | str]) -> bool:
    """Whether the settings are those of the one surface that is asked for."""
    return all(choice == settings.label for choice in choices)


def written_pieces_steps(
    volume: Volume | SlabVolume, settings: ReconstructionSettings, threads: int | None, outputs: Outputs
) -> Steps[tuple[Reconstruction, list[Path]]]:
    """Write the surface and its report, both or neither."""
    path, start = outputs.surfaces[0], time.perf_counter()
    paths = [path] if outputs.report is None else [path, outputs.report]
    normals = settings.normals == "gradient" and path.suffix.lower() == ".ply"
    pieces = surface_pieces_steps(volume, settings, threads, normals=normals)
    with whole_files(paths) as places:
        with memory_refusal("writing the surface as it is extracted", REMEDY):
            written = yield from write_pieces_steps(places[path], pieces, outputs.space)
            result = yield from described_pieces_steps(volume, settings, written.info, written.measured)
        stages = (Stage("Extracting and writing", time.perf_counter() - start),)
        result = replace(result, stages=stages, notes=(*result.notes, NOT_HELD))
        if outputs.report is not None:
            write_json(places[outputs.report], result.report() | {"files": [path.name for path in paths]})
    return result, paths
