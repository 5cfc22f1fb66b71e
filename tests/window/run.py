# SPDX-License-Identifier: GPL-3.0-or-later
"""`make test-window`: the tests in windowed Blenders, or one line that says why they cannot run here."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from provision import SUITES, NoWindowError, provide, require_means

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tools"))

from run_tests import run_tests


def main() -> int:
    """Pytest's status; 0 where this machine has no means for a window.

    Only a test that fails is a failure: no root, no mirror or a Debian that does not install is said in one line, and
    the Blender of that Debian is left out.
    """
    try:
        require_means()
    except NoWindowError as reason:
        print(f"The window tests are skipped: {reason}")
        return 0
    os.environ.setdefault("TEST_TIMEOUT", "3600")  # software OpenGL on a busy machine
    provided = []
    for suite, version in SUITES.items():
        try:
            provide(suite)
        except NoWindowError as reason:
            print(f"The window tests of Blender {version} are skipped: {reason}")
        else:
            provided.append(suite)
    if not provided:
        return 0
    # All tests share one window, so one process has them.
    return run_tests(sys.executable, ["tests/window", "-m", "window", *sys.argv[1:]], processes=0)


if __name__ == "__main__":
    sys.exit(main())
