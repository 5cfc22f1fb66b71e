# SPDX-License-Identifier: GPL-3.0-or-later
"""Compressed pixels from a process of their own: the same values, and whatever ends it is one sentence."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from ctmc_addon.core import ReadError, finish
from ctmc_addon.core.machine.own_process import PACKAGE
from ctmc_addon.readers import open_volume, read_volume
from ctmc_addon.readers.decoding import process as decoding

J2K, RLE = "1.2.840.10008.1.2.4.90", "1.2.840.10008.1.2.5"
READY = "import sys, os, time; sys.stdin.buffer.readline(); print('{\"ready\": true}', flush=True); "


@pytest.fixture
def stack(tmp_path, save_stack):
    pytest.importorskip("openjpeg")
    return save_stack(tmp_path, range(4), shape=(40, 50), compress=J2K)


@pytest.fixture
def started(monkeypatch):
    """The processes that were started."""
    made = []

    class Counted(subprocess.Popen):
        def __init__(self, *args, **options):
            super().__init__(*args, **options)
            if "-I" in self.args:  # libraries start others
                made.append(self)

    monkeypatch.setattr(decoding.subprocess, "Popen", Counted)
    return made


def test_one_process_decodes_a_series_and_is_gone(tmp_path, stack, started):
    np.testing.assert_array_equal(read_volume(tmp_path).values, stack)
    assert len(started) == 1
    assert started[0].poll() is not None


def test_frames_of_one_file_are_told_apart(tmp_path, save_frames):
    pydicom = pytest.importorskip("pydicom")
    stored = np.random.default_rng(0).integers(0, 3000, (5, 40, 48)).astype(np.uint16)
    save_frames(tmp_path / "ct.dcm", stored, [(0, 0, -z) for z in range(5)])
    dataset = pydicom.dcmread(tmp_path / "ct.dcm")
    dataset.compress(J2K, generate_instance_uid=False)
    dataset.save_as(tmp_path / "ct.dcm")
    np.testing.assert_array_equal(read_volume(tmp_path / "ct.dcm").values, stored[::-1].astype(np.int16) - 1000)


@pytest.mark.parametrize("compress", [None, RLE])
def test_pixels_that_no_library_in_c_decodes_need_no_process(tmp_path, save_stack, started, compress):
    expected = save_stack(tmp_path, range(3), compress=compress)
    np.testing.assert_array_equal(read_volume(tmp_path).values, expected)
    assert not started


@pytest.mark.parametrize("reason", ["no interpreter", "processes are forbidden", "it does not start"])
def test_where_there_can_be_no_process_pixels_are_decoded_here(tmp_path, stack, monkeypatch, reason):
    def forbidden(*args, **options):
        raise PermissionError(1, "forbidden")

    if reason == "no interpreter":
        monkeypatch.setattr(decoding, "interpreter", lambda: None)
    elif reason == "processes are forbidden":
        monkeypatch.setattr(decoding.subprocess, "Popen", forbidden)
    else:
        monkeypatch.setattr(decoding, "BOOT", "raise SystemExit(3)")
    np.testing.assert_array_equal(read_volume(tmp_path).values, stack)


@pytest.mark.parametrize(
    ("then", "words"),
    [
        ("import os; os.close(1); os.close(2); time.sleep(600)", "it closed its output"),
        ("sys.stdin.buffer.readline(); os._exit(3)", "exit code 3"),
        ("sys.stdin.buffer.readline(); os.kill(os.getpid(), 11)", "SIGSEGV"),
        ("sys.stdin.buffer.readline(); print('{}', flush=True)", "another picture"),
        ("sys.stdin.buffer.readline(); print('x', flush=True)", "could not be read"),
        ("sys.stdin.buffer.readline(); print('[1]', flush=True)", "could not be read"),
        ('print(\'{"shape": [40, 50], "dtype": "|O8"}\', flush=True)', "another picture"),
        ('print(\'{"shape": [40, 50], "dtype": "<u2"}\', flush=True)', "exit code 0"),
    ],
)
def test_a_process_that_ends_is_a_sentence_that_names_the_slice(tmp_path, stack, monkeypatch, then, words):
    if "kill" in then and sys.platform == "win32":
        pytest.skip("Windows has no such signals")
    monkeypatch.setattr(decoding, "BOOT", READY + then)
    with pytest.raises(ReadError) as caught:
        read_volume(tmp_path)
    assert all(word in str(caught.value) for word in (".dcm", words, "copy it again")), caught.value
    assert "\n" not in str(caught.value)


def test_a_process_that_hangs_is_ended(tmp_path, stack, monkeypatch, started):
    monkeypatch.setattr(decoding, "BOOT", READY + "time.sleep(600)")
    monkeypatch.setattr(decoding, "PICTURE_SECONDS", 0.2)
    with pytest.raises(ReadError, match="took longer than"):
        read_volume(tmp_path)
    assert started[0].poll() is not None


def test_closing_the_steps_ends_the_process(tmp_path, stack, monkeypatch, started):
    monkeypatch.setattr(decoding, "BOOT", READY + "time.sleep(600)")
    steps = open_volume(tmp_path).read_steps()
    for _ in range(200):
        next(steps)
        if started:
            break
    next(steps)
    steps.close()
    assert started[0].poll() not in (None, 0)  # it did not sleep to its end


def test_a_defect_in_the_process_is_a_traceback_here(tmp_path, stack, monkeypatch):
    monkeypatch.setattr(decoding, "BOOT", READY + 'print(\'{"defect": "Traceback: line 1"}\', flush=True)')
    with pytest.raises(RuntimeError, match="line 1"):
        read_volume(tmp_path)


def test_memory_beyond_the_limit_is_refused_to_the_process():
    if not sys.platform.startswith("linux"):
        pytest.skip("only Linux holds a process to its limit")
    code = "from ctmc_addon.readers.decoding.worker import limit_memory; limit_memory(1 << 30); bytearray(2 << 30)"
    done = subprocess.run([sys.executable, "-c", code], cwd=PACKAGE.parent, capture_output=True, check=False)
    assert b"MemoryError" in done.stderr


def test_the_process_finds_its_modules_from_any_folder(tmp_path, stack, monkeypatch):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "numpy.py").write_text("raise SystemExit(7)")
    monkeypatch.chdir(tmp_path / "elsewhere")
    monkeypatch.setattr(sys, "path", ["", "elsewhere", *sys.path])
    process = finish(decoding.started_steps(100))
    assert process is not None
    process.close()
