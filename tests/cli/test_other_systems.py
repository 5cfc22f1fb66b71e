# SPDX-License-Identifier: GPL-3.0-or-later
"""What only Linux has is left out elsewhere: commands run where it is taken away, as on Windows and macOS."""

from __future__ import annotations

import ctypes
import io
import json
import os
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from ctmc_addon.core.files import atomic_write
from ctmc_addon.core.machine import memory
from ctmc_addon.readers.decoding import worker

pytestmark = pytest.mark.once
ONLY_ON_LINUX = {
    "win32": ("sysconf", "geteuid", "fork", "sched_getaffinity", "killpg", "getuid", "statvfs", "mkfifo", "getpgid"),
    "darwin": ("sched_getaffinity",),
}


class Kernel32:
    """What is asked of Windows' own library here."""

    @staticmethod
    def GlobalMemoryStatusEx(status):
        status._obj.available = 8 << 30
        return 1


@pytest.fixture
def leave_linux(monkeypatch):
    """Take from this process what another system does not have."""
    read_text, load = Path.read_text, ctypes.CDLL

    def leave(system):
        def read(path, *args, **kwargs):
            if path.as_posix().startswith(("/proc/", "/sys/")):
                raise FileNotFoundError(2, "no such folder here", str(path))
            return read_text(path, *args, **kwargs)

        def loaded(name, *args, **kwargs):
            if system == "win32" and name is None:
                raise TypeError("LoadLibrary() argument 1 must be str, not None")
            return load(name, *args, **kwargs)

        monkeypatch.setattr(sys, "platform", system)
        monkeypatch.setattr(Path, "read_text", read)
        monkeypatch.setattr(ctypes, "CDLL", loaded)
        for name in ONLY_ON_LINUX[system]:
            monkeypatch.delattr(os, name, raising=False)
        if system == "win32":
            monkeypatch.setitem(sys.modules, "resource", None)
            monkeypatch.setitem(sys.modules, "fcntl", None)
            monkeypatch.setattr(ctypes, "windll", SimpleNamespace(kernel32=Kernel32), raising=False)

    return leave


@pytest.fixture(params=ONLY_ON_LINUX)
def elsewhere(request, leave_linux):
    """The name of the system that this process is now like."""
    leave_linux(request.param)
    return request.param


@pytest.fixture
def ball(tmp_path):
    z, y, x = np.mgrid[:20, :20, :20] - 9.5
    np.save(tmp_path / "ball.npy", (np.sqrt(x * x + y * y + z * z) < 7).astype(np.int16) * 300)
    return tmp_path / "ball.npy"


@pytest.mark.parametrize("system", ONLY_ON_LINUX)
def test_a_surface_is_the_same_as_on_linux(ctmc, ball, tmp_path, leave_linux, system):
    words = ("reconstruct", ball, "--spacing", 1, 1, 1, "--threshold", 150, "--simplify", 0.5, "--quiet")
    assert ctmc(*words, "-o", tmp_path / "linux.ply").code == 0
    leave_linux(system)
    outcome = ctmc(*words, "-o", tmp_path / f"{system}.ply", "--report", tmp_path / "report.json")
    assert (outcome.code, outcome.errors) == (0, [])
    assert (tmp_path / f"{system}.ply").read_bytes() == (tmp_path / "linux.ply").read_bytes()
    assert json.loads((tmp_path / "report.json").read_bytes())["closed"] is True


def test_a_phantom_is_written_and_read(ctmc, elsewhere, tmp_path):
    assert ctmc("phantom", tmp_path, "--slices", 3, "--size", 16, "--format", "nifti", "--quiet").code == 0
    assert "int16" in ctmc("info", next(tmp_path.glob("volume*"))).out


def test_memory_is_asked_for_without_proc(elsewhere, monkeypatch):
    memory.look_again()
    assert memory.resident_bytes() is None
    assert memory.peak_bytes() is None
    assert memory.available_bytes() > 1 << 20
    memory.reset_peak_bytes()
    memory.give_back()
    if elsewhere == "win32":
        worker.limit_memory(1 << 30)
        assert memory.address_space_available() is None


def test_a_folder_is_not_opened_on_windows(monkeypatch, tmp_path):
    monkeypatch.setattr(atomic_write.os, "name", "nt")
    monkeypatch.setattr(atomic_write.os, "open", None)
    atomic_write._sync_folder(tmp_path)


@pytest.mark.parametrize("encoding", ["cp437", "cp1252", "ascii"])
def test_a_console_without_a_letter_shows_its_code(monkeypatch, ball, encoding):
    from ctmc_addon.cli import main

    other = ball.rename(ball.with_name("肝 Ω.npy"))
    out = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    monkeypatch.setattr(sys, "stdout", out)
    assert main(["info", str(other), "--spacing", "1", "1", "1"]) == 0
    out.flush()
    assert "\\u809d" in out.buffer.getvalue().decode(encoding)
