# SPDX-License-Identifier: GPL-3.0-or-later
"""Write a file whole or not at all, and check before the work whether a file can be written.

A file is written next to its path under a temporary name and moved there when complete: neither a full disk nor a
crash leaves half of one, and an older file stays until the new one is ready. A link stays a link: what it points to
is replaced. The new file gets the permissions of the older one. A file of the input is never replaced.
"""

from __future__ import annotations

import csv
import errno
import io
import json
import os
import shutil
import stat
import uuid
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from ..errors import OutputError
from .input_files import plan_output, require_no_input
from .temporary_names import remove_leftovers, temporary_name, without_temporary

REMEDIES = {
    errno.ENOENT: "the folder does not exist; make it first",
    errno.ENOTDIR: "the folder is a file; choose another",
    errno.EACCES: "writing there is not allowed; choose another folder",
    errno.EPERM: "writing there is not allowed; choose another folder",
    errno.EROFS: "the disk is read-only; choose another folder",
    errno.EISDIR: "a folder has that name; choose another name",
    errno.ENOSPC: "the disk is full; free some space or choose another disk",
    errno.EDQUOT: "the quota is used up; free some space or choose another disk",
    errno.EFBIG: "the disk allows no file that large; choose another disk",
    errno.ENAMETOOLONG: "the name is too long; choose a shorter one",
}


