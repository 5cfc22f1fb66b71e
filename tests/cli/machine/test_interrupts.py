# SPDX-License-Identifier: GPL-3.0-or-later
"""Ctrl-C and SIGTERM while a command runs: one line, an exit code of their own, and nothing left behind."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from ctmc_addon.cli.machine.interrupts import interrupts_held, sigterm_raised

ROOT = Path(__file__).resolve().parents[3]
pytestmark = pytest.mark.once
# Sends the process a signal when the module is imported that is named first.
SIGNAL_AT_IMPORT = """
import builtins, signal, sys
name, number = sys.argv[1], int(sys.argv[2])
class Finder:
    def find_spec(self, module, path=None, target=None):
        if module == name:
            sys.meta_path.remove(self)
            signal.raise_signal(number)
sys.meta_path.insert(0, Finder())
from ctmc_addon.cli import main
sys.exit(main(sys.argv[3:]))
"""


@pytest.fixture(autouse=True)
def heard():
    """Python's own handler, also where the tests were started in the background, which ignores the interrupt."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_an_interrupt_waits_for_the_end_of_the_block():
    reached = []

    def held():
        with interrupts_held():
            signal.raise_signal(signal.SIGINT)
            reached.append(True)

    with pytest.raises(KeyboardInterrupt):
        held()
    assert reached == [True]
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)


def test_an_error_in_the_block_arrives_and_interrupts_work_again():
    with pytest.raises(ValueError, match="broken"), interrupts_held():
        raise ValueError("broken")
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)


def test_sigterm_is_raised_in_the_block_alone():
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(KeyboardInterrupt), sigterm_raised():
        signal.raise_signal(signal.SIGTERM)
    assert signal.getsignal(signal.SIGTERM) == before


def test_whoever_handles_sigterm_goes_on_doing_so():
    received = []
    before = signal.signal(signal.SIGTERM, lambda number, _: received.append(number))
    try:
        with sigterm_raised(), interrupts_held():
            signal.raise_signal(signal.SIGTERM)
        assert received == [signal.SIGTERM]
    finally:
        signal.signal(signal.SIGTERM, before)


@pytest.mark.skipif(os.name == "nt", reason="Windows sends no such signals")
@pytest.mark.parametrize("module", ["argparse", "numpy", "ctmc_addon.core", "ctmc_addon.readers.labels.masks"])
@pytest.mark.parametrize(
    ("number", "code", "line"),
    [(signal.SIGINT, 130, "ctmc: interrupted\n"), (signal.SIGTERM, 143, "ctmc: terminated\n")],
)
def test_while_modules_are_imported_there_is_one_line(tmp_path, module, number, code, line):
    command = [sys.executable, "-c", SIGNAL_AT_IMPORT, module, str(int(number)), "info", str(tmp_path)]
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=60, preexec_fn=with_default_handlers
    )
    assert (done.returncode, done.stdout, done.stderr) == (code, "", line)


def with_default_handlers():
    """Signals as a shell's foreground has them."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)


@pytest.mark.skipif(os.name == "nt", reason="Windows sends no such signals")
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_while_a_surface_is_written_leaves_nothing(tmp_path, number, code):
    z, y, x = np.ogrid[:160, :160, :160]
    np.save(tmp_path / "in.npy", (np.sin(x / 3.0) + np.sin(y / 3.0) + np.sin(z / 3.0)).astype(np.float32))
    out = tmp_path / "out"
    out.mkdir()
    words = ["reconstruct", str(tmp_path / "in.npy"), "-o", str(out / "x.stl"), "--threshold", "0"]
    for _ in range(5):  # the surface may be written before the signal is sent
        returned, printed, errors = signaled(words, out, number)
        if returned:
            break
        (out / "x.stl").unlink()
    assert (returned, printed) == (code, "")
    assert errors.splitlines() in (["ctmc: interrupted"], ["ctmc: terminated"])
    assert list(out.iterdir()) == []


def signaled(words, out, number):
    """Run the command, and send it a signal once a hidden file is in the folder."""
    process = subprocess.Popen(
        [sys.executable, "-m", "ctmc_addon", *words],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=with_default_handlers,
    )
    end = time.monotonic() + 60
    while not any(out.glob(".ctmc-*/*")) and process.poll() is None:
        assert time.monotonic() < end
        time.sleep(0.002)
    process.send_signal(number)
    printed, errors = process.communicate(timeout=60)
    return process.returncode, printed, errors


@pytest.mark.parametrize(("words", "code", "line"), [("'terminated'", 143, "terminated"), ("", 130, "interrupted")])
def test_a_stop_inside_code_from_a_string_has_the_same_exit_code(tmp_path, words, code, line):
    (tmp_path / "stopped.py").write_text(
        "import sys\n"
        "from ctmc_addon import cli\n"
        "from ctmc_addon.cli import program\n"
        f'program.run = lambda argv: exec("raise KeyboardInterrupt({words})")\n'
        "sys.exit(cli.main(['info']))\n"
    )
    ended = subprocess.run(
        [sys.executable, "-m", "stopped"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (ended.returncode, ended.stderr) == (code, f"ctmc: {line}\n")
