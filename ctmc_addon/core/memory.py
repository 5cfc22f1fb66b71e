"""How much memory there is, and whether work would fit, asked before the work starts."""

from __future__ import annotations

import ctypes
import os
import sys

from .errors import MemoryLimitError


def available_bytes() -> int | None:
    """Memory that can be had without swapping, in bytes; None where the system does not say."""
    if sys.platform == "win32":
        return _windows_available()
    try:
        with open("/proc/meminfo", encoding="ascii") as lines:
            for line in lines:
                if line.startswith("MemAvailable:"):
                    return int(line.split()[1]) * 1024
    except OSError:
        pass
    try:  # macOS: half of what is built in, since the free pages alone say little there
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // 2
    except (OSError, ValueError):
        return None


def require(needed_bytes: int, what: str, remedy: str, limit_bytes: int | None = None) -> None:
    """Raise `MemoryLimitError` if `what` needs more than `limit_bytes`, by default what is available."""
    limit = available_bytes() if limit_bytes is None else limit_bytes
    if limit is not None and needed_bytes > limit:
        raise MemoryLimitError(
            f"{what} needs about {needed_bytes / 2**30:.1f} GiB of memory "
            f"and {limit / 2**30:.1f} GiB are available; {remedy}"
        )


def _windows_available() -> int | None:
    class Status(ctypes.Structure):
        # MEMORYSTATUSEX, winbase.h
        _fields_ = [("length", ctypes.c_ulong), ("load", ctypes.c_ulong)] + [
            (name, ctypes.c_ulonglong)
            for name in ("total", "available", "page_total", "page_free", "virtual_total", "virtual_free", "extended")
        ]

    status = Status(length=ctypes.sizeof(Status))
    kernel32 = getattr(ctypes, "windll").kernel32  # noqa: B009  (exists on Windows only)
    return int(status.available) if kernel32.GlobalMemoryStatusEx(ctypes.byref(status)) else None
