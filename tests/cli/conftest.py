# SPDX-License-Identifier: GPL-3.0-or-later
import json
import os
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest

from ctmc_addon.cli import main

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).resolve().parent
BY_PYTHON = ("test_arguments.py", "test_refusals.py", "test_settings.py", "test_start.py")  # argparse, imports


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Mark commands without Blender as run once: core and readers, which do their work, run with each NumPy.

    How a command line is read is Python's affair too, so it is tested with each.
    """
    for item in items:
        with_blender = "scene" in item.fixturenames or hasattr(item.module, "bpy")
        if HERE in item.path.parents and not with_blender and item.path.name not in BY_PYTHON:
            item.add_marker(pytest.mark.once)


class Outcome:
    """What a command did: exit code, standard output, and the lines of standard error."""

    def __init__(self, code, out, err):
        self.code, self.out = code, out
        self.errors = err.splitlines()


@pytest.fixture
def ctmc(capfd):
    """Run a command in this process."""

    def run(*words):
        capfd.readouterr()
        code = main([str(word) for word in words])
        out, err = capfd.readouterr()
        return Outcome(code, out, err)

    return run


@pytest.fixture
def refused(ctmc):
    """Run a command that must fail with exit code 1 and one sentence, and return the sentence."""

    def run(*words):
        outcome = ctmc(*words)
        assert (outcome.code, outcome.out) == (1, ""), outcome.errors
        assert len(outcome.errors) == 1
        assert outcome.errors[0].startswith("ctmc: ")
        assert "Traceback" not in outcome.errors[0]
        return outcome.errors[0]

    return run


@pytest.fixture
def misused(ctmc):
    """Run a command that must fail with exit code 2 and the usage, and return the sentence below it."""

    def run(*words):
        outcome = ctmc(*words)
        assert (outcome.code, outcome.out) == (2, ""), outcome.errors
        assert outcome.errors[0].startswith("usage: ctmc ")
        assert ": error: " in outcome.errors[-1]
        return outcome.errors[-1].partition(": error: ")[2]

    return run


@pytest.fixture(scope="session")
def phantom_folder(tmp_path_factory):
    """A small phantom in every format, in a folder whose name has a space, an umlaut and Chinese letters."""
    folder = tmp_path_factory.mktemp("cli") / "Bäuche 腹部" / "a b"
    assert main(["phantom", str(folder), "--slices", "9", "--size", "64", "--seed", "4"]) == 0
    return folder


@pytest.fixture(scope="session")
def truth(phantom_folder):
    return json.loads((phantom_folder / "truth.json").read_text("utf-8"))


@pytest.fixture(scope="session")
def scene():
    """Blender; tests that need it skip without it."""
    return pytest.importorskip("bpy", reason="the Python package bpy is not installed")


@pytest.fixture
def small_pictures(scene, monkeypatch):
    """Render the picture beside a surface with a twentieth of its pixels."""
    from ctmc_addon.blender.figure.rendering import render

    monkeypatch.setattr(render, "render_figure_steps", partial(render.render_figure_steps, size=(280, 210)))


@pytest.fixture
def cluster(tmp_path_factory):
    """A cluster of two worker processes: its address, and what has it kill one of them as soon as one is busy.

    At its end no process of a case leaves its folder.
    """
    script = Path(__file__).with_name("batch") / "local_cluster.py"
    temporary = tmp_path_factory.mktemp("temporary")
    process = subprocess.Popen(
        [sys.executable, str(script)],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT), "TMPDIR": str(temporary)},  # the workers need the package
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    try:
        yield process
    finally:
        process.communicate("\n", timeout=60)
    end = time.monotonic() + 60
    while list(temporary.glob("ctmc-*")) and time.monotonic() < end:
        time.sleep(0.05)
    assert list(temporary.glob("ctmc-*")) == []
