# SPDX-License-Identifier: GPL-3.0-or-later
"""Speed without a clock: how often the work calls, and how many bytes it holds and hands on.

The numbers hang on the code alone, so a change that asks for more work fails here on any machine. Where more work is
meant, print the new numbers with `pytest -s tests/core/test_counted_work.py` and put them into the table.
"""

from __future__ import annotations

import sys
import tracemalloc
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from shapes import distance_mm
from volumes import waves

import ctmc_addon
from ctmc_addon.core import Budget, ReconstructionSettings, Volume, reconstruct, reconstruct_labels

pytestmark = pytest.mark.once

OURS = str(Path(ctmc_addon.__file__).parent)
NEAR = 0.05  # Versions of NumPy and Python differ a little.
NUMPY_NEAR = 0.25  # They differ more in the functions that NumPy itself calls.
ONE_THREAD = Budget(threads=1, bytes=4 << 30)
THICK = np.diag([0.75, 0.75, 3.0, 1.0])


class Work(NamedTuple):
    """What a piece of work took.

    Parameters
    ----------
    calls : int
        Of functions of this package, each resumption of a generator too.
    array_calls : int
        Of functions in C by those, which are NumPy's for the most part.
    returned_bytes : int
        Bytes of the arrays that functions of this package returned.
    peak_bytes : int
        Bytes that were allocated at most.
    """

    calls: int
    array_calls: int
    returned_bytes: int
    peak_bytes: int


def nested_bytes(value):
    """Bytes of an array, or of those in a tuple or list."""
    if isinstance(value, (tuple, list)):
        return sum(map(nested_bytes, value))
    return value.nbytes if isinstance(value, np.ndarray) else 0


def work_of(run):
    """Run twice, because the first time fills caches, and count the second time."""
    run()
    calls = array_calls = returned = 0

    def count(frame, event, argument):
        nonlocal calls, array_calls, returned
        code = frame.f_code
        if not code.co_filename.startswith(OURS) or code.co_name.startswith("<"):  # 3.12 calls no comprehension
            return
        if event == "call":
            calls += 1
        elif event == "c_call":
            array_calls += 1
        elif event == "return":
            returned += nested_bytes(argument)

    before = sys.getprofile()
    sys.setprofile(count)
    try:
        run()
    finally:
        sys.setprofile(before)
    tracemalloc.start()
    try:
        run()
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    return Work(calls, array_calls, returned, peak)


def field(shape=(23, 21, 70), **chosen):
    """Make a surface with many components."""
    volume = Volume(waves(shape), THICK)
    return lambda: reconstruct(volume, ReconstructionSettings(threshold=0.0, **chosen), ONE_THREAD)


def labels(smoothing, **chosen):
    """Make surfaces of a ball of two labels."""
    values = (distance_mm((14, 48, 48), spacing=(0.75, 0.75, 3.0)) < 16).astype(np.uint8)
    values[:, :, 24:] *= 2
    volume = Volume(values, THICK, kind="label")
    return lambda: reconstruct_labels(volume, ReconstructionSettings(smoothing=smoothing, **chosen), budget=ONE_THREAD)


WORK = {
    "extraction": (field(), Work(900, 1_679, 6_790_000, 3_001_000)),
    "trilinear extraction": (field(topology="trilinear"), Work(994, 2_113, 8_594_000, 3_306_000)),
    "Gaussian smoothing": (field(smoothing_mm=1.5), Work(2_353, 1_947, 9_283_000, 1_928_000)),
    "constrained smoothing": (
        labels("constrained", interfaces="separate"),
        Work(10_966, 14_323, 15_850_000, 3_382_000),
    ),
    "shared walls": (labels("none"), Work(3_325, 4_257, 6_983_000, 3_440_000)),
    "simplification": (field((10, 21, 40), reduction=0.8), Work(94_879, 87_532, 63_529_000, 6_278_000)),
    "simplification of shared walls": (labels("none", reduction=0.8), Work(31_107, 35_140, 22_217_000, 3_682_000)),
}


@pytest.mark.parametrize("name", WORK)
def test_the_work_is_what_it_was(name):
    run, expected = WORK[name]
    counted = work_of(run)
    print(f"\n{name}: {counted}")
    for what, number, before in zip(Work._fields, counted, expected, strict=True):
        near = NUMPY_NEAR if what == "array_calls" else NEAR
        assert number <= before * (1 + near), f"{name} takes more {what} than it did"
        assert number >= before * (1 - near), f"{name} takes fewer {what} than it did: note the new number"
