# SPDX-License-Identifier: GPL-3.0-or-later
"""Write maps as a CSV table: a row for each vertex with its position and its values."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from ..arrays import Doubles, Floats
from ..progress import Step, Steps, finish
from .atomic_write import refused, whole_file
from .map_names import words_of
from .mesh_files import parts_of
from .structures.structure import Structure, as_structures

POSITION = ("x_mm", "y_mm", "z_mm")
SURFACE = "structure"  # The first column if there are several surfaces.


def write_map_table(path: str | os.PathLike[str], structures: Sequence[Structure], space: str = "ras") -> None:
    """Write the maps of structures as CSV, whole or not at all.

    Rows are in the order of the surfaces and their vertices. Columns are x_mm, y_mm, z_mm and the maps by name, with 9
    significant digits, enough for the same float32. A missing value is an empty cell. With several structures, the
    first column has their names.

    Parameters
    ----------
    path : path
    structures : sequence of Structure
    space : {"ras", "lps"}
        Axes of the positions.

    Raises
    ------
    OutputError
        For a structure without triangles, a map of another surface, or a place that cannot be written to.
    """
    with whole_file(path) as temporary:
        finish(write_map_table_steps(temporary, structures, space))


def write_map_table_steps(path: Path, structures: Sequence[Structure], space: str = "ras") -> Steps[None]:
    """Do what `write_map_table` does in steps, directly to a path; the caller moves the complete file."""
    named = as_structures(structures, path.name)
    several = len(named) > 1
    names = list(dict.fromkeys(each.name for structure in named for each in structure.maps))
    head = ([SURFACE] if several else []) + list(POSITION)
    turn = np.array([-1, -1, 1] if space == "lps" else [1, 1, 1], np.float32)
    whole = sum(len(structure.vertices) for structure in named) or 1
    done = 0
    try:
        with path.open("wb") as file:
            file.write(_line([*head, *_columns(names, head)]) + b"\n")
            for structure in named:
                prefix = _line([structure.name]) + b"," if several else b""
                for rows in _rows(structure, names, turn):
                    file.write(_text(rows, prefix))
                    done += len(rows)
                    yield Step(done / whole, f"Writing {structure.name}")
    except OSError as error:
        raise refused(path, error) from error


def _columns(names: Sequence[str], head: Sequence[str]) -> list[str]:
    """Return the names of the maps, changed if they are columns of positions."""
    return [name if name not in head else words_of([name], head)[0] for name in names]


def _line(cells: Sequence[str]) -> bytes:
    stream = io.StringIO()
    csv.writer(stream, lineterminator="").writerow(cells)
    return stream.getvalue().encode("utf-8", "replace")


def _rows(structure: Structure, names: Sequence[str], turn: Floats) -> Iterator[Doubles]:
    """Yield positions and values of some thousand vertices at a time, (n, 3 + maps) float64."""
    values = {each.name: each.values for each in structure.maps}
    for part in parts_of(len(structure.vertices)):
        positions = structure.vertices[part] * turn
        columns = [values[name][part] if name in values else np.full(len(positions), np.nan) for name in names]
        yield np.concatenate([positions, *(column[:, None] for column in columns)], axis=1, dtype=np.float64) + 0.0


def _text(rows: Doubles, prefix: bytes) -> bytes:
    """Return rows as lines, each after the prefix; NaN is left out."""
    line = b",".join([b"%.9g"] * rows.shape[1]) + b"\n"
    text = ((line * len(rows)) % tuple(rows.ravel().tolist())).replace(b",nan", b",")
    return prefix + text[:-1].replace(b"\n", b"\n" + prefix) + b"\n" if prefix else text
