# SPDX-License-Identifier: GPL-3.0-or-later
"""Masks painted into one label volume: the highest rank keeps a voxel in any order, and what is lost is counted."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest

from ctmc_addon.core import CtmcError
from ctmc_addon.readers.labels.label_map import LabelMap

NAMES = {1: "body", 2: "liver", 3: "tumor"}


@pytest.mark.parametrize("ranks", [None, {1: -30.0, 2: -20.0, 3: -10.0}, {1: 5.0, 2: 9.0, 3: -1.0}])
def test_any_order_gives_the_same_labels_and_counts(ranks):
    random = np.random.default_rng(2)
    masks = {label: random.random((6, 7)) < 0.5 for label in NAMES}
    rank = ranks or {label: float(label) for label in NAMES}
    expected = np.zeros((6, 7), np.uint8)
    for label in sorted(NAMES, key=lambda label: rank[label]):
        expected[masks[label]] = label
    lost = [int((masks[label] & (expected != label)).sum()) for label in NAMES]
    for order in permutations(NAMES):
        label_map = LabelMap((2, 6, 7), NAMES, {}, "test", ranks=ranks)
        for label in order:
            label_map.paint(label_map.values[1], masks[label], label)
        np.testing.assert_array_equal(label_map.values[1], expected)
        assert not label_map.values[0].any()
        assert label_map.lost[1:].tolist() == lost


def test_many_labels_take_two_bytes_and_too_many_are_refused():
    assert LabelMap((2, 2, 2), {255: "a"}, {}, "test").values.dtype == np.uint8
    assert LabelMap((2, 2, 2), {256: "a"}, {}, "test").values.dtype == np.uint16
    with pytest.raises(CtmcError, match="test has the label 65536, and labels up to 65535 are read"):
        LabelMap((2, 2, 2), {65536: "a"}, {}, "test")


def test_notes_name_a_few_and_count_the_rest():
    names = {label: f"organ {label}" for label in range(1, 21)}
    label_map = LabelMap((2, 2, 2), names, {}, "test")
    (note,) = label_map.empty_note("masks")
    assert note.startswith("20 of 20 masks are empty: organ 1, organ 2, ")
    assert note.endswith("organ 8 and 12 more")
    assert label_map.overlap_note("masks", "the later") == []
