# SPDX-License-Identifier: GPL-3.0-or-later
"""Work over threads: in order, with its own errors, and ended with the steps."""

import threading
import time

import pytest

from ctmc_addon.core import finish
from ctmc_addon.core.errors import SettingsError
from ctmc_addon.core.parallel import map_steps, worker_count


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
