"""One batch at a time in an output folder; the system lets go of the lock however the process ends."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from ...core import OutputError
from ...reporting.atomic_write import refused

LOCK = ".ctmc-lock"


@contextmanager
def folder_of_one_batch(folder: Path) -> Iterator[None]:
    """Hold the folder for the block; an `OutputError` if another batch does."""
    path = folder / LOCK
    try:
        file = path.open("wb")
    except OSError as error:
        raise refused(folder, error) from error
    with file:
        if not locked(file):
            raise OutputError(
                f"another batch is writing to {folder.name or folder}; let it end, or choose another folder"
            )
        try:
            yield
        finally:
            try:
                path.unlink()
            except OSError:
                pass  # Windows removes no open file; an empty one that is hidden stays


def locked(file: IO[bytes]) -> bool:
    """Lock the file for this process; True also on a disk that knows no locks."""
    try:
        if sys.platform == "win32":
            import msvcrt

            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError):  # the latter is how Windows says it
        return False
    except OSError:
        return True
    return True
