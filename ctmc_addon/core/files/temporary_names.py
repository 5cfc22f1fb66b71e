# SPDX-License-Identifier: GPL-3.0-or-later
"""Name incomplete files after the process that writes them, so that leftovers of a dead process can be removed.

A killed process removes nothing. The next process that writes in the folder recognizes the leftovers by their names.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import platform
import re
import shutil
import uuid
from contextlib import suppress
from functools import cache
from pathlib import Path

PREFIX = ".ctmc-"
NAME = re.compile(r"\.ctmc-(?:run-)?(?P<machine>[0-9a-f]{8})-(?P<pid>[0-9]+)-[0-9a-f]{12}(?:\..*)?")


def temporary_name(prefix: str = PREFIX) -> str:
    """Return a new hidden name that carries this machine and process."""
    return f"{prefix}{_machine()}-{os.getpid()}-{uuid.uuid4().hex[:12]}"


def without_temporary(path: Path) -> Path:
    """Return a path without the folders that have such names, as a message shows it.

    Examples
    --------
    >>> without_temporary(Path("out", temporary_name(), "case 1", "bone.stl")).as_posix()
    'out/case 1/bone.stl'
    """
    return Path(*(part for part in path.parts if not NAME.fullmatch(part)))


def may_be_in_use(name: str) -> bool:
    """Return whether the process that chose a name may still run: False only if it ran on this machine and ended."""
    match = NAME.fullmatch(name)
    return match is None or match["machine"] != _machine() or _runs(int(match["pid"]))


def remove_leftovers(folder: Path) -> None:
    """Remove the files that killed processes of this machine left in a folder."""
    for path in folder.glob(PREFIX + "*"):
        if may_be_in_use(path.name):
            continue
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            with suppress(OSError):
                path.unlink()


@cache
def _machine() -> str:
    """Eight digits for the machine and, on Linux, the container: a process number means something only within."""
    words = [platform.node()]
    with suppress(OSError):
        words.append(str(Path("/proc/self/ns/pid").readlink()))
    with suppress(OSError):  # hosts of a cluster may have one name
        words.append(Path("/etc/machine-id").read_text("ascii", "ignore"))
    return hashlib.blake2b(" ".join(words).encode(), digest_size=4).hexdigest()


def _runs(pid: int) -> bool:
    if os.name == "nt":
        return _runs_on_windows(pid)
    try:
        os.kill(pid, 0)  # sends nothing
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        pass
    return True


def _runs_on_windows(pid: int) -> bool:
    limited_information, still_active = 0x1000, 259
    kernel32 = getattr(ctypes, "windll").kernel32  # noqa: B009  (exists on Windows only)
    handle = kernel32.OpenProcess(limited_information, False, ctypes.c_ulong(pid))
    if not handle:
        return False
    code = ctypes.c_ulong()
    kernel32.GetExitCodeProcess(handle, ctypes.byref(code))
    kernel32.CloseHandle(handle)
    return code.value == still_active
