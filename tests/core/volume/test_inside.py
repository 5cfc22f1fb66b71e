# SPDX-License-Identifier: GPL-3.0-or-later
import numpy as np
import pytest

from ctmc_addon.core.errors import LabelError
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
    with pytest.raises(LabelError, match=r"0\.5 mm apart"):
        finish(inside_values_steps(Volume(values, moved), labels, 1))
    with pytest.raises(LabelError, match="5 x 4 x 2 voxels and its labels have 5 x 4 x 3"):
        finish(inside_values_steps(Volume(values[:2], np.eye(4)), labels, 1))
