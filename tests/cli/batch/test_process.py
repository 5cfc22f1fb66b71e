# SPDX-License-Identifier: GPL-3.0-or-later
"""Processes that make several cases: one start for all, a crash costs one case, memory is asked for and given back."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import nibabel
import numpy as np
import pytest
from shapes import distance_mm

from ctmc_addon.cli.batch import process as batch_process
from ctmc_addon.cli.batch.case import NO_HU, CaseWork, announced_budget, do_case
from ctmc_addon.cli.batch.files import remove_own_unfinished, unfinished_folder
from ctmc_addon.cli.batch.process import CaseProcess, first_to_grant, fits, run_here, run_task
from ctmc_addon.cli.batch.worker import MARK, NEEDS, OVER
from ctmc_addon.core import VERSION, CtmcError, MemoryLimitError
from ctmc_addon.core.machine.memory import peak_bytes, reset_peak_bytes, resident_bytes
from ctmc_addon.core.machine.own_process import PACKAGE
from ctmc_addon.core.planning.case_plan import PROCESS_BYTES

pytestmark = pytest.mark.once
# Says that it is over after every task; ends at a task called "bad", makes one called "long" without end, and asks for
# memory where a task says how much. After one called "last" it dies before it is given another.
SCRIPT = f"""
import json, os, sys
for line in sys.stdin:
    task = json.loads(line)
    if task["case"] == "bad":
        os.abort()
    if task["case"] == "long":
        sys.stdin.read()
        break
    if task.get("bytes", 0) > task["reserved"]:
        print(f"chatter{MARK}{NEEDS} {{task['bytes']}}", flush=True)
        sys.stdin.readline()
    print("chatter", file=sys.stderr, flush=True)
    print("{MARK}{OVER}", os.fstat(2).st_size, flush=True)
    if task["case"] == "last":
        raise ValueError("x")
