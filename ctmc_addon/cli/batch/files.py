# SPDX-License-Identifier: GPL-3.0-or-later
"""Manage the files of a batch: the outputs of a case, and the records by which a later run skips it.

A case's JSON is written last. It carries a key of the input, the settings and the version, so whoever finds it knows
whether the surface beside it is still the one that is asked for. What is being written lies in a hidden folder of the
run until it is complete.
"""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import time
from collections.abc import Container, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

from ...core import VERSION, CtmcError, OutputError, ReconstructionSettings, descriptions, finish
from ...core.files.atomic_write import create_folder, refused, write_json
from ...core.files.input_files import require_no_input
from ...core.files.temporary_names import may_be_in_use, remove_leftovers, temporary_name
from ...core.solid import SolidRequest
from ...readers import ReadingOptions, VolumeSource, files_below, open_volume, open_volume_steps
from ..flags.arguments import label_for_checks
from ..flags.maps import NO_MAPS, AskedMaps

WAITING, RUNNING = "waiting", "running"
DONE, ABSENT, FAILED = "done", "absent", "failed"  # A case that does not have the label is absent.
UNFINISHED = ".ctmc-run-"  # The name goes on with the machine and process of the batch.
THUMBNAILS = "thumbnails"
BLOCK = 1 << 20
PATIENCE, TICK = 5.0, 0.02  # Seconds to remove unfinished files, and between two tries.
SHORTEST_NAME = 5  # Shorter names of files, in letters, cannot identify a patient.


def record_path(folder: Path, name: str) -> Path:
    """Return the path of an output's JSON."""
    return folder / f"{name}.json"


def thumbnail_path(folder: Path, name: str) -> Path:
    """Return the small picture of an output."""
    return folder / THUMBNAILS / f"{name}.png"


def own_unfinished_folder(task: Mapping[str, Any]) -> Path:
    """Return the folder for a case's incomplete files, on the disk of its output.

    Parameters
    ----------
    task : mapping
        What the batch hands to the case.
    """
    return Path(task["folder"], task["unfinished"], task["outputs"][0]["name"])


def batch_is_over(task: Mapping[str, Any]) -> bool:
    """Return whether the batch of a task has ended: its hidden folder is removed, or its local process has ended.

    Another batch may be at work in the folder then, and what this one had not finished is of no use to it.
    """
    unfinished = Path(task["folder"], task["unfinished"])
    try:
        unfinished.stat()
    except FileNotFoundError:
        return True
    except OSError:  # storage that does not answer for a while
        return False
    return not may_be_in_use(unfinished.name)


def require_batch(task: Mapping[str, Any]) -> None:
    """Raise a `CtmcError` if the batch of a task has ended."""
    if batch_is_over(task):
        raise CtmcError(f"the batch has ended, or its folder {task['unfinished']} is not visible from this machine")


def put_output(
    folder: Path,
    name: str,
    unfinished: Path,
    surfaces: Sequence[Path],
    thumbnail: Path | None,
    record: Mapping[str, Any],
) -> None:
    """Replace older files by complete ones, the JSON last: while files change there is no JSON.

    Parameters
    ----------
    folder : Path
        Of the batch.
    name : str
        Of the output.
    unfinished : Path
        The folder that holds the files now.
    surfaces : sequence of Path
    thumbnail : Path, optional
    record : mapping
        The JSON.

    Raises
    ------
    OutputError
        If one of them cannot be written, or would replace a file of the input.
    """
    moves = [(surface, folder / surface.relative_to(unfinished)) for surface in surfaces]
    if thumbnail is not None:
        moves.append((thumbnail, folder / THUMBNAILS / thumbnail.name))
    older = (read_record(folder, name) or {}).get("files")
    target = record_path(folder, name)
    for path in (target, thumbnail_path(folder, name), *(target_path for _, target_path in moves)):
        require_no_input(path)
    try:
        target.unlink(missing_ok=True)
        for path, target in moves:
            create_folder(target.parent)
            path.replace(target)
        _remove_older(folder, name, older, {target for _, target in moves})
        if thumbnail is None:
            thumbnail_path(folder, name).unlink(missing_ok=True)
    except OSError as error:
        raise refused(target, error) from error
    write_json(record_path(folder, name), record)


def _remove_older(folder: Path, name: str, older: Any, kept: Container[Path]) -> None:
    """Remove the files of an output that an older run wrote and this one does not."""
    for file in map(str, older if isinstance(older, list) else []):
        path = folder / name / file.rpartition("/")[2]
        if file == f"{name}/{path.name}" and path not in kept:
            path.unlink(missing_ok=True)
        path = folder / file
        if file == f"{name}{path.suffix}" and path not in kept:
            path.unlink(missing_ok=True)
    if older:
        with suppress(OSError):  # not there, or not empty
            (folder / name).rmdir()


def read_record(folder: Path, name: str) -> dict[str, Any] | None:
    """Return the JSON of an output, None if there is none that can be read."""
    try:
        record = json.loads(record_path(folder, name).read_text("utf-8"))
    except (OSError, ValueError):
        return None
    return record if isinstance(record, dict) else None


