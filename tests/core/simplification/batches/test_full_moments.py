# SPDX-License-Identifier: GPL-3.0-or-later
"""Removed components count with the volume that they enclose in the full surface, however often they are simplified."""

import numpy as np
import pytest
from meshes import as_mesh, component_of_face, icosphere, joined, layered

from ctmc_addon.core import Budget, finish, marching_cubes
from ctmc_addon.core.mesh import surface_distance
from ctmc_addon.core.mesh.measures import component_moments_steps, component_volumes_steps, volumes_of_moments
from ctmc_addon.core.simplification.batches.full_moments import FullMoments
from ctmc_addon.core.simplification.simplify import simplification_steps

SHARE = icosphere(1).volume  # of a ball whose radius is 1


def balls(count=240):
    """Balls and cavities, each of a radius of its own, at a large ball's surface; also their middles and volumes."""
    up, turn = 1 - (2 * np.arange(count) + 1) / count, np.arange(count) * np.pi * (3 - 5**0.5)
    way = np.stack([np.sqrt(1 - up**2) * np.cos(turn), np.sqrt(1 - up**2) * np.sin(turn), up], axis=1)
    middles = np.where(np.arange(count) % 20, 23.5, 20.5)[:, None] * way
    radii = np.linspace(0.3, 0.6, count)
    small = [icosphere(1, radius, middle) for radius, middle in zip(radii, middles, strict=True)]
    small[::20] = [as_mesh(ball.vertices, ball.faces[:, ::-1]) for ball in small[::20]]  # cavities
    return layered(joined(icosphere(4, 22.0), *small)), middles, SHARE * radii**3


FACES = (1 << 20, 12000, 3000)
BOUND = pytest.param({"max_error": 2.5}, 12000, marks=pytest.mark.once)


@pytest.mark.parametrize(
    ("goal", "whole_faces"),
    [({"reduction": 0.96}, faces) for faces in FACES[:2]]
    + [pytest.param({"reduction": 0.96}, FACES[2], marks=pytest.mark.once)]
    + [pytest.param({"reduction": 0.99}, faces, marks=pytest.mark.once) for faces in FACES]
    + [BOUND],
)
def test_removed_balls_count_with_their_exact_volume_in_one_batch_and_in_many(goal, whole_faces):
    mesh, middles, volumes = balls()
    result = finish(simplification_steps(mesh, **goal, budget=Budget(whole_faces=whole_faces)))
    corners, component = result.mesh.vertices[result.mesh.faces], component_of_face(result.mesh)
    found = np.array([corners[component == number].mean(axis=(0, 1)) for number in range(result.mesh.components)])
    away = np.linalg.norm(found[:, None] - middles, axis=2)
    left = away.argmin(axis=1)[away.min(axis=1) < 0.6]
    lost = np.delete(volumes, left)
    assert len(left) == len(found) - 1  # besides the large ball
    assert result.collapsed.count == len(lost) > 20
    assert result.collapsed.volume == pytest.approx(lost.sum(), rel=1e-5)
    assert result.collapsed.largest == pytest.approx(lost.max(), rel=1e-4)
    distance = surface_distance(result.mesh, mesh)
    assert distance.lost.count == result.collapsed.count
    assert distance.lost.volume == pytest.approx(result.collapsed.volume, rel=1e-9)


@pytest.mark.once
@pytest.mark.parametrize("close_border", [True, False])
def test_open_components_and_cavities_of_noise_count_with_the_volume_that_the_full_surface_has(close_border):
    values = np.random.default_rng(0).normal(size=(20, 20, 20)).astype(np.float32)
    for axis in range(3):
        values = (values + np.roll(values, 1, axis)) / 2
    mesh = marching_cubes(values, 0.45, close_border=close_border)
    result = finish(simplification_steps(mesh, reduction=0.9, budget=Budget(threads=1, whole_faces=2000)))
    lost = surface_distance(result.mesh, mesh).lost
    assert result.collapsed.count == lost.count > 50
    assert result.collapsed.volume == pytest.approx(lost.volume, rel=1e-9)


def test_moments_of_a_cut_component_add_up_to_its_volume_open_and_closed():
    ball = icosphere(3, 0.5, (300.0, -200.0, 100.0))
    for mesh in (ball, as_mesh(ball.vertices, ball.faces[ball.vertices[ball.faces, 2].mean(axis=1) < 100.2])):
        one = np.zeros(len(mesh.faces), np.int32)
        expected = finish(component_volumes_steps(mesh.vertices, mesh.faces, one))
        parts = np.random.default_rng(0).integers(0, 7, len(mesh.faces)).astype(np.int32)
        moments = finish(component_moments_steps(mesh.vertices, mesh.faces, parts))
        assert volumes_of_moments(moments.sum(axis=0)[None]) == pytest.approx(expected, rel=1e-9)


def test_moments_in_another_unit_are_those_of_the_scaled_mesh():
    mesh = icosphere(2, 3.0, (5.0, 6.0, 7.0))
    one = np.zeros(len(mesh.faces), np.int32)
    here = finish(component_moments_steps(mesh.vertices, mesh.faces, one))
    there = finish(component_moments_steps(mesh.vertices * np.float32(0.25), mesh.faces, one))
    np.testing.assert_array_equal(FullMoments(np.zeros(1, np.int64), here).scaled(0.25), there)
