# SPDX-License-Identifier: GPL-3.0-or-later
"""The field between two labels: signs kept where they are known, a bulge kept where smoothing would flatten it."""

import numpy as np
import pytest

from ctmc_addon.core import Budget
from ctmc_addon.core.progress import finish
from ctmc_addon.core.smoothing.between_labels import between_labels_steps


def bulge(slices=9, rows=40, columns=48, steps=1):
    """A wall across x that bulges by three pixels; its field in pixels, and the signs at the samples."""
    _, y, x = np.meshgrid(
        *(np.arange(n, dtype=np.float64) for n in ((slices - 1) * steps + 1, rows, columns)), indexing="ij"
    )
    field = (x - columns / 2 - 3 * np.cos(2 * np.pi * y / rows)).astype(np.float32)
    return field, np.sign(field[::steps]).astype(np.int8)


@pytest.mark.parametrize("steps", [1, 2, 4])
@pytest.mark.parametrize("threads", [1, 2])
def test_known_signs_are_kept_and_threads_change_nothing(steps, threads):
    field, sign = bulge(steps=steps)
    noise = np.random.default_rng(1).normal(0, 0.8, field.shape).astype(np.float32)
    sign[:, :8] = 0
    (smooth,) = finish(between_labels_steps([(field + noise, sign)], (1.0, 1.0, 2.0), steps, Budget(threads=threads)))
    assert smooth.shape == field.shape
    assert (smooth[::steps] * sign)[sign != 0].min() > 0
    # The wall moves back towards where it was before the noise.
    near = np.abs(field) < 0.5
    near[:, :8] = False  # what is far beyond both is left as it is
    assert np.abs(smooth - field)[near].mean() < 0.5 * np.abs(noise)[near].mean()
    (again,) = finish(between_labels_steps([(field + noise, sign)], (1.0, 1.0, 2.0), steps, Budget(threads=1)))
    assert smooth.tobytes() == again.tobytes()


def test_a_bulge_is_not_flattened_and_the_wall_not_bent_where_it_ends():
    """The start is the bulge made flat by a third, and bent where one label ends."""
    field, sign = bulge()
    y = np.arange(40, dtype=np.float32)[:, None]
    start = field + np.cos(2 * np.pi * y / 40) + np.maximum(y - 28, 0) / 4
    sign[:, 32:] = 0
    (smooth,) = finish(between_labels_steps([(start.copy(), sign)], (1.0, 1.0, 1.0), 1, Budget(threads=1)))
    for rows in (slice(0, 28), slice(28, 32)):
        near = np.abs(field[:, rows]) < 0.5
        assert np.abs(start - field)[:, rows][near].mean() > 0.4
        assert np.abs(smooth - field)[:, rows][near].mean() < 0.2


def test_a_field_without_a_wall_is_left_as_it_is():
    field = np.full((3, 6, 9), 2.0, np.float32)
    (smooth,) = finish(
        between_labels_steps([(field, np.ones(field.shape, np.int8))], (1.0, 1.0, 1.0), 1, Budget(threads=1))
    )
    assert np.array_equal(smooth, field)


@pytest.mark.parametrize("spacing", [(1.0, 1.0, 1.0), (1.0, 1.0, 5.0)])
def test_walls_smoothed_together_are_those_smoothed_alone(spacing):
    """Of several shapes, one of them without a wall; the last has the same end of a grid as the first."""
    rng = np.random.default_rng(4)
    steps = 1 if spacing[2] == 1.0 else 3
    walls = []
    for slices, rows, columns in ((7, 20, 30), (5, 11, 16), (9, 24, 21), (7, 20, 30)):
        field, sign = bulge(slices, rows, columns, steps)
        field += rng.normal(0, 0.8, field.shape).astype(np.float32)
        walls.append((field, sign if slices != 5 else np.ones_like(sign)))
    before = [field.copy() for field, _ in walls]
    together = finish(between_labels_steps(walls, spacing, steps, Budget(threads=1)))
    for (field, sign), start, smooth in zip(walls, before, together, strict=True):
        (alone,) = finish(between_labels_steps([(start, sign)], spacing, steps, Budget(threads=1)))
        assert np.array_equal(field, start)
        assert smooth.tobytes() == alone.tobytes()
    assert together[1].tobytes() == before[1].tobytes()
