# SPDX-License-Identifier: GPL-3.0-or-later
import csv
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from batches import FLAGS, ball, in_place_of_a_case, page_content, states, summary, whole

from ctmc_addon import core, readers
from ctmc_addon.cli.batch import process as batch_process
from ctmc_addon.cli.batch.case import THUMBNAIL
from ctmc_addon.cli.batch.process import CaseProcess, run_here
from ctmc_addon.cli.batch.summary.rows import COLUMNS

ROOT = Path(__file__).resolve().parents[3]
FIRST_COLUMNS = ["case", "status", "faces", "volume_mm3", "seconds", "error"]  # which scripts read


@pytest.mark.once
def test_the_summary_has_a_row_for_every_case(done):
    rows = summary(done)
    assert [list(row) for row in rows] == [list(COLUMNS)] * 3
    assert list(COLUMNS[:6]) == FIRST_COLUMNS
    assert [(row["case"], row["status"]) for row in rows] == [
        ("broken", "failed"),
        ("large", "done"),
        ("small", "done"),
    ]
    broken, large, small = rows
    assert (broken["faces"], broken["volume_mm3"]) == (None, None)
    assert "broken.npy" in broken["error"]
    assert large["error"] is small["error"] is None
    assert large["volume_mm3"] == pytest.approx(4 / 3 * np.pi * (7 * 0.5) ** 3, rel=0.05)
    assert all(row["seconds"] > 0 for row in rows)
    assert [row["removed_components"] for row in rows] == [row["collapsed_components"] for row in rows] == [None, 0, 0]
    with (done / "summary.csv").open(encoding="utf-8", newline="") as stream:
        table = list(csv.reader(stream))
    assert table == [list(COLUMNS), *[["" if row[key] is None else str(row[key]) for key in COLUMNS] for row in rows]]


def test_each_case_leaves_surface_and_json_and_nothing_else(done):
    there = {path.relative_to(done).as_posix() for path in done.rglob("*") if path.is_file()}
    assert there == {
        "large.stl", "large.json", "small.stl", "small.json", "broken.json", "thumbnails/large.png",
        "thumbnails/small.png", "summary.csv", "summary.json", "summary.html",
    }  # fmt: skip
    assert whole(done)
    assert [path.name for path in done.iterdir() if path.name.startswith(".")] == []


def test_a_cases_mesh_is_the_one_that_python_makes(done, cases):
    settings = core.ReconstructionSettings(threshold=50, reduction=0.5)
    expected = core.reconstruct(readers.read_volume(cases / "small.npy", spacing=0.5), settings).mesh
    triangle = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("pad", "<u2")])
    corners = np.frombuffer((done / "small.stl").read_bytes(), triangle, offset=84)["corners"]
    np.testing.assert_allclose(corners, expected.vertices[expected.faces], atol=1e-3)
    record = json.loads((done / "small.json").read_text("utf-8"))
    assert record["faces"] == len(corners)
    assert record["settings"] == settings.to_dict()
    assert record["version"]
    assert re.fullmatch("[0-9a-f]{32}", record["fingerprint"])
    assert record["stages"][0]["name"] == "Reading"


def test_an_error_gives_a_json_with_its_sentence(done):
    record = json.loads((done / "broken.json").read_text("utf-8"))
    assert record["status"] == "failed"
    assert record["error"] == summary(done)[0]["error"]
    assert len(record["error"].splitlines()) == 1
    assert record["faces"] is None


def test_no_output_names_a_folder_of_this_machine(done, cases):
    for path in done.glob("*.*"):
        content = path.read_bytes()
        for folder in (str(cases), str(done), str(Path.home())):
            assert folder.encode() not in content, path.name


def test_the_page_shows_a_thumbnail_of_every_surface_and_every_error(done):
    page = (done / "summary.html").read_text("utf-8")
    assert [row["picture"] for row in page_content(page)["rows"]] == [
        None, "thumbnails/large.png", "thumbnails/small.png",
    ]  # fmt: skip
    assert "3 cases: 2 done, 1 failed" in page
    assert "broken.npy" in page
    assert "http-equiv" not in page  # it is over, and needs no looking again
    assert not re.search(r'(src|href)="', page)
    assert "://" not in page  # no network


