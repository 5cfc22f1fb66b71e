# SPDX-License-Identifier: GPL-3.0-or-later
"""Check for Blender's exporters that an output file has room.

That a file is written whole or not at all is `core/files/atomic_write.py`'s.
"""

from __future__ import annotations

import os
from pathlib import Path

ZEROS = bytes(2**20)


def require_room(path: Path, size: int) -> None:
    """Raise `OSError` now if `size` bytes cannot be written to `path`; the file is left empty.

    Call it before an exporter: Blender's PLY exporter ends the whole process when the disk is full.
    """
    with path.open("r+b") as file:
        if hasattr(os, "posix_fallocate"):
            os.posix_fallocate(file.fileno(), 0, size)
        else:
            for start in range(0, size, len(ZEROS)):
                file.write(ZEROS[: size - start])
        file.truncate(0)
