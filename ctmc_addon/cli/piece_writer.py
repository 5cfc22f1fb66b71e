# SPDX-License-Identifier: GPL-3.0-or-later
"""A surface that does not fit in memory, written to STL or PLY as it is extracted."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

from ..core import (
    Reconstruction,
    ReconstructionSettings,
    Stage,
    Steps,
    Volume,
    described_pieces_steps,
    memory_refusal,
)
from ..core.files.piece_files import write_pieces_steps
from ..core.streaming import surface_pieces_steps
from ..core.volume import SlabVolume

REMEDY = "use a larger stride or a region"
NOT_HELD = "The surface does not fit in memory: it was written as it was extracted."


def written_in_pieces_steps(
    volume: Volume | SlabVolume, settings: ReconstructionSettings, threads: int | None, path: Path, space: str
) -> Steps[Reconstruction]:
    """Write the surface; returned is what is known of it."""
    start = time.perf_counter()
    normals = settings.normals == "gradient" and path.suffix.lower() == ".ply"
    pieces = surface_pieces_steps(volume, settings, threads, normals=normals)
    with memory_refusal("writing the surface as it is extracted", REMEDY):
        written = yield from write_pieces_steps(path, pieces, space)
        result = yield from described_pieces_steps(volume, settings, written.info, written.measured)
    stages = (Stage("Extracting and writing", time.perf_counter() - start),)
    return replace(result, stages=stages, notes=(*result.notes, NOT_HELD))
