# SPDX-License-Identifier: GPL-3.0-or-later
"""The runner's status is pytest's, whatever the interpreter does at its end, in one process and in several."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path

import pytest

CRASH_AT_EXIT = "import atexit, os\natexit.register(os.abort)\n"
pytestmark = pytest.mark.once
OPTIONS = [
    "-q",
    "-p",
    "no:cacheprovider",
    "-p",
    "xdist.plugin",
    "--config-file",
    "/dev/null",
    "--import-mode=importlib",
]


@pytest.fixture(autouse=True)
def without_other_plugins(monkeypatch):
    """Zarr's and hypothesis' plugins take longer to import than these tests take."""
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")


@pytest.fixture(params=[0, 1], ids=["here", "in a process beside"])
def run(load_tool, tmp_path, request):
    """Run the runner on one small test file; returns its status."""

    def run(source: str) -> int:
        Path(tmp_path, "test_small.py").write_text(source, encoding="utf-8")
        return load_tool("run_tests").run_tests(
            sys.executable, [*OPTIONS, "--rootdir", str(tmp_path), str(tmp_path)], request.param
        )

    return run


def test_a_crash_at_exit_does_not_hide_that_the_tests_passed(run, capfd):
    assert run(f"{CRASH_AT_EXIT}def test_it():\n    pass\n") == 0
    said = capfd.readouterr()
    assert re.search(r"^1 passed in ", said.out, re.MULTILINE)
    assert said.err == ""


def test_a_failing_test_is_status_one_even_with_a_crash_at_exit(run, capfd):
    assert run(f"{CRASH_AT_EXIT}def test_it():\n    assert False\n") == 1
    assert re.search(r"^1 failed in ", capfd.readouterr().out, re.MULTILINE)


def test_a_crash_in_a_test_is_no_success(run):
    assert run("import os\ndef test_it():\n    os.abort()\n") > 0


def test_a_run_past_its_limit_is_stopped(run, monkeypatch):
    monkeypatch.setenv("TEST_TIMEOUT", "3")
    assert run("import time\ndef test_it():\n    time.sleep(60)\n") == 124


def test_several_processes_have_a_test_each(load_tool, tmp_path, monkeypatch):
    monkeypatch.setenv("TEST_TIMEOUT", "300")
    source = "import os, pathlib, time\ndef test_it():\n    pathlib.Path({0!r}, str(os.getpid())).touch()\n    {1}\n"
    wait = f"while len(list(pathlib.Path({str(tmp_path)!r}).glob('[0-9]*'))) < 2: time.sleep(0.01)"
    for name in ("test_one.py", "test_other.py"):
        Path(tmp_path, name).write_text(source.format(str(tmp_path), wait), encoding="utf-8")
    run_tests = load_tool("run_tests").run_tests
    assert run_tests(sys.executable, [*OPTIONS, "--rootdir", str(tmp_path), str(tmp_path)], 2) == 0
    processes = {path.name for path in tmp_path.glob("[0-9]*")}
    assert len(processes) == 2
    assert str(os.getpid()) not in processes


def test_an_n_among_the_arguments_goes_first(load_tool, tmp_path, capfd):
    Path(tmp_path, "test_small.py").write_text("def test_it(worker_id):\n    assert worker_id == 'master'\n")
    options = [*OPTIONS, "--rootdir", str(tmp_path), "-n", "0"]
    assert load_tool("run_tests").run_tests(sys.executable, [*options, str(tmp_path)], 2) == 0
    assert re.search(r"^1 passed in ", capfd.readouterr().out, re.MULTILINE)
