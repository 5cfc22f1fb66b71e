# SPDX-License-Identifier: GPL-3.0-or-later
"""The runner's status is pytest's, whatever the interpreter does at its end."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

CRASH_AT_EXIT = "import atexit, os\natexit.register(os.abort)\n"


@pytest.fixture
def run(load_tool, tmp_path):
    """Run the runner on one small test file; returns its status."""

    def run(source: str) -> int:
        file = Path(tmp_path, "test_small.py")
        file.write_text(source, encoding="utf-8")
        options = ["-q", "-p", "no:cacheprovider", "--rootdir", str(tmp_path), "--config-file", "/dev/null"]
        return load_tool("run_tests").run_tests(sys.executable, [*options, str(file)])

    return run


def test_a_crash_at_exit_does_not_hide_that_the_tests_passed(run):
    assert run(f"{CRASH_AT_EXIT}def test_it():\n    pass\n") == 0


def test_a_failing_test_is_status_one_even_with_a_crash_at_exit(run):
    assert run(f"{CRASH_AT_EXIT}def test_it():\n    assert False\n") == 1


def test_a_crash_in_a_test_is_no_success(run):
    assert run("import os\ndef test_it():\n    os.abort()\n") > 1


def test_a_run_past_its_limit_is_stopped(run, monkeypatch):
    monkeypatch.setenv("TEST_TIMEOUT", "2")
    assert run("import time\ndef test_it():\n    time.sleep(60)\n") == 124