def remove_unfinished(folder: Path) -> None:
    """Remove unfinished files of runs that were killed."""
    for each in (folder, folder / THUMBNAILS):
        remove_leftovers(each)


@contextmanager
def unfinished_folder(folder: Path) -> Iterator[str]:
    """Return the name of a new hidden folder in `folder` for incomplete files; it is removed at the end.

    Raises
    ------
    OutputError
        If another run is at work in `folder`, or it cannot be written to.
    """
    own = create_folder(folder / temporary_name(UNFINISHED))
    try:
        # Made first, asked then: of two that start together at least one sees the other.
        for unfinished in folder.glob(UNFINISHED + "*"):
            if unfinished != own and may_be_in_use(unfinished.name):
                raise OutputError(
                    f"another batch is running in {folder}; wait for it, choose another folder, "
                    f"or remove {unfinished.name} there if that batch was ended on another machine"
                )
        yield own.name
    finally:
        _remove_in_use(own)


def _remove_in_use(folder: Path) -> None:
    """Remove a folder in which ending processes may still write for a moment."""
    end = time.monotonic() + PATIENCE
    shutil.rmtree(folder, ignore_errors=True)
    while folder.exists() and time.monotonic() < end:  # a file came while the others were removed
        time.sleep(TICK)
        shutil.rmtree(folder, ignore_errors=True)


def remove_own_unfinished(unfinished: Path) -> None:
    """Remove a case's incomplete files, and the hidden folder of an ended batch with its last case.

    The folder of a batch that lives stays: by it the other cases know that the batch lives.
    """
    _remove_in_use(unfinished)
    if not may_be_in_use(unfinished.parent.name):
        with suppress(OSError):  # not empty while other cases of the run work there
            unfinished.parent.rmdir()


def identity(task: Mapping[str, Any], output: Mapping[str, Any]) -> dict[str, Any]:
    """Return the part of a JSON that must match this output, in addition to the key of the input."""
    reading = options_of(task)
    return {
        "version": VERSION,
        "settings": output["settings"],
        "labels": output["labels"],
        "beside": output["beside"],
        "reading": {name: getattr(reading, name) for name, about in descriptions(ReadingOptions).items() if about.kept},
        "format": task["format"],
        "space": task["space"],
        "solid": task.get("solid"),
        # A page or a measure more than is asked for does no harm.
        **{name: True for name in ("html", "hu", "map_table") if task.get(name)},
        **({"asked_maps": maps.named(), "map_files": maps.state_of_files()} if (maps := maps_of_task(task)) else {}),
        **({"pair": task["pair"]} if "pair" in task else {}),
    }


def maps_of_task(task: Mapping[str, Any]) -> AskedMaps:
    """Return the maps that a task asks for."""
    return AskedMaps.from_plain(task["maps"]) if task.get("maps") else NO_MAPS


def solid_of_task(task: Mapping[str, Any]) -> SolidRequest:
    """Return the solid that a task asks for."""
    return SolidRequest.from_dict(task.get("solid") or {})


def stands_for(record: Mapping[str, Any], task: Mapping[str, Any], output: Mapping[str, Any]) -> bool:
    """Return whether a JSON is that of this output, made without an error, its files as they were written.

    Parameters
    ----------
    record : mapping
        The JSON.
    task : mapping
    output : mapping
        One of the task's outputs.
    """
    expected: dict[str, Any] = json.loads(json.dumps(identity(task, output)))
    sizes, reading = record.get("file_bytes"), record.get("reading")
    if isinstance(reading, dict):  # strict reading makes no other surface, it refuses: see `is_refused_now`
        record = {**record, "reading": {**reading, "strict": expected["reading"]["strict"]}}
    return (
        record.get("status") in (DONE, ABSENT)
        and all(record.get(key) == value for key, value in expected.items())
        and isinstance(sizes, dict)
        and all(size_of(Path(task["folder"], name)) == size for name, size in sizes.items())
    )


def is_refused_now(record: Mapping[str, Any], task: Mapping[str, Any], source: Path) -> bool:
    """Return whether strict reading is asked for now, was not when a JSON was made, and refuses the input."""
    options = options_of(task)
    return options.strict and not record["reading"]["strict"] and _is_refused(source, options)


@lru_cache(maxsize=1)  # the outputs of a case mostly have one source
def _is_refused(source: Path, options: ReadingOptions) -> bool:
    """Return whether an input cannot be read; it is read until the type of its values is known."""
    try:
        finish(finish(open_volume_steps(source, options.allow_outside)).slabs_steps(options))
    except (CtmcError, OSError):
        return True
    return False


def is_otsu(settings: ReconstructionSettings) -> bool:
    """Return whether a surface is that of Otsu's threshold, as nothing else was asked for."""
    return settings.label is None and settings.threshold is None


def size_of(path: Path) -> int | None:
    """Return the bytes of a file, None if it is not there."""
    try:
        return path.stat().st_size
    except OSError:
        return None


