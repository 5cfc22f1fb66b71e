# SPDX-License-Identifier: GPL-3.0-or-later
"""The field: a label in its box, NaN replaced or refused where it matters, values shared where they can be."""

import numpy as np
import pytest
from volumes import gaussian_smoothed, in_file

from ctmc_addon.core import ReconstructionSettings, Volume, finish, marching_cubes, reconstruct
from ctmc_addon.core.errors import VolumeError
from ctmc_addon.core.smoothing.prepare import field_steps
from ctmc_addon.core.volume.field import held_steps


def ball(size=(40, 36, 30), radius=9.0, spacing=(1.0, 1.0, 1.0), where=0.5):
    """Distance to a sphere in mm, positive inside; (slices, rows, columns)."""
    x, y, z = (np.arange(n) * step for n, step in zip(size, spacing, strict=True))
    cx, cy, cz = (where * (n - 1) * step for n, step in zip(size, spacing, strict=True))
    distance = np.sqrt((z[:, None, None] - cz) ** 2 + (y[:, None] - cy) ** 2 + (x - cx) ** 2)
    return (radius - distance).astype(np.float32)


def values_of(field):
    """All values of a field, (slices, rows, columns)."""
    return finish(field.values.again().slices_steps(range(field.values.shape[0])))


def test_gray_values_are_seen_and_not_copied():
    volume = Volume(ball(), np.eye(4))
    settings = ReconstructionSettings(threshold=0.0, region=(4, 5, 6, 20, 25, 22))
    field = finish(field_steps(volume, settings))
    assert field.values.held
    assert np.shares_memory(values_of(field), volume.values)
    assert not finish(field_steps(in_file(volume), settings)).values.held
    assert field.window == ((4, 21), (5, 26), (6, 23))
    assert field.origin == (3, 4, 5)  # normals look one voxel beyond
    assert field.window_in_values == ((1, 18), (1, 22), (1, 18))


def test_a_label_is_sought_in_its_own_box_on_the_grid_of_the_stride():
    values = np.zeros((30, 30, 30), np.uint8)
    values[10:15, 11:16, 12:17] = 7
    settings = ReconstructionSettings(label=7, stride=(2, 2, 3), smoothing="none")
    field = finish(field_steps(Volume(values, np.eye(4)), settings))
    assert field.threshold == 0.5
    assert field.window == ((10, 19), (10, 17), (9, 16))
    assert values_of(field).sum() == 125


def test_a_smoothed_label_is_the_same_in_its_box_as_in_the_whole_volume():
    labels = np.where(ball((60, 50, 40), 7.0) > 0, 2, 0).astype(np.uint8)
    labels[:3, :3, :3] = 1
    settings = ReconstructionSettings(label=2, smoothing_mm=1.2, stride=(3, 2, 1), alpha=0.7)
    result = reconstruct(Volume(labels, np.eye(4), kind="label"), settings)
    whole = gaussian_smoothed(labels == 2, (1.0, 1.0, 1.0), 1.2)
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


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize(
    ("shift", "close", "is_open"), [(-1, False, True), (1, False, True), (-1, True, False), (0, False, False)]
)
def test_the_note_says_what_a_label_encloses_only_where_its_surface_is_closed(axis, shift, close, is_open):
    labels = (ball() > 0).astype(np.uint8)
    cut = [slice(None)] * 3  # through the ball's middle, at the end of the volume that `shift` names
    middle = labels.shape[axis] // 2
    cut[axis] = {-1: slice(middle, None), 0: slice(None), 1: slice(None, middle)}[shift]
    volume = Volume(labels[tuple(cut)], np.eye(4), kind="label")
    result = reconstruct(volume, ReconstructionSettings(label=1, close_border=close))
    assert result.measures.closed is not is_open
    words = "Smoothed label, closed at the border: " if is_open else "Smoothed label: "
    assert result.notes[0].startswith(words)


SOURCES = [
    {"threshold": 0.0},
    {"threshold": 0.0, "nan_as": -1.0},
    {"threshold": 0.0, "smoothing_mm": 1.2, "region": (4, 5, 6, 30, 25, 22)},
    {"label": 2, "smoothing": "none"},
    {"label": 2, "smoothing": "gaussian", "smoothing_mm": 1.2},
    {"label": 2, "smoothing": "constrained"},
]


@pytest.mark.parametrize("source", SOURCES)
@pytest.mark.parametrize("step", [1, 3, 7])
def test_values_come_in_any_portions_and_again_from_the_first_slice(source, step):
    values = np.where(ball() > 0, 2, 0).astype(np.uint8) if "label" in source else ball()
    volume = Volume(values, np.eye(4), kind="label" if "label" in source else "gray value")
    settings = ReconstructionSettings(**source)
    expected = values_of(finish(held_steps(finish(field_steps(volume, settings)))))
    field = finish(field_steps(in_file(volume), settings))
    count = field.values.shape[0]
    assert expected.shape == field.values.shape
    for each in (field, field.again()):
        portions = [
            finish(each.values.slices_steps(range(first, min(first + step, count)))) for first in range(0, count, step)
        ]
        assert np.concatenate(portions).tobytes() == expected.tobytes()
    some = [*range(0, count, 4)]
    assert finish(field.again().values.slices_steps(some)).tobytes() == expected[some].tobytes()


def test_samples_on_the_wrong_side_are_counted_once_however_they_come():
    mask = np.where(ball() > 0, 2, 0).astype(np.uint8)
    mask[4:9, 4:9, 4:9] = 2  # a small cube, whose corners a Gaussian rounds off
    settings = ReconstructionSettings(label=2, smoothing="gaussian", smoothing_mm=1.2)
    smooth = gaussian_smoothed(mask == 2, (1.0, 1.0, 1.0), 1.2)
    expected = int(((smooth >= 0.5) != (mask == 2)).sum())
    assert expected > 0
    for step in (1, 4, 100):
        field = finish(field_steps(in_file(Volume(mask, np.eye(4))), settings))
        count = field.values.shape[0]
        for first in range(0, count, step):
            low = max(0, first - 2)  # slices that two slabs share are fetched again
            finish(field.values.slices_steps(range(low, min(first + step, count))))
        assert field.wrong_side == expected
        assert field.again().wrong_side == 0


@pytest.mark.parametrize(("is_hole", "volume"), [(False, 207.448), (True, 3725.878)])
def test_replaced_nan_counts_where_a_closed_border_alone_would_be_refused(is_hole, volume):
    finite = (ball((16, 16, 16), 4.0) > 0) != is_hole
    values = np.where(finite, np.float32(100), np.float32(np.nan))
    settings = ReconstructionSettings(threshold=50, nan_as=-1000, close_border=True)
    result = reconstruct(Volume(values, np.eye(4)), settings)
    filled = reconstruct(Volume(np.where(finite, 100, -1000), np.eye(4)), settings)
    assert result.mesh.volume == filled.mesh.volume == pytest.approx(volume, abs=0.01)


def test_a_field_says_which_of_its_values_are_its_own():
    gray, labels = Volume(ball() > 0, np.eye(4)), Volume((ball() > 0).astype(np.float32), np.eye(4), kind="label")
    assert finish(field_steps(gray, ReconstructionSettings(threshold=0.5))).values.own_bytes == 0
    for smoothing, bytes_each in (("none", 1), ("constrained", 4)):
        field = finish(field_steps(labels, ReconstructionSettings(label=1, smoothing=smoothing)))
        assert field.values.own_bytes == bytes_each * np.prod(field.values.shape)
