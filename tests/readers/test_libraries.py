"""How the readers' libraries are imported and kept quiet."""

import sys
import threading
import time
import warnings

import pytest

from ctmc_addon.core import Step, finish
from ctmc_addon.core.errors import ReadError
from ctmc_addon.readers.libraries import imported_steps, quietly


@pytest.fixture
def slow_library(tmp_path, monkeypatch):
    """The name of a module that takes 0.2 s to import."""
    (tmp_path / "slow_library.py").write_text("import time; time.sleep(0.2)", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    yield "slow_library"
    sys.modules.pop("slow_library", None)


def test_a_slow_import_gives_steps_and_the_module(slow_library):
    steps = list(imported_steps(slow_library, "slow", "it"))
    assert steps[0] == Step(0.0, "Loading slow")
    assert len(steps) > 1
    assert finish(imported_steps(slow_library, "slow", "it")) is sys.modules[slow_library]
    assert not list(imported_steps(slow_library, "slow", "it"))


def test_closing_an_import_leaves_no_thread(slow_library):
    before = threading.active_count()
    steps = imported_steps(slow_library, "slow", "it")
    next(steps)
    assert threading.active_count() == before + 1
    steps.close()
    assert threading.active_count() == before
    assert slow_library in sys.modules


def test_a_missing_library_is_named():
    with pytest.raises(ReadError, match="reading it needs the Python package nothing, which is missing"):
        finish(imported_steps("no_such_module", "nothing", "it"))


def test_quiet_steps_warn_of_nothing_and_leave_the_filters_alone_between_them():
    def noisy():
        warnings.warn("from a library", stacklevel=1)
        yield Step(0.0, "a")
        warnings.warn("from a library", stacklevel=1)
        return 7

    filters = list(warnings.filters)
    steps = quietly(noisy())
    assert next(steps) == Step(0.0, "a")
    assert warnings.filters == filters
    assert finish(steps) == 7


def test_closing_quiet_steps_closes_those_inside():
    closed = []

    def work():
        try:
            yield Step(0.0, "a")
        finally:
            closed.append(time.monotonic())

    steps = quietly(work())
    next(steps)
    steps.close()
    assert closed
