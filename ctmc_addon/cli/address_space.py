# SPDX-License-Identifier: GPL-3.0-or-later
"""A process whose address space is limited (`ulimit -v`, `prlimit --as`) reserves no more of it than it uses.

Such a limit counts what is reserved, used or not: OpenBLAS reserves buffers for each processor when NumPy is loaded,
and glibc 64 MiB of malloc and 8 MiB of stack for each thread, and keeps what was freed between two blocks. Numbers do
not change by this.
"""

from __future__ import annotations

import ctypes
import os
import sys
import threading
from contextlib import suppress

ARENA_MAX, TRIM_THRESHOLD, MMAP_THRESHOLD = -8, -1, -3  # malloc.h
LARGE, KEPT = 1 << 24, 1 << 26  # bytes of a block that goes back to the system once it is freed, and of free ones kept
STACK = 1 << 20  # bytes for each thread


def reserve_little() -> None:
    """Make the most of a limited address space; to be called before NumPy is loaded."""
    if not sys.platform.startswith("linux"):
        return
    import resource

    if resource.getrlimit(resource.RLIMIT_AS)[0] == resource.RLIM_INFINITY:
        return
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    threading.stack_size(STACK)
    with suppress(OSError, AttributeError):  # another C library than glibc
        mallopt = ctypes.CDLL(None).mallopt
        for parameter, value in ((ARENA_MAX, 1), (MMAP_THRESHOLD, LARGE), (TRIM_THRESHOLD, KEPT)):
            mallopt(parameter, value)
