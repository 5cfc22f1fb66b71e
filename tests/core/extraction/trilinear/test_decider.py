# SPDX-License-Identifier: GPL-3.0-or-later
"""The trilinear topology against an oracle that resamples, and the tables against what a surface must be."""

import zlib
from itertools import permutations

import numpy as np
import pytest
from oracles.triangles import is_closed_manifold, sides, topology
from oracles.trilinear import grid_topology, united, voxel_topology

from ctmc_addon.core.extraction.case_table import CLASSIC, EDGES, loops
from ctmc_addon.core.extraction.trilinear.cases import INTERIOR, ambiguous_faces
from ctmc_addon.core.extraction.trilinear.decider import (
    AMBIGUOUS,
    NEEDS_DECISION,
    crossings,
    decide,
    interior_points,
    trilinear_tables,
)

CORNERS = np.array([(corner & 1, corner >> 1 & 1, corner >> 2) for corner in range(8)])
CHECKERBOARD = 1 - 2 * (CORNERS.sum(axis=1) % 2)


def configuration_triangles(row):
    tables = trilinear_tables()
    first = tables.first_triangle[row]
    return [tuple(edges) for edges in tables.triangle_edges[first : first + tables.triangle_count[row]].tolist()]


def cases_of(values, threshold=0.0):
    return ((values >= threshold) << np.arange(8)).sum(axis=1).astype(np.uint8)


def voxels_of(grid):
    """Corner values (n, 8) of all voxels of an (x, y, z) grid, and the places of their lowest corners."""
    places = np.array(list(np.ndindex(*(side - 1 for side in grid.shape))))
    at = places[:, None] + CORNERS
    return grid[at[..., 0], at[..., 1], at[..., 2]], places


