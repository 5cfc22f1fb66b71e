# SPDX-License-Identifier: GPL-3.0-or-later
"""What keeps two checkouts apart, and what makes the window tests stand aside instead of failing; needs no window."""

from __future__ import annotations

import sys

import pytest
from window import provision
from window.provision import DESKS, STAMP, NoWindowError, call, is_ready, make, packages, used

fcntl = pytest.importorskip("fcntl")


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """An empty cache folder."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return provision.cache_folder()


@pytest.fixture
def root(cache):
    """A folder that looks provided."""
    (cache / "sid" / "tmp").mkdir(parents=True)
    (cache / "sid" / STAMP).write_text(packages("sid"), encoding="utf-8")
    return cache / "sid"


def test_a_mirror_that_does_not_answer_is_a_reason_to_stand_aside(cache, monkeypatch):
    monkeypatch.setenv("CTMC_DEBIAN_MIRROR", "http://127.0.0.1:9/debian")
    with pytest.raises(NoWindowError, match=r"^http://127.0.0.1:9/debian/dists/sid/Release does not answer"):
        make("sid")
    assert not (cache / "sid").exists()


def test_a_command_that_fails_is_told_by_its_last_line():
    with pytest.raises(NoWindowError, match=r"ended with status 3 and said: no such suite$"):
        call(sys.executable, "-c", "print('Retrieving'); print('no such suite'); raise SystemExit(3)")


def test_a_folder_made_from_other_packages_is_not_ready(root):
    assert is_ready("sid")
    (root / STAMP).write_text("blender", encoding="utf-8")
    assert not is_ready("sid")
    with pytest.raises(NoWindowError), used("sid"):
        pass


def test_two_runs_share_a_folder_and_nobody_makes_it_anew_meanwhile(root):
    with used("sid") as one, used("sid") as other, provision.open_lock("sid") as lock:
        assert one == other == root
        with pytest.raises(BlockingIOError):
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    with provision.open_lock("sid") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)


def test_the_first_run_sweeps_what_a_killed_one_left_and_no_other_does(root):
    left, of_others = root / "tmp" / f"{DESKS}left", root / "tmp" / "other"
    left.mkdir()
    of_others.mkdir()
    with used("sid"):
        assert not left.exists()
        assert of_others.exists()
        mine = root / "tmp" / f"{DESKS}mine"
        mine.mkdir()
        with used("sid"):
            assert mine.exists()
