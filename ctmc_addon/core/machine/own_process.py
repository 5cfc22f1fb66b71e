# SPDX-License-Identifier: GPL-3.0-or-later
"""Talk with a process that runs a module of this package, and put how it ended into words.

Work that cannot be interrupted, because it is done in C, or that may crash, gets a process of its own. It reads
requests on its standard input: lines of JSON, of which the first says what to run.
"""

from __future__ import annotations

import json
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

if TYPE_CHECKING:
    import subprocess

PACKAGE = Path(__file__).resolve().parents[2]
ENDING_SECONDS = 1.0  # A process may take this many seconds to end after its output has ended.
CRASHES = {getattr(signal, name, None) for name in ("SIGABRT", "SIGBUS", "SIGFPE", "SIGILL", "SIGSEGV")}
# For `python -I -S -c`: neither the current folder nor the user's own modules; the first request has the path. It is
# read without a buffer, which would take the requests behind it too.
BOOT = (
    "import json, sys; first = json.loads(open(0, 'rb', 0, closefd=False).readline()); sys.path[:] = first['path']; "
    "import importlib; importlib.import_module(first['module']).serve(*first['arguments'])"
)


def first_request(module: Path, *arguments: Any) -> dict[str, Any]:
    """Return the request that has `BOOT` import a module of this package and call its `serve`.

    Parameters
    ----------
    module : Path
        The file of the module.
    *arguments
        Of its function `serve`; JSON must be able to hold them.
    """
    name = ".".join((PACKAGE.name, *module.resolve().relative_to(PACKAGE).with_suffix("").parts))
    # An empty entry is the folder one happens to be in.
    path = [str(PACKAGE.parent), *(entry for entry in sys.path if Path(entry).is_absolute())]
    return {"path": path, "module": name, "arguments": arguments}


def interpreter() -> Path | None:
    """Return the program of the running Python; None inside a program that embeds Python without an interpreter.

    Blender's `sys.executable` is the Python in its folder, and in some builds Blender itself.
    """
    version = f"python{sys.version_info[0]}.{sys.version_info[1]}"
    inside = [Path(sys.prefix, "bin", name) for name in (version, "python3", "python.exe")]
    candidates = [Path(sys.executable or "-"), *inside, Path(sys.prefix, "python.exe")]
    return next((path for path in candidates if path.name.lower().startswith("python") and path.is_file()), None)


def temporary_files_in(folder: str) -> dict[str, str]:
    """Return the environment of this process, but with a folder for the temporary files, such as those of Blender."""
    return {**os.environ, **dict.fromkeys(("TMPDIR", "TEMP", "TMP"), folder)}


def ending(process: subprocess.Popen[bytes], errors: IO[bytes] | None = None, begin: int = 0, remedy: str = "") -> str:
    """Return how a process ended, whose output has; one that goes on without it is killed.

    Parameters
    ----------
    process : Popen
    errors : file, optional
        Its standard error.
    begin : int, optional
        The bytes of it to leave out.
    remedy : str, optional
        As in `how_it_ended`.
    """
    import subprocess  # Whoever asks has started a process; other commands start without it.

    try:
        status = process.wait(ENDING_SECONDS)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
        return "closed its output"
    if errors is None:
        return how_it_ended(status, remedy=remedy)
    errors.seek(begin)
    return how_it_ended(status, errors.read().decode("utf-8", "replace"), remedy)


def how_it_ended(status: int, printed: str = "", remedy: str = "") -> str:
    r"""Return an exit status in words that follow the name of the process.

    Parameters
    ----------
    status : int
        Below 0 for a signal.
    printed : str, optional
        The standard error of the process, whose last line says why.
    remedy : str, optional
        The advice where memory may have run out; without it, memory is not mentioned.

    Examples
    --------
    >>> how_it_ended(1, "Traceback ...\nValueError: x\n")
    'ended with exit code 1: ValueError: x'
    """
    lines = [line.strip() for line in printed.splitlines() if line.strip()]
    # A crash of Python ends with lists of threads and modules.
    why = next((line for line in lines if line.startswith("Fatal Python error")), lines[-1] if lines else "")
    last = why and f": {why.removeprefix('ctmc: ')}"
    if status >= 0:
        return f"ended with exit code {status}{last}"
    try:
        number = signal.Signals(-status)
    except ValueError:
        return f"was ended by signal {-status}"
    if number in CRASHES:
        return f"crashed with {number.name}{last}"
    advice = f"; perhaps memory ran out: {remedy}" if remedy and number.name == "SIGKILL" else ""
    return f"was ended by {number.name}{advice}"


def requests() -> Iterator[Any]:
    """Yield the requests of the other side, from inside the process, until standard input ends.

    Nothing here holds the lock of a buffer: a thread that waits with one would have Python abort at its end.
    """
    rest = b""
    while piece := os.read(0, 1 << 16):
        *lines, rest = (rest + piece).split(b"\n")
        yield from map(json.loads, lines)


def own_output() -> int:
    """Return standard output for the other side only, and discard what other code prints there."""
    output = os.dup(1)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.close(nowhere)
    return output


def send(output: int, words: bytes) -> None:
    """Write all of the words to the other side, although a pipe accepts only some at a time."""
    left = memoryview(words)
    with suppress(OSError):  # it is gone, which standard input says too
        while left:
            left = left[os.write(output, left) :]
