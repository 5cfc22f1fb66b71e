# SPDX-License-Identifier: GPL-3.0-or-later
"""What holds for every test: the checkout is a plain folder, and Blender's profile is an empty one.

The checkout's `__init__.py` is the extension's door for Blender. Left to itself, pytest imports it as a package of the
folder's name, which fails where that name is not a Python name.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SHARED = ROOT.parent / "shared" / "data"


class PlainRoot:
    """A plugin, because a conftest.py has no say over the folders above it."""

    @staticmethod
    def pytest_collect_directory(path: Path, parent: pytest.Collector) -> pytest.Dir | None:
        """Collect the checkout itself as a plain folder."""
        return pytest.Dir.from_parent(parent, path=path) if path == ROOT else None


def pytest_configure(config: pytest.Config) -> None:
    """Prepare what must stand before a test's file imports Blender.

    Each process of tests has a profile of its own: no add-on of this machine's user is seen, none is written for him,
    and processes side by side do not meet.
    """
    config.pluginmanager.register(PlainRoot())
    profile = tempfile.mkdtemp(prefix="ctmc-profile-")
    os.environ["BLENDER_USER_RESOURCES"] = profile
    config.add_cleanup(lambda: shutil.rmtree(profile, ignore_errors=True))


@pytest.fixture
def tmp_path(tmp_path: Path) -> Path:
    """Give each test a folder with nothing beside it.

    A segmentation looks for its CT in the folders beside its own, which would be those of other tests.
    """
    folder = tmp_path / "files"
    folder.mkdir()
    return folder


@pytest.fixture
def name_of_an_ended_process():
    """Make hidden names as a process of this machine chose them that has ended."""
    from ctmc_addon.core.files.temporary_names import temporary_name

    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()

    def name(*prefix):
        return temporary_name(*prefix).replace(f"-{os.getpid()}-", f"-{process.pid}-")

    return name


@pytest.fixture
def real() -> Callable[[str], Path]:
    """Path of a shared data set, or a skip that names what is missing."""

    def find(name: str) -> Path:
        if not (SHARED / name).exists():
            pytest.skip(f"real CT '{name}' is not beside the checkout")
        return SHARED / name

    return find
