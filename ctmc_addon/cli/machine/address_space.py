# SPDX-License-Identifier: GPL-3.0-or-later
"""Limit what a process reserves of memory, and give memory back; results do not change.

A limit of the address space (`ulimit -v`, `prlimit --as`) counts what is reserved, used or not: OpenBLAS reserves
buffers for each processor when NumPy is loaded, and glibc 64 MiB of malloc and 8 MiB of stack for each thread, and
keeps what was freed between two blocks. Without a limit glibc gives large blocks back to the system as soon as they
are freed, and the system hands out every page of the next one again: up to a tenth of a liver's processor seconds.
"""

from __future__ import annotations

import ctypes
import os
import sys
import threading
from contextlib import suppress

TRIM_THRESHOLD, MMAP_THRESHOLD = -1, -3  # From malloc.h.
LARGE, KEPT = 1 << 25, 1 << 28  # Bytes of a block to return at once, and of free memory to keep.
STACK = 1 << 20  # Bytes for each thread.


def reserve_memory() -> None:
    """Reserve little of a limited address space, or keep freed memory; to be called before NumPy is loaded.

    Where memory is short `core.keep_little` lets less be kept, once the system can be asked.
    """
    if not sys.platform.startswith("linux"):
        return
    import resource

    if resource.getrlimit(resource.RLIMIT_AS)[0] != resource.RLIM_INFINITY:
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        threading.stack_size(STACK)
        return
    with suppress(OSError, AttributeError):  # another C library than glibc
        mallopt = ctypes.CDLL(None).mallopt
        mallopt(MMAP_THRESHOLD, LARGE)
        mallopt(TRIM_THRESHOLD, KEPT)
