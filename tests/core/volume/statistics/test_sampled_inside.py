# SPDX-License-Identifier: GPL-3.0-or-later
"""Dose and uptake inside structures, against closed forms and the obvious way."""

import math

import numpy as np
import pytest

from ctmc_addon.core import Volume
from ctmc_addon.core.progress import finish
from ctmc_addon.core.volume import transform_points
from ctmc_addon.core.volume.statistics.sampled_inside import (
    BALL_MM,
    sampled_inside_label_steps,
    sampled_inside_range_steps,
)


def inside_label(volume, labels, label=1, **options):
    return finish(sampled_inside_label_steps(volume, labels, label, **options))


def centers_of(volume, chosen):
    """Return the RAS positions of chosen voxels, (n, 3)."""
    return transform_points(volume.affine, np.argwhere(chosen)[:, ::-1])


def oblique(spacing, origin=(0.0, 0.0, 0.0)):
    a, b = 0.3, -0.5
    turn = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    tilt = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
    affine = np.eye(4)
    affine[:3, :3] = turn @ tilt * spacing
    affine[:3, 3] = origin
    return affine


def ramp_dose(slope=(0.5, 0.0, 0.0), at_zero=30.0, spacing=(2.5, 2.5, 3.0)):
    """Return a linear dose on a grid of its own around the origin."""
    affine = np.diag([-spacing[0], -spacing[1], spacing[2], 1.0])
    affine[:3, 3] = 60.0, 60.0, -60.0
    shape = (41, 49, 49)
    index = np.argwhere(np.ones(shape))[:, ::-1]
    values = at_zero + (transform_points(affine, index) * slope).sum(axis=1)
    return Volume(values.reshape(shape).astype(np.float32), affine, kind="Gy")


def cube_labels(affine, shape=(20, 22, 24), low=3):
    labels = np.zeros(shape, np.uint8)
    labels[low:-low, low:-low, low:-low] = 1
    labels[0, 0, 0] = 2
    return Volume(labels, affine, kind="label")


def test_a_linear_dose_in_a_cube_has_closed_forms():
    affine = np.diag([0.8, 0.8, 1.1, 1.0])
    affine[:3, 3] = -9.0, -9.0, -10.0
    labels = cube_labels(affine)
    inside = inside_label(ramp_dose(), labels, doses=[30.0, 31.0, 99.0])
    columns = np.arange(3, 21) * 0.8 - 9.0  # x of voxel centers, each as often
    doses = np.repeat(30.0 + 0.5 * columns, 16 * 14)
    assert inside.samples == doses.size
    assert inside.beyond == 0
    assert inside.mean == pytest.approx(doses.mean(), abs=1e-5)
    assert inside.deviation == pytest.approx(doses.std(), abs=1e-5)
    assert inside.maximum == pytest.approx(doses.max(), abs=1e-5)
    assert inside.d95 == pytest.approx(np.percentile(doses, 5), abs=1e-5)
    assert (inside.mean, inside.d95) == (pytest.approx(30.1, abs=1e-5), pytest.approx(26.7, abs=1e-4))
    assert inside.percent_at == {dose: pytest.approx(100 * (doses >= dose).mean()) for dose in (30.0, 31.0, 99.0)}
    assert inside.peak is None


@pytest.mark.parametrize("label_spacing", [(1.0, 1.0, 1.0), (0.7, 0.9, 4.0)])
def test_an_oblique_label_grid_is_not_resampled(label_spacing):
    labels = cube_labels(oblique(label_spacing, (-20.0, 5.0, -10.0)))
    dose = ramp_dose((0.5, -0.3, 0.2))
    exact = 30.0 + centers_of(labels, labels.values == 1) @ (0.5, -0.3, 0.2)
    inside = inside_label(dose, labels, doses=[25.0])
    assert inside.samples == len(exact)
    assert inside.mean == pytest.approx(exact.mean(), abs=1e-4)
    assert inside.maximum == pytest.approx(exact.max(), abs=1e-4)
    assert inside.d95 == pytest.approx(np.percentile(exact, 5), abs=1e-4)
    assert inside.percent_at[25.0] == pytest.approx(100 * (exact >= 25.0).mean(), abs=0.1)


def test_at_its_own_samples_a_dose_is_itself_bit_for_bit():
    affine = oblique((1.7, 2.3, 3.1), (-311.7, 95.3, -20.9))
    values = (np.random.default_rng(0).integers(0, 600, (9, 10, 11)) * 0.1).astype(np.float32)
    dose = Volume(values, affine, kind="Gy")
    labels = Volume(np.ones(values.shape, np.uint8), affine, kind="label")
    levels = np.unique(values)[[5, 100, -5]].tolist()
    inside = inside_label(dose, labels, doses=levels)
    assert inside.maximum == values.max()
    assert inside.percent_at == {level: 100 * (values >= np.float32(level)).sum() / values.size for level in levels}


def test_voxels_beyond_the_dose_do_not_count_and_are_counted():
    affine = np.diag([1.0, 1.0, 1.0, 1.0])
    affine[0, 3] = 50.0  # of columns 0 to 10 the dose has a value
    labels = Volume(np.ones((4, 4, 20), np.uint8), affine, kind="label")
    inside = inside_label(ramp_dose(), labels)
    assert (inside.samples, inside.beyond) == (16 * 11, 16 * 9)
    assert inside.mean == pytest.approx(30 + 0.5 * 55.0, abs=1e-4)
    affine[0, 3] = 500.0
    far = inside_label(ramp_dose(), Volume(labels.values, affine, kind="label"), doses=[20.0])
    assert (far.samples, far.beyond, far.mean, far.d95, far.percent_at) == (0, 320, None, None, {20.0: None})


