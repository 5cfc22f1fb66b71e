# SPDX-License-Identifier: GPL-3.0-or-later
"""Run the tests in every Blender version that the extension is for, each in an environment of its own.

Parts that need no Blender run once for each NumPy: 1.24 beside Blender 4.2, 1.26 beside 5.0 and 2 beside 5.2; Blender
4.5 has the NumPy of 5.0. Core runs with NumPy 1.24 as on a plain processor. `test_all.py 4.2 5.2` runs only these two
versions, `test_all.py 5.2 core` one part of one.
"""

from __future__ import annotations

import sys
from typing import NamedTuple

from plain_processor import plain_environment
from run_tests import REPEATED, run_tests
from setup_environment import SetupError, say, set_up


class Part(NamedTuple):
    """Tests that run in one process tree: one Blender version, and whether as on a plain processor."""

    blender: str
    name: str
    arguments: list[str]
    plain: bool = False


WITH_BLENDER = ["tests/blender", "tests/ui", "tests/extension"]
READERS = ["tests/reporting", "tests/readers"]
PARTS = [
    Part("4.2.23", "blender", [*REPEATED, *WITH_BLENDER, *READERS]),
    # One run shows both what an old NumPy lacks and what a plain processor rounds differently.
    Part("4.2.23", "core", [*REPEATED, "tests/core"], plain=True),
    Part("4.5.15", "blender", [*REPEATED, *WITH_BLENDER]),
    Part("5.0.1", "all", ["tests"]),
    Part("5.2.3", "blender", [*REPEATED, "tests", "--ignore=tests/core"]),
    Part("5.2.3", "core", [*REPEATED, "tests/core"]),
]


def tested(part: Part) -> int:
    """Run a part's tests; returns 0 only if all passed."""
    python = str(set_up(part.blender))
    return run_tests(python, part.arguments, variables=plain_environment(python) if part.plain else None)


def chosen(words: list[str]) -> list[Part]:
    """Return the parts of these versions, given by their beginning, and of these names; all where none is given."""
    names = {part.name for part in PARTS}.intersection(words)
    versions = tuple(word for word in words if word not in names)
    return [
        part
        for part in PARTS
        if (not versions or part.blender.startswith(versions)) and (not names or part.name in names)
    ]


def main() -> int:
    """Run them all, whatever fails, and end with a line for each; 1 if any failed."""
    outcomes = {}
    for part in chosen(sys.argv[1:]):
        title = f"Blender {part.blender}, {part.name}{' on a plain processor' if part.plain else ''}"
        say(f"\n{title}")
        try:
            status = tested(part)
        except SetupError as error:
            outcomes[title] = str(error)
        else:
            outcomes[title] = "passed" if status == 0 else f"failed, status {status}"
    say("")
    for title, outcome in outcomes.items():
        say(f"{title}: {outcome}")
    return 0 if outcomes and set(outcomes.values()) == {"passed"} else 1


if __name__ == "__main__":
    sys.exit(main())
