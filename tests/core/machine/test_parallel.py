# SPDX-License-Identifier: GPL-3.0-or-later
"""Work over threads: in order, with its own errors, and ended with the steps."""

import os
import threading
import time

import pytest

from ctmc_addon.core import Step, finish
from ctmc_addon.core.errors import SettingsError
from ctmc_addon.core.machine.memory import NO_THREAD
from ctmc_addon.core.machine.parallel import in_order_steps, map_steps, processors, side_by_side_steps, worker_count


@pytest.mark.parametrize("threads", [1, 3])
def test_results_keep_the_order_of_the_items(threads):
    assert finish(map_steps(lambda n: n * n, range(100), threads, "Squaring")) == [n * n for n in range(100)]


def test_the_fractions_rise_to_one():
    fractions = [step.fraction for step in map_steps(str, range(40), 2, "Writing", batches=8)]
    assert fractions == [number / 8 for number in range(1, 9)]


def test_an_error_in_a_thread_comes_out_as_itself():
    def work(number):
        if number == 5:
            raise SettingsError("five")
        return number

    with pytest.raises(SettingsError, match="five"):
        finish(map_steps(work, range(10), 2, "Working"))


def test_closed_steps_leave_no_thread_and_start_no_more_work():
    before, started = threading.active_count(), []

    def work(number):
        started.append(number)
        time.sleep(0.01)

    steps = map_steps(work, range(1000), 3, "Working", batches=1000)
    next(steps)
    steps.close()
    count = len(started)
    assert threading.active_count() == before
    time.sleep(0.03)
    assert len(started) == count < 1000


def test_threads_below_one_are_refused():
    with pytest.raises(SettingsError, match="not 0"):
        worker_count(0)
    assert worker_count(3) == 3
    assert 1 <= worker_count(None) <= 8


def test_threads_are_by_default_as_many_as_the_processors_that_may_be_used(monkeypatch):
    monkeypatch.setattr(os, "cpu_count", lambda: 64)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {3, 5}, raising=False)
    assert worker_count(None) == processors() == 2
    monkeypatch.delattr(os, "sched_getaffinity")
    assert (worker_count(None), processors()) == (8, 64)


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_works_side_by_side_give_their_results_in_order_and_their_steps(threads):
    def work_steps(number):
        for step in range(number):
            yield Step(step / number)
        return 10 * number

    works = [lambda n=n: work_steps(n) for n in (7, 1, 4, 0)]
    steps = side_by_side_steps(works, [7, 1, 4, 1], threads, "Working")
    seen = []
    assert finish(steps, seen.append) == [70, 10, 40, 0]
    assert {step.message for step in seen} == {"Working"}
    fractions = [step.fraction for step in seen]
    assert fractions == sorted(fractions)


@pytest.mark.parametrize("threads", [1, 3])
def test_closed_works_side_by_side_are_closed_and_others_not_begun(threads):
    begun, closed = [], []

    def endless_steps(number):
        begun.append(number)
        try:
            while True:
                yield Step(0.5)
        finally:
            closed.append(number)

    steps = side_by_side_steps([lambda n=n: endless_steps(n) for n in range(9)], [1] * 9, threads)
    next(steps)
    steps.close()
    assert sorted(closed) == sorted(begun) == list(range(threads))


def test_an_error_of_a_work_side_by_side_ends_the_others():
    def failing_steps(number):
        yield Step(0.0)
        if number == 1:
            raise ValueError("broken")
        while True:
            yield Step(0.1)

    with pytest.raises(ValueError, match="broken"):
        finish(side_by_side_steps([lambda n=n: failing_steps(n) for n in range(3)], [1] * 3, 3))


def test_work_is_done_by_this_thread_where_no_other_can_be_started(monkeypatch):
    started = threading.Thread.start
    room = [1]  # threads for which there is memory

    def start(thread):
        if not room:
            raise RuntimeError(NO_THREAD)
        room.pop()
        started(thread)

    def square(number):
        squared.append(number)
        time.sleep(0.001)
        return number * number

    squared = []
    monkeypatch.setattr(threading.Thread, "start", start)
    assert finish(map_steps(square, range(40), threads=4)) == [n * n for n in range(40)]
    assert room == []
    assert sorted(squared) == list(range(40))  # each once


