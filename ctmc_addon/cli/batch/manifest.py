# SPDX-License-Identifier: GPL-3.0-or-later
"""Read a CSV manifest: a line for each case, with its input, its name and its own settings.

Columns: `input` (a path, from the manifest's folder), `case` (a name), the settings by name or flag, how the input is
read, and maps and solids by their flags. An empty cell means what holds for all cases.
"""

from __future__ import annotations

import argparse
import csv
import io
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ...core import SETTINGS, ReadError, Setting, SettingsError, descriptions
from ...core.files.input_files import add_inputs
from ...readers import ReadingOptions, stem
from ..flags.arguments import UsageError, flag_of, label_choices
from ..flags.described import value_reader
from ..flags.maps import KINDS, NO_MAPS, AskedMaps, limit_of
from ..flags.solid import COLUMNS as SOLID, cells_of

READING = {name: about for name, about in descriptions(ReadingOptions).items() if about.kept}
Parse = Callable[[str], Any]
LIMIT_COLUMN = "map-limit"
LONGEST_PLACE = 20  # A message shows this many letters before a byte that is not UTF-8.
SWITCHES = {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}


@dataclass(frozen=True)
class CaseInput:
    """One input, the name of its case, and its own settings."""

    path: Path
    name: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    reading: Mapping[str, Any] = field(default_factory=dict)
    maps: AskedMaps = NO_MAPS
    solid: Mapping[str, Any] = field(default_factory=dict)
    where: str = ""  # Such as 'cases.csv, line 3'; empty without a manifest.


@dataclass(frozen=True)
class ManifestRow:
    """The cells of a row that are not empty, by the names of their columns.

    Parameters
    ----------
    own : mapping
        Columns of this kind of manifest, such as input and case.
    settings, reading : mapping
    maps : AskedMaps
    solid : mapping
        As `overridden_solid` takes it.
    where : str
        Such as 'cases.csv, line 3'.
    """

    own: Mapping[str, Any]
    settings: Mapping[str, Any]
    reading: Mapping[str, Any]
    maps: AskedMaps
    solid: Mapping[str, Any]
    where: str


INPUT_COLUMNS: Mapping[str, Parse] = {"input": str, "case": str}


def manifest_inputs(path: Path) -> list[CaseInput]:
    """Read the rows of a manifest as inputs; errors are those of `manifest_rows`."""
    inputs = []
    for row in manifest_rows(path, INPUT_COLUMNS, {"input": "it names each case's file or folder"}):
        input_path = input_of(row, "input", path.parent)
        name = row.own.get("case", stem(input_path))
        maps = row.maps.in_folder(path.parent)
        inputs.append(CaseInput(input_path, name, row.settings, row.reading, maps, row.solid, row.where))
    return inputs


def manifest_rows(path: Path, own: Mapping[str, Parse], required: Mapping[str, str]) -> list[ManifestRow]:
    """Read the rows of a manifest.

    Parameters
    ----------
    path : Path
    own : mapping of str to function
        Columns beside those of settings and reading, and what reads their cells.
    required : mapping of str to str
        Columns that there must be, and what they do, for messages.

    Raises
    ------
    ReadError
        If it is not text, has no rows, an unknown column, or names a missing file; with the number of the line.
    SettingsError
        If a cell does not fit its column.
    """
    add_inputs([path])
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ReadError(f"{_not_utf8(error.object, error.start, path.name)}; save it as 'CSV UTF-8'") from error
    except OSError as error:
        raise ReadError(f"{path.name} cannot be read ({error.strerror}); check its permissions") from error
    rows: list[ManifestRow] = []
    columns: list[tuple[str, str, Parse]] = []
    for where, cells in _rows_of(text, path.name):
        if not any(cells):
            continue
        if not columns:
            columns = [_column_of(cell, where, own) for cell in cells]
            _require_columns([column[1] for column in columns], where, required)
        elif len(cells) > len(columns) and any(cells[len(columns) :]):
            raise ReadError(f"{where} has {len(cells)} cells and there are {len(columns)} columns; quote a comma")
        else:
            rows.append(_row_of(columns, cells, where))
    if not rows:
        raise ReadError(f"{path.name} names no case; it needs a line of columns and a line for each case")
    return rows


def _not_utf8(content: bytes, at: int, name: str) -> str:
    """Return the byte of a manifest that is not UTF-8, and its position."""
    lines = content[:at].decode("utf-8", "replace").split("\n")
    behind = f" behind {lines[-1][-LONGEST_PLACE:]!r}" if lines[-1] else ""
    return f"{name}, line {len(lines)}: the byte 0x{content[at]:02x}{behind} is not UTF-8"


def _rows_of(text: str, name: str) -> Iterator[tuple[str, list[str]]]:
    """Yield where each row ends, such as 'cases.csv, line 3', and its cells without spaces around them."""
    first = text.partition("\n")[0]
    # Spreadsheets write semicolons where the comma is the decimal sign.
    lines = csv.reader(io.StringIO(text, newline=""), delimiter=";" if ";" in first and "," not in first else ",")
    while True:
        begin = lines.line_num + 1
        try:
            cells = next(lines)
        except StopIteration:
            return
        except csv.Error as error:
            raise ReadError(f"{name}, line {begin}: the row cannot be read ({error}); close its quotes") from error
        yield f"{name}, line {lines.line_num}", [cell.strip() for cell in cells]


