# SPDX-License-Identifier: GPL-3.0-or-later
"""A batch under signals and on a full disk: what is done stays, nothing is half, and --resume does the rest.

SIGNALS=20 tries as many moments as you like; some take minutes.
"""

from __future__ import annotations

import json
import os
import random
import signal
import struct
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from ctmc_addon.cli.batch import command, process
from ctmc_addon.cli.batch.summary import write as summary
from ctmc_addon.core import OutputError

ROOT = Path(__file__).resolve().parents[3]
CASES = 4
pytestmark = pytest.mark.once


@pytest.fixture
def words(tmp_path):
    """The words of a batch of small balls, and its folder."""
    (tmp_path / "in").mkdir()
    z, y, x = np.ogrid[-1:1:16j, -1:1:16j, -1:1:16j]
    for number in range(CASES):
        np.save(tmp_path / "in" / f"case{number}.npy", (100 * (1 - x * x - y * y - z * z)).astype(np.float32))
    out = tmp_path / "out"
    return ["batch", str(tmp_path / "in"), "-o", str(out), "--threshold", "50", "--no-thumbnails", "--jobs", "2"], out


def require_whole(out):
    """No half file, no row that runs, and no row that says more than there is."""
    for path in out.glob("*.stl"):
        content = path.read_bytes()
        assert len(content) == 84 + 50 * struct.unpack_from("<I", content, 80)[0], path
    records = {path.stem: json.loads(path.read_text("utf-8")) for path in out.glob("*.json") if path.stem != "summary"}
    for row in json.loads((out / "summary.json").read_text("utf-8")) if (out / "summary.json").exists() else []:
        assert row["status"] in ("waiting", "done", "failed"), row
        assert row["status"] != "done" or (out / f"{row['case']}.stl").exists()
    return records


@pytest.mark.skipif(os.name == "nt", reason="Windows sends no such signals")
@pytest.mark.parametrize("seed", range(int(os.environ.get("SIGNALS") or 2)))
def test_a_batch_that_gets_a_signal_at_any_moment_is_resumed(words, seed):
    chance = random.Random(seed)
    number = chance.choice((signal.SIGTERM, signal.SIGINT))
    words, out = words
    command = [sys.executable, "-m", "ctmc_addon", *words]
    batch = subprocess.Popen(
        command,
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    while not out.exists() and batch.poll() is None:  # signals before that: test_interrupts.py
        time.sleep(0.01)
    try:
        batch.wait(chance.uniform(0.0, 2.0))
    except subprocess.TimeoutExpired:
        batch.send_signal(number)
    _, errors = batch.communicate(timeout=60)
    # The signal itself ends a process that is done and leaves Python.
    assert batch.returncode in (0, 130 if number == signal.SIGINT else 143, -number), errors
    assert "Traceback" not in errors
    before = require_whole(out) if out.exists() else {}
    again = subprocess.run([*command, "--resume"], cwd=ROOT, capture_output=True, text=True, timeout=120, check=False)
    assert again.returncode == 0, again.stderr
    after = require_whole(out)
    assert {record["status"] for record in after.values()} == {"done"}
    assert len(after) == CASES
    assert all(after[name]["run"] == record["run"] for name, record in before.items() if record["status"] == "done")
    assert not list(out.glob(".ctmc-*"))


@pytest.mark.parametrize("first", [0, 1, 4, 9, 16])
def test_a_disk_that_is_full_for_a_while_does_not_end_a_batch(ctmc, words, monkeypatch, first):
    words, out = words
    calls = []

    def full(write):
        def tried(path, *content):
            calls.append(path)
            if first <= len(calls) - 1 < first + 6:
                raise OutputError(f"{path} cannot be written: the disk is full; free some space")
            return write(path, *content)

        return tried

    for module, name in (
        (summary, "write_json"),
        (summary, "write_csv"),
        (summary, "write_text"),
        (process, "write_json"),
    ):
        monkeypatch.setattr(module, name, full(getattr(module, name)))
    monkeypatch.setattr(command, "SUMMARY_SECONDS", 0.0)
    monkeypatch.setattr(command, "SUMMARY_SHARE", 1e9)
    outcome = ctmc(*words)
    assert len(calls) > first
    assert outcome.code == 0, outcome.errors
    assert {record["status"] for record in require_whole(out).values()} == {"done"}


def test_a_case_that_can_write_nothing_is_said_and_done_by_resume(ctmc, words, monkeypatch):
    words, out = words

    def full(path, *_):
        raise OutputError(f"{path} cannot be written: the disk is full; free some space")

    with monkeypatch.context() as patch:
        patch.setattr(process, "command", lambda: [sys.executable, "-c", "raise SystemExit(1)"])
        patch.setattr(process, "write_json", full)
        outcome = ctmc(*words)
    assert outcome.code == 1
    assert "is the disk full?" in outcome.out
    assert ctmc(*words, "--resume").code == 0
    assert len(require_whole(out)) == CASES


def test_no_summary_names_a_slice(ctmc, tmp_path):
    folder = tmp_path / "in" / "thorax"
    folder.mkdir(parents=True)
    for number in range(3):
        head = bytes(128) + b"DICM"
        (folder / f"MUSTER_ERIKA_{number}.dcm").write_bytes(head + bytes(50))
    out = tmp_path / "out"
    assert ctmc("batch", tmp_path / "in", "-o", out).code == 1
    texts = [path.read_text("utf-8") for path in out.iterdir()]
    assert any("file 1 of 3 is a truncated or damaged DICOM file" in text for text in texts)
    assert not any("MUSTER" in text for text in texts)
