# SPDX-License-Identifier: GPL-3.0-or-later
"""What triangles cut off of curved surfaces, against integrals of quadratic fields and volumes of offset balls."""

import numpy as np
import pytest
from meshes import icosphere
from solids import Ball, ball_volume

from ctmc_addon.core import finish
from ctmc_addon.core.machine.budget import Budget
from ctmc_addon.core.solid import Lattice
from ctmc_addon.core.solid.cells.chords import depths_steps, gradients_steps
from ctmc_addon.core.solid.cells.extract import extract_parts_steps
from ctmc_addon.core.solid.cells.recipe import Recipe
from ctmc_addon.core.solid.fields.lattice_fields import HeldField
from ctmc_addon.core.solid.rule import PartRule

OBLIQUE = np.array([[0.7, -0.2, 0.3, 5], [0.1, 0.8, -0.4, -9], [-0.2, 0.3, 1.1, 30], [0, 0, 0, 1]])
AFFINES = pytest.mark.parametrize("affine", [np.eye(4), OBLIQUE, OBLIQUE * [-1, 1, 1, 1]])


def lattice(affine, count=25):
    """Samples whose last steps are longer."""
    along = np.append(np.arange(count, dtype=float), [count + 0.5, count + 2.0])
    return Lattice(along, along, along, affine)


def samples_of(shape, on):
    z, y, x = np.unravel_index(np.arange(np.prod(on.shape)), on.shape)
    return shape.at(on.points(x, y, z)).reshape(on.shape).astype(np.float32)


def ball_in(on):
    middle = (on.affine @ [12.2, 12.4, 11.9, 1.0])[:3]
    inverse = np.linalg.inv(on.affine[:3, :3])
    return Ball(tuple(middle.tolist()), float(10.0 / np.sqrt((inverse**2).sum(axis=1)).max()))


def test_the_mean_of_a_quadratic_field_on_a_triangle_is_exact():
    draw = np.random.default_rng(1)
    curvature = draw.normal(size=(3, 3)) / 50
    curvature = curvature + curvature.T
    slope = draw.normal(size=(3, 1))
    corners = draw.normal(size=(3, 3))
    field = lambda at: 0.5 * (at * (curvature @ at)).sum(axis=0) + (slope * at).sum(axis=0)  # noqa: E731
    middles = (corners + np.roll(corners, 1, axis=1)) / 2
    expected = (field(middles) - (field(corners) + np.roll(field(corners), 1)) / 2).mean()
    found = finish(depths_steps(corners, curvature @ corners + slope, np.array([[0, 1, 2]], np.int32)))
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_triangles_of_a_ball_lie_below_it_by_a_third_of_what_its_volume_lacks():
    mesh = icosphere(3, 10.0)
    points = np.ascontiguousarray(mesh.vertices.T, float)
    depths = finish(depths_steps(points, -points / 10.0, mesh.faces))
    larger = (points * (1 + depths / 10.0)).T.astype(np.float32)
    assert mesh.volume / ball_volume(10) - 1 < -0.005
    assert type(mesh)(larger, mesh.faces).volume == pytest.approx(ball_volume(10), rel=1e-4)


def test_a_crease_is_left():
    corners = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])
    across = np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
    assert finish(depths_steps(corners, across, np.array([[0, 1, 2]], np.int32))).tolist() == [0.0] * 3


@AFFINES
def test_gradients_and_values_at_vertices_are_those_of_the_distance(affine):
    on = lattice(affine)
    ball = ball_in(on)
    values = samples_of(ball, on)
    keys, shares = [], []
    for axis, along in enumerate((2, 1, 0)):
        low, high = (values.take(range(start, on.shape[along] - 1 + start), along) for start in (0, 1))
        crossed = np.argwhere((low > 0) != (high > 0))
        keys.append(3 * np.ravel_multi_index(tuple(crossed.T), on.shape) + axis)
        shares.append((low / (low - high).astype(float))[(low > 0) != (high > 0)])
    keys, shares = np.concatenate(keys), np.concatenate(shares)
    gradients, depths = finish(gradients_steps(HeldField(on, values), on, keys, shares, 1))
    z, y, x = np.unravel_index(keys // 3, on.shape)
    low = on.points(x, y, z)
    ends = [np.stack([x, y, z]) + np.eye(3, dtype=int)[:, keys % 3]]
    points = low + shares * (on.points(*ends[0]) - low)
    inward = np.array(ball.center)[:, None] - points
    exact = inward / np.linalg.norm(inward, axis=0)
    told = depths != 0
    assert told.mean() > 0.6
    assert np.linalg.norm(gradients - exact, axis=0)[told].max() < 0.05
    assert np.linalg.norm(gradients - exact, axis=0)[told].mean() < 0.01
    before, after = ball.at(points), ball.at(points) - depths
    assert np.abs(after[told]).mean() < 0.15 * np.abs(before[told]).mean()


@AFFINES
def test_a_field_that_keeps_volume_makes_a_ball_as_large_as_it_is(affine):
    on = lattice(affine)
    ball = ball_in(on)
    sizes = []
    for keeps in (False, True):
        field = HeldField(on, samples_of(ball, on), keeps_volume=keeps)
        mesh = finish(extract_parts_steps(Recipe(on, [field], PartRule(1), {}), Budget())).mesh.of_label(1)
        assert mesh.closed
        sizes.append(mesh.volume / ball_volume(ball.radius) - 1)
    assert sizes[0] < -0.005
    assert abs(sizes[1]) < 0.25 * abs(sizes[0])
