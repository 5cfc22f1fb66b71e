# SPDX-License-Identifier: GPL-3.0-or-later
"""Run pytest so that its exit status is right whatever the interpreter does afterwards.

Blender as a module can hang or crash while Python shuts down. pytest therefore runs in a process of its own that
leaves at once with pytest's status, and that is ended if it takes longer than TEST_TIMEOUT seconds (an hour).
Each core gets a process of tests (pytest-xdist) with a Blender of its own, which leaves at once too; `-n 0` runs all
tests in one process. A process that crashes in a test is a test that failed.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
# The processes of tests get this process's path and plugins.
SESSION = """
import os, sys
sys.path.append(sys.argv.pop(1))
import pytest
status = int(pytest.main(["-p", "leave_at_once", *sys.argv[1:]]))
sys.stdout.flush()
sys.stderr.flush()
os._exit(status)
"""
MOST_PROCESSES = 8  # Each process takes up to 1.5 GB.
# Tests marked `once` run in `make test` alone.
REPEATED = ["-m", "not window and not packaging and not once"]


def cores() -> int:
    """Return the number of processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def run_tests(
    python: str, arguments: list[str], processes: int | None = None, variables: Mapping[str, str] | None = None
) -> int:
    """Run pytest and return its status.

    Parameters
    ----------
    python : str
        The interpreter, with pytest and pytest-xdist.
    arguments : list of str
        For pytest; a `-n` among them goes before `processes`.
    processes : int, optional
        How many processes share the tests; 0 is pytest's own one. By default what TEST_PROCESSES says, else one for
        each core, at most eight.
    variables : mapping of str to str, optional
        Variables of the environment, besides this process's own.

    Returns
    -------
    int
        pytest's status; 124 after the time limit, 128 + signal if pytest was killed.
    """
    seconds = float(os.environ.get("TEST_TIMEOUT", "3600"))
    if processes is None:
        processes = int(os.environ.get("TEST_PROCESSES", min(cores(), MOST_PROCESSES)))
    # Neighbors stay together, so what they share is made once; loadfile hangs where a process crashes.
    shared = ["-n", str(processes), "--dist", "worksteal"]
    command = [python, "-c", SESSION, str(ROOT / "tools"), *shared, *arguments]
    # Without it each process would let NumPy's products wait for all cores.
    environment = {"OPENBLAS_NUM_THREADS": "1", **os.environ, **(variables or {})}
    try:
        status = subprocess.run(
            command, cwd=ROOT, env=environment, stdin=subprocess.DEVNULL, timeout=seconds, check=False
        ).returncode
    except subprocess.TimeoutExpired:
        print(
            f"The tests took longer than {seconds:g} s and were stopped; TEST_TIMEOUT sets the limit", file=sys.stderr
        )
        return 124
    if status < 0:
        print(f"The tests' process was ended by signal {-status}", file=sys.stderr)
        return 128 - status
    return status


if __name__ == "__main__":
    sys.exit(run_tests(sys.executable, sys.argv[1:]))