"""


def task_of(folder, name, **more):
    return {
        "case": name, "input": str(folder / "in.npy"), "folder": str(folder), "version": "0", "threads": 1,
        "outputs": [{"name": name, "settings": {}, "labels": [], "beside": []}], "reading": {}, "format": ".stl",
        "space": "ras", "thumbnails": False, "run": "1", **more,
    }  # fmt: skip


@pytest.fixture
def started(monkeypatch):
    """A list with an entry for every process that is started."""
    started = []

    def command():
        started.append(None)
        return [sys.executable, "-c", SCRIPT]

    monkeypatch.setattr(batch_process, "command", command)
    return started


def events_of(tasks, jobs, needs, limit):
    return [(event.task["case"], event.status) for event in run_here(tasks, jobs, needs, limit) if event]


def test_a_case_does_not_give_back_every_array_as_workers_of_dask_do(monkeypatch):
    monkeypatch.setenv("MALLOC_TRIM_THRESHOLD_", "65536")
    monkeypatch.setenv("OTHERS", "stay")
    environment = batch_process.environment("temporary files")
    assert "MALLOC_TRIM_THRESHOLD_" not in environment
    assert environment["OTHERS"] == "stay"
    assert environment["TMPDIR"] == "temporary files"


def test_a_process_makes_one_case_after_the_other(started, tmp_path):
    events = events_of([task_of(tmp_path, name) for name in "abcd"], 1, [0] * 4, None)
    assert events == [(name, status) for name in "abcd" for status in ("running", "ended")]
    assert len(started) == 1


def test_a_crash_takes_one_case_and_a_new_process_the_others(started, tmp_path):
    names = ["a", "bad", "c", "d"]
    events = events_of([task_of(tmp_path, name) for name in names], 1, [0] * 4, None)
    assert events == [(name, status) for name in names for status in ("running", "ended")]
    assert len(started) == 2
    errors = {name: json.loads((tmp_path / f"{name}.json").read_text("utf-8"))["error"] for name in names}
    assert errors.pop("bad") == "the case's process crashed with SIGABRT"
    assert set(errors.values()) == {"the case left no record"}  # of a script that makes nothing


def test_a_process_that_dies_before_its_case_begins_says_why(started, tmp_path, monkeypatch):
    begin = CaseProcess.begin

    def begin_late(self, task, *reserved):
        if task["case"] == "b":
            self.process.wait(60)  # so that all it has to say is written
        begin(self, task, *reserved)

    monkeypatch.setattr(CaseProcess, "begin", begin_late)
    events_of([task_of(tmp_path, name) for name in ("last", "b")], 1, [0, 0], None)
    record = json.loads((tmp_path / "b.json").read_text("utf-8"))
    assert record["error"] == "the case's process ended with exit code 1: ValueError: x"
    assert record["traceback"][0].startswith("Traceback ")  # without the chatter of the case before


def test_where_all_wait_for_memory_the_last_is_put_back_and_begins_with_what_it_asked_for(started, tmp_path):
    tasks = [task_of(tmp_path, name, bytes=18) for name in ("a", "b")]
    assert events_of(tasks, 2, [5, 5], 20) == [
        ("a", "running"),
        ("b", "running"),
        ("b", "waiting"),
        ("a", "ended"),
        ("b", "running"),
        ("b", "ended"),
    ]
    assert len(started) == 2  # the one that was put back is done by the other's process


def test_memory_is_granted_in_order_where_there_is_room():
    running = [SimpleNamespace(reserved_bytes=5, asked_bytes=asked) for asked in (12, 10)]
    assert first_to_grant(running, 17) is running[0]
    assert first_to_grant(running, 16) is running[1]
    assert first_to_grant(running, 14) is None
    assert first_to_grant([running[0]], 1) is running[0]  # alone
    assert fits(running, 5, 15)
    assert not fits(running, 6, 15)
    assert fits(running, 1 << 60, None)


def test_a_budget_asks_once_for_more_than_it_has():
    asked = []
    budget = announced_budget({"threads": 1, "reserved": 1 << 40}, asked.append)
    budget.require(1, "this", "do that")
    assert asked == []
    has = resident_bytes()
    if has is None:
        pytest.skip("the system does not say what a process has")
    budget = announced_budget({"threads": 1, "reserved": 0}, asked.append)
    with pytest.raises(MemoryLimitError):
        budget.require(1 << 50, "this", "do that")
    budget.require(1 << 20, "less", "do that")
    assert len(asked) == 1
    assert 1.4 * (1 << 50) < asked[0] < 1.4 * (1 << 50) + 2 * has + (1 << 30)


def test_labels_made_side_by_side_ask_for_what_they_need_together():
    asked = []
    budget = announced_budget({"threads": 2, "reserved": 0}, asked.append)
    needs, both = (10 << 20, 20 << 20), threading.Barrier(2)

    def label(needed):
        own = budget.shared_by(2)
        both.wait()  # each lives until the other has asked
        own.require(needed, "a label", "choose a region")
        both.wait()

    threads = [threading.Thread(target=label, args=[needed]) for needed in needs]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert max(asked) >= 1.4 * sum(needs)
    if resident_bytes() is not None:
        assert max(asked) - min(asked) >= 1.4 * min(needs) - (4 << 20)  # but for what the process has meanwhile
    before = len(asked)
    budget.require(20 << 20, "what follows", "choose a region")  # they are over
    assert len(asked) == before


def test_the_peak_of_a_process_begins_anew():
    reset_peak_bytes()
    before = peak_bytes()
    if before is None:
        pytest.skip("the system does not say what a process had")
    taken = np.ones(64 << 20, np.uint8)
    assert peak_bytes() >= before + len(taken) - (8 << 20)
    del taken
    reset_peak_bytes()
    assert peak_bytes() < before + (48 << 20)


def test_cases_of_one_process_have_the_bytes_of_their_own_and_stay_below_what_was_reserved(ctmc, tmp_path, monkeypatch):
    for number in (6, 5, 7):
        ball = (distance_mm((20, 20, 20)) < number).astype(np.uint8)
        np.save(tmp_path / f"c{number}.npy", ball)
    processes = []
    begin = CaseProcess.begin

    def noted(self, task, *reserved):
        processes.append(self)
        begin(self, task, *reserved)

    monkeypatch.setattr(CaseProcess, "begin", noted)
    words = ["--label", "1", "--spacing", "1", "--no-thumbnails", "--jobs", "1"]
    assert ctmc("batch", tmp_path, "-o", tmp_path / "together", *words).code == 0
    assert len(processes) == 3
    assert len(set(processes)) == 1
    assert ctmc("batch", tmp_path / "c7.npy", "-o", tmp_path / "alone", *words).code == 0
    assert (tmp_path / "alone" / "c7.stl").read_bytes() == (tmp_path / "together" / "c7.stl").read_bytes()
    for number in (5, 6, 7):
        record = json.loads((tmp_path / "together" / f"c{number}.json").read_text("utf-8"))
        assert record["memory_bytes"] is None or 30 << 20 < record["memory_bytes"] < PROCESS_BYTES


def test_a_case_without_a_batch_asks_for_nothing(tmp_path):
    case = CaseWork(task_of(tmp_path, "a"), tmp_path / "unfinished")
    case.budget.require(1, "this", "do that")
    assert type(case.budget).__name__ == "Budget"


def test_hu_inside_a_label_is_that_of_the_ct_beside_it(ctmc, tmp_path):
    folder = tmp_path / "in"
    folder.mkdir()
    values = np.random.default_rng(2).integers(-100, 200, (20, 20, 20)).astype(np.int16)
    labels = (distance_mm((20, 20, 20)) < 6).astype(np.uint8)
    for name, array in (("volume-1", values), ("segmentation-1", labels)):
        nibabel.save(nibabel.Nifti1Image(array.T, np.diag([1.0, 1.0, 2.0, 1.0])), folder / f"{name}.nii.gz")
    words = ["--label", "1", "--no-thumbnails", "--jobs", "1"]
    assert ctmc("batch", folder, "-o", tmp_path / "out", *words, "--hu").code == 0
    [row] = json.loads((tmp_path / "out" / "summary.json").read_text("utf-8"))
    chosen = values[labels == 1].astype(float)
    assert row["mean_hu"] == pytest.approx(chosen.mean(), abs=6e-4)
    assert row["sd_hu"] == pytest.approx(chosen.std(), abs=6e-4)
    assert (row["spacing_z_mm"], row["components"], row["closed"]) == (2.0, 1, True)
    assert "1 done before" in ctmc("batch", folder, "-o", tmp_path / "out", *words, "--resume").out
    assert ctmc("batch", folder, "-o", tmp_path / "without", *words).code == 0
    [row] = json.loads((tmp_path / "without" / "summary.json").read_text("utf-8"))
    assert (row["mean_hu"], NO_HU in row["notes"]) == (None, False)
    alone = folder / "segmentation-1.nii.gz"
    assert ctmc("batch", alone, "-o", tmp_path / "alone", *words, "--hu").code == 0
    [row] = json.loads((tmp_path / "alone" / "summary.json").read_text("utf-8"))
    assert (row["mean_hu"], NO_HU in row["notes"]) == (None, True)


def test_a_clusters_worker_keeps_a_process_for_the_next_case_and_not_for_long(started, tmp_path, monkeypatch):
    monkeypatch.setattr(batch_process, "KEPT_SECONDS", 600.0)
    for name in ("a", "b", "bad", "c"):
        if name == "c":
            monkeypatch.setattr(batch_process, "KEPT_SECONDS", 0.1)
        batch_process.run_task(task_of(tmp_path, name, reserved=0, unfinished="."))
    assert len(started) == 2  # one for a, b and the one that crashed, one for c
    assert all((tmp_path / f"{name}.json").exists() for name in ("a", "b", "bad", "c"))
    [kept] = batch_process._idle
    kept.process.wait(60)
    end = time.monotonic() + 60
    while Path(kept.folder).exists() and time.monotonic() < end:
        time.sleep(0.02)
    assert not Path(kept.folder).exists()
    assert batch_process._idle == []


@pytest.mark.parametrize("then", ["", "os._exit(1)"], ids=["it ends", "it dies"])
def test_a_clusters_worker_that_is_gone_leaves_no_temporary_folder(tmp_path, then):
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    (tmp_path / "unfinished").mkdir()
    code = f"import json, os, sys; from {run_task.__module__} import run_task; run_task(json.load(sys.stdin)); " + then
    task = task_of(tmp_path, "a", reserved=0, unfinished="unfinished", verify=False)
    worker = subprocess.run(
        [sys.executable, "-c", code],
        cwd=PACKAGE.parent,
        env={**os.environ, "TMPDIR": str(temporary)},
        input=json.dumps(task),
        text=True,
        check=False,
    )
    assert worker.returncode == (1 if then else 0)
    assert json.loads((tmp_path / "a.json").read_text("utf-8"))["status"] == "failed"
    end = time.monotonic() + 60
    while list(temporary.iterdir()) and time.monotonic() < end:
        time.sleep(0.02)
    assert list(temporary.iterdir()) == []


def test_a_process_that_talks_nonsense_costs_its_case(tmp_path, monkeypatch):
    monkeypatch.setattr(threading, "excepthook", lambda args: None)
    script = f"import time; print('{MARK}{OVER} many', flush=True); time.sleep(1000)"
    monkeypatch.setattr(batch_process, "command", lambda: [sys.executable, "-c", script])
    assert events_of([task_of(tmp_path, "a")], 1, [0], None) == [("a", "running"), ("a", "ended")]
    assert json.loads((tmp_path / "a.json").read_text("utf-8"))["error"] == "the case's process closed its output"


def test_a_worker_stops_the_case_of_a_batch_that_has_ended_and_writes_no_record(started, tmp_path):
    errors, processes = [], []
    begin = CaseProcess.begin

    def work(name):
        try:
            batch_process.run_task(task_of(tmp_path, "long", unfinished=name))
        except CtmcError as error:
            errors.append(str(error))

    with pytest.MonkeyPatch.context() as patched, unfinished_folder(tmp_path) as name:
        patched.setattr(CaseProcess, "begin", lambda self, task: (processes.append(self), begin(self, task)))
        worker = threading.Thread(target=work, args=[name], daemon=True)
        worker.start()
        end = time.monotonic() + 60
        while not processes and time.monotonic() < end:
            time.sleep(0.02)
        worker.join(0.1)
        assert worker.is_alive()
    worker.join(60)
    assert not worker.is_alive()
    assert processes[0].process.poll() is not None
    assert errors == [f"the batch has ended, or its folder {name} is not visible from this machine"]
    with pytest.raises(CtmcError, match="the batch has ended"):  # nor is one begun
        batch_process.run_task(task_of(tmp_path, "a", unfinished=name))
    assert len(started) == 1
    assert list(tmp_path.iterdir()) == []


def test_a_case_of_a_batch_that_has_ended_leaves_the_records_of_the_next_one(tmp_path, name_of_an_ended_process):
    np.save(tmp_path / "in.npy", (distance_mm((9, 9, 9)) < 3).astype(np.uint8))
    record = tmp_path / "a.json"
    record.write_text("{}")
    for number, output in enumerate(({"label": 1}, {"label": 2}, {"threshold": 9.0})):  # done, absent, failed
        run = tmp_path / (".ctmc-run-of-another-machine" if number % 2 else name_of_an_ended_process(".ctmc-run-"))
        task = task_of(tmp_path, "a", unfinished=run.name, verify=False, version=VERSION)
        task["outputs"][0]["settings"] = output
        do_case(task, run / "a")
        assert record.read_text() == "{}"
        assert not run.exists()


def test_a_cases_end_leaves_the_hidden_folder_of_a_batch_that_lives(tmp_path, name_of_an_ended_process):
    with unfinished_folder(tmp_path) as name:
        for run in (tmp_path / name, tmp_path / name_of_an_ended_process(".ctmc-run-")):
            (run / "a").mkdir(parents=True, exist_ok=True)
            (run / "a" / "half.stl").write_text("half")
            remove_own_unfinished(run / "a")
        assert [path.name for path in tmp_path.iterdir()] == [name]
        assert list((tmp_path / name).iterdir()) == []
