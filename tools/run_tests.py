# SPDX-License-Identifier: GPL-3.0-or-later
"""Run pytest so that its exit status is right whatever the interpreter does afterwards.

Blender as a module can hang or crash while Python shuts down. pytest therefore runs in a process of its own that
leaves at once with pytest's status, and that is ended if it takes longer than TEST_TIMEOUT seconds (an hour).
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SESSION = """
import os, sys, pytest
status = int(pytest.main(sys.argv[1:]))
sys.stdout.flush()
sys.stderr.flush()
os._exit(status)
"""


def run_tests(python: str, arguments: list[str]) -> int:
    """Pytest's status; 124 after the time limit, 128 + signal if the process was killed."""
    seconds = float(os.environ.get("TEST_TIMEOUT", "3600"))
    command = [python, "-c", SESSION, *arguments]
    try:
        status = subprocess.run(command, cwd=ROOT, stdin=subprocess.DEVNULL, timeout=seconds, check=False).returncode
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
