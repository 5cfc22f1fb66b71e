# SPDX-License-Identifier: GPL-3.0-or-later
"""Masks painted into layers: each is whole, in as few layers as its overlaps need, in any order."""

from __future__ import annotations

from itertools import combinations, permutations

import numpy as np
import pytest

from ctmc_addon.core import CtmcError
from ctmc_addon.readers.labels.label_map import LabelMap

NAMES = {1: "body", 2: "liver", 3: "tumor"}


def test_any_order_gives_the_same_layers_with_every_mask_whole():
    random = np.random.default_rng(2)
    masks = {label: random.random((6, 7)) < 0.5 for label in NAMES}
    shared = {(first, second): int((masks[first] & masks[second]).sum()) for first, second in combinations(NAMES, 2)}
    for order in permutations(NAMES):
        label_map = LabelMap((2, 6, 7), NAMES, {}, "test")
        for label in order:
            label_map.paint(1, masks[label][:, :3], label)  # in two windows
            label_map.paint(1, masks[label][:, 3:], label, 0, 3)
        layers = label_map.layers()
        assert len(layers) == 3  # each overlaps both of the others
        for label, layer in zip(NAMES, layers, strict=True):
            np.testing.assert_array_equal(layer[1], np.where(masks[label], label, 0))
            assert not layer[0].any()
        assert label_map.overlaps == shared


def test_what_does_not_overlap_shares_a_layer_and_a_label_takes_the_first_that_is_free():
    body, liver, tumor = (np.zeros((4, 8), bool) for _ in range(3))
    body[:, :6], liver[:, 6:], tumor[1, 4:7] = True, True, True
    label_map = LabelMap((2, 4, 8), NAMES, {}, "test")
    for label, mask in ((3, tumor), (1, body), (2, liver)):
        label_map.paint(0, mask, label)
    first, second = label_map.layers()
    assert first[0].tolist() == [[1] * 6 + [2] * 2] * 4
    assert second[0].tolist() == np.where(tumor, 3, 0).tolist()
    assert label_map.overlap_note("masks") == [
        "masks overlap and each is kept whole; they share body and tumor 2, liver and tumor 1 voxels"
    ]


def test_many_labels_take_two_bytes_and_too_many_are_refused():
    assert LabelMap((2, 2, 2), {255: "a"}, {}, "test").layers()[0].dtype == np.uint8
    assert LabelMap((2, 2, 2), {256: "a"}, {}, "test").layers()[0].dtype == np.uint16
    with pytest.raises(CtmcError, match="test has the label 65536, and labels up to 65535 are read"):
        LabelMap((2, 2, 2), {65536: "a"}, {}, "test")


def test_notes_name_a_few_and_count_the_rest():
    names = {label: f"organ {label}" for label in range(1, 21)}
    label_map = LabelMap((2, 2, 2), names, {}, "test")
    (note,) = label_map.empty_note("masks")
    assert note.startswith("20 of 20 masks are empty: organ 1, organ 2, ")
    assert note.endswith("organ 8 and 12 more")
    assert label_map.overlap_note("masks") == []
