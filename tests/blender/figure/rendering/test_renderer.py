# SPDX-License-Identifier: GPL-3.0-or-later
"""The process that renders: it ends with the steps, and how it ends is a sentence."""

import subprocess
import sys

import pytest

bpy = pytest.importorskip("bpy", reason="the Python package bpy is not installed")

from ctmc_addon.blender.figure.rendering import renderer
from ctmc_addon.blender.figure.rendering.render import figure_steps
from ctmc_addon.blender.figure.spec import Cell, FigureStyle, Page, ShownSurface
from ctmc_addon.blender.surface import add_reconstruction
from ctmc_addon.core import OutputError, finish

SLEEPS = "import time; time.sleep(1000)"
CLOSES = "import os, time; os.close(1); time.sleep(1000)"
CRASHES = "import os, signal; os.kill(os.getpid(), signal.SIGKILL)"
FAILS = 'print(\'ctmc-renderer {"defect": "division by zero"}\', flush=True); input(); input()'


@pytest.fixture
def figure_of(scene, torus, tmp_path, monkeypatch):
    """The steps of a figure that a script renders, else Blender, and the processes that they start."""
    thing = add_reconstruction(torus(rings=16, sides=8), scene)
    started, start = [], subprocess.Popen

    def begin(*args, **options):
        started.append(start(*args, **options))
        return started[-1]

    def steps(script=None):
        if script:
            monkeypatch.setattr(renderer, "command", lambda: [sys.executable, "-c", script])
        monkeypatch.setattr(renderer.subprocess, "Popen", begin)
        cell = Cell((ShownSurface(thing),))
        blend = tmp_path / "a.blend"
        return figure_steps([cell], tmp_path / "a.png", Page(40.0, 72.0), FigureStyle(), blend, own_process=True)

    return steps, started


def test_closing_the_steps_ends_the_process_and_leaves_nothing(figure_of, tmp_path):
    steps, started = figure_of
    work = steps(SLEEPS)
    while not next(work).message.startswith("Rendering"):
        pass
    next(work)
    assert started[0].poll() is None
    assert len(bpy.data.scenes) == 1  # the figure's own scene is in the process alone
    work.close()
    assert started[0].poll() is not None
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("script", "said"),
    [
        ("raise SystemExit(3)", "its process ended with exit code 3$"),
        ("raise SystemExit('no room')", "its process ended with exit code 1: no room$"),
        (CLOSES, "its process closed its output$"),
        (CRASHES, "SIGKILL; perhaps memory ran out: make a smaller picture"),
    ],
)
@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such signals")
def test_a_process_that_ends_is_a_sentence_and_leaves_nothing(figure_of, tmp_path, script, said):
    steps, _ = figure_of
    with pytest.raises(OutputError, match=said):
        finish(steps(script))
    assert list(tmp_path.iterdir()) == []


def test_a_defect_in_the_process_is_one_here(figure_of, tmp_path):
    steps, _ = figure_of
    with pytest.raises(RuntimeError, match="division by zero"):
        finish(steps(FAILS))
    assert list(tmp_path.iterdir()) == []


def test_an_answer_that_is_none_is_a_defect(figure_of, tmp_path):
    steps, _ = figure_of
    with pytest.raises(RuntimeError, match=r"the rendering process reported b'\{"):
        finish(steps("print('ctmc-renderer {', flush=True); input(); input()"))
    assert list(tmp_path.iterdir()) == []


def test_a_scene_that_cannot_be_read_again_is_a_sentence(figure_of, tmp_path, monkeypatch):
    monkeypatch.setattr(renderer, "write_scene", lambda figure, path: path.write_bytes(b"noise"))
    steps, _ = figure_of
    with pytest.raises(OutputError, match=r"the scene to render cannot be read back \(.*\); choose"):
        finish(steps())
    assert list(tmp_path.iterdir()) == []


def test_a_process_whose_input_ends_removes_its_folder(figure_of, tmp_path):
    steps, started = figure_of
    work = steps()
    while not started:
        next(work)
    assert any(tmp_path.glob(".ctmc-*/scene.blend"))
    started[0].stdin.close()  # as where this process is killed
    assert started[0].wait(60) == 0
    assert not any(path.is_dir() for path in tmp_path.iterdir())
    work.close()
    assert list(tmp_path.iterdir()) == []
