# SPDX-License-Identifier: GPL-3.0-or-later
import csv
import json
import os
import re
import shutil
import signal
import struct
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from shapes import distance_mm

from ctmc_addon import core, readers
from ctmc_addon.cli import main
from ctmc_addon.cli.batch import process as batch_process
from ctmc_addon.cli.batch.case import THUMBNAIL
from ctmc_addon.cli.batch.files import unfinished_folder
from ctmc_addon.cli.batch.process import run_here
from ctmc_addon.cli.batch.summary.rows import COLUMNS
from ctmc_addon.core.files.temporary_names import temporary_name

ROOT = Path(__file__).resolve().parents[3]
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
FIRST_COLUMNS = ["case", "status", "faces", "volume_mm3", "seconds", "error"]  # which scripts read
FLAGS = ["--threshold", "50", "--spacing", "0.5"]


def ball(radius, size=20):
    """Return a ball at 50 and above, its radius in voxels."""
    return (50 + 20 * (radius - distance_mm((size,) * 3))).clip(0, 200).astype(np.uint8)


def wait_until(condition, seconds=90):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not come about"
        time.sleep(0.05)


def summary(folder):
    return json.loads((folder / "summary.json").read_text("utf-8"))


def states(folder):
    return {row["case"]: row["status"] for row in summary(folder)}


def whole(folder):
    """Whether every file is complete: an STL as long as it says, a JSON that can be read."""
    for path in folder.rglob("*.stl"):
        content = path.read_bytes()
        assert len(content) == 84 + 50 * struct.unpack_from("<I", content, 80)[0], path
    for path in folder.rglob("*.json"):
        json.loads(path.read_text("utf-8"))
    return True


def written_at(folder):
    return {path.name: path.stat().st_mtime_ns for path in folder.glob("*.json") if path.name != "summary.json"}


@pytest.fixture(scope="module")
def cases(tmp_path_factory):
    folder = tmp_path_factory.mktemp("Fälle 病例")
    for name, radius in (("large", 7), ("small", 4)):
        np.save(folder / f"{name}.npy", ball(radius))
    (folder / "broken.npy").write_bytes((folder / "large.npy").read_bytes()[:4000])
    return folder


@pytest.fixture(scope="module")
def done(scene, cases, tmp_path_factory):
    """A batch of three cases, one of them broken; the output's parents are not there."""
    folder = tmp_path_factory.mktemp("out") / "a" / "b"
    assert main(["batch", str(cases), "-o", str(folder), *FLAGS, "--simplify", "0.5"]) == 1
    return folder


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


def test_each_label_of_lits_is_said_to_be_from_the_segmentation(ctmc, phantom_folder, tmp_path):
    words = ("--label", 1, 2, "--no-thumbnails")
    done = ctmc("batch", phantom_folder / "volume-4.nii.gz", "-o", tmp_path / "out", *words)
    assert done.code == 0, done.errors
    for label in (1, 2):
        report = json.loads((tmp_path / "out" / f"volume-4-label-{label}.json").read_text("utf-8"))
        assert report["settings"]["label"] == label
        note = "volume-4.nii.gz holds gray values: labels are taken from segmentation-4.nii.gz beside it"
        assert [said for said in report["notes"] if "taken from" in said] == [note]


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
    assert re.findall(r'loading="lazy".*?src="(.*?)"', page) == ["thumbnails/large.png", "thumbnails/small.png"]
    assert "3 cases: 2 done, 1 failed" in page
    assert "broken.npy" in page
    assert "http-equiv" not in page  # it is over, and needs no looking again
    assert not re.search(r'(src|href)="(?!thumbnails/)', page)
    assert "://" not in page  # no network


def test_a_thumbnail_shows_the_form_and_no_triangles(done):
    image = pytest.importorskip("PIL.Image", reason="Pillow is not installed")
    with image.open(done / "thumbnails" / "large.png") as picture:
        assert picture.size == THUMBNAIL
        pixels = np.asarray(picture.convert("RGB")).reshape(-1, 3).astype(int)
    filled = (pixels < 235).any(axis=1)
    assert 0.3 < filled.mean() < 0.8  # a ball as high as the picture, a little margin around it
    assert (pixels[filled].max(axis=1) - pixels[filled].min(axis=1)).max() < 110  # bone, where edges would be yellow


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


@pytest.mark.usefixtures("scene")
def test_several_labels_come_from_one_reading_and_one_that_a_case_lacks_is_absent(ctmc, phantom_folder, tmp_path):
    words = ["-o", tmp_path, "--label", "1", "2", "9", "--close-border", "--output-format", "ply", "--no-thumbnails"]
    (tmp_path / "volume-4-label-9.ply").write_text("of an older run")
    (tmp_path / "volume-4-label-9.json").write_text('{"files": ["volume-4-label-9.ply"]}')
    outcome = ctmc("batch", phantom_folder, *words, "--overwrite")
    assert outcome.code == 0
    assert "absent  volume-4-label-9  label 9 is empty here; the labels are 1, 2" in outcome.out
    assert "3 cases: 2 done, 1 absent; see summary.html" in outcome.out
    again = ctmc("batch", phantom_folder, *words, "--resume")
    assert (again.code, again.out.splitlines()[0]) == (0, "cases  1, 1 done before")  # what is absent is not looked for
    again = ctmc("batch", phantom_folder, *words, "--resume", "--strict")
    assert again.code == 1
    assert again.errors == ["ctmc: 1 of 3 cases lack the label, as --strict refuses: volume-4-label-9"]
    liver, tumour, none = summary(tmp_path)
    assert (none["status"], none["faces"]) == ("absent", None)
    assert [row["case"] for row in (liver, tumour, none)] == [f"volume-4-label-{label}" for label in (1, 2, 9)]
    assert liver["volume_mm3"] > tumour["volume_mm3"] > 0
    assert sorted(path.name for path in tmp_path.glob("*.ply")) == ["volume-4-label-1.ply", "volume-4-label-2.ply"]


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
    page = (out / "summary.html").read_text("utf-8")
    assert f'<td class="number">{row["faces"]}</td><td class="number">-</td>' in page
    assert (row["closed"], row["outlier"]) == (False, "open")


@pytest.mark.once
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


def plain_task(folder, name):
    return {
        "case": name, "input": str(folder / "in.npy"), "folder": str(folder), "version": "0", "threads": 1,
        "outputs": [{"name": name, "settings": {}, "labels": [], "beside": []}], "reading": {}, "format": ".stl",
        "space": "ras", "thumbnails": False, "run": "1",
    }  # fmt: skip


def in_place_of_a_case(monkeypatch, script):
    monkeypatch.setattr(batch_process, "command", lambda: [sys.executable, "-c", script])


@pytest.mark.parametrize(
    ("script", "words"),
    [
        ("import os, signal; os.kill(os.getpid(), signal.SIGKILL)", "signal 9 (SIGKILL); perhaps memory ran out"),
        ("import os; os.abort()", "signal 6 (SIGABRT)"),
        ("import sys; sys.exit(3)", "exit code 3: it printed nothing"),
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


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (["--jobs", "0"], "--jobs: must be 1 or more, not 0"),
        (["--threads", "0"], "--threads: must be 1 or more"),
        (["--alpha", "2"], "--alpha: must be from 0 to 1"),
        (["--spacing", "0"], "above 0 mm"),
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
