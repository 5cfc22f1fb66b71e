# SPDX-License-Identifier: GPL-3.0-or-later
"""Read the pairs of a manifest: a line for each case, with its earlier and later labels, and its own settings.

Columns: `case` (a name), `before` and `after` (paths, from the manifest's folder), `days`, the settings by name or
flag, and how both are read. An empty cell means what holds for all cases.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ....core import OutputError, ReconstructionSettings, SettingsError
from ....core.files.file_names import file_key
from ....readers import ReadingOptions, stem, suffix
from ...commands.change import days, require_comparison
from ...flags.arguments import UsageError, choices_of, label_for_checks, overridden
from ..cases import require_file_name
from ..manifest import ManifestRow, Parse, input_of, manifest_rows

COLUMNS: Mapping[str, Parse] = {"case": str, "before": str, "after": str, "days": days}
REQUIRED = {"before": "it names each case's earlier labels", "after": "it names each case's later labels"}
TAKEN = "changes"  # The combined table is changes.csv.


@dataclass(frozen=True, eq=False)
class PairCase:
    """Labels at two times, and how they are compared."""

    name: str
    before: Path
    after: Path
    labels: tuple[int | str, ...]
    days: float | None
    settings: ReconstructionSettings
    reading: ReadingOptions


def collect_pairs(inputs: Sequence[str], settings: Mapping[str, Any], reading: ReadingOptions) -> list[PairCase]:
    """Return the pairs of manifests, in their order.

    Raises
    ------
    CtmcError
        If an input is not a manifest or is missing, a setting is wrong, or two cases have one name.
    """
    pairs = []
    for word in inputs:
        path = Path(word)
        if suffix(path) != ".csv":
            raise UsageError(f"--pairs takes a .csv with the columns case, before, after, label and days, not {word}")
        pairs += [_pair_of(row, path.parent, settings, reading) for row in manifest_rows(path, COLUMNS, REQUIRED)]
    names: set[str] = set()
    for pair in pairs:
        if file_key(pair.name) in names:
            raise OutputError(f"two cases would write {pair.name}/change.csv; give them names in the column 'case'")
        names.add(file_key(pair.name))
    return pairs


def _pair_of(row: ManifestRow, folder: Path, settings: Mapping[str, Any], reading: ReadingOptions) -> PairCase:
    before, after = (input_of(row, name, folder) for name in ("before", "after"))
    name = row.own.get("case", stem(after))
    require_file_name(name, row.where)
    if name.casefold() == TAKEN:
        raise OutputError(f"{row.where}: a case called {name} would write the combined table; choose another name")
    if row.solid:
        raise SettingsError(f"{row.where}: pairs compare surfaces of labels; leave out the columns of solids")
    values = overridden(settings, row.settings)
    choices = choices_of(values)
    try:
        own = ReconstructionSettings(**values | {"label": label_for_checks(choices)})
        require_comparison(own, choices)
    except (SettingsError, UsageError) as error:
        raise SettingsError(f"{row.where}: {error}") from error
    return PairCase(name, before, after, choices, row.own.get("days"), own, replace(reading, **row.reading))