def test_a_label_without_a_voxel_has_no_values():
    labels = cube_labels(np.eye(4))
    assert inside_label(ramp_dose(), labels, 7, doses=[1.0]).percent_at == {1.0: None}


def test_labels_that_overlap_are_measured_each():
    first, second = np.zeros((6, 6, 6), np.uint8), np.zeros((6, 6, 6), np.uint8)
    first[:, :, :4], second[:, :, 2:] = 1, 2
    layers = (Volume(second, np.eye(4)).reader,)
    labels = Volume(first, np.eye(4), kind="label", layers=layers)
    dose = Volume(np.broadcast_to(np.arange(6, dtype=np.float32), (6, 6, 6)).copy(), np.eye(4), kind="Gy")
    assert inside_label(dose, labels, 1).mean == pytest.approx(1.5)
    assert inside_label(dose, labels, 2).mean == pytest.approx(3.5)


def test_a_threshold_is_measured_at_its_own_samples():
    dose = ramp_dose()
    inside = finish(sampled_inside_range_steps(dose, 20.0, 40.0, doses=[30.0]))
    chosen = dose.values[(dose.values >= 20) & (dose.values <= 40)].astype(float)
    assert inside.samples == chosen.size
    assert inside.mean == pytest.approx(chosen.mean(), rel=1e-9)
    assert inside.percent_at[30.0] == pytest.approx(100 * (chosen >= 30).mean())


def peak_the_obvious_way(values, chosen, affine, label_affine=None):
    """Return the highest mean of values within the ball around a chosen voxel, on one grid."""
    everything = transform_points(affine, np.argwhere(np.ones(values.shape))[:, ::-1])
    flat = values.reshape(-1).astype(float)
    best = -math.inf
    for center in transform_points(affine, np.argwhere(chosen)[:, ::-1]):
        near = ((everything - center) ** 2).sum(axis=1) <= BALL_MM**2 * (1 + 1e-6)
        best = max(best, flat[near].mean())
    return best


@pytest.mark.parametrize("affine", [np.diag([3.0, 3.0, 2.0, 1.0]), oblique((2.7, 2.0, 3.3), (5.0, -8.0, 1.0))])
def test_the_peak_is_the_highest_mean_of_any_ball(affine):
    rng = np.random.default_rng(4)
    values = rng.gamma(2.0, 2.0, (19, 21, 23)).astype(np.float32)
    chosen = np.zeros(values.shape, bool)
    chosen[2:18, 1:9, 3:20] = rng.random((16, 8, 17)) < 0.5
    chosen[0, 20, 22] = True  # whose ball reaches beyond the volume
    pet = Volume(values, affine, kind="SUVbw")
    labels = Volume(chosen.astype(np.uint8), affine, kind="label")
    expected = peak_the_obvious_way(values, chosen, affine)
    inside = inside_label(pet, labels)
    assert inside.peak == pytest.approx(expected, rel=1e-6)
    assert inside.maximum == values[chosen].max()
    assert inside.d95 is None
    inner = finish(sampled_inside_range_steps(pet, 6.0))
    assert inner.peak == pytest.approx(peak_the_obvious_way(values, values >= 6.0, affine), rel=1e-6)


def test_the_peak_of_a_cone_of_uptake_is_its_mean_in_the_ball():
    # uptake 10 - 0.5 r has a mean of 10 - 0.5 * 3/4 R in a ball of radius R around its tip
    affine = np.diag([1.0, 1.0, 1.0, 1.0])
    z, y, x = np.meshgrid(*[np.arange(41.0)] * 3, indexing="ij")
    values = 10 - 0.5 * np.sqrt((x - 20) ** 2 + (y - 20) ** 2 + (z - 20) ** 2)
    pet = Volume(values.astype(np.float32), affine, kind="SUVbw")
    fine = np.diag([0.5, 0.5, 0.5, 1.0])
    fine[:3, 3] = 12.0
    labels = Volume(np.ones((33, 33, 33), np.uint8), fine, kind="label")
    assert inside_label(pet, labels).peak == pytest.approx(10 - 0.5 * 0.75 * BALL_MM, abs=0.02)


def test_a_ball_has_a_volume_of_one_cubic_centimeter():
    assert 4 / 3 * math.pi * BALL_MM**3 == pytest.approx(1000.0, rel=1e-12)


def test_a_uniform_uptake_is_its_own_peak_at_every_border():
    pet = Volume(np.full((8, 9, 10), 2.5, np.float32), np.diag([4.0, 4.0, 4.0, 1.0]), kind="SUVbw")
    labels = Volume(np.ones((60, 70, 80), np.uint8), np.diag([0.5, 0.5, 0.5, 1.0]), kind="label")
    inside = inside_label(pet, labels)
    assert (inside.mean, inside.maximum, inside.deviation) == (2.5, 2.5, 0.0)
    assert inside.peak == pytest.approx(2.5, rel=1e-12)
