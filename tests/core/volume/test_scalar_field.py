# SPDX-License-Identifier: GPL-3.0-or-later
"""The scalar field: a label in its box, NaN replaced or refused where it matters, values shared where they can be."""

import numpy as np
import pytest

from ctmc_addon.core import ReconstructionSettings, Volume, finish, marching_cubes, reconstruct
from ctmc_addon.core.errors import VolumeError
from ctmc_addon.core.volume.scalar_field import scalar_field_steps
from ctmc_addon.core.volume.smoothing import gaussian_smooth_steps


def ball(size=(40, 36, 30), radius=9.0, spacing=(1.0, 1.0, 1.0), where=0.5):
    """Distance to a sphere in mm, positive inside; (slices, rows, columns)."""
    x, y, z = (np.arange(n) * step for n, step in zip(size, spacing, strict=True))
    cx, cy, cz = (where * (n - 1) * step for n, step in zip(size, spacing, strict=True))
    distance = np.sqrt((z[:, None, None] - cz) ** 2 + (y[:, None] - cy) ** 2 + (x - cx) ** 2)
    return (radius - distance).astype(np.float32)


def test_gray_values_are_seen_and_not_copied():
    volume = Volume(ball(), np.eye(4))
    settings = ReconstructionSettings(threshold=0.0, region=(4, 5, 6, 20, 25, 22))
    field = finish(scalar_field_steps(volume, settings))
    assert np.shares_memory(field.values, volume.values)
    assert field.window == ((4, 21), (5, 26), (6, 23))
    assert field.origin == (3, 4, 5)  # normals look one voxel beyond
    assert field.window_in_values == ((1, 18), (1, 22), (1, 18))


def test_a_label_is_sought_in_its_own_box_on_the_grid_of_the_stride():
    values = np.zeros((30, 30, 30), np.uint8)
    values[10:15, 11:16, 12:17] = 7
    field = finish(
        scalar_field_steps(
            Volume(values, np.eye(4)), ReconstructionSettings(label=7, stride=(2, 2, 3), smoothing="none")
        )
    )
    assert field.threshold == 0.5
    assert field.window == ((10, 19), (10, 17), (9, 16))
    assert field.values.sum() == 125


def test_a_smoothed_label_is_the_same_in_its_box_as_in_the_whole_volume():
    labels = np.where(ball((60, 50, 40), 7.0) > 0, 2, 0).astype(np.uint8)
    labels[:3, :3, :3] = 1
    settings = ReconstructionSettings(label=2, smoothing_mm=1.2, stride=(3, 2, 1), alpha=0.7)
    result = reconstruct(Volume(labels, np.eye(4), kind="label"), settings)
    whole = finish(gaussian_smooth_steps(labels == 2, (1.0, 1.0, 1.0), 1.2))
    expected = marching_cubes(whole, 0.5, (3, 2, 1), 0.7)
    order, peer = np.lexsort(result.mesh.vertices.T), np.lexsort(expected.vertices.T)
    np.testing.assert_allclose(result.mesh.vertices[order], expected.vertices[peer], atol=1e-4)
    assert len(result.mesh.faces) == len(expected.faces)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("stride", [2, 3, 4, 8])
def test_a_label_in_the_last_slice_is_found_under_any_stride(axis, stride):
    values = np.zeros((10, 10, 10), np.uint8)
    np.moveaxis(values, axis, 0)[9, 3:8, 3:8] = 1
    strides = tuple(stride if 2 - axis == at else 1 for at in range(3))
    label, gray = (
        reconstruct(Volume(values, np.eye(4)), ReconstructionSettings(**source, stride=strides, close_border=True)).mesh
        for source in ({"label": 1, "smoothing": "none"}, {"threshold": 0.5})
    )
    assert label.closed
    assert len(label.faces) == len(gray.faces)
    assert np.array_equal(label.vertices.min(axis=0), gray.vertices.min(axis=0))
    assert np.array_equal(label.vertices.max(axis=0), gray.vertices.max(axis=0))


def test_nan_is_refused_or_replaced():
    values = ball()
    values[:2] = np.nan
    volume = Volume(values, np.eye(4))
    with pytest.raises(VolumeError, match="2880 voxels are NaN or infinite"):
        reconstruct(volume, ReconstructionSettings(threshold=0.0))
    read = reconstruct(volume, ReconstructionSettings(threshold=0.0, nan_as=-100))
    assert read.mesh.closed


@pytest.mark.parametrize("soften", [0.0, 1.0])
def test_nan_beyond_a_region_is_replaced_where_smoothing_and_normals_reach_it(soften):
    values = ball()
    values[:, :, 28:] = np.nan
    settings = {"threshold": 0.0, "smoothing_mm": soften, "region": (2, 2, 2, 27, 30, 26)}
    replaced = reconstruct(Volume(values, np.eye(4)), ReconstructionSettings(nan_as=-5.0, **settings)).mesh
    filled = np.where(np.isnan(values), np.float32(-5), values)
    same = reconstruct(Volume(filled, np.eye(4)), ReconstructionSettings(**settings)).mesh
    assert np.array_equal(replaced.vertices, same.vertices)
    assert np.array_equal(replaced.normals, same.normals)


def test_nan_beyond_a_region_is_refused_only_where_smoothing_reaches_it():
    values = ball()
    values[:, :, 28:] = np.nan
    settings = {"threshold": 0.0, "region": (2, 2, 2, 27, 30, 26)}
    mesh = reconstruct(Volume(values, np.eye(4)), ReconstructionSettings(**settings)).mesh
    assert np.allclose(np.sqrt((mesh.normals.astype(float) ** 2).sum(axis=1)), 1.0, atol=1e-5)
    with pytest.raises(VolumeError, match="nan_as"):
        reconstruct(Volume(values, np.eye(4)), ReconstructionSettings(smoothing_mm=1.0, **settings))
