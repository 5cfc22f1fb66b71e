# SPDX-License-Identifier: GPL-3.0-or-later
import numpy as np
import pytest
from meshes import boundary_edges, edges

from ctmc_addon.core import TriangleMesh, finish
from ctmc_addon.core.errors import MeshError
from ctmc_addon.core.mesh.quality import neighbors, roughness, surface_samples_steps, triangle_shapes

CORNERS = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], np.float32)
QUADS = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
CUBE = TriangleMesh(CORNERS, np.array([t for a, b, c, d in QUADS for t in ((a, b, c), (a, c, d))], np.int32))


def flat_grid(side, bump=0.0):
    x, y = np.meshgrid(np.arange(side), np.arange(side), indexing="ij")
    z = bump * ((x + y) % 2)
    number = np.arange(side * side).reshape(side, side)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    return TriangleMesh(np.stack([x, y, z], -1).reshape(-1, 3).astype(np.float32), faces.astype(np.int32))


def test_a_cube_turns_by_90_degrees_at_twelve_of_its_eighteen_edges():
    assert CUBE.closed
    assert CUBE.volume == 1
    assert roughness(CUBE) == pytest.approx(60)


def test_a_regular_tetrahedron_has_the_angle_of_its_closed_form():
    corners = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], np.float32)
    mesh = TriangleMesh(corners, np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]], np.int32))
    assert roughness(mesh) == pytest.approx(180 - np.degrees(np.arccos(1 / 3)))
    assert triangle_shapes(mesh) == pytest.approx(1)


def test_a_flat_surface_is_not_rough_and_a_wavy_one_more_the_higher_its_waves():
    assert roughness(flat_grid(8)) == 0
    low, high = roughness(flat_grid(8, 1e-5)), roughness(flat_grid(8, 2e-5))
    assert high == pytest.approx(2 * low, rel=1e-3)
    assert low > 0


def test_border_edges_and_triangles_without_area_have_no_angle():
    grid = flat_grid(3)
    assert neighbors(grid).shape[1] == len(edges(grid)[0]) - len(boundary_edges(grid))
    spiked = TriangleMesh(CUBE.vertices, np.concatenate([CUBE.faces, np.array([[0, 0, 3]], np.int32)]))
    assert np.isfinite(roughness(spiked))
    assert roughness(TriangleMesh(CORNERS, np.array([[0, 1, 2]], np.int32))) == 0


def test_the_shape_of_a_right_triangle_is_root_three_over_two_and_that_of_a_line_zero():
    assert triangle_shapes(CUBE) == pytest.approx(np.sqrt(3) / 2)
    assert triangle_shapes(TriangleMesh(CORNERS, np.array([[0, 0, 1], [0, 0, 0]], np.int32))).tolist() == [0, 0]


def test_samples_lie_on_the_surface_and_every_share_of_its_area_has_its_own():
    long = TriangleMesh(CORNERS * np.float32([8, 1, 1]), CUBE.faces)  # sides of 8, 8, 8, 8, 1 and 1: 34 in all
    points = finish(surface_samples_steps(long, 3400, seed=3))
    on = np.abs(points / [8, 1, 1] - 0.5).max(axis=1)
    np.testing.assert_allclose(on, 0.5, atol=1e-12)
    per_side = [(np.abs(points[:, axis] - at) < 1e-9).sum() for axis, at in ((0, 0), (0, 8), (1, 0), (1, 1), (2, 0))]
    np.testing.assert_allclose(per_side, [100, 100, 800, 800, 800], atol=2)


def test_samples_are_the_same_for_a_seed_and_others_for_another():
    np.testing.assert_array_equal(
        finish(surface_samples_steps(CUBE, 50, 1)), finish(surface_samples_steps(CUBE, 50, 1))
    )
    assert (finish(surface_samples_steps(CUBE, 50, 1)) != finish(surface_samples_steps(CUBE, 50, 2))).any()


def test_a_surface_without_area_has_no_samples():
    with pytest.raises(MeshError, match="without area"):
        finish(surface_samples_steps(TriangleMesh(CORNERS, np.zeros((0, 3), np.int32))))
