# SPDX-License-Identifier: GPL-3.0-or-later
"""How much memory there is, and whether work would fit, asked before the work starts."""

from __future__ import annotations

import ctypes
import math
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from ..errors import MemoryLimitError

VERSION_1_LIMITS: tuple[str, ...] = ("memory.limit_in_bytes",)
VERSION_2_LIMITS: tuple[str, ...] = (
    "memory.max",
    "memory.high",
)  # Beyond memory.high a process is slowed down until it hardly runs.
LOOK_AGAIN = 0.2  # Ask the system again after this many seconds.
_seen: tuple[float, int | None] = (-math.inf, None)  # The time of the last question to the system, and its answer.
# Parameters of malloc.h where memory is short: one arena for all threads, bytes of free pages that are kept, and of a
# block that goes back to the system as soon as it is freed.
LITTLE = {-8: 1, -1: 1 << 26, -3: 1 << 24}
PLENTY = 1 << 32  # Memory is not short from this many available bytes on.
NO_THREAD = "can't start new thread"  # Python's message if there is no memory for a thread.


def available_bytes() -> int | None:
    """Return the bytes of memory that can be used without swapping; None if the system does not report them.

    Small works ask a hundred times a second, and the system answers from twenty files: it is asked now and then.
    """
    global _seen
    now = time.monotonic()
    if now - _seen[0] > LOOK_AGAIN:
        _seen = now, _available()
    return _seen[1]


def look_again() -> None:
    """Ask the system for its memory at the next question, whenever that is."""
    global _seen
    _seen = (-math.inf, None)


def _available() -> int | None:
    if sys.platform == "win32":
        return _windows_available()
    if sys.platform.startswith("linux"):
        return linux_available(Path("/"))
    return _half_of_physical()


def linux_available(root: Path, address_space: bool = True) -> int | None:
    """Return the least of the machine's rest, the control groups' limits and the process's address space.

    In a container or a batch system's job (SLURM) the control group's limit is below the machine's memory.

    Parameters
    ----------
    root : Path
        Folder that holds `proc` and `sys`.
    address_space : bool
        Whether to look at the last of the three.
    """
    limits = [_meminfo_available(root), *_cgroups_available(root)]
    limits += [address_space_available(root)] if address_space else []
    bounds = [limit for limit in limits if limit is not None]
    return max(0, min(bounds)) if bounds else _half_of_physical()


def require(needed_bytes: int, what: str, remedy: str | Callable[[int], str], limit_bytes: int | None = None) -> None:
    """Raise `MemoryLimitError` if `what` needs more than `limit_bytes`, by default what is available.

    A remedy that depends on the bytes there are is a function of them.
    """
    limit = _limit_for(needed_bytes, available_bytes) if limit_bytes is None else limit_bytes
    if limit is not None and needed_bytes > limit:
        advice = remedy if isinstance(remedy, str) else remedy(limit)
        raise MemoryLimitError(
            f"{what} needs about {amount(needed_bytes)} of memory and {amount(limit)} are available; {advice}"
        )


def require_or_killed(needed_bytes: int, what: str, remedy: str) -> None:
    """Do what `require` does before memory is taken that Linux does not refuse but kills for.

    A limit of the address space is left out: it refuses, and what was asked for is often less than was expected.
    """
    if sys.platform.startswith("linux"):
        require(needed_bytes, what, remedy, _limit_for(needed_bytes, _unrefused))


def _unrefused() -> int | None:
    return linux_available(Path("/"), address_space=False)


def _limit_for(needed_bytes: int, available: Callable[[], int | None]) -> int | None:
    """Return the available bytes; if they are too few, without the freed pages that the C library keeps."""
    limit = available()
    if limit is None or needed_bytes <= limit:
        return limit
    give_back()
    look_again()
    return available()


@contextmanager
def refusal(what: str, remedy: str, limit_bytes: int | None = None) -> Iterator[None]:
    """Raise `MemoryLimitError` if the system refuses memory to `what`, whose need is not known beforehand."""
    limit = available_bytes() if limit_bytes is None else limit_bytes
    try:
        yield
    except (MemoryError, RuntimeError) as error:
        if isinstance(error, RuntimeError) and str(error) != NO_THREAD:
            raise
        more = f"at least {amount(_asked(error))} more memory" if _asked(error) else "more memory"
        there = "there is" if limit is None else f"the {amount(limit)} that are available"
        raise MemoryLimitError(f"{what} needs {more} than {there}; {remedy}") from error


def give_back() -> None:
    """Give freed pages that the C library keeps back to the system, because they count as used."""
    if sys.platform == "win32":
        return
    with suppress(OSError, AttributeError):  # in glibc alone
        ctypes.CDLL(None).malloc_trim(0)


def keep_little() -> None:
    """Let the C library keep few freed pages where memory is short, as they count as used.

    Otherwise it keeps as many as cli/machine/address_space.py has set, and more for each thread.
    """
    available = available_bytes()
    short = address_space_available() is not None or (available is not None and available < PLENTY)
    if sys.platform.startswith("linux") and short:
        with suppress(OSError, AttributeError):  # another C library than glibc
            mallopt = ctypes.CDLL(None).mallopt
            for parameter, value in LITTLE.items():
                mallopt(parameter, value)


