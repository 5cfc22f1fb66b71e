# SPDX-License-Identifier: GPL-3.0-or-later
"""Volumes: read-only views at their position; broken geometry is refused."""

import pickle

import numpy as np
import pytest

from ctmc_addon.core import Volume
from ctmc_addon.core.errors import VolumeError
from ctmc_addon.core.volume import ValueKind


def random_affine(seed):
    rng = np.random.default_rng(seed)
    affine = np.eye(4)
    affine[:3, :3] = rng.normal(size=(3, 3)) * [0.7, 0.7, 5.0]
    affine[:3, 3] = rng.normal(size=3) * 200
    return affine


def test_spacing_is_the_length_of_the_columns_even_when_tilted():
    affine = np.array([[0.5, 0, 0, 0], [0, 0.6, 3.0, 0], [0, 0, 4.0, 0], [0, 0, 0, 1]])
    volume = Volume(np.zeros((2, 3, 4)), affine)
    assert volume.spacing == pytest.approx((0.5, 0.6, 5.0))
    assert volume.size == (4, 3, 2)


def test_values_are_seen_not_copied_and_cannot_be_written():
    values = np.zeros((3, 4, 5), np.int16)
    volume = Volume(values, np.eye(4))
    assert np.shares_memory(volume.values, values)
    with pytest.raises(ValueError, match="read-only"):
        volume.values[0, 0, 0] = 1
    values[0, 0, 0] = 7  # the caller's own array is still its own
    assert volume.values[0, 0, 0] == 7


def test_a_crop_stays_in_its_place():
    affine = random_affine(1)
    values = np.arange(4 * 5 * 6).reshape(4, 5, 6)
    part = Volume(values, affine, label_colors={3: (1, 2, 3)}).cropped((1, 2, 1), (5, 5, 4))
    assert part.label_colors == {3: (1, 2, 3)}
    assert part.values.shape == (3, 3, 4)
    assert part.values[0, 0, 0] == values[1, 2, 1]
    np.testing.assert_allclose(part.affine[:3, 3], affine[:3, :3] @ [1, 2, 1] + affine[:3, 3])


def test_a_volume_can_be_pickled():
    words = (("a note",), "case 1", "label", {1: "liver"}, {1: (255, 0, 128)})
    volume = Volume(np.arange(8).reshape(2, 2, 2), random_affine(0), *words)
    copy = pickle.loads(pickle.dumps(volume))
    assert (copy.notes, copy.name, copy.kind, copy.label_names, copy.label_colors) == words
    assert copy.values.tobytes() == volume.values.tobytes()
    assert not copy.values.flags.writeable


@pytest.mark.parametrize(
    ("values", "affine", "words"),
    [
        (np.zeros((4, 4)), np.eye(4), "three dimensions"),
        (np.zeros((1, 4, 4)), np.eye(4), "at least 2 samples"),
        (np.zeros((4, 4, 4), complex), np.eye(4), "complex128"),
        (np.zeros((4, 4, 4)), np.eye(3), r"\(4, 4\)"),
        (np.zeros((4, 4, 4)), np.diag([1, np.nan, 1, 1]), "NaN"),
        (np.zeros((4, 4, 4)), np.diag([1, 0, 1, 1.0]), "singular"),
        (np.zeros((4, 4, 4)), np.diag([1, 1, 1, 2.0]), "last row"),
        (np.zeros((4, 4, 4)), [[1, 2, 0, 0], [2, 4, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], "singular"),
    ],
)
def test_what_is_no_volume_is_refused_in_one_sentence(values, affine, words):
    with pytest.raises(VolumeError, match=words):
        Volume(values, affine)


def test_a_kind_is_told_by_its_name_the_older_spelling_too():
    values = np.zeros((2, 2, 2), np.int16)
    for name, kind in (("HU", ValueKind.HU), ("label", ValueKind.LABEL), ("grey value", ValueKind.GRAY)):
        assert Volume(values, np.eye(4), kind=name).kind is kind
    assert Volume(values, np.eye(4)).kind == "gray value"
    with pytest.raises(VolumeError, match="kind is one of HU, SUVbw, Gy, gray value, label, not 'air'"):
        Volume(values, np.eye(4), kind="air")
