# SPDX-License-Identifier: GPL-3.0-or-later
"""The walls between labels: every label closed and manifold for any owners, positions where the fields say."""

from itertools import product

import numpy as np
import pytest

from ctmc_addon.core.extraction.case_table import CLASSIC, EDGES, FACES
from ctmc_addon.core.extraction.grid import make_axes
from ctmc_addon.core.extraction.interfaces import bands
from ctmc_addon.core.extraction.interfaces.bands import band_ranges, fill_band, find_band
from ctmc_addon.core.extraction.interfaces.constants import measured_pairs_steps, next_constants
from ctmc_addon.core.extraction.interfaces.crossings import ComplexVertices, crossings_of
from ctmc_addon.core.extraction.interfaces.owners import Owners
from ctmc_addon.core.extraction.interfaces.voxel_patterns import (
    FACE_POINT,
    INNER_POINT,
    faces_with_points,
    pattern_numbers,
    pattern_of,
)
from ctmc_addon.core.mesh import self_intersections
from ctmc_addon.core.mesh.labels.label_complex import borders_of
from ctmc_addon.core.progress import finish


def complex_of(numbers):
    """Vertices at edge midpoints in index space, faces and sides of a grid of owners, a layer of 0 put around it."""
    padded = np.pad(numbers, 1)
    axes = make_axes([(0, size) for size in numbers.shape[::-1]], 1, True)
    owners = Owners(*axes, padded)
    found = [find_band(owners, *layers) for layers in band_ranges(padded.shape)]
    counts = np.array([band.counts for band in found])
    ends = np.cumsum(counts.reshape(-1))
    starts = (ends - counts.reshape(-1)).reshape(counts.shape)
    filled = []
    for at, band in enumerate(found):
        above = (None, []) if at + 1 == len(found) else (found[at + 1], starts[at + 1].tolist())
        filled.append(fill_band(owners, band, starts[at].tolist(), *above))
    crossings = [[crossings_of(owners, band, axis, []) for axis in range(3)] for band in found]
    placed = ComplexVertices(crossings, filled, starts, int(ends[-1]))
    origins = np.zeros((int(padded.max()) + 1, 3), np.intp)
    positions = finish(placed.positions_steps(owners, None, origins, 1))
    faces, sides = (np.concatenate([getattr(band, name) for band in filled]) for name in ("faces", "sides"))
    return positions, faces, sides.astype(np.intp)


def edge_faults(faces, sides):
    """How many edges of a label's triangles are not used once in each direction, over all labels."""
    behind = np.column_stack([np.repeat(sides[:, 0], 3), faces.reshape(-1), np.roll(faces, -1, 1).reshape(-1)])
    front = np.column_stack([np.repeat(sides[:, 1], 3), np.roll(faces, -1, 1).reshape(-1), faces.reshape(-1)])
    directed = np.concatenate([behind, front]).astype(np.int64)
    directed = directed[directed[:, 0] > 0]
    label, start, end = directed.T
    base = int(faces.max()) + 1
    forward, back = ((label * base + a) * base + b for a, b in ((start, end), (end, start)))
    return len(forward) - len(np.unique(forward)) + int((~np.isin(back, forward)).sum())


def grids(count, seed):
    """Grids of random owners, some noise and some blocks, each in a frame of 0 that keeps it from its neighbors."""
    rng = np.random.default_rng(seed)
    for number in range(count):
        labels = 2 + number % 4
        shape = rng.integers(2, 5, 3)
        grid = rng.integers(number % 3 == 0, labels + 1, shape)
        yield np.kron(grid, np.ones((1, 1, 2), int))[:4, :4, :4] if number % 5 == 0 else grid


def together(some):
    """Grids one after the other along x in one grid, and how many."""
    rows = [np.pad(grid, [(0, 4 - size) for size in grid.shape[:2]] + [(0, 5 - grid.shape[2])]) for grid in some]
    return np.concatenate(rows, axis=2).astype(np.uint8)


@pytest.mark.parametrize("seed", range(4))
def test_every_label_of_a_thousand_random_grids_is_closed_and_manifold(seed):
    grid = together(grids(250, seed))
    positions, faces, sides = complex_of(grid)
    assert edge_faults(faces, sides) == 0
    assert (sides[:, 0] > sides[:, 1]).all()
    # No triangle twice, and none without area.
    assert len(np.unique(np.sort(faces, axis=1), axis=0)) == len(faces)
    corners = positions[faces].astype(np.float64)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    assert area.min() > 1e-3
    # The labels fill the space that all of them fill: what one gains at a wall another loses.
    volume, areas = finish(measured_pairs_steps(positions, faces, sides, (1.0, 1.0, 1.0), int(grid.max())))
    assert abs(volume.sum()) < 1e-6 * volume[1:].sum()
    counts = np.bincount(grid.reshape(-1))
    assert np.allclose(volume[1:], counts[1:], rtol=0.4)
    assert np.array_equal(areas, areas.T)
    assert np.trace(areas) == 0