def test_a_thumbnail_shows_the_form_and_no_triangles(done):
    image = pytest.importorskip("PIL.Image", reason="Pillow is not installed")
    with image.open(done / "thumbnails" / "large.png") as picture:
        assert picture.size == THUMBNAIL
        pixels = np.asarray(picture.convert("RGB")).reshape(-1, 3).astype(int)
    filled = (pixels < 235).any(axis=1)
    assert 0.3 < filled.mean() < 0.8  # a ball as high as the picture, a little margin around it
    assert (pixels[filled].max(axis=1) - pixels[filled].min(axis=1)).max() < 110  # bone, where edges would be yellow


def test_a_surface_that_is_open_has_no_volume_in_any_summary(scene, ctmc, tmp_path):
    np.save(tmp_path / "open.npy", ball(14))  # reaches over the border
    out = tmp_path / "out"
    done = ctmc("batch", tmp_path / "open.npy", "-o", out, *FLAGS, "--no-thumbnails")
    assert done.code == 0
    assert "surfaces  1, open: --close-border closes it at the border" in done.out
    [row] = summary(out)
    assert (row["status"], row["volume_mm3"]) == ("done", None)
    assert "; --close-border closes it" in row["notes"]
    assert row["faces"] > 0
    record = json.loads((out / "open.json").read_text("utf-8"))
    assert (record["closed"], record["volume_mm3"]) == (False, None)
    assert f"open,done,{row['faces']},," in (out / "summary.csv").read_text("utf-8")
    [shown] = page_content((out / "summary.html").read_text("utf-8"))["rows"]
    assert shown["texts"][:2] == [str(row["faces"]), "-"]
    assert (row["closed"], row["outlier"]) == (False, "open")


def plain_task(folder, name):
    return {
        "case": name, "input": str(folder / "in.npy"), "folder": str(folder), "version": "0", "threads": 1,
        "outputs": [{"name": name, "settings": {}, "labels": [], "beside": []}], "reading": {}, "format": ".stl",
        "space": "ras", "thumbnails": False, "run": "1",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("script", "words"),
    [
        ("import os, signal; os.kill(os.getpid(), signal.SIGKILL)", "SIGKILL; perhaps memory ran out: try fewer jobs"),
        ("import os; os.abort()", "crashed with SIGABRT"),
        ("import sys; sys.exit(3)", "exit code 3"),
        ("raise ValueError('in /some/where/x.py')", "exit code 1: ValueError: in x.py"),
        ("", "exit code 0"),
    ],
)
@pytest.mark.skipif(os.name == "nt", reason="Windows has no signals to end a process by")
def test_a_crash_takes_nothing_with_it_but_its_case(tmp_path, monkeypatch, script, words):
    in_place_of_a_case(monkeypatch, script)
    tasks = [plain_task(tmp_path, name) for name in ("a", "b")]
    events = [event for event in run_here(tasks, 2, [0, 0], None) if event]
    assert sorted((event.task["case"], event.status) for event in events) == [
        (case, status) for case in "ab" for status in ("ended", "running")
    ]
    record = json.loads((tmp_path / "a.json").read_text("utf-8"))
    assert words in record["error"]
    assert record["status"] == "failed"
    assert ("traceback" in record) == ("ValueError" in script)


def test_a_case_that_dies_at_once_says_why_however_late_it_begins(tmp_path, monkeypatch):
    in_place_of_a_case(monkeypatch, "raise ValueError('x')")
    begin = CaseProcess.begin
    monkeypatch.setattr(CaseProcess, "begin", lambda self, *task: (self.process.wait(60), begin(self, *task)))
    assert [event.status for event in run_here([plain_task(tmp_path, "a")], 1, [0], None) if event][-1] == "ended"
    record = json.loads((tmp_path / "a.json").read_text("utf-8"))
    assert record["error"] == "the case's process ended with exit code 1: ValueError: x"


