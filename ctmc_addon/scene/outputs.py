"""Write a file whole or not at all.

The file is made beside its place under another name and moved there once it is complete, so neither
a full disk nor a crash leaves half of one, and an older file stays until the new one is ready.
"""

from __future__ import annotations

import errno
import os
import shutil
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ..core.errors import OutputError

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

ZEROS = bytes(2**20)


@contextmanager
def written_whole(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A name beside `path` to write to; moved to `path` at the end, removed if anything goes wrong.

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
        with suppress(OSError):  # what could not be made is not there either
            beside.unlink()


def require_room(path: Path, size: int) -> None:
    """Raise `OSError` now if `size` bytes cannot be written to `path`; the file is left empty.

    Asked before an exporter starts, as Blender's PLY exporter ends the whole process when the disk is full.
    """
    with path.open("r+b") as file:
        if hasattr(os, "posix_fallocate"):
            os.posix_fallocate(file.fileno(), 0, size)
        else:
            for start in range(0, size, len(ZEROS)):
                file.write(ZEROS[: size - start])
        file.truncate(0)


def refused(path: Path, error: OSError) -> OutputError:
    """What an `OSError` means for whoever wanted `path`, with a remedy."""
    remedy = REMEDIES.get(error.errno or 0, f"{error.strerror or error}; choose another place")
    return OutputError(f"{path.name} cannot be written to {path.parent.resolve().name or path.parent}: {remedy}")


def require_complete(path: Path, written: int, expected: int, name: str) -> None:
    """Raise `OutputError` if `written` is not what was `expected`, bytes or faces, of the file `name`."""
    if written != expected:
        free = shutil.disk_usage(path.parent).free // 2**20
        raise OutputError(
            f"{name} came out incomplete ({written} of {expected}) and was removed; "
            f"{free} MiB are free there, so free some space or choose another disk"
        )