def test_the_surface_of_one_label_is_that_of_the_case_table():
    rng = np.random.default_rng(5)
    grid = (rng.random((12, 11, 10)) < 0.4).astype(np.uint8)
    _, faces, sides = complex_of(grid)
    padded = np.pad(grid, 1)
    corner = [padded[c >> 2 :, c >> 1 & 1 :, c & 1 :][:13, :12, :11] for c in range(8)]
    cases = sum(one.astype(int) << c for c, one in enumerate(corner))
    assert len(faces) == CLASSIC.triangle_count[cases].sum()
    assert np.unique(sides, axis=0).tolist() == [[1, 0]]


@pytest.mark.parametrize("height", [1, 2, 5])
def test_no_cut_into_bands_changes_the_complex_but_for_the_order(monkeypatch, height):
    grid = np.random.default_rng(2).integers(0, 4, (9, 6, 7)).astype(np.uint8)
    whole = complex_of(grid)
    monkeypatch.setattr(bands, "BAND_SAMPLES", height * 8 * 9)
    cut = complex_of(grid)
    assert len(band_ranges((11, 8, 9))) == -(-10 // height)
    for first, second in zip(*(sorted_triangles(*each) for each in (whole, cut)), strict=True):
        assert np.array_equal(first, second)


def sorted_triangles(positions, faces, sides):
    """Corners of all triangles, each from its lowest corner on, in one order."""
    order = np.lexsort(positions.T)
    rank = np.empty(len(order), np.intp)
    rank[order] = np.arange(len(order))
    assert len(np.unique(positions, axis=0)) == len(positions)
    numbers = rank[faces]
    first = numbers.argmin(axis=1)
    turned = np.take_along_axis(numbers, (first[:, None] + np.arange(3)) % 3, axis=1)
    rows = np.column_stack([turned, sides])
    return positions[order], rows[np.lexsort(rows.T)]


def test_both_voxels_at_a_face_cut_it_alike():
    # All ways to give four labels to a face, seen from the voxel below and, mirrored, from the one above.
    for labels in product(range(4), repeat=4):
        below, above = np.full(8, 9), np.full(8, 9)
        for at, (x, y) in enumerate(product(range(2), repeat=2)):
            below[x + 2 * y + 4] = above[x + 2 * y] = labels[at]
        cuts = []
        for owners, face in ((below, 5), (above, 4)):
            pattern = pattern_of(int(pattern_numbers(owners[None])[0]))
            node_corners = {
                n: frozenset(c & 3 for c in EDGES[n]) for n in range(12) if set(EDGES[n]) <= set(FACES[face])
            }
            node_corners[FACE_POINT + face] = frozenset(range(4))
            cut = set()
            for triangle, (behind, front) in zip(pattern.triangles, pattern.sides, strict=True):
                for a, b in zip(triangle, triangle[1:] + triangle[:1], strict=True):
                    if a in node_corners and b in node_corners:
                        cut.add(
                            (frozenset((node_corners[a], node_corners[b])), frozenset(owners[[behind, front]].tolist()))
                        )
            cuts.append(cut)
        assert cuts[0] == cuts[1]


@pytest.mark.parametrize("seed", range(4))
def test_no_triangles_cross_whatever_the_owners_are(seed):
    numbers = np.random.default_rng(seed).integers(0, 4, (9, 9, 9)).astype(np.uint8)
    positions, faces, _ = complex_of(numbers)
    assert len(faces) > 5000
    assert self_intersections(positions, faces).tolist() == []


def test_points_on_faces_are_where_three_labels_meet_without_a_diagonal():
    for labels in product(range(4), repeat=4):
        owners = np.full((1, 8), 9)
        owners[0, list(FACES[4])] = labels
        a, b, c, d = labels
        expected = len(set(labels)) > 2 and a != c and b != d
        assert faces_with_points(owners)[0, 4] == expected


def test_a_pattern_of_four_labels_has_one_point_inside_and_a_triangle_for_each_segment():
    number = pattern_numbers(np.array([[0, 1, 2, 3, 0, 1, 2, 3]]))[0]
    pattern = pattern_of(int(number))
    # Two faces with four segments each, four with one.
    assert len(pattern.triangles) == 12
    assert len(pattern.inner_points) == 1
    assert all(triangle[2] == INNER_POINT for triangle in pattern.triangles)


@pytest.mark.parametrize("seed", range(2))
def test_labels_that_touch_themselves_inside_a_voxel_get_a_point_for_each_part(seed):
    grid = together(grids(200, seed))
    _, faces, sides = complex_of(grid)
    copies = 0
    for border in borders_of(faces.astype(np.int32), sides.astype(np.int32)).values():
        copies += len(border.used) - len(np.unique(border.used))
    assert copies == 0


def test_constants_move_a_wall_by_half_their_difference():
    # Two cubes with one wall of 1 mm2: the first lacks 0.5 mm3, the second has 0.5 mm3 too much.
    areas = np.array([[0.0, 5, 5], [5, 0, 1], [5, 1, 0]])
    step = next_constants(np.array([0.0, 0.5, -0.5]), areas, np.array([False, True, True]))
    total = areas[:, 0] * step + (areas[:, 1:] * (step[:, None] - step[None, 1:])).sum(axis=1) / 2
    assert np.allclose(total[1:], [0.5, -0.5], atol=1e-6)
    assert step[0] == 0
