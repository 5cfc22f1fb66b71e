# SPDX-License-Identifier: GPL-3.0-or-later
import errno
import io
import subprocess
import sys
from pathlib import Path

import pytest

from ctmc_addon.cli import main
from ctmc_addon.cli.terminal import Progress, require_empty, table
from ctmc_addon.core import Step
from ctmc_addon.core.errors import OutputError


class Terminal(io.StringIO):
    def isatty(self):
        return True


def work():
    yield Step(0.0, "Reading")
    yield Step(0.01, "Looking")
    yield Step(0.5, "Extracting")
    return "done"


def test_a_terminal_shows_one_line_that_is_wiped_at_the_end():
    screen = Terminal()
    with Progress(screen) as progress:
        assert progress.finish(work()) == "done"
    assert "\n" not in screen.getvalue()
    assert "[###############...............] Extracting" in screen.getvalue()
    assert screen.getvalue().endswith("\r\033[K")


def test_a_file_gets_nothing_or_a_line_now_and_then():
    silent, spoken = io.StringIO(), io.StringIO()
    Progress(silent).finish(work())
    Progress(spoken, lines=True).finish(work())
    assert silent.getvalue() == ""
    assert spoken.getvalue().splitlines() == ["  0%  Reading", " 50%  Extracting"]


def test_an_interrupt_closes_the_work():
    closed = []

    def endless():
        try:
            while True:
                yield Step(0.0, "Working")
        finally:
            closed.append(True)

    class Interrupting(Progress):
        def __call__(self, step):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        Interrupting(io.StringIO()).finish(endless())
    assert closed == [True]


def test_columns_line_up():
    assert table([("a", "b"), ("long", "1"), ("c", "22")]) == "a      b\nlong   1\nc     22"


def test_a_folder_with_hidden_files_alone_is_empty(tmp_path):
    (tmp_path / ".DS_Store").write_bytes(b"")
    require_empty(tmp_path, "choose another")
    require_empty(tmp_path / "not there", "choose another")
    (tmp_path / "table.md").write_bytes(b"")
    with pytest.raises(OutputError, match=r"is not empty \(it holds table.md\); choose another$"):
        require_empty(tmp_path, "choose another")


class Broken(io.StringIO):
    """A stream whose disk is full, or whose reader has gone: for what is written, or only when it is flushed."""

    def __init__(self, number, at_once):
        super().__init__()
        self.number, self.at_once = number, at_once

    def write(self, text):
        return self.fail() if self.at_once else len(text)

    def flush(self):
        self.fail()

    def fail(self):
        raise OSError(self.number, "")


@pytest.mark.parametrize("at_once", [True, False])
@pytest.mark.parametrize("words", [("settings",), ("info", "--help"), ("--version",), ("--help",)])
@pytest.mark.parametrize(
    ("number", "code", "sentence"),
    [(errno.ENOSPC, 1, "ctmc: standard output cannot be written: the disk is full; free"), (errno.EPIPE, 0, "")],
)
def test_standard_output_on_a_full_disk_is_one_sentence(monkeypatch, capsys, at_once, words, number, code, sentence):
    with monkeypatch.context() as patch:
        patch.setattr(sys, "stdout", Broken(number, at_once))
        assert main(words) == code
    errors = capsys.readouterr().err
    assert errors.startswith(sentence)
    assert errors.count("\n") == code


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
@pytest.mark.parametrize("words", [["--version"], ["batch", "--help"]])
def test_a_process_whose_output_is_full_ends_with_one_sentence(words):
    with Path("/dev/full").open("wb") as full:
        done = subprocess.run(
            [sys.executable, "-m", "ctmc_addon", *words], stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
    assert done.returncode == 1
    assert done.stderr.startswith("ctmc: standard output cannot be written: the disk is full")
    assert done.stderr.count("\n") == 1


def test_without_a_standard_output_a_command_runs(monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(sys, "stdout", None)
        assert main(("settings",)) == 0
