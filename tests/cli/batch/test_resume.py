# SPDX-License-Identifier: GPL-3.0-or-later
"""A batch that goes on, or begins again, in a folder that has something."""

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from batches import FLAGS, ball, in_place_of_a_case, states, wait_until, whole, written_at

from ctmc_addon.cli.batch.files import unfinished_folder
from ctmc_addon.core.files.temporary_names import temporary_name

pytestmark = pytest.mark.once

ROOT = Path(__file__).resolve().parents[3]
RECORDS = Path(__file__).resolve().parent / "old_records"
# A batch that waits as soon as its summary has a case that is done, one that runs and one that waits.
WAITING = """
import sys, time
from ctmc_addon.cli import main
from ctmc_addon.cli.batch import command
write = command.write_summary
def write_and_wait(folder, rows, *rest):
    write(folder, rows, *rest)
    if {"done", "running", "waiting"} <= {row.status for row in rows}:
        time.sleep(600)
command.write_summary = write_and_wait
command.SUMMARY_SECONDS, command.SUMMARY_SHARE = 0, 1000
sys.exit(main(sys.argv[1:]))
"""


def test_a_folder_in_use_is_refused_without_resume_or_overwrite(refused, done, cases):
    before = written_at(done)
    sentence = refused("batch", cases, "-o", done, *FLAGS)
    assert "is not empty" in sentence
    assert "--resume" in sentence
    assert "--overwrite" in sentence
    assert written_at(done) == before


def test_resume_redoes_only_what_is_missing_failed_or_no_longer_fits(ctmc, done, cases, tmp_path):
    done, cases = shutil.copytree(done, tmp_path / "out"), shutil.copytree(cases, tmp_path / "in")
    before = written_at(done)
    (cases / "broken.npy").write_bytes((cases / "large.npy").read_bytes())
    np.save(cases / "small.npy", ball(5))  # as long as the old one
    outcome = ctmc("batch", cases, "-o", done, *FLAGS, "--simplify", "0.5", "--resume", "--no-thumbnails")
    assert outcome.code == 0, outcome.errors
    assert "1 done before" in outcome.out
    after = written_at(done)
    assert {name for name in after if after[name] != before[name]} == {"broken.json", "small.json"}
    assert states(done) == {"broken": "done", "large": "done", "small": "done"}
    assert whole(done)
    again = ctmc("batch", cases, "-o", done, *FLAGS, "--simplify", "0.5", "--resume")
    assert (again.code, written_at(done)) == (0, after)
    assert "at once" not in again.out  # there is nothing to say of how what is not done is done


@pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGKILL")
def test_a_batch_that_is_killed_leaves_no_half_file_and_resumes(scene, ctmc, tmp_path):
    for number in range(5):
        np.save(tmp_path / f"c{number}.npy", ball(30 + number, size=80))
    out = tmp_path / "out"
    words = ["batch", str(tmp_path / "c*.npy"), "-o", str(out), *FLAGS, "--jobs", "1", "--no-thumbnails"]
    process = subprocess.Popen(
        [sys.executable, "-c", WAITING, *words], cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        wait_until(
            lambda: (out / "summary.json").exists() and {"done", "running", "waiting"} <= set(states(out).values())
        )
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
    # The case that ran notices, and removes what it has not finished; half a summary is for the next batch to remove.
    wait_until(lambda: not any(out.glob(".ctmc-*/*")))
    assert whole(out)
    before = written_at(out)
    assert 1 <= len(before) < 5
    assert ctmc(*words, "--resume").code == 0
    assert set(states(out).values()) == {"done"}
    assert {name: written_at(out)[name] for name in before} == before
    assert not list(out.glob(".ctmc-*"))


def test_what_killed_runs_left_is_removed(ctmc, cases, tmp_path, name_of_an_ended_process):
    run, half = name_of_an_ended_process(".ctmc-run-"), name_of_an_ended_process()
    for name in (f"{run}/large", f"thumbnails/{half}"):
        (tmp_path / name).mkdir(parents=True)
    (tmp_path / f"{half}.json").write_text("half")
    assert ctmc("batch", cases / "small.npy", "-o", tmp_path, *FLAGS, "--overwrite", "--no-thumbnails").code == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "small.json", "small.stl", "summary.csv", "summary.html", "summary.json", "thumbnails",
    ]  # fmt: skip
    assert list((tmp_path / "thumbnails").iterdir()) == []


