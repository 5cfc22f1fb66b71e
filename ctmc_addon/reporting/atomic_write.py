"""Write a file whole or not at all, and find out before the work whether a place can be written to.

A file is made beside its place under another name and moved there once it is complete: neither a full
disk nor a crash leaves half of one, and an older file stays until the new one is ready.
"""

from __future__ import annotations

import errno
import json
import os
import shutil
import uuid
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from ..core import OutputError

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
    """A name beside `path`, with its suffix, to write to; moved to `path` at the end, removed if anything goes wrong.

    Raises
    ------
    OutputError
        If the folder is missing, full or closed to us, or `path` cannot be replaced.
    """
    target = Path(path)
    # A short name of its own: the target's may already be as long as the disk allows.
    beside = target.parent / f".ctmc-{uuid.uuid4().hex[:12]}{target.suffix}"
    try:
        beside.open("xb").close()
        yield beside
        beside.replace(target)
    except OSError as error:
        raise refused(target, error) from error
    finally:
        try:
            beside.unlink(missing_ok=True)
        except OSError:
            pass  # a folder that is none; said already


@contextmanager
def whole_files(paths: Iterable[Path]) -> Iterator[dict[Path, Path]]:
    """For every path a place to write it to; all are moved to their paths at the end, none if anything goes wrong.

    The places lie in a hidden folder beside each path, under its name, which errors then show.

    Raises
    ------
    OutputError
        As of `whole_file`.
    """
    hidden = f".ctmc-{uuid.uuid4().hex[:12]}"
    places = {path: path.parent / hidden / path.name for path in paths}
    try:
        for path, place in places.items():
            with _refusing(path):
                place.parent.mkdir(exist_ok=True)
        yield places
        for path, place in places.items():
            with _refusing(path):
                place.replace(path)
    except OutputError as error:
        raise OutputError(str(error).replace(hidden + os.sep, "")) from error
    finally:
        for folder in {place.parent for place in places.values()}:
            shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def _refusing(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise refused(path, error) from error


def refused(path: Path, error: OSError) -> OutputError:
    """What an `OSError` means for whoever wanted `path`, with a remedy."""
    remedy = REMEDIES.get(error.errno or 0, f"{error.strerror or error}; choose another place")
    return OutputError(f"{path} cannot be written: {remedy}")


def require_writable(path: str | os.PathLike[str], suffixes: tuple[str, ...] = ()) -> Path:
    """`path` if a file can be put there and has one of the suffixes, else an `OutputError`; leaves nothing behind."""
    target = Path(path)
    if suffixes and target.suffix.lower() not in suffixes:
        name = target.name or "an empty name"
        raise OutputError(f"{name} needs one of the suffixes {', '.join(suffixes)}; they choose the format")
    if target.is_dir():
        raise refused(target, IsADirectoryError(errno.EISDIR, ""))
    try:
        probe = target.parent / f".ctmc-{uuid.uuid4().hex[:12]}"
        probe.open("xb").close()
        probe.unlink()
    except OSError as error:
        raise refused(target, error) from error
    return target


def made_folder(path: str | os.PathLike[str]) -> Path:
    """The folder `path`, made with its parents if need be, or an `OutputError`."""
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise refused(folder, NotADirectoryError(errno.ENOTDIR, "") if folder.exists() else error) from error
    return folder


@contextmanager
def own_folder(path: str | os.PathLike[str]) -> Iterator[Path]:
    """`made_folder`; of what was made, that which has nothing in it at the end is removed again."""
    folder = Path(path)
    missing = [one for one in (folder, *folder.parents) if not one.exists()]
    try:
        yield made_folder(folder)
    finally:
        with suppress(OSError):  # rmdir removes no folder that holds something
            for one in missing:
                one.rmdir()


def write_json(path: str | os.PathLike[str], content: Any) -> None:
    """Write `content` as indented UTF-8 JSON, whole or not at all."""
    text = json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    with whole_file(path) as beside:
        beside.write_bytes(text.encode())
