# SPDX-License-Identifier: GPL-3.0-or-later
import itertools

import numpy as np
import pytest

from ctmc_addon.core.errors import LabelError, VolumeError
from ctmc_addon.core.progress import finish
from ctmc_addon.core.volume import Volume, inside_values_steps


def test_mean_and_deviation_are_those_of_the_samples_with_the_label():
    random = np.random.default_rng(3)
    values = random.integers(-1000, 2000, (40, 9, 11)).astype(np.int16)
    labels = random.integers(0, 3, values.shape).astype(np.uint8)
    labels[:20] = 0  # the label's box is smaller than the volume
    affine = np.diag([0.7, 0.7, 2.0, 1.0])
    inside = finish(inside_values_steps(Volume(values, affine), Volume(labels, affine, kind="label"), 2))
    chosen = values[labels == 2].astype(float)
    assert inside.samples == len(chosen)
    assert inside.mean == pytest.approx(chosen.mean(), rel=1e-12)
    assert inside.deviation == pytest.approx(chosen.std(), rel=1e-12)


def test_an_empty_label_has_no_values_and_another_place_is_refused():
    values = np.zeros((3, 4, 5), np.int16)
    labels = Volume(np.ones((3, 4, 5), np.uint8), np.eye(4), kind="label")
    assert finish(inside_values_steps(Volume(values, np.eye(4)), labels, 7)) is None
    moved = np.eye(4)
    moved[0, 3] = 0.5
    with pytest.raises(VolumeError, match=r"has samples up to 0\.5 mm away from those of the CT"):
        finish(inside_values_steps(Volume(values, moved), labels, 1))
    with pytest.raises(LabelError, match="label 1 of volume extends beyond volume"):
        finish(inside_values_steps(Volume(values[:2], np.eye(4)), labels, 1))


@pytest.mark.parametrize("axes", list(itertools.permutations(range(3))))
@pytest.mark.parametrize("signs", list(itertools.product((1, -1), repeat=3)))
def test_labels_may_have_their_axes_in_any_order_and_cover_a_part(axes, signs):
    random = np.random.default_rng(4)
    values = random.integers(-1000, 2000, (19, 7, 8)).astype(np.int16)
    labels = np.zeros(values.shape, np.uint8)
    labels[2:18, 1:6, 3:8] = random.integers(0, 3, (16, 5, 5))
    affine = np.array([[0.7, 0.1, 0, 5], [-0.1, 0.7, 0, -9], [0, 0, 2.0, 40], [0, 0, 0, 1]])
    # The labels' index (i, j, k) is a sample of the CT: x, y, z = first + turn @ (i, j, k).
    part = labels[1:19, 1:6, 2:8].T  # x, y, z
    turn = np.zeros((3, 3))
    turn[axes, range(3)] = signs
    first = np.array((2, 1, 1)) + (np.array(part.shape) - 1) * (turn.sum(axis=1) < 0)
    of_index = np.eye(4)
    of_index[:3, :3], of_index[:3, 3] = turn, first
    turned = part.transpose(axes)[tuple(slice(None, None, sign) for sign in signs)].T
    inside = finish(inside_values_steps(Volume(values, affine), Volume(turned, affine @ of_index, kind="label"), 2))
    chosen = values[labels == 2].astype(float)
    assert inside.samples == len(chosen)
    assert inside.mean == pytest.approx(chosen.mean(), rel=1e-12)
    assert inside.deviation == pytest.approx(chosen.std(), rel=1e-12)