def doubled(number, slow=()):
    def work_steps():
        for _ in range(3):
            if number in slow:
                time.sleep(0.01)
            yield Step(0.5)
        if number == 5:
            raise SettingsError("five")
        return 2 * number

    return work_steps


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_works_that_come_one_by_one_give_their_results_in_order(threads):
    items = list(in_order_steps([Step(0.1), *map(doubled, range(5)), Step(0.9)], threads))
    assert [item for item in items if not isinstance(item, Step)] == [0, 2, 4, 6, 8]
    assert {item.fraction for item in items if isinstance(item, Step)} - {0.0} == {0.1, 0.9}
    items = in_order_steps([doubled(number, slow=range(5)) for number in range(9)], threads)
    with pytest.raises(SettingsError, match="five"):
        list(items)


def test_no_more_works_come_than_can_be_at_work():
    lock, begun, ended, waiting = threading.Lock(), [], [], []

    def work(number):
        def work_steps():
            for _ in range(3):
                time.sleep(0.005)
                yield Step(0.5)
            with lock:
                ended.append(number)
            return number

        return work_steps

    def works():
        for number in range(6):
            with lock:
                begun.append(number)
                waiting.append(len(begun) - len(ended))
            yield work(number)

    assert [item for item in in_order_steps(works(), 2) if not isinstance(item, Step)] == [0, 1, 2, 3, 4, 5]
    assert len(begun) == 6
    assert max(waiting) <= 3  # two at work, and the one that comes


def test_a_work_that_lasts_keeps_no_thread_from_the_works_after_it():
    ended = threading.Event()

    def first_steps():
        while not ended.is_set():
            time.sleep(0.001)
            yield Step(0.5)
        return "first"

    def last_steps():
        ended.set()
        yield Step(0.5)
        return "last"

    works = [first_steps, *(doubled(number) for number in range(4)), last_steps]
    items = [item for item in in_order_steps(works, 2) if not isinstance(item, Step)]
    assert items == ["first", 0, 2, 4, 6, "last"]


def test_works_that_come_one_by_one_end_with_the_steps():
    before, ended = threading.active_count(), []

    def works():
        try:
            yield from (doubled(number, slow=range(9)) for number in range(9))
        finally:
            ended.append(True)

    steps = in_order_steps(works(), 3)
    next(steps)
    steps.close()
    assert (threading.active_count(), ended) == (before, [True])


def test_works_are_done_here_where_the_system_gives_no_thread(monkeypatch):
    started = []
    start = threading.Thread.start

    def refused(thread):
        if started:
            raise RuntimeError(NO_THREAD)
        started.append(thread)
        start(thread)

    monkeypatch.setattr(threading.Thread, "start", refused)
    items = in_order_steps([doubled(number, slow=[0]) for number in range(5)], 3)
    assert [item for item in items if not isinstance(item, Step)] == [0, 2, 4, 6, 8]
    assert len(started) == 1


@pytest.mark.parametrize("room", [0, 1, 2])
def test_works_side_by_side_are_done_by_the_threads_there_are_or_here(monkeypatch, room):
    started = []
    start = threading.Thread.start

    def refused(thread):
        if len(started) == room:
            raise RuntimeError(NO_THREAD)
        started.append(thread)
        start(thread)

    before = threading.active_count()
    monkeypatch.setattr(threading.Thread, "start", refused)
    here = []

    def work_steps(number):
        for step in range(4):
            time.sleep(0.002)
            yield Step(step / 4)
        here.append(threading.current_thread() is threading.main_thread())
        return 10 * number

    seen = []
    works = [lambda n=n: work_steps(n) for n in range(7)]
    assert finish(side_by_side_steps(works, [1] * 7, 4), seen.append) == [10 * n for n in range(7)]
    assert len(started) == room
    assert any(here) == (room == 0)
    assert threading.active_count() == before
    fractions = [step.fraction for step in seen]
    assert fractions == sorted(fractions)


def test_another_error_of_a_thread_that_does_not_start_stays_what_it_is(monkeypatch):
    def refused(_thread):
        raise RuntimeError("cannot schedule new futures after interpreter shutdown")

    monkeypatch.setattr(threading.Thread, "start", refused)
    works = [lambda n=n: doubled(n)() for n in range(3)]
    for steps in (side_by_side_steps(works, [1] * 3, 2), map_steps(str, range(3), 2), in_order_steps(works, 2)):
        with pytest.raises(RuntimeError, match="interpreter shutdown"):
            for _ in steps:
                pass
