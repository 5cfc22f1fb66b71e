# SPDX-License-Identifier: GPL-3.0-or-later
"""Build the site into out/site: `make site`. `ARGS=--serve` shows it at a port of this machine while pages are edited.

Makes .venvs/site with what tools/site.txt names. Standard library only; any Python 3 may start it.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import setup_environment as tools

ROOT = Path(__file__).resolve().parents[1]
NEEDS = ROOT / "tools" / "site.txt"


def main() -> int:
    """Set up unless that is done, then build; 0 if every link, picture and anchor leads somewhere."""
    try:
        python = environment()
    except tools.SetupError as error:
        print(error, file=sys.stderr)
        return 1
    command = ["serve"] if "--serve" in sys.argv[1:] else ["build", "--strict", "--quiet"]
    settings = {**os.environ, "NO_MKDOCS_2_WARNING": "1", "DISABLE_MKDOCS_2_WARNING": "true"}
    return subprocess.run([str(python), "-m", "mkdocs", *command], cwd=ROOT, env=settings, check=False).returncode


def environment() -> Path:
    """Return the Python of an environment that holds MkDocs."""
    folder = ROOT / ".venvs" / "site"
    python, version = tools.find_python(("3.11", "3.12", "3.13", "3.14"), "")
    stamp = f"Python {version} and MkDocs\n{folder}\n{NEEDS.read_text(encoding='utf-8')}"
    done, inside = folder / "stamp.txt", tools.environment_python(folder)
    if not (inside.exists() and done.is_file() and done.read_text(encoding="utf-8") == stamp):
        tools.make_environment(folder, python, stamp, ["--requirement", str(NEEDS)])
    return inside


if __name__ == "__main__":
    sys.exit(main())
