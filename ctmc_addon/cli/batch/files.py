"""The files of a batch: what a case leaves behind, and how it is told that a case is done.

A case's JSON is written last. It carries a fingerprint of the input, the settings and the version, so whoever finds
it knows whether the surface beside it is still the one that was asked for. Whatever is being written lies in one
hidden folder until it is complete.
"""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import uuid
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ...core import VERSION, CtmcError
from ...readers import open_volume
from ...reporting.atomic_write import json_text, made_folder, refused

UNFINISHED = ".ctmc-unfinished"
THUMBNAILS = "thumbnails"
BLOCK = 1 << 20


def record_path(folder: Path, name: str) -> Path:
    """The JSON of an output."""
    return folder / f"{name}.json"


def thumbnail_path(folder: Path, name: str) -> Path:
    """The small picture of an output."""
    return folder / THUMBNAILS / f"{name}.png"


def unfinished_folder(folder: Path) -> Path:
    """A new folder for what is being written, on the same disk as where it will go."""
    return made_folder(folder / UNFINISHED / uuid.uuid4().hex[:12])


def put_text(path: Path, text: str) -> None:
    """Write a file of the output folder whole or not at all."""
    beside = made_folder(path.parent / UNFINISHED) / f"{uuid.uuid4().hex[:12]}{path.suffix}"
    try:
        beside.write_bytes(text.encode())
        beside.replace(path)
    except OSError as error:
        beside.unlink(missing_ok=True)
        raise refused(path, error) from error


def put_record(folder: Path, name: str, record: Mapping[str, Any]) -> None:
    """Write the JSON of an output."""
    put_text(record_path(folder, name), json_text(record))


def read_record(folder: Path, name: str) -> dict[str, Any] | None:
    """The JSON of an output, None if there is none that can be read."""
    try:
        record = json.loads(record_path(folder, name).read_text("utf-8"))
    except (OSError, ValueError):
        return None
    return record if isinstance(record, dict) else None


def remove_output(folder: Path, name: str, suffix_of_surface: str) -> None:
    """Take away what an earlier run left of an output, its JSON first."""
    for path in (record_path(folder, name), folder / (name + suffix_of_surface), thumbnail_path(folder, name)):
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            raise refused(path, error) from error


def remove_unfinished(folder: Path) -> None:
    """Take away what a run that was killed had not finished."""
    shutil.rmtree(folder / UNFINISHED, ignore_errors=True)


def identity(task: Mapping[str, Any], output: Mapping[str, Any]) -> dict[str, Any]:
    """What a JSON must carry, besides the fingerprint, to stand for this output."""
    return {
        "version": VERSION,
        "settings": output["settings"],
        "reading": task["reading"],
        "format": task["format"],
        "space": task["space"],
    }


def stands_for(record: Mapping[str, Any], task: Mapping[str, Any], output: Mapping[str, Any]) -> bool:
    """Whether a JSON is that of this output, made without an error, its files as they were written."""
    wanted: dict[str, Any] = json.loads(json.dumps(identity(task, output)))
    sizes = record.get("file_bytes")
    return (
        record.get("status") == "done"
        and all(record.get(key) == value for key, value in wanted.items())
        and isinstance(sizes, dict)
        and all(size_of(Path(task["folder"], name)) == size for name, size in sizes.items())
    )


def size_of(path: Path) -> int | None:
    """Bytes of a file, None if it is not there."""
    try:
        return path.stat().st_size
    except OSError:
        return None


def failed_record(
    task: Mapping[str, Any], output: Mapping[str, Any], error: str, seconds: float | None, fingerprint: str | None
) -> dict[str, Any]:
    """The JSON of an output that did not come about."""
    return {
        "case": output["name"],
        "status": "failed",
        "error": without_folders(error, task),
        "faces": None,
        "volume_mm3": None,
        "seconds": seconds,
        "fingerprint": fingerprint,
        **identity(task, output),
    }


def fingerprint_of(path: Path) -> str:
    """A hash of the content of all files that are read for `path`, and of their names where they are several."""
    total = hashlib.blake2b(digest_size=16)
    files = open_volume(path).files
    for file in files:
        if len(files) > 1:
            name = file.relative_to(path).as_posix() if path in file.parents else file.name
            total.update(f"{name}\0{file.stat().st_size}\0".encode("utf-8", "surrogatepass"))
        with file.open("rb") as stream:
            while block := stream.read(BLOCK):
                total.update(block)
    return total.hexdigest()


def fingerprint_or_none(path: Path) -> str | None:
    """The fingerprint of an input that can be read."""
    try:
        return fingerprint_of(path)
    except (CtmcError, OSError):
        return None


def without_folders(text: str, task: Mapping[str, Any]) -> str:
    r"""A sentence on one line, its absolute paths shortened to their last part.

    Examples
    --------
    >>> without_folders("/home/a b/x.nii is empty; see C:\\scans\\y.nii, 1/2 mm", {"input": "/home/a b/x.nii"})
    'x.nii is empty; see y.nii, 1/2 mm'
    """
    known = [Path(task[key]) for key in ("input", "folder") if task.get(key)]
    for path in sorted({*known, *(one.parent for one in known), *(one.resolve() for one in known)}, key=depth):
        if path.name and path.is_absolute():
            text = text.replace(str(path), path.name)
    text = re.sub(r"(?:(?<![\w.:/\\])(?:[A-Za-z]:)?|(?<=:)(?=[\\/][^\\/]))[\\/](?:[^\\/\s'\"]+[\\/])+", "", text)
    return " ".join(text.split())


def depth(path: Path) -> int:
    """Sort key: the longest path first."""
    return -len(str(path))