def _column_of(title: str, where: str, own: Mapping[str, Parse]) -> tuple[str, str, Parse]:
    """Return a column by its title: its kind ('', 'settings' or 'reading'), its name and the parser of its cells."""
    columns: dict[str, tuple[str, str, Parse]] = {name: ("", name, parse) for name, parse in own.items()}
    for name, about in SETTINGS.items():
        columns[name] = columns[_underscored(_word_of(name))] = ("settings", name, _parse_of(name, about))
    columns["soften"] = columns["soften_mm"] = columns["smoothing_mm"]  # as older manifests have it
    for name in (*KINDS, LIMIT_COLUMN):
        columns[_underscored(name)] = ("maps", name, str)
    for name, read in SOLID.items():
        columns[name] = ("solid", name, read)
    for kind in KINDS.values():
        for name, about in descriptions(kind.options).items() if kind.options else ():
            columns[name] = ("options", name, _parse_of(name, about))
    for name, about in READING.items():
        columns[name] = ("reading", name, _parse_of(name, about))
    column = columns.get(_underscored(title.lower()), ("", "", str))
    if not column[1]:
        further = [*(name.replace("_", "-") for name in READING), *KINDS, *map(_word_of, SOLID)]
        there = ", ".join([*own, *map(_word_of, SETTINGS), *further])
        raise ReadError(f"{where}: unknown column '{title}'; the columns are {there}")
    return column


def _word_of(name: str) -> str:
    """Return the title of a column: a setting's flag without its dashes, else the name itself.

    Examples
    --------
    >>> _word_of("min_part_mm3"), _word_of("keep_parts"), _word_of("case")
    ('min-part', 'keep-parts', 'case')
    """
    if name in SOLID:
        return name.replace("_", "-")
    return flag_of(name, SETTINGS[name]).lstrip("-") if name in SETTINGS else name


def _underscored(title: str) -> str:
    """Return a title as names are written: 'keep_parts' of '--keep-parts'."""
    return title.lstrip("-").replace("-", "_")


def _require_columns(names: list[str], where: str, required: Mapping[str, str]) -> None:
    """Refuse a manifest without a column that is needed or with a column twice."""
    for name, purpose in required.items():
        if name not in names:
            raise ReadError(f"{where}: there is no column '{name}'; {purpose}")
    for name in names:
        if names.count(name) > 1:
            raise ReadError(f"{where}: column '{_word_of(name)}' appears twice; keep one")


def _row_of(columns: list[tuple[str, str, Parse]], cells: list[str], where: str) -> ManifestRow:
    values: dict[str, dict[str, Any]] = {"": {}, "settings": {}, "reading": {}, "maps": {}, "options": {}, "solid": {}}
    for (kind, name, parse), cell in zip(columns, cells, strict=False):
        if not cell:
            continue
        try:
            values[kind][name] = parse(cell)
        except argparse.ArgumentTypeError as error:
            raise SettingsError(f"{where}: {_word_of(name)} cannot be '{cell}'; {error}") from error
    maps = _maps_of(values["maps"], values["options"], where)
    return ManifestRow(values[""], values["settings"], values["reading"], maps, cells_of(values["solid"]), where)


def input_of(row: ManifestRow, name: str, folder: Path) -> Path:
    """Return the path in a column of a row, from the manifest's folder; raise `ReadError` if there is none."""
    if name not in row.own:
        raise ReadError(f"{row.where}: the {name} is missing; give a file or a folder")
    path = folder / row.own[name]
    if not path.exists():
        raise ReadError(f"{row.where}: there is no file or folder {row.own[name]!r}; check the path")
    return path


def _maps_of(cells: Mapping[str, str], options: Mapping[str, Any], where: str) -> AskedMaps:
    """Return the maps of a row; several of one column are separated by '|'."""
    quantities: list[tuple[str, str]] = []
    limits: list[tuple[str, float | None, float | None]] = []
    for name, cell in cells.items():
        parts = [part.strip() for part in cell.split("|")]
        if name == LIMIT_COLUMN:
            try:
                limits += map(limit_of, parts)
            except UsageError as error:
                raise SettingsError(f"{where}: {error}") from error
        elif KINDS[name].metavar:
            quantities += [(name, part) for part in parts]
        elif _switch_of(name, cell, where):
            quantities.append((name, ""))
    return AskedMaps(tuple(quantities), dict(options), tuple(limits))


def _switch_of(name: str, cell: str, where: str) -> bool:
    try:
        return _switch(cell)
    except argparse.ArgumentTypeError as error:
        raise SettingsError(f"{where}: {name} cannot be '{cell}'; {error}") from error


def _parse_of(name: str, about: Setting) -> Parse:
    """Return the parser of a setting's cells."""
    if about.type is bool:
        return _switch
    if about.choices:
        return str
    return label_choices if name == "label" else value_reader(name, about)


def _switch(cell: str) -> bool:
    """Read a truth value from a cell."""
    if cell.lower() not in SWITCHES:
        raise argparse.ArgumentTypeError("write true or false")
    return SWITCHES[cell.lower()]
