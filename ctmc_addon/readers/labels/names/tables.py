# SPDX-License-Identifier: GPL-3.0-or-later
"""Find tables of label names and colors in text files beside a label volume, by their content.

3D Slicer's `.ctbl` and FreeSurfer's look-up tables have a number, a name, and red, green, blue, alpha in a line;
ITK-SNAP has a number, red, green, blue, alpha, two switches and a name in quotes.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from ....core.files.input_files import add_inputs
from ...file_formats import natural_key, stem
from ..colors import RGB
from ..label_map import clean_name
from .total_segmentator import NAMES, is_total_segmentator

SUFFIXES = (".txt", ".ctbl", ".label", ".lut")
MOST_BYTES = 1 << 20  # Larger files are not tables; FreeSurfer's table of all its labels has 70,000 bytes.
MOST_FILES = 100  # Only this many text files of a folder are examined.
BYTE = r"(\d{1,3})"
NAMED = re.compile(rf"(\d{{1,9}})\s+(\S.{{0,250}}?)\s+{BYTE}\s+{BYTE}\s+{BYTE}\s+{BYTE}", re.ASCII)
ITK_SNAP = re.compile(rf"(\d{{1,9}})\s+{BYTE}\s+{BYTE}\s+{BYTE}\s+[\d.]+\s+[01]\s+[01]\s+\"(.*)\"", re.ASCII)


class LabelTable(NamedTuple):
    """Names and colors by label, and a note on their source."""

    names: Mapping[int, str]
    colors: Mapping[int, RGB]
    notes: tuple[str, ...] = ()


def table_for(path: Path, name: str) -> LabelTable:
    """Return the table that belongs to a label volume without names of its own; empty where there is none.

    A table of the volume's name, or the only one in its folder; else TotalSegmentator's where the volume is called so.
    """
    files = [file for file in path.parent.iterdir() if file.suffix.lower() in SUFFIXES] if path.is_file() else []
    own = [file for file in files if stem(path) in (file.stem, stem(file))]
    for candidates in (own, sorted(files, key=natural_key)[:MOST_FILES]):
        tables = {file: table for file in candidates if (table := _read_table(file)) is not None}
        if len(tables) == 1:
            file, table = tables.popitem()
            add_inputs([file])
            return table._replace(notes=(f"names and colors of labels are from {file.name} beside it",))
    if is_total_segmentator(name):
        return LabelTable(NAMES, {}, ("names of labels are those of TotalSegmentator 2, as the file's name says",))
    return LabelTable({}, {})


def _read_table(path: Path) -> LabelTable | None:
    """Return the labels of a text file; None where a line of it is something else."""
    try:
        with path.open("rb") as file:
            content = file.read(MOST_BYTES + 1)
    except OSError:
        return None
    return None if len(content) > MOST_BYTES else parsed(content.decode("utf-8-sig", "replace"))


def parsed(text: str) -> LabelTable | None:
    r"""Return the labels of a table's lines, the background left out; None for any other text.

    Examples
    --------
    >>> parsed("# Slicer\n0 air 0 0 0 0\n1 left lung 10 20 30 255")
    LabelTable(names={1: 'left lung'}, colors={1: (10, 20, 30)}, notes=())
    >>> parsed('2 255 0 0 1 1 1 "Liver"').names
    {2: 'Liver'}
    """
    names: dict[int, str] = {}
    colors: dict[int, RGB] = {}
    for line in map(str.strip, text.splitlines()):
        if not line or line.startswith(("#", "//")):
            continue
        if match := ITK_SNAP.fullmatch(line):
            number, name, color = match[1], match[5], match.group(2, 3, 4)
        elif match := NAMED.fullmatch(line):
            number, name, color = match[1], match[2], match.group(3, 4, 5)
        else:
            return None
        red, green, blue = map(int, color)
        if max(red, green, blue) > 255:
            return None
        if int(number):
            names[int(number)] = clean_name(name.strip('"'), f"label {int(number)}")
            colors[int(number)] = (red, green, blue)
    return LabelTable(names, colors) if names else None
