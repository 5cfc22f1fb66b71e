# SPDX-License-Identifier: GPL-3.0-or-later
"""Ctrl-C and SIGTERM at moments of every command that renders: it ends, and leaves nothing.

The pictures have so many pixels that they would take minutes anywhere; the moments are no part of what is asserted.
"""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from batches import whole

from ctmc_addon.core.files.temporary_names import temporary_name

ROOT = Path(__file__).resolve().parents[3]
COMMANDS = ["reconstruct", "figure", "sheet", "turntable", "batch"]
MOMENTS = [0.1, 0.3, 0.6, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0]  # seconds; the last of each command is the middle of a picture
ENDLESS = ["--dpi", "600", "--width-mm", "300"]
pytestmark = [
    pytest.mark.once,
    pytest.mark.usefixtures("scene"),
    pytest.mark.skipif(os.name == "nt", reason="Windows sends no such signals"),
]


def words_of(command, folder, out):
    volume = str(folder / "volume-4.nii.gz")
    return {
        "reconstruct": ["reconstruct", volume, "--threshold", "200", "-o", out / "b.stl", "--figure", out / "b.png"],
        "figure": ["figure", volume, "--label", "1", "2", "-o", out / "figure.png", *ENDLESS],
        "sheet": ["figure", "sheet", volume, "--label", "1", "--strides", "1", "2", "-o", out / "sheet.png", *ENDLESS],
        "turntable": ["figure", "turntable", volume, "--label", "1", "-o", out / "loop.mp4", *ENDLESS],
        "batch": ["batch", folder, "--label", "1", "-o", out / "batch", "--jobs", "2"],
    }[command]


def with_default_handlers():
    """Signals as a shell's foreground has them."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)


def renders(out):
    return any(out.rglob(".ctmc-*/scene.blend"))


def listens(process):
    """Whether a process handles SIGTERM: before its command has begun, a signal ends Python itself."""
    try:
        status = Path(f"/proc/{process.pid}/status").read_text()
    except OSError:
        return False
    caught = next((line.split()[1] for line in status.splitlines() if line.startswith("SigCgt:")), "0")
    return bool(int(caught, 16) >> (signal.SIGTERM - 1) & 1)


def stopped(words, out, temporary, moment, number):
    """Run a command and send it a signal; its exit code, whether it had ended before, and whether it listened."""
    process = subprocess.Popen(
        [sys.executable, "-m", "ctmc_addon", *map(str, words)],
        cwd=ROOT,
        env={**os.environ, "TMPDIR": str(temporary)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        preexec_fn=with_default_handlers,
    )
    end = time.monotonic() + (100 if moment is None else moment)
    while process.poll() is None and time.monotonic() < end and not (moment is None and renders(out)):
        time.sleep(0.02)
    listened, was_over = listens(process), process.poll() is not None
    process.send_signal(number)
    try:
        return process.wait(timeout=60), was_over, listened
    except subprocess.TimeoutExpired:
        process.kill()
        raise


def processes_that_know(path):
    """Processes in whose environment a path stands."""
    found = []
    for environ in Path("/proc").glob("[0-9]*/environ"):
        try:
            if str(path).encode() in environ.read_bytes() and environ.parent.name != str(os.getpid()):
                found.append(environ.parent.name)
        except OSError:
            continue
    return found


def test_the_next_figure_removes_what_a_killed_one_left(ctmc, phantom_folder, tmp_path):
    out, temporary = tmp_path / "out", tmp_path / "temporary"
    out.mkdir(), temporary.mkdir()
    returned, _, _ = stopped(words_of("figure", phantom_folder, out), out, temporary, None, signal.SIGKILL)
    assert returned == -signal.SIGKILL
    left = next(out.glob(".ctmc-*.png"))
    beside = tmp_path / "beside" / left.name
    beside.parent.mkdir()
    left.with_suffix("").mkdir(), beside.with_suffix(".blend").touch()
    used = out / temporary_name()
    used.touch()
    small = [phantom_folder / "volume-4.nii.gz", "--label", 1, "--dpi", 72, "--width-mm", 30, "--style", "clinical"]
    blend = ["--blend", beside.with_name("figure.blend")]
    done = ctmc("figure", *small, "-o", out / "figure.png", *blend)
    assert done.code == 0, done.errors[-3:]
    assert set(tmp_path.rglob(".*")) == {used}, "its process runs"
    left.touch(), beside.with_suffix(".blend").touch()
    done = ctmc("figure", "turntable", *small, "--seconds", 1, "--fps", 3, "-o", out / "loop.mp4", *blend)
    assert done.code == 0, done.errors[-3:]
    assert set(tmp_path.rglob(".*")) == {used}


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_ends_at_any_moment_and_leaves_nothing(phantom_folder, tmp_path, command):
    heard = 0
    moments = MOMENTS[COMMANDS.index(command) % 3 :: 3]  # commands share their parts, so each has a third
    for at, moment in enumerate([*moments, None if command != "batch" else 5.0]):
        out, temporary = tmp_path / f"out {at}", tmp_path / f"temporary {at}"
        out.mkdir(), temporary.mkdir()
        number, code = ((signal.SIGINT, 130), (signal.SIGTERM, 143))[at % 2]
        words = words_of(command, phantom_folder, out)
        returned, was_over, listened = stopped(words, out, temporary, moment, number)
        if was_over:
            assert returned == 0
            continue
        assert returned in ({code} if listened else {code, -number, 1})
        assert list(temporary.iterdir()) == []
        assert list(out.rglob(".*")) == []
        assert processes_that_know(tmp_path) == []
        if command == "batch":
            assert whole(out)
        elif command == "turntable":
            assert {path.name for path in out.rglob("*")} <= {"loop.blend", "loop.frames", "turntable.json"}
        else:
            assert list(out.iterdir()) == []
        heard += listened
    # Only Linux tells whether a process listens, and a batch may end before it is looked at.
    assert heard > 0 or command == "batch" or not Path("/proc/self/status").exists()
