# SPDX-License-Identifier: GPL-3.0-or-later
"""The set-up's choices and refusals; that it works is seen whenever the tests run."""

from __future__ import annotations

import subprocess

import pytest

pytestmark = pytest.mark.once


@pytest.fixture
def setup_environment(load_tool):
    return load_tool("setup_environment")


def pretend_versions(monkeypatch, setup_environment, versions: dict[str, str]) -> None:
    """Only these interpreters exist, with these versions."""
    monkeypatch.setattr(setup_environment.shutil, "which", lambda name: name if name in versions else None)
    monkeypatch.setattr(setup_environment, "python_version", versions.get)


def test_a_python_without_blender_is_refused_in_one_sentence(monkeypatch, setup_environment):
    pretend_versions(monkeypatch, setup_environment, {"python3": "3.12"})
    with pytest.raises(setup_environment.SetupError, match=r"^No Python 3\.11 or 3\.13 .*[^\n]*$"):
        setup_environment.find_python(("3.11", "3.13"), "")


def test_the_asked_python_is_named_with_its_version_when_it_is_refused(monkeypatch, setup_environment):
    pretend_versions(monkeypatch, setup_environment, {"/opt/python": "3.12", "python3": "3.11"})
    with pytest.raises(setup_environment.SetupError, match=r"/opt/python is Python 3\.12.*3\.11.*3\.13"):
        setup_environment.find_python(("3.11", "3.13"), "/opt/python")


def test_the_first_suitable_python_is_taken(monkeypatch, setup_environment):
    pretend_versions(monkeypatch, setup_environment, {"python3": "3.12", "python3.13": "3.13"})
    assert setup_environment.find_python(("3.11", "3.13"), "") == ("python3.13", "3.13")


def test_without_rights_the_packages_are_one_line_to_copy(monkeypatch, setup_environment):
    monkeypatch.setattr(setup_environment.os, "geteuid", lambda: 1000, raising=False)
    monkeypatch.setattr(setup_environment.shutil, "which", lambda name: name if name == "apt-get" else None)
    with pytest.raises(setup_environment.SetupError, match=r": sudo apt-get install .* libegl1 libsm6$"):
        setup_environment.install_packages(["libegl1", "libsm6"])


def test_missing_libraries_are_named_by_their_debian_packages(monkeypatch, setup_environment):
    def find_library(name: str) -> str | None:
        return None if name in {"EGL", "Xi"} else f"lib{name}.so"

    monkeypatch.setattr(setup_environment.ctypes.util, "find_library", find_library)
    passes = subprocess.CompletedProcess([], 0)
    monkeypatch.setattr(setup_environment.subprocess, "run", lambda *_, **__: passes)
    assert setup_environment.missing_packages("python3", "3.11") == ["libxi6", "libegl1"]