def most_at_once(tmp_path, jobs, needs, limit):
    tasks = [plain_task(tmp_path, f"c{number}") for number in range(len(needs))]
    running = most = 0
    for event in run_here(tasks, jobs, needs, limit):
        if event:
            running += 1 if event.status == "running" else -1
            most = max(most, running)
    return most


def test_cases_at_once_are_limited_by_jobs_and_memory(tmp_path, monkeypatch):
    # A case ends once as many as are expected have begun.
    script = (
        "import os, pathlib, sys, time; sys.stdin.readline(); folder = pathlib.Path({!r}); "
        "(folder / str(os.getpid())).touch(); end = time.monotonic() + 60\n"
        "while len(list(folder.iterdir())) < {} and time.monotonic() < end: time.sleep(0.01)"
    )
    # Of 20 two have room; larger than the limit, one goes alone.
    for number, (needs, limit, expected) in enumerate((([10] * 4, None, 3), ([10] * 4, 20, 2), ([30, 30], 20, 1))):
        begun = tmp_path / str(number)
        begun.mkdir()
        in_place_of_a_case(monkeypatch, script.format(str(begun), expected))
        assert most_at_once(tmp_path, 3, needs, limit) == expected


def test_stopping_ends_every_process(tmp_path, monkeypatch):
    in_place_of_a_case(monkeypatch, "import sys; sys.stdin.read()")
    events = run_here([plain_task(tmp_path, name) for name in ("a", "b")], 2, [0, 0], None)
    assert [next(events).status for _ in range(2)] == ["running", "running"]
    events.close()  # waits for both: they leave at the end of their standard input
    assert list(tmp_path.glob("*.json")) == []


def test_an_interrupted_batch_is_quiet_and_says_nothing_is_running(ctmc, cases, scene, tmp_path, monkeypatch):
    def interrupted(running, _limit):
        if running:
            raise KeyboardInterrupt

    in_place_of_a_case(monkeypatch, "import sys; sys.stdin.read()")
    monkeypatch.setattr(batch_process, "first_to_grant", interrupted)
    outcome = ctmc("batch", cases, "-o", tmp_path, *FLAGS)
    assert (outcome.code, outcome.errors) == (130, ["ctmc: interrupted"])
    assert set(states(tmp_path).values()) == {"waiting"}
    assert sorted(path.name for path in tmp_path.iterdir()) == ["summary.csv", "summary.html", "summary.json"]


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (["--jobs", "0"], "--jobs: must be 1 or more, not 0"),
        (["--threads", "0"], "--threads: must be 1 or more"),
        (["--alpha", "2"], "--alpha: must be from 0 to 1"),
        (["--spacing", "0"], "from 1e-06 to 10000 mm"),
    ],
)
def test_flags_outside_their_limits_are_wrong_usage(misused, cases, tmp_path, flags, words):
    assert words in misused("batch", cases, "-o", tmp_path / "out", *flags)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (["--settings", "none.toml"], "none.toml cannot be read"),
        (["--scheduler", "nonsense"], "'nonsense' is not a scheduler's address"),
    ],
)
def test_a_bad_file_or_scheduler_is_refused_before_anything_is_made(refused, cases, tmp_path, flags, words):
    if "--scheduler" in flags:
        pytest.importorskip("distributed", reason="dask.distributed is not installed")
    assert words in refused("batch", cases, "-o", tmp_path / "out", *flags)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("words", [[], ["x"], ["x", "-o", "y", "--resume", "--overwrite"]], ids=str)
def test_wrong_usage_has_exit_code_2(ctmc, words):
    assert ctmc("batch", *words).code == 2


def test_the_inner_command_is_not_for_people():
    command = [sys.executable, "-m", "ctmc_addon", "batch-case"]
    done = subprocess.run(command, cwd=ROOT, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "is for `ctmc batch`" in done.stderr
