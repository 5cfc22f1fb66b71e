# SPDX-License-Identifier: GPL-3.0-or-later
"""Steps: finished, weighed and timed as stages, cancelled."""

import time

import pytest

from ctmc_addon.core import PAUSE, Stages, Step, equal_part, finish


def counting_steps(log):
    try:
        for number in range(4):
            yield Step(number / 4, f"{number}")
        return "done"
    finally:
        log.append("closed")


def test_finish_reports_every_step_and_returns_the_result():
    seen, log = [], []
    assert finish(counting_steps(log), seen.append) == "done"
    assert [step.message for step in seen] == ["0", "1", "2", "3"]
    assert log == ["closed"]


def test_a_stage_moves_fractions_into_its_share_and_closes_what_it_drives():
    log = []
    steps = Stages({"Reading": 1, "Counting": 3}).run("Counting", counting_steps(log))
    assert next(steps) == Step(0.25, "0")
    assert next(steps).fraction == pytest.approx(0.25 + 0.75 / 4)
    steps.close()
    assert log == ["closed"]


def test_an_equal_part_moves_fractions_into_its_share_and_closes_what_it_drives():
    log = []
    steps = equal_part(counting_steps(log), 2, 4)
    assert next(steps) == Step(0.5, "0")
    steps.close()
    assert log == ["closed"]


def test_a_stage_names_the_steps_without_a_message_of_their_own():
    def pausing_steps():
        yield PAUSE

    assert list(Stages({"Reading": 1, "Counting": 1}).run("Counting", pausing_steps())) == [Step(0.5, "Counting")]


def test_the_seconds_of_a_stage_are_those_of_its_work(monkeypatch):
    clock = [0.0]
    monkeypatch.setattr(time, "perf_counter", lambda: clock[0])

    def working_steps():
        for _ in range(2):
            clock[0] += 2.0
            yield PAUSE

    stages = Stages({"Working": 1})
    for _ in stages.run("Working", working_steps()):
        clock[0] += 30.0  # a window that redraws
    assert stages.seconds["Working"] == 4.0
