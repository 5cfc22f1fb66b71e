"""Steps: finished, moved into a part of larger work, cancelled."""

import pytest

from ctmc_addon.core import Step, finish
from ctmc_addon.core.errors import MemoryLimitError, SettingsError
from ctmc_addon.core.memory import available_bytes, require
from ctmc_addon.core.parallel import in_batches, worker_count
from ctmc_addon.core.progress import within


def counting(log):
    try:
        for number in range(4):
            yield Step(number / 4, f"{number}")
        return "done"
    finally:
        log.append("closed")


def test_finish_reports_every_step_and_returns_the_result():
    seen, log = [], []
    assert finish(counting(log), seen.append) == "done"
    assert [step.message for step in seen] == ["0", "1", "2", "3"]
    assert log == ["closed"]


def test_within_moves_fractions_and_closes_what_it_drives():
    log = []
    steps = within(counting(log), 0.5, 0.9)
    assert next(steps).fraction == 0.5
    assert next(steps).fraction == pytest.approx(0.6)
    steps.close()
    assert log == ["closed"]


@pytest.mark.parametrize("threads", [1, 3])
def test_batches_keep_the_order(threads):
    assert finish(in_batches(lambda n: n * n, range(100), threads, "Squaring")) == [n * n for n in range(100)]


def test_an_error_in_a_thread_comes_out_as_itself():
    def work(number):
        if number == 5:
            raise SettingsError("five")
        return number

    with pytest.raises(SettingsError, match="five"):
        finish(in_batches(work, range(10), 2, "Working"))


def test_threads_below_one_are_refused():
    with pytest.raises(SettingsError, match="threads must be 1 or more, not 0"):
        worker_count(0)
    assert worker_count(3) == 3
    assert 1 <= worker_count(None) <= 8


def test_memory_is_asked_for_before_work():
    assert (available_bytes() or 1) > 0
    require(10, "a little", "take less", limit_bytes=10)
    with pytest.raises(
        MemoryLimitError, match=r"a lot needs about 2\.0 GiB of memory and 1\.0 GiB are available; take less"
    ):
        require(2 << 30, "a lot", "take less", limit_bytes=1 << 30)