def settings_of(output: Mapping[str, Any]) -> ReconstructionSettings:
    """Return the settings of a task's output; of several labels with one of them, or any."""
    labels = output["labels"]
    return ReconstructionSettings.from_dict(
        output["settings"] | ({"label": label_for_checks(labels)} if labels else {})
    )


def options_of(task: Mapping[str, Any]) -> ReadingOptions:
    """Return the reading options of a task's input."""
    return ReadingOptions.from_dict(task["reading"])


def failed_record(
    task: Mapping[str, Any], output: Mapping[str, Any], error: str, seconds: float | None, status: str = FAILED
) -> dict[str, Any]:
    """Return the JSON of a failed or absent output."""
    return {
        "case": output["name"],
        "status": status,
        "error": without_folders(error, task),
        "faces": None,
        "volume_mm3": None,
        "seconds": seconds,
        **identity(task, output),
        "run": task["run"],
        "files": [],
        "file_bytes": {},
    }


def since(start: float) -> float:
    """Return the seconds since `start`, to a millisecond."""
    return round(time.perf_counter() - start, 3)


def input_key(source: VolumeSource, verify: bool) -> dict[str, str]:
    """Return a key that changes with the input: a hash of the names, sizes and times of its files, or of their content.

    Returns
    -------
    dict
        `fingerprint`, a hash of names, sizes and times; with `verify` also `content_hash`, which reads every byte.
    """
    path = source.path
    names = [file.relative_to(path).as_posix() if path in file.parents else file.name for file in source.files]
    stats = [file.stat() for file in source.files]
    times = [f"{name}\0{stat.st_size}\0{stat.st_mtime_ns}\0" for name, stat in zip(names, stats, strict=True)]
    key = {"fingerprint": hashlib.blake2b("".join(times).encode("utf-8", "surrogatepass"), digest_size=16).hexdigest()}
    if verify:
        content = hashlib.blake2b(digest_size=16)
        for name, stat, file in zip(names, stats, source.files, strict=True):
            content.update(f"{name}\0{stat.st_size}\0".encode("utf-8", "surrogatepass"))
            with file.open("rb") as stream:
                while block := stream.read(BLOCK):
                    content.update(block)
        key["content_hash"] = content.hexdigest()
    return key


def key_or_empty(path: Path, verify: bool, allow_outside: bool = False) -> dict[str, str]:
    """Return the key of the input at a path; empty where it cannot be opened."""
    try:
        return input_key(open_volume(path, allow_outside), verify)
    except (CtmcError, OSError):
        return {}


def is_same_input(record: Mapping[str, Any], key: Mapping[str, str]) -> bool:
    """Return whether the input is the one that a JSON's surface was made from: by its content if that is known."""
    name = "content_hash" if "content_hash" in key else "fingerprint"
    return name in key and record.get(name) == key[name]


def without_folders(text: str, task: Mapping[str, Any]) -> str:
    r"""Return a sentence on one line, its absolute paths shortened to their last part.

    Examples
    --------
    >>> without_folders("/home/a b/x.nii is empty; see C:\\scans\\y.nii, 1/2 mm", {"input": "/home/a b/x.nii"})
    'x.nii is empty; see y.nii, 1/2 mm'
    """
    paths = [Path(task[key]) for key in ("input", "after", "folder") if task.get(key)]
    for path in sorted(
        {*paths, *(path.parent for path in paths), *(path.resolve() for path in paths)},
        key=lambda path: -len(str(path)),
    ):
        if path.name and path.is_absolute():
            text = text.replace(str(path), path.name)
    text = _without_slices(text, task)
    text = re.sub(r"(?:(?<![\w.:/\\])(?:[A-Za-z]:)?|(?<=:)(?=[\\/][^\\/]))[\\/](?:[^\\/\s'\"]+[\\/])+", "", text)
    return " ".join(text.split())


def _without_slices(text: str, task: Mapping[str, Any]) -> str:
    """Return a sentence that calls files of the input's folder 'file 3 of 20': names of slices often are identifiers.

    A file that names the case stays as it is.
    """
    path = Path(task["input"])
    folder = path if path.is_dir() else path.parent
    if not folder.is_dir() or (folder != path and path.name.startswith(str(task.get("case", path.name)))):
        return text
    numbers, count = _slice_numbers(folder, task.get("run"), task.get("case"))
    for name, number in numbers.items():
        if name in text:
            text = re.sub(rf"(?<![\w.-]){re.escape(name)}(?![\w-])", f"file {number} of {count}", text)
    return text


@lru_cache(maxsize=1)
def _slice_numbers(folder: Path, _run: str | None, _case: str | None) -> tuple[dict[str, int], int]:
    """Return the number of each file in a folder by its name, the longest name first, and how many files there are.

    Names that are too short to tell of whom they are are left out. A folder is looked through once for each case.
    """
    numbers: dict[str, int] = {}
    number = 0
    for number, file in enumerate(files_below(folder), 1):
        if len(file.name) >= SHORTEST_NAME:
            numbers.setdefault(file.name, number)
    return {name: numbers[name] for name in sorted(numbers, key=len, reverse=True)}, number