def assembled(grid, threshold=0.0, inside=None):
    """Triangles of a grid, voxel by voxel: slow and obvious. A vertex is named by its edge or by its voxel."""
    values, places = voxels_of(grid)
    cases = cases_of(values, threshold) if inside is None else cases_of(voxels_of(inside)[0], 1)
    number = np.arange(grid.size).reshape(grid.shape)
    triangles = []
    for voxel, (place, row) in enumerate(zip(places, decide(values, threshold, cases).tolist(), strict=True)):
        corners = [int(number[tuple(place + corner)]) for corner in CORNERS]
        names = [3 * corners[low] + edge // 4 for edge, (low, _) in enumerate(EDGES)]
        names += [3 * grid.size + 3 * voxel + own for own in range(3)]
        triangles += [tuple(names[edge] for edge in triangle) for triangle in configuration_triangles(row)]
    return triangles


def closed(inner, outside=-1.0):
    """A grid with a border of outside values."""
    return np.pad(inner, 1, constant_values=outside)


def random_corners(count, seed, checkerboard):
    """Corner values from -1 to 1; in a checkerboard five of six corners take its sign: all loops and tunnels."""
    rng = np.random.default_rng(seed)
    values = rng.uniform(-1, 1, (count, 8))
    if checkerboard:
        values = np.abs(values) * CHECKERBOARD * np.where(rng.random((count, 8)) < 1 / 6, -1, 1)
    return values


def test_the_first_configurations_are_the_classic_cases():
    assert (trilinear_tables().triangle_count[:256] == CLASSIC.triangle_count).all()
    assert (trilinear_tables().first_triangle[:256] == CLASSIC.first_triangle).all()
    assert (trilinear_tables().triangle_edges[: len(CLASSIC.triangle_edges)] == CLASSIC.triangle_edges).all()
    assert not trilinear_tables().interior_count[:256].any()


def test_the_tables_are_the_same_in_every_python_and_numpy():
    # Python 3.12 began to add fractions up more exactly than before: no choice among triangles may hang on that.
    assert zlib.crc32(trilinear_tables().triangle_edges.astype("<i2").tobytes()) == 3292774164


def test_a_case_needs_a_decision_where_it_has_an_ambiguous_face_or_two_loops():
    for case in range(256):
        faces = ambiguous_faces(case)
        assert np.flatnonzero(AMBIGUOUS[case]).tolist() == faces
        assert NEEDS_DECISION[case] == (bool(faces) or len(loops(case)) > 1)


def test_interior_vertices_are_inside_the_voxel_and_apart():
    values = random_corners(100_000, 6, checkerboard=True)
    rows = decide(values, 0.0, cases_of(values))
    count = trilinear_tables().interior_count[rows]
    assert set(count.tolist()) == {0, 1, 3}
    voxel, number = np.nonzero(np.arange(3) < count[:, None])
    for share in (crossings(values, 0.0), np.full((len(values), 12), 0.5)):
        places = interior_points(rows[voxel], number, share[voxel])
        assert places.min() > 0
        assert places.max() < 1
        waist = places[count[voxel] == 3].reshape(-1, 3, 3)
        assert np.abs(waist - np.roll(waist, 1, axis=1)).max(axis=2).min() > 0.01


@pytest.mark.parametrize("checkerboard", [False, True])
def test_a_voxel_has_the_trilinear_surfaces_euler_number_and_parts(checkerboard):
    values = random_corners(500, 1, checkerboard)
    cases = cases_of(values)
    checked = 0
    for corners, case, row in zip(values, cases, decide(values, 0.0, cases).tolist(), strict=True):
        expected = voxel_topology(corners.reshape(2, 2, 2).transpose(2, 1, 0))
        if expected is None or not NEEDS_DECISION[case]:
            continue
        triangles = configuration_triangles(row)
        label = united(INTERIOR + 3, np.array(triangles)[:, [0, 1, 1, 2]].reshape(-1, 2))
        parts = {
            frozenset(np.flatnonzero(label == name).tolist()) - {12, 13, 14} for name in label[np.unique(triangles)]
        }
        assert (topology(triangles)[0], parts) == expected
        checked += 1
    assert checked > 200


def test_a_grid_is_closed_and_manifold_with_the_trilinear_surfaces_euler_number_and_parts():
    rng = np.random.default_rng(2)
    for _ in range(25):
        grid = closed(rng.uniform(-1, 1, (3, 3, 3)))
        triangles = assembled(grid)
        assert is_closed_manifold(triangles)
        assert topology(triangles) == grid_topology(grid, 0.0)


def crossing(places, triangles):
    """Which of (n, 15, 3) placements make a side go through a triangle that it has no corner of."""
    edges = {frozenset(side) for side in sides(triangles)}
    pairs = np.array([(*edge, *triangle) for edge in edges for triangle in triangles if not edge & {*triangle}])
    start, end, a, b, c = (places[:, corner] for corner in pairs.T)  # (n, pairs, 3) each
    normal = np.cross(b - a, c - a)
    above, below = ((start - a) * normal).sum(axis=2), ((end - a) * normal).sum(axis=2)
    apart = above * below < -1e-18
    through = start + (above / np.where(apart, above - below, 1.0))[:, :, None] * (end - start)
    for one, other in ((a, b), (b, c), (c, a)):
        apart &= (np.cross(other - one, through - one) * normal).sum(axis=2) > 1e-9
    return apart.any(axis=1)


@pytest.mark.parametrize("alpha", [0.0, 0.5, 1.0])
def test_no_triangles_of_a_voxel_with_interior_vertices_cross(alpha):
    values = np.concatenate([random_corners(20_000, 5, checkerboard) for checkerboard in (False, True)])
    rows = decide(values, 0.0, cases_of(values))
    chosen = np.flatnonzero(trilinear_tables().interior_count[rows])
    values, rows = values[chosen], rows[chosen]
    share = 0.5 + alpha * (crossings(values, 0.0) - 0.5)
    places = np.zeros((len(rows), 15, 3))
    places[:, :12] = CORNERS[[low for low, _ in EDGES]]
    places[:, np.arange(12), np.arange(12) // 4] = share
    for number in range(3):
        places[:, INTERIOR + number] = interior_points(rows, np.full(len(rows), number), share)
    assert len(set(rows.tolist())) > 200
    assert not [row for row in set(rows.tolist()) if crossing(places[rows == row], configuration_triangles(row)).any()]


@pytest.mark.parametrize("axes", [*permutations(range(3))][1:])
def test_tunnels_are_found_along_any_axis(axes):
    """The slices are taken along z, but the answer does not know it."""
    values = random_corners(20_000, 3, checkerboard=True)
    turned = values.reshape(-1, 2, 2, 2).transpose(0, *(1 + axis for axis in axes)).reshape(-1, 8)
    decided = [decide(corners, 0.0, cases_of(corners)) for corners in (values, turned)]
    tunnel, tunnel_turned = (trilinear_tables().interior_count[each] == 3 for each in decided)
    assert tunnel.sum() > 200
    assert (tunnel == tunnel_turned).all()


def test_a_closed_border_that_repeats_its_neighbors_is_closed_and_manifold():
    """As `close_border` has it: the outside samples repeat the outermost ones and count as outside."""
    rng = np.random.default_rng(4)
    for _ in range(10):
        inner = rng.uniform(-1, 1, (3, 3, 3))
        triangles = assembled(np.pad(inner, 1, mode="edge"), inside=np.pad(inner >= 0, 1).astype(int))
        assert is_closed_manifold(triangles)


@pytest.mark.parametrize("levels", [2, 3, 5])
def test_ties_are_decided_as_by_a_threshold_a_little_lower(levels):
    """Few gray values: saddles and corners that meet the threshold exactly."""
    rng = np.random.default_rng(levels)
    for threshold in (0.0, 0.5):
        for _ in range(8):
            grid = closed(rng.integers(-(levels // 2), levels // 2 + 1, (3, 3, 3)).astype(float), -levels)
            triangles = assembled(grid, threshold)
            assert is_closed_manifold(triangles)
            assert topology(triangles) == grid_topology(grid, threshold - 1e-6)


def test_two_opposite_corners_are_connected_where_the_voxels_middle_is_inside():
    """All other corners at -1: the interpolant in the middle is (2 corner - 6) / 8."""
    corner = np.array([0.1, 2.9, 3.0, 3.1, 50.0])
    values = np.full((5, 8), -1.0)
    values[:, [0, 7]] = corner[:, None]
    tunnel = trilinear_tables().interior_count[decide(values, 0.0, cases_of(values))] == 3
    assert tunnel.tolist() == [False, False, True, True, True]
    euler = [voxel_topology(one.reshape(2, 2, 2))[0] for one in values[[0, 1, 3, 4]]]
    assert euler == [2, 2, 0, 0]