@contextmanager
def whole_file(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path next to `path` to write to; move it to `path` at the end, or remove it after an error.

    Raises
    ------
    OutputError
        If the folder is missing, full or not writable, or `path` cannot be replaced or is an input.
    """
    target = Path(path)
    require_no_input(target)
    # A short name of its own: the target's may already be as long as the disk allows.
    temporary_path = _linked(target).with_name(temporary_name() + target.suffix)
    with _refusing(target):
        try:
            temporary_path.open("xb").close()
            _copy_mode(target, temporary_path)  # The temporary file is as private.
            yield temporary_path
            _copy_mode(target, temporary_path)  # Blender writes a new file.
            _sync(temporary_path)
            temporary_path.replace(_linked(target))
            _sync_folder(temporary_path.parent)
        finally:
            with suppress(OSError):  # the folder may not exist
                temporary_path.unlink(missing_ok=True)


@contextmanager
def whole_files(paths: Iterable[Path]) -> Iterator[dict[Path, Path]]:
    """Yield a temporary path for every path; move all files at the end, or none after an error.

    A temporary path lies in a hidden folder next to its path and keeps the name, which errors show. If a file cannot be
    moved, the moves before are reverted: the older files return and the new ones are removed.

    Raises
    ------
    OutputError
        For the reasons of `whole_file`.
    """
    hidden = temporary_name()
    temporary_paths = {path: _linked(path).parent / hidden / path.name for path in paths}
    for path in temporary_paths:
        require_no_input(path)
    try:
        for path, temporary_path in temporary_paths.items():
            with _refusing(path):
                temporary_path.parent.mkdir(0o700, exist_ok=True)
        yield temporary_paths
        _replace_all(temporary_paths)
    except OutputError as error:
        raise OutputError(str(error).replace(hidden + os.sep, "")) from error
    finally:
        for folder in {temporary_path.parent for temporary_path in temporary_paths.values()}:
            shutil.rmtree(folder, ignore_errors=True)


def _replace_all(places: Mapping[Path, Path]) -> None:
    """Move every temporary file to its path, or none of them."""
    older: dict[Path, Path | None] = {}  # A second name of the file at each path.
    for path, place in places.items():
        with _refusing(path):
            _copy_mode(path, place)
            _sync(place)
            older[path] = _second_name(_linked(path), place.parent) if path.exists() else None
    targets = {path: _linked(path) for path in places}
    try:
        for path, place in places.items():
            with _refusing(path):
                place.replace(targets[path])
    except BaseException:  # Ctrl-C too
        for path, target in targets.items():
            if places[path].exists():  # not moved
                continue
            with suppress(OSError):
                second = older[path]
                target.unlink() if second is None else second.replace(target)
        raise
    for folder in {target.parent for target in targets.values()}:
        _sync_folder(folder)


def _linked(path: Path) -> Path:
    """Return the file that a link points to, or the path itself."""
    return Path(os.path.realpath(path)) if path.is_symlink() else path


def _copy_mode(older: Path, path: Path) -> None:
    """Give a file the permissions of an older one, if there is one."""
    with suppress(OSError):  # some disks have no permissions
        path.chmod(stat.S_IMODE(older.stat().st_mode))


def _second_name(path: Path, folder: Path) -> Path:
    """Return a hard link to the file in `folder`, or a copy where the disk does not know links."""
    second = folder / uuid.uuid4().hex[:12]
    try:
        os.link(path, second)
    except OSError:
        shutil.copy2(path, second)
    return second


def _sync(path: Path) -> None:
    """Write a file's bytes to the disk before the file is renamed."""
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def _sync_folder(folder: Path) -> None:
    """Write a folder's names to the disk if the system can."""
    if os.name == "nt":
        return
    with suppress(OSError):  # some network disks refuse it
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


@contextmanager
def _refusing(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise refused(path, error) from error


def refused(path: Path, error: OSError) -> OutputError:
    """Return an `OutputError` that explains an `OSError` about `path`, with a remedy."""
    remedy = REMEDIES.get(error.errno or 0, f"{error.strerror or error}; choose another place")
    return OutputError(f"{without_temporary(path)} cannot be written: {remedy}")


def require_writable(path: str | os.PathLike[str], suffixes: tuple[str, ...] = ()) -> Path:
    """Return `path` if a file can be written there and has one of the suffixes; raise an `OutputError` otherwise.

    A path that is an input is refused, now or as soon as the input is opened. Leftovers of killed processes in its
    folder are removed.
    """
    target = Path(path)
    if suffixes and not (target.suffix and target.name.lower().endswith(suffixes)):  # .stl alone has none
        name = target.name or "an empty name"
        several = f"one of the suffixes {', '.join(suffixes)}; it chooses the format"
        raise OutputError(f"{name} needs {several if len(suffixes) > 1 else f'the suffix {suffixes[0]}'}")
    if target.is_dir():
        raise refused(target, IsADirectoryError(errno.EISDIR, ""))
    plan_output(target)
    try:
        probe = _linked(target).with_name(temporary_name())
        probe.open("xb").close()
        probe.unlink()
        remove_leftovers(probe.parent)
    except OSError as error:
        raise refused(target, error) from error
    return target


def create_folder(path: str | os.PathLike[str]) -> Path:
    """Create the folder `path` and its parents if needed, and return it; raise an `OutputError` if that fails."""
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise refused(folder, NotADirectoryError(errno.ENOTDIR, "") if folder.exists() else error) from error
    return folder


@contextmanager
def own_folder(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Create a folder as `create_folder` does; at the end, remove new folders that are still empty."""
    folder = Path(path)
    missing = [parent for parent in (folder, *folder.parents) if not parent.exists()]
    try:
        yield create_folder(folder)
    finally:
        with suppress(OSError):  # rmdir removes no folder that holds something
            for parent in missing:
                parent.rmdir()


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write UTF-8 text with the line ends it has, whole or not at all."""
    with whole_file(path) as temporary:
        temporary.write_bytes(text.encode())


def write_json(path: str | os.PathLike[str], content: Any) -> None:
    """Write `content` as indented UTF-8 JSON, whole or not at all."""
    write_text(path, json_text(content))


def write_csv(path: str | os.PathLike[str], rows: Sequence[Mapping[str, Any]], names: Sequence[str]) -> None:
    """Write rows under their column names as CSV, whole or not at all; missing values stay empty."""
    write_text(path, csv_text(rows, names))


def json_text(content: Any) -> str:
    """`content` as indented JSON; NaN and infinite numbers are refused, as JSON does not know them."""
    return json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def csv_text(rows: Sequence[Mapping[str, Any]], names: Sequence[str]) -> str:
    """Return rows under their column names as CSV.

    Examples
    --------
    >>> print(csv_text([{"a": 1, "b": "x,y"}, {"a": 2}], ["a", "b"]), end="")
    a,b
    1,"x,y"
    2,
    """
    stream = io.StringIO()
    writer = csv.DictWriter(stream, names, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return stream.getvalue()
