# SPDX-License-Identifier: GPL-3.0-or-later
"""What only Blender's exporters need of an output file: room before they start, and all of it afterwards.

That a file is written whole or not at all is `core/files/atomic_write.py`'s.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from ..core import OutputError

ZEROS = bytes(2**20)


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


def require_complete(path: Path, written: int, expected: int, name: str) -> None:
    """Raise `OutputError` if `written` is not what was `expected`, bytes or faces, of the file `name`."""
    if written != expected:
        free = shutil.disk_usage(path.parent).free // 2**20
        raise OutputError(
            f"{name} came out incomplete ({written} of {expected}) and was removed; "
            f"{free} MiB are free there, so free some space or choose another disk"
        )
