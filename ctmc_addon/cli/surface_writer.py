# SPDX-License-Identifier: GPL-3.0-or-later
"""Write each surface as it is made, so that only the surfaces at work are in memory."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from ..core import Write
from ..core.files.atomic_write import refused
from ..core.files.temporary_names import temporary_name


@dataclass(frozen=True)
class SurfaceWriter:
    """A writer of surfaces to temporary files until all files of a command are complete.

    Parameters
    ----------
    folder : Path
        Hidden.
    suffix, space : str
        Of the files: .stl or .ply, "ras" or "lps".
    prefix : str
        Of the files' names.
    """

    folder: Path
    suffix: str
    space: str
    prefix: str = ""

    def path_of(self, number: int | None) -> Path:
        """Return the file of a surface, by the number of its label."""
        return self.folder / f"{self.prefix}surface{'' if number is None else f' {number}'}{self.suffix}"

    def of_time(self, time: int) -> SurfaceWriter:
        """Return the writer for the surface of a time."""
        return replace(self, prefix=f"time {time} ")

    def sink_of(self, number: int | None) -> Write:
        """Return the sink that writes that file."""
        return Write(self.path_of(number), self.space)


@contextmanager
def surface_writer(folder: Path, suffix: str, space: str) -> Iterator[SurfaceWriter]:
    """Give a writer with a hidden folder in `folder`; the hidden folder is removed at the end, with its files."""
    hidden = folder / temporary_name()
    try:
        hidden.mkdir(0o700)
    except OSError as error:
        raise refused(folder, error) from error
    try:
        yield SurfaceWriter(hidden, suffix, space)
    finally:
        shutil.rmtree(hidden, ignore_errors=True)