def resident_bytes() -> int | None:
    """Return the bytes of memory that this process has now; None if the system does not report them (not Linux)."""
    if sys.platform == "win32":
        return None
    words = "".join(_lines(Path("/proc/self/statm"))).split()
    if len(words) < 2 or not words[1].isdigit():
        return None
    return int(words[1]) * os.sysconf("SC_PAGE_SIZE")


def peak_bytes() -> int | None:
    """Return the most bytes of memory that this process had since `reset_peak_bytes`; None where it is not known."""
    for line in _lines(Path("/proc/self/status")):
        if line.startswith("VmHWM:"):
            return None if (kilobytes := _second_number(line)) is None else kilobytes * 1024
    return None


def reset_peak_bytes() -> None:
    """Let `peak_bytes` begin again, if the system can."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", "ascii")


def _asked(error: Exception) -> int:
    """Bytes of the array that NumPy had no memory for; 0 for another error."""
    if len(error.args) != 2 or not isinstance(error.args[0], tuple):
        return 0
    shape, dtype = error.args
    return math.prod(shape) * int(dtype.itemsize)


def amount(number: int) -> str:
    """Return bytes in GiB, below 1 GiB in MiB."""
    return f"{number / 2**30:.1f} GiB" if number >= 2**30 else f"{number / 2**20:.3g} MiB"


def _meminfo_available(root: Path) -> int | None:
    for line in _lines(root / "proc/meminfo"):
        if line.startswith("MemAvailable:"):
            return None if (kilobytes := _second_number(line)) is None else kilobytes * 1024
    return None


def _cgroups_available(root: Path) -> list[int]:
    """Return the rest of each control group of this process and of those around it; without limit, none."""
    left = []
    groups = root / "sys/fs/cgroup"
    for line in _lines(root / "proc/self/cgroup"):
        number, _, controllers_and_path = line.partition(":")
        controllers, _, path = controllers_and_path.partition(":")
        if number == "0":  # version 2; beside version 1 it is mounted at `unified`
            mounts: tuple[Path, ...] = (groups, groups / "unified")
            limits, used_name, cached = VERSION_2_LIMITS, "memory.current", ("active_file", "inactive_file")
        elif "memory" in controllers.split(","):
            mounts, limits, used_name = (groups / "memory",), VERSION_1_LIMITS, "memory.usage_in_bytes"
            cached = ("total_active_file", "total_inactive_file")
        else:
            continue
        for mount in mounts:
            # A container sees its own group at the mount, under whatever path the machine knows it by.
            group = mount / path.lstrip("/")
            for folder in (group, *group.parents):
                allowed = [limit for limit in (_number(folder / name) for name in limits) if limit is not None]
                used = _number(folder / used_name)
                if allowed and used is not None:
                    left.append(min(allowed) - used + _reclaimable(folder / "memory.stat", cached))
                if folder == mount:
                    break
    return left


def _reclaimable(stat: Path, names: Sequence[str]) -> int:
    """Cached file contents that count as used, and that the kernel gives up for a program.

    Those of a file that was read twice are called active, and go as well.
    """
    return sum(_second_number(line) or 0 for line in _lines(stat) if line.partition(" ")[0] in names)


def address_space_available(root: Path = Path("/")) -> int | None:
    """Return the rest that `ulimit -v` leaves to this process; None without such a limit."""
    if sys.platform == "win32":
        return None
    import resource

    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    pages = _lines(root / "proc/self/statm")
    used = pages[0].split()[0] if pages and pages[0].split() else ""
    if limit == resource.RLIM_INFINITY or not used.isdigit():
        return None
    return limit - int(used) * resource.getpagesize()


def _half_of_physical() -> int | None:
    """Return half of the installed memory, for macOS, where the count of free pages says little."""
    if sys.platform == "win32":
        return None
    with suppress(OSError, ValueError):
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // 2
    return None


def _lines(path: Path) -> list[str]:
    """Return the lines of a small file; none where it is missing or closed to us."""
    try:
        return path.read_text("ascii").splitlines()
    except (OSError, UnicodeDecodeError):
        return []


def _number(path: Path) -> int | None:
    """Return the number in a file; None where the file is missing or says 'max'."""
    text = "".join(_lines(path)).strip()
    return int(text) if text.isdigit() else None


def _second_number(line: str) -> int | None:
    """Return the number after a name; None where a line has none."""
    words = line.split()
    return int(words[1]) if len(words) > 1 and words[1].isdigit() else None


def _windows_available() -> int | None:
    class MemoryStatus(ctypes.Structure):
        # MEMORYSTATUSEX, winbase.h
        _fields_ = [("length", ctypes.c_ulong), ("load", ctypes.c_ulong)] + [
            (name, ctypes.c_ulonglong)
            for name in ("total", "available", "page_total", "page_free", "virtual_total", "virtual_free", "extended")
        ]

    status = MemoryStatus(length=ctypes.sizeof(MemoryStatus))
    kernel32 = getattr(ctypes, "windll").kernel32  # noqa: B009  (exists on Windows only)
    return int(status.available) if kernel32.GlobalMemoryStatusEx(ctypes.byref(status)) else None
