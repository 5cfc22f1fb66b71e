"""Run the tests in every Blender version that the extension is for, each in an environment of its own.

`test_all.py 4.2 5.2` runs only these.
"""

from __future__ import annotations

import sys

from run_tests import run_tests
from setup_environment import BLENDERS, SetupError, say, set_up


def main() -> int:
    """Run them all, whatever fails, and end with a line for each; 1 if any failed."""
    asked = sys.argv[1:]
    versions = [version for version in BLENDERS if not asked or version.startswith(tuple(asked))]
    outcomes = {}
    for version in versions:
        say(f"\nBlender {version}")
        try:
            status = run_tests(str(set_up(version)), [])
        except SetupError as error:
            outcomes[version] = str(error)
        else:
            outcomes[version] = "passed" if status == 0 else f"failed, status {status}"
    say("")
    for version, outcome in outcomes.items():
        say(f"Blender {version}: {outcome}")
    return 0 if outcomes and set(outcomes.values()) == {"passed"} else 1


if __name__ == "__main__":
    sys.exit(main())
