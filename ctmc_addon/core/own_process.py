# SPDX-License-Identifier: GPL-3.0-or-later
"""Start a process that runs a module of this package: with the same Python, or inside a Blender.

Work that cannot be interrupted, because it is done in C, or that may crash, gets a process of its own. It reads
requests on its standard input: lines of JSON, of which the first says what to run.
"""

from __future__ import annotations

import signal
import sys
from pathlib import Path
from typing import Any

PACKAGE = Path(__file__).resolve().parents[1]
# For `python -I -S -c`: neither the current folder nor the user's own modules; the first request has the path.
BOOT = (
    "import json, sys; first = json.loads(sys.stdin.buffer.readline()); sys.path[:] = first['path']; "
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
    """The program of the running Python; None inside a program that holds Python and brings no interpreter along.

    Blender's `sys.executable` is the Python in its folder, and in some builds Blender itself.
    """
    version = f"python{sys.version_info[0]}.{sys.version_info[1]}"
    inside = [Path(sys.prefix, "bin", name) for name in (version, "python3", "python.exe")]
    candidates = [Path(sys.executable or "-"), *inside, Path(sys.prefix, "python.exe")]
    return next((path for path in candidates if path.name.lower().startswith("python") and path.is_file()), None)


def how_it_ended(status: int) -> str:
    """Return an exit status in words."""
    if status >= 0:
        return f"it ended with exit code {status}"
    try:
        return f"it crashed with {signal.Signals(-status).name}"
    except ValueError:
        return f"it was ended by signal {-status}"
