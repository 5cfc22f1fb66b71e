# SPDX-License-Identifier: GPL-3.0-or-later
"""Run the tests in every Blender version that the extension is for, each in an environment of its own.

What needs no Blender runs once for each NumPy: 1.24 beside Blender 4.2, 1.26 beside 5.0 and 2 beside 5.2; Blender 4.5
has the NumPy of 5.0. Core runs with NumPy 1.24 as on a plain processor. `test_all.py 4.2 5.2` runs only these two.
"""

from __future__ import annotations

import sys

from plain_processor import plain_environment
from run_tests import REPEATED, run_tests
from setup_environment import BLENDERS, SetupError, say, set_up

WITH_BLENDER = ["tests/blender", "tests/ui", "tests/extension"]
TESTS = {
    "4.2.23": [*REPEATED, *WITH_BLENDER, "tests/reporting", "tests/readers"],
    "4.5.15": [*REPEATED, *WITH_BLENDER],
    "5.0.1": ["tests"],
    "5.2.3": [*REPEATED, "tests"],
}
# One run shows both what an old NumPy lacks and what a plain processor rounds differently.
ON_PLAIN_PROCESSOR = {"4.2.23": [*REPEATED, "tests/core"]}


def tested(version: str) -> int:
    """Run the tests of a Blender version; returns 0 only if all passed."""
    python = str(set_up(version))
    status = run_tests(python, TESTS[version])
    if version in ON_PLAIN_PROCESSOR:
        say("\nCore on a plain processor")
        plain = plain_environment(python)
        status = run_tests(python, ON_PLAIN_PROCESSOR[version], variables=plain) or status
    return status


def main() -> int:
    """Run them all, whatever fails, and end with a line for each; 1 if any failed."""
    asked = sys.argv[1:]
    versions = [version for version in BLENDERS if not asked or version.startswith(tuple(asked))]
    outcomes = {}
    for version in versions:
        say(f"\nBlender {version}")
        try:
            status = tested(version)
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