def test_a_second_batch_in_the_folder_is_refused_and_harms_nothing(ctmc, cases, tmp_path):
    out = tmp_path / "out"
    half = out / temporary_name()  # as another process would be writing
    with unfinished_folder(out) as name:
        (out / name / "large").mkdir()
        half.write_text("half")
        outcome = ctmc("batch", cases / "small.npy", "-o", out, *FLAGS, "--overwrite", "--no-thumbnails")
        assert outcome.code == 1
        assert len(outcome.errors) == 1
        assert name in outcome.errors[0]
        assert sorted(path.name for path in out.iterdir()) == sorted([name, half.name])
        assert (out / name / "large").is_dir()
    assert ctmc("batch", cases / "small.npy", "-o", out, *FLAGS, "--overwrite", "--no-thumbnails").code == 0
    assert half.read_text() == "half"


def test_overwrite_keeps_the_older_surface_until_there_is_a_new_one(ctmc, cases, tmp_path, monkeypatch):
    words = ["batch", cases / "small.npy", "-o", tmp_path, *FLAGS, "--no-thumbnails"]
    assert ctmc(*words).code == 0
    before = (tmp_path / "small.stl").read_bytes()
    with monkeypatch.context() as patched:
        in_place_of_a_case(patched, "import sys; sys.exit(3)")
        assert ctmc(*words, "--overwrite").code == 1
    assert (tmp_path / "small.stl").read_bytes() == before
    assert states(tmp_path) == {"small": "failed"}
    assert json.loads((tmp_path / "small.json").read_text("utf-8"))["status"] == "failed"
    assert ctmc(*words, "--overwrite", "--simplify", "0.5").code == 0
    assert len((tmp_path / "small.stl").read_bytes()) < len(before)
    assert states(tmp_path) == {"small": "done"}


def test_verify_looks_at_the_content_and_not_at_the_time(ctmc, cases, tmp_path):
    source = tmp_path / "small.npy"
    source.write_bytes((cases / "small.npy").read_bytes())
    words = ["batch", source, "-o", tmp_path / "out", *FLAGS, "--no-thumbnails"]
    assert ctmc(*words, "--verify").code == 0
    os.utime(source, (1, 1))
    assert "1 done before" in ctmc(*words, "--resume", "--verify").out
    assert "1 done before" not in ctmc(*words, "--resume").out  # another time: made again, and its content not kept
    assert "1 done before" in ctmc(*words, "--resume").out
    assert "1 done before" not in ctmc(*words, "--resume", "--verify").out


def test_strict_reading_makes_again_only_what_it_refuses(ctmc, phantom_folder, tmp_path):
    for name in ("even", "uneven"):
        shutil.copytree(phantom_folder / "dicom", tmp_path / "in" / name)
    sorted((tmp_path / "in" / "uneven").iterdir())[3].unlink()
    out = tmp_path / "out"
    words = ["batch", tmp_path / "in", "-o", out, "--threshold", "200", "--no-thumbnails"]
    assert ctmc(*words).code == 0
    before = written_at(out)
    outcome = ctmc(*words, "--resume", "--strict")
    assert outcome.code == 1
    assert "cases    2, 1 done before" in outcome.out
    assert "uneven" in outcome.errors[0]
    assert states(out) == {"even": "done", "uneven": "failed"}
    assert written_at(out)["even.json"] == before["even.json"]
    assert ctmc(*words, "--resume", "--strict", "--overwrite").code == 2
    assert "1 done before" in ctmc(*words, "--resume").out  # what was refused is made
    assert states(out) == {"even": "done", "uneven": "done"}
    assert written_at(out)["even.json"] == before["even.json"]


@pytest.mark.parametrize("version", ["0.2.0", "0.3.0"])
def test_a_folder_of_an_older_version_is_made_again_with_the_fields_it_had(ctmc, tmp_path, version):
    """Each version wrote its record in `old_records` from these two boxes; later ones place vertices elsewhere."""
    values = np.zeros((10, 12, 14), np.uint8)
    values[3:7, 3:9, 3:7], values[3:7, 3:9, 7:11] = 1, 2
    np.save(tmp_path / "two.npy", values)
    os.utime(tmp_path / "two.npy", ns=(10**18, 10**18))
    before = json.loads((RECORDS / f"{version}.json").read_text("utf-8"))
    (tmp_path / "out").mkdir()
    shutil.copy(RECORDS / f"{version}.json", tmp_path / "out" / "two-label-1.json")
    words = ("--label", "1", "2", "--no-thumbnails", "--resume")
    outcome = ctmc("batch", tmp_path / "two.npy", "-o", tmp_path / "out", *words)
    assert outcome.code == 0, outcome.errors
    after = json.loads((tmp_path / "out" / "two-label-1.json").read_text("utf-8"))
    assert before["version"] == version
    assert states(tmp_path / "out") == {"two-label-1": "done", "two-label-2": "done"}
    same = ("faces", "vertices", "closed", "labels", "beside", "fingerprint", "files", "file_bytes")
    assert {key: after[key] for key in same} == {key: before[key] for key in same}
    assert before.keys() <= after.keys()
