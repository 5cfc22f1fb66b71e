# SPDX-License-Identifier: GPL-3.0-or-later
"""A windowed Blender for each Debian suite, the extension's zip and a phantom, made beforehand."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from window.desk import Desk
from window.provision import SUITES, NoWindowError, is_ready, used

ROOT = Path(__file__).resolve().parents[2]

CT = "volume-0.nii.gz"


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Run a test marked `once` only in the newest Blender that this machine provides."""
    older = [suite for suite in SUITES if is_ready(suite)][:-1]
    repeated = [item for item in items if item.get_closest_marker("once") and suite_of(item) in older]
    config.hook.pytest_deselected(items=repeated)
    items[:] = [item for item in items if item not in repeated]


def suite_of(item: pytest.Item) -> str | None:
    """The Debian suite whose Blender a test uses; None where it uses none."""
    return item.callspec.params.get("opened") if hasattr(item, "callspec") else None


def run(*command: str) -> None:
    """Run one of the project's own commands."""
    done = subprocess.run([sys.executable, *command], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="session")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The extension's zip for this platform, as `make build` makes it."""
    folder = tmp_path_factory.mktemp("dist")
    run("tools/build_extension.py", "--platform=linux-x64", f"--output={folder}")
    (found,) = folder.glob("*.zip")
    return found


@pytest.fixture(scope="session")
def phantom(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with an abdominal CT, 512 x 512 x 29, its liver on the patient's right."""
    folder = tmp_path_factory.mktemp("window") / "phantom"
    run("-m", "ctmc_addon", "phantom", str(folder), "--format", "nifti")
    return folder


@pytest.fixture(scope="session", params=list(SUITES), ids=[f"Blender{v}" for v in SUITES.values()])
def opened(request: pytest.FixtureRequest, package: Path, phantom: Path) -> Iterator[Callable[[], Desk]]:
    """A Blender with the extension installed, one for all tests; another where it has ended."""
    suite = request.param
    desks: list[Desk] = []
    with ExitStack() as stack:
        try:
            root = stack.enter_context(used(suite))
        except NoWindowError as reason:
            pytest.skip(str(reason))

        def get() -> Desk:
            if not desks or not desks[-1].is_open():
                desks.append(Desk(root, ROOT / "out" / "window" / f"blender-{SUITES[suite]}"))
                stack.callback(desks[-1].close)
                desks[-1].install(package)
                desks[-1].bring(phantom / CT)
                desks[-1].open()
            return desks[-1]

        yield get


@pytest.fixture(scope="module")
def desk(opened: Callable[[], Desk]) -> Desk:
    """A Blender with the extension installed, as it was when its window opened."""
    desk = opened()
    desk.reset()
    return desk
