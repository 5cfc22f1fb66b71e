# SPDX-License-Identifier: GPL-3.0-or-later
"""The preview: coarse within a budget, finer later, at the true place, none where there is no surface."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from ctmc_addon.core import ReconstructionSettings, Volume, finish, preview, reconstruct, smoothing_of
from ctmc_addon.core.preview import Preview, strides, subsample


@pytest.fixture(scope="module")
def ball():
    """A ball of 20 mm about (5, -7, 11) mm at 100 and above, on a mirrored grid; in it a ball of label 3."""
    affine = np.array([[-1.0, 0, 0, 40.0], [0, 1.0, 0, -40.0], [0, 0, 2.0, -30.0], [0, 0, 0, 1]])
    z, y, x = np.ogrid[:40, :70, :70]
    away = np.sqrt((40.0 - x - 5) ** 2 + (y - 40.0 + 7) ** 2 + (2.0 * z - 30 - 11) ** 2)
    return Volume((300 - 10 * away).astype(np.int16), affine), Volume((away < 4).astype(np.uint8) * 3, affine)


@pytest.mark.parametrize("budget", [1e-9, 1e-3, 10.0])
def test_the_surface_is_at_its_true_place_whatever_the_stride(ball, budget):
    shown = Preview(ball[0], budget).interactive(ReconstructionSettings(threshold=100.0))
    away = np.sqrt(((shown.surface.linear - [5.0, -7.0, 11.0]) ** 2).sum(axis=1))
    assert away.mean() == pytest.approx(20.0, abs=0.15 * max(shown.stride))
    assert (shown.stride == (1, 1, 1)) == (budget == 10.0)


def test_faces_point_outwards_in_the_patient(ball):
    shown = Preview(ball[0], 1e-9).interactive(ReconstructionSettings(threshold=100.0))
    assert shown.surface.at(1.0).volume > 0


def test_the_pace_is_learnt_from_the_last_surface(ball, monkeypatch):
    def half_second_steps(steps):
        return (yield from steps), 0.5

    monkeypatch.setattr(preview, "timed_steps", half_second_steps)
    quick = Preview(ball[0], 0.3)
    monkeypatch.setattr(type(smoothing_of(ReconstructionSettings())), "voxel_seconds", 0.0)
    settings = ReconstructionSettings(threshold=100.0)
    assert quick.interactive(settings).stride == (1, 1, 1)
    coarse = [quick.interactive(settings).stride for _ in range(3)]
    assert np.prod(coarse[0]) > 1
    assert np.prod(coarse[2]) > np.prod(coarse[0])


def test_refining_is_finer_and_can_be_stopped(ball):
    quick = Preview(ball[0], 1e-9)
    settings = ReconstructionSettings(threshold=100.0)
    coarse = quick.interactive(settings)
    quick.budget = 1.0
    steps = quick.refine_steps(settings)
    next(steps)
    steps.close()
    assert len(finish(quick.refine_steps(settings)).surface.faces) > len(coarse.surface.faces)


def test_a_small_label_is_found_by_going_finer(ball):
    shown = Preview(ball[1], 1e-9).interactive(ReconstructionSettings(label=3, smoothing_mm=0.5))
    assert len(shown.surface.faces) > 0
    assert Preview(ball[1], 1e-9).interactive(ReconstructionSettings(label=9)) is None


def test_there_is_none_at_a_threshold_without_surface(ball):
    assert Preview(ball[0]).interactive(ReconstructionSettings(threshold=5000.0)) is None


def test_a_region_is_kept_to(ball):
    settings = ReconstructionSettings(threshold=100.0, region=(0.0, -30.0, 0.0, 40.0, 30.0, 40.0), region_unit="mm")
    shown = Preview(ball[0], 1e-9).interactive(settings)
    assert shown.surface.linear[:, 0].min() >= -1.0


def test_strides_begin_with_the_settings_own_and_even_the_sides_out(ball):
    ladder = strides(ball[0], (3, 1, 1), (70, 70, 40))
    assert ladder[0] == (3, 1, 1)
    assert ladder[1] == (3, 2, 1)
    assert all(np.prod(after) == 2 * np.prod(before) for before, after in pairwise(ladder))


def test_a_subsampled_volume_has_its_samples_at_their_places(ball):
    from ctmc_addon.core.volume.affine import transform_points

    box = ((4, 60), (6, 50), (3, 33))
    small = subsample(ball[0], (2, 3, 2), box)
    assert small.values[5, 7, 9] == ball[0].values[3 + 10, 6 + 21, 4 + 18]
    place = transform_points(small.affine, np.array([[9, 7, 5]]))
    assert place == pytest.approx(transform_points(ball[0].affine, np.array([[22, 27, 13]])))


@pytest.mark.parametrize(
    ("stride", "slice_steps", "region"),
    [((1, 1, 1), 0, None), ((1, 1, 1), 1, None), ((1, 1, 2), 4, None), ((2, 1, 2), 0, (5, 5, 3, 20, 30, 9))],
)
def test_the_finest_preview_of_a_constrained_label_is_the_reconstruction(stride, slice_steps, region):
    z, y, x = np.indices((14, 40, 40)).astype(float)
    inside = ((z - 6.5) * 5 / 24) ** 2 + ((y - 19.2) * 0.9 / 14) ** 2 + ((x - 20.3) * 0.9 / 12) ** 2 < 1
    volume = Volume(inside.astype(np.uint8), np.diag([0.9, 0.9, 5.0, 1.0]), kind="label")
    settings = ReconstructionSettings(label=1, stride=stride, slice_steps=slice_steps, region=region)
    surface = finish(Preview(volume, 10.0).refine_steps(settings)).surface
    mesh = reconstruct(volume, settings).mesh
    assert np.array_equal(surface.faces, mesh.faces)
    assert np.array_equal(surface.at(1.0).vertices, mesh.vertices)


def test_steps_between_slices_are_given_up_before_samples(ball):
    settings = ReconstructionSettings(label=3, slice_steps=8, stride=(2, 1, 2))
    ladder = preview.rungs(ball[1], settings, (70, 70, 40))
    assert [tuple(rung)[:2] for rung in ladder[:4]] == [((2, 1, 2), 8), ((2, 1, 1), 4), ((2, 1, 1), 2), ((2, 1, 1), 1)]
    assert all(rung.slice_steps == 1 for rung in ladder[4:])
    counts = [preview.voxel_count(rung, ((0, 70), (0, 70), (0, 40))) for rung in ladder]
    assert counts == sorted(counts, reverse=True)
