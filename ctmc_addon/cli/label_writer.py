# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces of several labels, each written as soon as it is made, so that no more than those at work are in memory."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..core import (
    MemoryLimitError,
    OutputError,
    Reconstruction,
    ReconstructionSettings,
    Step,
    Steps,
    TriangleMesh,
    Volume,
    give_back,
    reconstruct_steps,
)
from ..core.files.temporary_names import temporary_name
from ..core.volume import SlabVolume
from .piece_writer import written_in_pieces_steps


@contextmanager
def label_writer(folder: Path, suffix: str, space: str) -> Iterator[LabelWriter]:
    """A writer with a hidden folder in `folder`, which goes at the end with what is still in it."""
    hidden = folder / temporary_name()
    try:
        hidden.mkdir(0o700)
        yield LabelWriter(hidden, suffix, space)
    except OutputError as error:
        raise OutputError(str(error).replace(hidden.name + os.sep, "")) from error
    finally:
        shutil.rmtree(hidden, ignore_errors=True)


@dataclass(frozen=True)
class LabelWriter:
    """Makes the surface of a label and writes it.

    Parameters
    ----------
    folder : Path
        Where files are until all are there.
    suffix, space : str
        Of the files: .stl or .ply, "ras" or "lps".
    """

    folder: Path
    suffix: str
    space: str

    def path_of(self, settings: ReconstructionSettings) -> Path:
        """The file of a label."""
        return self.folder / f"label {settings.label}{self.suffix}"

    def make_steps(
        self,
        volume: Volume | SlabVolume,
        settings: ReconstructionSettings,
        threads: int,
        limit: int | None,
        beside: bool,
    ) -> Steps[Reconstruction]:
        """Write the surface of a label, as it is extracted where it does not fit; returned are its measures alone."""
        path, normals = self.path_of(settings), self.suffix == ".ply"
        try:
            making = reconstruct_steps(volume, settings, threads, limit, normals=normals, streams=not beside)
            return (yield from self._saved_steps(path, making))
        except (MemoryLimitError, MemoryError):
            if beside or settings.simplifies:
                raise
        give_back()
        return (yield from written_in_pieces_steps(volume, settings, threads, path, self.space))

    def _saved_steps(self, path: Path, making: Steps[Reconstruction]) -> Steps[Reconstruction]:
        result = yield from making
        yield Step(1.0, "Measuring the surface")
        measures = result.mesh.measures
        yield Step(1.0, "Writing the surface")
        result.mesh.save(path, self.space)
        nothing = TriangleMesh(np.empty((0, 3), np.float32), np.empty((0, 3), np.int32))
        return replace(result, mesh=nothing, surface=None, measured=measures)
