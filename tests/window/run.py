"""`make test-window`: the tests in windowed Blenders, or one line that says why they cannot run here."""

from __future__ import annotations

import sys
from pathlib import Path

from provision import SUITES, NoWindowError, provide, require_means

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tools"))

from run_tests import run_tests  # noqa: E402


def main() -> int:
    """Pytest's status; 0 where this machine has no means for a window."""
    try:
        require_means()
        for suite in SUITES:
            provide(suite)
    except NoWindowError as reason:
        print(f"The window tests are skipped: {reason}")
        return 0
    return run_tests(sys.executable, ["tests/window", "-m", "window", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
