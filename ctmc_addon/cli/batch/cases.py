# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the cases of a batch: folders, files, globs and manifests become paths, names and settings.

Only names and first bytes are looked at; nothing is read yet.
"""

from __future__ import annotations

import glob
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import takewhile
from pathlib import Path
from typing import Any

from ... import readers
from ...core import CtmcError, OutputError, ReadError, ReconstructionSettings, SettingsError, share_walls
from ...core.files.file_names import LONGEST_BYTES, file_key, name_problem
from ...core.solid import SolidRequest
from ...readers import VOLUME_SUFFIXES, ReadingOptions, natural_key, stem, suffix
from ..flags.arguments import UsageError, choices_of, label_for_checks, overridden
from ..flags.combined import labels_of
from ..flags.maps import NO_MAPS, AskedMaps
from ..flags.solid import NOTHING, overridden_solid, require_built_in, solid_of
from .manifest import CaseInput, manifest_inputs

DEEPEST = 6  # Folders are searched for cases to this depth.
LARGEST_VALUE = 8  # No voxel takes more bytes.
TAKEN = ("summary", "labels")


@dataclass(frozen=True)
class Output:
    """One output of a case: the stem of its files, and how its surface is made, or its surfaces of several labels."""

    name: str
    settings: ReconstructionSettings
    labels: tuple[int | str, ...] = ()  # Numbers, names or `all`; empty for the label of the settings.
    shared_labels: tuple[int, ...] = ()  # Labels whose surfaces are made at once, with that of the settings.

    def plain(self) -> dict[str, Any]:
        """Return the case as plain data, for JSON."""
        settings = self.settings.to_dict()
        if self.labels:
            settings.pop("label", None)
        return {
            "name": self.name,
            "settings": settings,
            "labels": list(self.labels),
            "beside": list(self.shared_labels),
        }


@dataclass(frozen=True, eq=False)
class Case:
    """One volume, how it is read, and what to make from it: an output for each label, or one for labels by name."""

    name: str
    path: Path
    reading: ReadingOptions
    outputs: tuple[Output, ...]
    maps: AskedMaps = NO_MAPS
    solid: SolidRequest = NOTHING


def collect(
    inputs: Sequence[str],
    settings: Mapping[str, Any],
    reading: ReadingOptions,
    aside: Path | None = None,
    maps: AskedMaps = NO_MAPS,
    solid: Mapping[str, Any] | None = None,
) -> list[Case]:
    """Return the cases in the order of the inputs, those of a folder in natural order.

    Parameters
    ----------
    inputs : sequence of str
        Folders, files, globs and `.csv` manifests.
    settings : mapping
        Of every case, by name; a manifest's own win. `label` may be a list, which gives as many surfaces.
    reading : ReadingOptions
        Of every case; a manifest's own win.
    aside : path, optional
        A folder to pass over: the output's, where it lies within an input's.
    maps : AskedMaps
        Of every case; a manifest's own are added.
    solid : mapping, optional
        Values of `given_solid` for every case; a manifest's own win.

    Raises
    ------
    CtmcError
        If an input is missing, a setting is wrong, or two cases would write the same file.
    """
    sources: list[CaseInput] = []
    for word in inputs:
        sources += _inputs_of(word, None if aside is None else aside.resolve())
    # A glob or a folder's list brings the labels of LiTS along; they belong to their volumes.
    labels = {readers.segmentation_sibling(source.path) for source in sources if not source.where}
    sources = [source for source in sources if source.where or source.path not in labels]
    cases = [_case_of(source, settings, reading, maps, solid or {}) for source in sources]
    _require_different_files(cases)
    return cases


def _inputs_of(word: str, aside: Path | None) -> list[CaseInput]:
    input_path = Path(word)
    if suffix(input_path) == ".csv" and input_path.is_file():
        return manifest_inputs(input_path)
    if not input_path.exists() and glob.has_magic(word):
        paths = _paths_of(word, aside)
        if not paths:
            raise ReadError(f"no file or folder fits '{word}'; check the pattern")
        return [source for path in paths for source in _inputs_at(path, aside)]
    return _inputs_at(readers.existing_path(input_path), aside)


def _paths_of(pattern: str, aside: Path | None) -> list[Path]:
    """Return the paths that fit a pattern, in natural order, without the folder to pass over and its content.

    A pattern that begins in that folder, or below it, means what is there.
    """
    parts = Path(pattern).parts
    begin = Path(*takewhile(lambda part: not glob.has_magic(part), parts)).resolve()
    paths = sorted((Path(path) for path in glob.glob(pattern, recursive=True)), key=natural_key)  # noqa: PTH207  (absolute too)
    if aside is None or aside in (begin, *begin.parents):
        return paths
    return [path for path in paths if aside not in (path.resolve(), *path.resolve().parents)]


def _inputs_at(input_path: Path, aside: Path | None) -> list[CaseInput]:
    """Return the volumes in a folder, or the one that a file is."""
    if not input_path.is_dir() or readers.folder_format(input_path):
        return [CaseInput(input_path, readers.volume_name(input_path))]
    volumes = _volumes_in(input_path, aside, DEEPEST)
    return [CaseInput(volume_path, name) for volume_path, name in volumes] or [CaseInput(input_path, stem(input_path))]


def _volumes_in(folder: Path, aside: Path | None, deepest: int) -> list[tuple[Path, str]]:
    """Return volumes and names: a folder's volume files, else itself if it holds slices, else those of its folders.

    A folder with one volume names it; of several, each also keeps its own name. One with none stays in the list: that
    nothing is in it should be said, not passed over.
    """
    files = _volume_files(folder)
    if files:
        return [(file, stem(file)) for file in files]
    if readers.holds_slices(folder):
        return [(folder, stem(folder))]
    nested: list[tuple[Path, str]] = []
    entries = sorted((entry for entry in folder.iterdir() if not entry.name.startswith(".")), key=natural_key)
    for inner in entries if deepest else []:
        if inner.is_dir() and inner.resolve() != aside:
            volumes = _volumes_in(inner, aside, deepest - 1) or [(inner, "")]
            is_single = len(volumes) == 1
            nested += [(path, inner.name if is_single else f"{inner.name}-{name}") for path, name in volumes]
    return nested


def _volume_files(folder: Path) -> list[Path]:
    """Return files and folders that are volumes, in natural order, without labels that belong to one of them."""
    entries = sorted((entry for entry in folder.iterdir() if not entry.name.startswith(".")), key=natural_key)
    files = [entry for entry in entries if entry.is_file()]
    volumes = [
        entry
        for entry in entries
        if (readers.folder_format(entry) if entry.is_dir() else suffix(entry) in VOLUME_SUFFIXES)
    ]
    if not volumes:
        tiffs = [file for file in files if suffix(file) in readers.PAGE_SUFFIXES]
        volumes = tiffs if tiffs and readers.is_volume_file(tiffs[0]) else []
    labels = {readers.segmentation_sibling(file) for file in volumes}
    return [file for file in volumes if file not in labels]


def _case_of(
    source: CaseInput,
    settings: Mapping[str, Any],
    reading: ReadingOptions,
    maps: AskedMaps,
    solid_values: Mapping[str, Any],
) -> Case:
    """Return the case of an input: a surface for each of its labels, or one; the parts of a solid are one output."""
    values = overridden(settings, source.settings)
    try:
        solid = solid_of(overridden_solid(solid_values, source.solid))
        choices = labels_of(choices_of(values), solid)
        numbers = [choice for choice in choices if isinstance(choice, int)]
        if len(numbers) < len(choices) or (solid and len(choices) > 1):
            several = ReconstructionSettings(**values | {"label": label_for_checks(choices)})
            outputs: tuple[Output, ...] = (Output(source.name, several, choices),)
        else:
            names = [f"{source.name}-label-{label}" for label in numbers] if len(numbers) > 1 else [source.name]
            every = [ReconstructionSettings(**values | {"label": label}) for label in numbers or (None,)]
            shared_labels = tuple(numbers) if share_walls(every) else ()
            outputs = tuple(
                Output(name, settings, shared_labels=shared_labels) for name, settings in zip(names, every, strict=True)
            )
        for output in outputs:
            require_built_in(solid, output.settings)
    except (SettingsError, UsageError) as error:
        if not source.where:
            raise UsageError(str(error)) from error
        raise SettingsError(f"{source.where}: {error}") from error
    for output in outputs:
        require_file_name(output.name, source.where)
    return Case(source.name, source.path, replace(reading, **source.reading), outputs, maps.of_case(source.maps), solid)


def _require_different_files(cases: Sequence[Case]) -> None:
    """Refuse two outputs with one name."""
    seen: dict[str, Case] = {}
    for case in cases:
        for output in case.outputs:
            key = file_key(output.name)
            if key in seen:
                raise OutputError(
                    f"two cases would write the same file {output.name}: {_short(seen[key])} and {_short(case)}; "
                    "give them names in the column 'case' of a manifest"
                )
            seen[key] = case


def require_file_name(name: str, where: str) -> None:
    """Refuse a name that is not a valid file name on every system; `where` is its place in a manifest, if any."""
    remedy = "choose another name" if where else "name the case in a manifest's column 'case'"
    line = f"{where}: " if where else ""
    if name.casefold() in TAKEN:
        raise OutputError(f"{line}a case called {name} would write the summary's own file; {remedy}")
    size = len(name.encode("utf-8", "surrogatepass"))
    if size > LONGEST_BYTES:
        raise OutputError(
            f"{line}the case's name '{name[:20]}...' has {size} bytes and may have {LONGEST_BYTES}; {remedy}"
        )
    if problem := name_problem(name):
        raise OutputError(f"{line}{name!r} is not a valid file name on every system: {problem}; {remedy}")


def _short(case: Case) -> str:
    """Return the last two names of the case's path."""
    return "/".join(case.path.parts[-2:])


def values_of(path: Path, allow_outside: bool) -> tuple[int, int]:
    """Return the number of voxels to read and the bytes of one, or the most bytes of any type.

    There are none where that is unknown, as of broken headers, which fail at once.
    """
    try:
        if path.is_dir():
            return readers.estimate_voxels(path, allow_outside), LARGEST_VALUE
        series = readers.open_volume(path, allow_outside).series
    except OutputError:  # it would replace a file of this input
        raise
    except (CtmcError, OSError):
        return 0, LARGEST_VALUE
    return max(((math.prod(each.shape), each.voxel_bytes) for each in series), default=(0, LARGEST_VALUE))
