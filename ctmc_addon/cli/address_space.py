# SPDX-License-Identifier: GPL-3.0-or-later
"""What a process reserves of memory, and what it gives back; numbers do not change by this.

A limit of the address space (`ulimit -v`, `prlimit --as`) counts what is reserved, used or not: OpenBLAS reserves
buffers for each processor when NumPy is loaded, and glibc 64 MiB of malloc and 8 MiB of stack for each thread, and
keeps what was freed between two blocks. Without a limit glibc gives large blocks back to the system as soon as they
are freed, and the system hands out every page of the next one anew: up to a tenth of a liver's processor seconds.
"""

from __future__ import annotations

import ctypes
import os
import sys
import threading
from contextlib import suppress

ARENA_MAX, TRIM_THRESHOLD, MMAP_THRESHOLD = -8, -1, -3  # malloc.h
# Bytes of a block that goes back to the system once it is freed, and of free ones kept: under a limit, and without.
LIMITED, FREE = (1 << 24, 1 << 26), (1 << 25, 1 << 28)
STACK = 1 << 20  # bytes for each thread


def reserve_memory() -> None:
    """Make the most of a limited address space, or keep freed memory; to be called before NumPy is loaded."""
    if not sys.platform.startswith("linux"):
        return
    import resource

    limited = resource.getrlimit(resource.RLIMIT_AS)[0] != resource.RLIM_INFINITY
    if limited:
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        threading.stack_size(STACK)
    large, kept = LIMITED if limited else FREE
    with suppress(OSError, AttributeError):  # another C library than glibc
        mallopt = ctypes.CDLL(None).mallopt
        if limited:
            mallopt(ARENA_MAX, 1)
        mallopt(MMAP_THRESHOLD, large)
        mallopt(TRIM_THRESHOLD, kept)
