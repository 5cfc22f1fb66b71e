# SPDX-License-Identifier: GPL-3.0-or-later
"""How the readers' libraries are imported and kept quiet."""

import subprocess
import sys
import threading
import warnings
from pathlib import Path

import nibabel
import numpy as np
import pytest
from pydicom import uid

from ctmc_addon import readers
from ctmc_addon.core import Step, finish
from ctmc_addon.core.errors import ReadError
from ctmc_addon.readers.optional_imports import imported_steps, quiet_batches_steps


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


@pytest.mark.parametrize("name", ["plain", "compressed", "ct.mgh", "ct.nii"])
def test_steps_rise_while_a_library_is_imported(tmp_path, save_slice, name):
    """In a process of its own, where none has been imported."""
    path = tmp_path / name if "." in name else tmp_path
    if path != tmp_path:
        kind = nibabel.MGHImage if name == "ct.mgh" else nibabel.Nifti1Image
        nibabel.save(kind(np.zeros((3, 4, 5), np.int16), np.eye(4)), path)
    for z in range(3 if path == tmp_path else 0):
        compress = uid.RLELossless if name == "compressed" else None
        save_slice(tmp_path / f"{z}.dcm", np.zeros((4, 5), np.uint16), (0, 0, z), compress=compress)
    code = (
        "import sys; from ctmc_addon.readers import read_volume_steps\n"
        "seen = list(read_volume_steps(sys.argv[1]))\n"
        "print([step.fraction for step in seen] == sorted(step.fraction for step in seen))\n"
        "print(any('Loading' in step.message for step in seen), 'pydicom' in sys.modules)"
    )
    root = Path(readers.__file__).parents[2]
    ran = subprocess.run(
        [sys.executable, "-c", code, str(path)], cwd=root, capture_output=True, text=True, check=False, timeout=100
    )
    assert ran.stdout.split() == ["True", "True", "True"], ran.stderr


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


@pytest.mark.parametrize("threads", [1, 3])
def test_batches_are_quiet_and_leave_filters_and_threads_alone_between_steps(threads):
    def noisy(number):
        warnings.warn("from a library", stacklevel=1)
        return number * number

    filters, before = list(warnings.filters), threading.active_count()
    seen = []

    def look(step):
        seen.append(step.fraction)
        assert warnings.filters == filters
        assert threading.active_count() == before

    assert finish(quiet_batches_steps(noisy, range(10), "Squaring", 4, threads), look) == [n * n for n in range(10)]
    assert seen == [0.4, 0.8, 1.0]


def test_the_error_of_the_earliest_item_is_raised():
    def work(number):
        raise ReadError(f"slice {number}")

    with pytest.raises(ReadError, match="slice 0"):
        finish(quiet_batches_steps(work, range(8), "Working", 8, 3))
