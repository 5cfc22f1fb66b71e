# SPDX-License-Identifier: GPL-3.0-or-later
"""Make .venvs/bench, where Blender and all peers are installed, and run a benchmark in it.

Standard library only; any Python 3 may start it. The module is benchmarks.bench unless the first argument names
another, such as benchmarks.labels; the other arguments go to it.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tools"))
import setup_environment as tools

PEERS = Path(__file__).with_name("peers.txt")
BLENDER = "5.0.1"  # The last one for Python 3.11, for which every peer has a wheel.


def main() -> int:
    """Set up unless that is done, then hand over."""
    try:
        python = environment()
    except tools.SetupError as error:
        print(error, file=sys.stderr)
        return 1
    paths = {"PYTHONPATH": os.pathsep.join([str(ROOT / "tests"), str(ROOT)])}
    # Blender as a module says a line about every missing cache; warnings of peers are not ours to show.
    settings = {**os.environ, **paths, "PYTHONWARNINGS": "ignore"}
    arguments = sys.argv[1:]
    module = arguments.pop(0) if arguments and arguments[0].startswith("benchmarks.") else "benchmarks.bench"
    return subprocess.run([str(python), "-m", module, *arguments], cwd=ROOT, env=settings, check=False).returncode


def environment() -> Path:
    """Return the Python of an environment with this checkout, Blender and the peers."""
    folder = ROOT / ".venvs" / "bench"
    python, version = tools.find_python((tools.BLENDERS[BLENDER][0],), "")
    requirements = [f"bpy=={BLENDER}", "--requirement", str(PEERS), "--editable", str(ROOT)]
    requirement_files = [(ROOT / "pyproject.toml").read_text(encoding="utf-8"), PEERS.read_text(encoding="utf-8")]
    stamp = "\n".join([f"Python {version} and the peers", str(folder), str(requirements), *requirement_files])
    tools.prepare_system(python, version)
    done, inside = folder / "stamp.txt", tools.environment_python(folder)
    if not (inside.exists() and done.is_file() and done.read_text(encoding="utf-8") == stamp):
        tools.make_environment(folder, python, stamp, requirements)
    return inside


if __name__ == "__main__":
    sys.exit(main())
