# SPDX-License-Identifier: GPL-3.0-or-later
"""Labels that touch are simplified together: every label stays closed, neighbors stay identical, corners stay."""

from functools import cache

import numpy as np
import pytest
from complexes import assert_labels_sound, complex_of, corners_of, edges_of, junction_edges, voronoi_labels
from meshes import icosphere

from ctmc_addon.core import Budget, distances, finish, simplify
from ctmc_addon.core.errors import MemoryLimitError, MeshError, SettingsError
from ctmc_addon.core.mesh.distance.surface_distance import surface_distance
from ctmc_addon.core.mesh.intersections import self_intersections
from ctmc_addon.core.mesh.labels.label_complex import ComplexMesh
from ctmc_addon.core.simplification import whole
from ctmc_addon.core.simplification.complexes.gaps import gaps_filled_steps
from ctmc_addon.core.simplification.complexes.shares import Shares
from ctmc_addon.core.simplification.complexes.simplify import simplify_complex, simplify_complex_steps
from ctmc_addon.core.simplification.engine.component_removal import CollapsedComponents

SEEDS = [[-3.1, 0.4, 1.2], [2.7, 2.2, -0.8], [0.6, -3.0, 0.3], [0.2, 1.0, 3.6]]


@cache
def cells(flipped=0):
    """Four cells of a ball, whose walls meet in lines and points."""
    return complex_of(voronoi_labels(16, SEEDS, 6.8), flipped=flipped)


@cache
def few_cells():
    """Four cells of a smaller ball."""
    return complex_of(voronoi_labels(9, 0.5 * np.array(SEEDS), 3.6))


@cache
def pair():
    """A ball cut in two by a plane: one junction line, without an end."""
    return complex_of(voronoi_labels(18, [[-2, 0.3, 0.2], [2, -0.3, 0.1]], 7.4))


def complex_of_spheres(*spheres):
    """Spheres (center, radius, label within, label around) as one complex."""
    meshes = [icosphere(3, radius, center) for center, radius, _, _ in spheres]
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    sides = [
        np.tile(np.int32(labels), (len(mesh.faces), 1)) for mesh, (_, _, *labels) in zip(meshes, spheres, strict=True)
    ]
    return ComplexMesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.faces + np.int32(start) for mesh, start in zip(meshes, starts, strict=False)]),
        np.concatenate(sides),
    )


def positions(mesh, vertices):
    return {position.tobytes() for position in mesh.vertices[vertices]}


def triangles_between(mesh, label, other):
    """The triangles of a label's own surface that border another, as sorted positions."""
    behind = np.flatnonzero((np.sort(mesh.sides, axis=1) == sorted((label, other))).all(axis=1))
    return sorted(sorted(corner.tobytes() for corner in mesh.vertices[face]) for face in mesh.faces[behind])


@pytest.mark.parametrize("reduction", [0.5, 0.9, 0.98])
@pytest.mark.parametrize("make", [cells, pair])
def test_the_count_is_exact_and_every_label_stays_closed_and_manifold(make, reduction):
    mesh = make()
    asked = round(len(mesh.faces) * (1 - reduction))
    result = finish(simplify_complex_steps(mesh, reduction=reduction))
    assert asked - 1 <= len(result.mesh.faces) <= asked
    assert result.mesh.labels == mesh.labels
    assert_labels_sound(result.mesh)
    for label in mesh.labels:
        assert result.full_faces[label] == len(mesh.of_label(label).faces)
        assert result.faces[label] == len(result.mesh.of_label(label).faces)


@pytest.mark.parametrize("target", [2000, 2001, 777])
def test_a_triangle_budget_counts_each_stored_triangle_once(target):
    assert target - 1 <= len(simplify_complex(cells(), target_faces=target).faces) <= target


def test_corners_stay_where_they_are_and_lines_keep_their_ends():
    mesh = cells()
    small = simplify_complex(mesh, reduction=0.97)
    assert len(corners_of(mesh)) == 5
    assert positions(small, corners_of(small)) == positions(mesh, corners_of(mesh))


def test_lines_collapse_along_themselves_only():
    mesh = cells()
    small = simplify_complex(mesh, reduction=0.9)
    line = junction_edges(small)
    assert 30 < len(line) < len(junction_edges(mesh)) / 2
    # As many triangles at a line as labels that meet there, at both rates.
    assert set(edges_of(small.faces)[1]) == set(edges_of(mesh.faces)[1]) == {2, 3}
    full_line = mesh.vertices[junction_edges(mesh)].mean(axis=1)
    middle = small.vertices[line].mean(axis=1)
    away = np.sqrt(((middle[:, None] - full_line) ** 2).sum(axis=2)).min(axis=1)
    assert away.max() < 0.5  # of the grid's spacing


def test_neighbors_have_the_same_wall_at_any_rate():
    small = simplify_complex(cells(), reduction=0.9)
    surfaces = {label: small.of_label(label) for label in small.labels}
    for label in small.labels:
        for other in small.labels[label:]:
            wall = triangles_between(small, label, other)
            faces = [
                {tuple(sorted(corner.tobytes() for corner in surface.vertices[face])) for face in surface.faces}
                for surface in (surfaces[label], surfaces[other])
            ]
            assert {tuple(triangle) for triangle in wall} == faces[0] & faces[1]


@pytest.mark.once
def test_errors_of_each_label_are_at_most_a_tenth_above_those_alone():
    mesh = pair()
    small = simplify_complex(mesh, reduction=0.9)
    for label in mesh.labels:
        full = mesh.of_label(label)
        alone = surface_distance(simplify(full, reduction=0.9), full)
        assert surface_distance(small.of_label(label), full).mean < 1.1 * alone.mean
        assert abs(small.of_label(label).volume / full.volume - 1) < 0.01


def test_each_label_keeps_its_share():
    mesh = cells()
    result = finish(simplify_complex_steps(mesh, reduction=0.9))
    for label in mesh.labels:
        assert result.faces[label] / result.full_faces[label] == pytest.approx(0.1, abs=0.005)


def touching(radius):
    """Two balls whose middles are seven samples apart."""
    z, y, x = np.mgrid[:11, :11, :20]
    labels = np.zeros(x.shape, int)
    for label, middle in ((1, 6), (2, 13)):
        labels[(z - 5) ** 2 + (y - 5) ** 2 + (x - middle) ** 2 < radius**2] = label
    return labels


def test_a_contact_smaller_than_a_triangle_becomes_a_point_that_both_labels_keep():
    mesh = complex_of(touching(3.1), 2)
    small = simplify_complex(mesh, reduction=0.98)
    assert_labels_sound(small)
    assert len(junction_edges(mesh)) == 12
    assert len(junction_edges(small)) == 0
    ours, theirs = ({vertex.tobytes() for vertex in small.of_label(label).vertices} for label in (1, 2))
    assert len(ours & theirs) == 1


@pytest.mark.parametrize(("target", "largest", "filled"), [(40, np.inf, 1), (400, np.inf, 0), (40, 0.1, 0)])
def test_a_gap_between_labels_smaller_than_four_triangles_is_filled(target, largest, filled):
    labels = touching(3.6)
    labels[5, 5, 10] = 0  # in the middle of nine samples where both touch
    mesh = complex_of(labels, 2)
    made, taken = finish(gaps_filled_steps(mesh, target, largest))
    collapsed = sum(taken.values(), CollapsedComponents())
    assert collapsed.count == len(taken) == filled
    assert_labels_sound(made)
    lost = sum(mesh.of_label(label).volume - made.of_label(label).volume for label in mesh.labels)
    assert -lost == pytest.approx(collapsed.volume, rel=1e-5)
    for label, gap in taken.items():
        assert made.of_label(label).volume - mesh.of_label(label).volume == pytest.approx(gap.volume, rel=1e-3)


def test_a_label_that_touches_none_has_the_bytes_that_it_has_alone():
    apart = complex_of_spheres(((0, 0, 0), 1.0, 3, 0), ((4, 0, 0), 1.5, 1, 0), ((0, 4, 0), 0.5, 7, 0))
    small = simplify_complex(apart, reduction=0.8)
    for label in apart.labels:
        alone = simplify(apart.of_label(label), reduction=0.8)
        own = small.of_label(label)
        assert own.vertices.tobytes() == alone.vertices.tobytes()
        assert own.faces.tobytes() == alone.faces.tobytes()


def test_a_label_within_another_stays_there():
    nested = complex_of_spheres(((0, 0, 0), 3.0, 1, 0), ((0.5, 0, 0), 1.0, 1, 2), ((-1.5, 0, 0), 0.05, 2, 1))
    nested = ComplexMesh(nested.vertices, nested.faces, nested.sides)
    inner = nested.sides[:, 1] == 2
    nested.sides[inner] = nested.sides[inner][:, ::-1]  # outward
    small = finish(simplify_complex_steps(nested, target_faces=300))
    assert small.collapsed.count == 1  # the smallest, of the same label
    assert small.collapsed_of.keys() == {1, 2}  # for one of them a cavity
    for collapsed in small.collapsed_of.values():
        assert (collapsed.count, collapsed.volume) == (1, pytest.approx(4 / 3 * np.pi * 0.05**3, rel=0.02))
    assert small.mesh.labels == (1, 2)
    assert small.mesh.of_label(2).volume == pytest.approx(4 / 3 * np.pi, rel=0.1)
    assert small.mesh.of_label(1).volume == pytest.approx(4 / 3 * np.pi * 26, rel=0.1)


def test_small_components_of_labels_that_touch_go_as_a_whole():
    mesh = pair()
    island = complex_of_spheres(((16.3, 8.5, 8.5), 0.1, 1, 0))
    both = ComplexMesh(
        np.concatenate([mesh.vertices, island.vertices]),
        np.concatenate([mesh.faces, island.faces + np.int32(len(mesh.vertices))]),
        np.concatenate([mesh.sides, island.sides]),
    )
    result = finish(simplify_complex_steps(both, reduction=0.98))
    assert result.collapsed.count == 1
    assert result.collapsed.largest == pytest.approx(4 / 3 * np.pi * 0.1**3, rel=0.02)
    assert result.collapsed_of.keys() == {1}
    assert result.collapsed_of[1].volume == pytest.approx(result.collapsed.volume, rel=1e-4)
    assert result.mesh.vertices[:, 0].max() < 16.2
    assert_labels_sound(result.mesh)


def test_no_label_goes_as_a_whole():
    mesh = pair()
    inner = complex_of_spheres(
        ((8.5, 8.5, 8.5), 0.01, 3, 1), ((16.3, 8.5, 8.5), 0.1, 4, 0), ((16.5, 8.5, 8.5), 0.01, 4, 0)
    )
    both = ComplexMesh(
        np.concatenate([mesh.vertices, inner.vertices]),
        np.concatenate([mesh.faces, inner.faces + np.int32(len(mesh.vertices))]),
        np.concatenate([mesh.sides, inner.sides]),
    )
    result = finish(simplify_complex_steps(both, target_faces=4))
    assert result.mesh.labels == (1, 2, 3, 4)
    assert result.faces[3] == result.faces[4] == 4
    assert_labels_sound(result.mesh)


def test_sides_stay_with_triangles_that_point_either_way():
    small = simplify_complex(cells(5), reduction=0.9)
    assert_labels_sound(small)
    assert 0.1 < (small.sides[:, 0] < small.sides[:, 1]).mean() < 0.3
    same = simplify_complex(cells(), reduction=0.9)
    np.testing.assert_array_equal(small.vertices, same.vertices)
    np.testing.assert_array_equal(np.sort(small.sides, axis=1), np.sort(same.sides, axis=1))


def test_threads_change_no_byte():
    mesh = cells()
    one, two = (simplify_complex(mesh, reduction=0.9, budget=Budget(threads=threads)) for threads in (1, 2))
    for name in ("vertices", "faces", "sides"):
        assert getattr(one, name).tobytes() == getattr(two, name).tobytes()


def test_normals_are_carried_along():
    mesh = pair()
    normals = np.zeros_like(mesh.vertices)
    corners = mesh.vertices[mesh.faces]
    for corner in mesh.faces.T:
        np.add.at(normals, corner, np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    small = simplify_complex(ComplexMesh(mesh.vertices, mesh.faces, mesh.sides, normals), reduction=0.9)
    np.testing.assert_allclose(np.linalg.norm(small.normals, axis=1), 1.0, rtol=1e-5)
    lines = np.zeros(len(small.vertices), bool)
    lines[junction_edges(small)] = True
    a, b, c = (small.vertices[corner] for corner in small.faces.T)
    along = (np.cross(b - a, c - a) * small.normals[small.faces[:, 0]]).sum(axis=1)
    assert (along[~lines[small.faces].any(axis=1)] > 0).mean() > 0.99


def test_an_open_complex_keeps_its_border():
    mesh = pair()
    inside = (mesh.vertices[mesh.faces][:, :, 2] > 4).all(axis=1)
    used, faces = np.unique(mesh.faces[inside], return_inverse=True)
    cut = ComplexMesh(mesh.vertices[used], faces.reshape(-1, 3).astype(np.int32), mesh.sides[inside])
    small = simplify_complex(cut, reduction=0.8)
    borders = []
    for each in (cut, small):
        edges, counts = edges_of(each.faces)
        borders.append({frozenset(p.tobytes() for p in each.vertices[edge]) for edge in edges[counts == 1]})
    assert borders[0] == borders[1]


def test_where_a_label_touches_itself_along_an_edge_its_triangles_there_stay():
    two = complex_of_spheres(((0, 0, 0), 1.0, 1, 0), ((2.5, 0, 0), 1.0, 1, 0), ((0, 3, 0), 1.0, 2, 0))
    faces = two.faces.copy()
    one, other = faces[0], faces[len(faces) // 3]
    faces[faces == other[0]], faces[faces == other[1]] = one[1], one[0]  # the edge of one, of the other too
    used, faces = np.unique(faces, return_inverse=True)
    mesh = ComplexMesh(two.vertices[used], faces.reshape(-1, 3).astype(np.int32), two.sides)
    small = simplify_complex(mesh, reduction=0.7)
    assert sorted(np.unique(edges_of(small.faces)[1])) == [2, 4]
    assert positions(mesh, junction_edges(mesh).ravel()) == positions(small, junction_edges(small).ravel())


@pytest.mark.parametrize("goal", [{}, {"reduction": 1.0}, {"target_faces": 0}, {"reduction": 0.5, "target_faces": 9}])
def test_a_goal_that_is_none_is_refused(goal):
    with pytest.raises(SettingsError):
        simplify_complex(pair(), **goal)


def test_bad_vertices_and_too_little_memory_are_refused():
    mesh = pair()
    with pytest.raises(MemoryLimitError, match=f"simplifying {len(mesh.faces)} triangles of labels that touch"):
        simplify_complex(mesh, reduction=0.5, budget=Budget(bytes=10_000))
    vertices = mesh.vertices.copy()
    vertices[3] = np.nan
    with pytest.raises(MeshError, match="vertex 3 "):
        simplify_complex(ComplexMesh(vertices, mesh.faces, mesh.sides), reduction=0.5)


def test_labels_that_lag_behind_get_a_lower_weight():
    labels = np.array([[1, 2, 2], [0, 0, 1]], np.int32)
    shares = Shares(labels, np.repeat(np.arange(3), [100, 100, 50]).astype(np.int32), 0.5)
    shares.update(np.repeat(np.arange(3), [100, 50, 40]).astype(np.int32))
    first, second, between = shares.weight
    assert first < between < second
    assert between == pytest.approx(np.sqrt(first * second), rel=0.1)
    assert not shares.closed.any()


def test_a_label_gives_at_most_a_quarter_beyond_its_share():
    labels = np.array([[1, 2, 3], [0, 0, 1]], np.int32)
    shares = Shares(labels, np.repeat(np.arange(3), [100, 100, 100]).astype(np.int32), 0.5)
    shares.update(np.repeat(np.arange(3), [50, 38, 36]).astype(np.int32))
    assert shares.closed.tolist() == [False, False, False]  # label 1 may give more, on its interface with 3 too
    shares.update(np.repeat(np.arange(3), [50, 37, 60]).astype(np.int32))
    assert shares.closed.tolist() == [False, True, False]
    shares.update(np.repeat(np.arange(3), [38, 50, 36]).astype(np.int32))
    assert shares.closed.tolist() == [True, False, True]


@pytest.mark.once
def test_neither_a_label_nor_two_come_to_cross(monkeypatch):
    mesh = noisy_shell()
    assert len(self_intersections(mesh.vertices, mesh.faces)) == 0
    result = finish(simplify_complex_steps(mesh, reduction=0.98))
    assert result.self_intersections == 0
    assert len(self_intersections(result.mesh.vertices, result.mesh.faces)) == 0
    assert_labels_sound(result.mesh)
    monkeypatch.setattr(whole, "uncross_steps", nothing_steps)
    unchecked = simplify_complex(mesh, reduction=0.98)
    assert len(self_intersections(unchecked.vertices, unchecked.faces)) > 0


def nothing_steps(mesh, hold):
    return False
    yield


@cache
def noisy_shell():
    """A ball in two halves within a thin shell, all with rough surfaces."""
    size = 20
    points = np.stack(np.meshgrid(*[np.arange(size) - (size - 1) / 2] * 3, indexing="ij"), axis=-1)
    noise = np.random.default_rng(3).normal(size=(size,) * 3)
    radius = np.sqrt((points**2).sum(axis=-1)) + 0.7 * noise
    labels = np.where(radius < 5.5, np.where(points[..., 0] > 0, 1, 2), np.where(radius < 7.5, 3, 0))
    return complex_of(labels, rounds=1)


def test_labels_that_do_not_touch_and_would_cross_are_simplified_together():
    near = complex_of_spheres(((0, 0, 0), 1.0, 1, 0), ((2.003, 0, 0), 1.0, 2, 0), ((0, 2.002, 0), 1.0, 3, 0))
    alone = [simplify(near.of_label(label), reduction=0.95) for label in near.labels]
    vertices = np.concatenate([each.vertices for each in alone])
    starts = np.cumsum([0] + [len(each.vertices) for each in alone])
    faces = np.concatenate([each.faces + start for each, start in zip(alone, starts, strict=False)])
    crossing = len(self_intersections(vertices, faces))
    result = finish(simplify_complex_steps(near, reduction=0.95))
    assert result.self_intersections == 0
    assert len(self_intersections(result.mesh.vertices, result.mesh.faces)) == 0
    assert crossing > 0
    assert_labels_sound(result.mesh)


def test_a_complex_that_is_simplified_is_near_it():
    mesh = pair()
    small = simplify_complex(mesh, reduction=0.9)
    for label in mesh.labels:
        assert distances(small.of_label(label).vertices, mesh.of_label(label)).max() < 0.5


def spread(mesh):
    """Points on every triangle, an eighth of a side apart, corners and edges too."""
    a, b, c = mesh.vertices[mesh.faces].astype(float).transpose(1, 0, 2)
    shares = [(i, j, 8 - i - j) for i in range(9) for j in range(9 - i)]
    return np.concatenate([(i * a + j * b + k * c) / 8 for i, j, k in shares])


@pytest.mark.once
@pytest.mark.parametrize(("make", "bound", "share"), [(cells, 0.3, 0.25), (pair, 0.8, 0.1)])
def test_no_label_moves_farther_than_a_maximum_error_either_way(make, bound, share):
    mesh = make()
    result = finish(simplify_complex_steps(mesh, max_error=bound))
    small = result.mesh
    assert_labels_sound(small)
    assert small.labels == mesh.labels
    assert len(small.faces) < share * len(mesh.faces)
    for label in mesh.labels:
        before, after = mesh.of_label(label), small.of_label(label)
        assert after.euler == before.euler
        middles = before.vertices[before.faces].mean(axis=1)  # its triangles are much smaller than the bound
        assert distances(np.concatenate([before.vertices, middles]), after).max() <= bound
        assert distances(spread(after), before).max() <= bound
    assert result.self_intersections == len(self_intersections(small.vertices, small.faces)) == 0


@pytest.mark.once
def test_a_maximum_error_below_all_detail_leaves_a_complex_alone():
    mesh = few_cells()
    small = simplify_complex(mesh, max_error=1e-6)
    for label in mesh.labels:
        assert distances(mesh.of_label(label).vertices, small.of_label(label)).max() <= 1e-6


@pytest.mark.once
def test_threads_change_no_byte_within_a_maximum_error():
    results = [simplify_complex(few_cells(), max_error=0.4, budget=Budget(threads=threads)) for threads in (1, 2)]
    one, two = (mesh.vertices.tobytes() + mesh.faces.tobytes() + mesh.sides.tobytes() for mesh in results)
    assert one == two


@pytest.mark.parametrize("bound", [0.3, 0.003])
def test_touching_boxes_become_their_twelve_triangles_within_any_maximum_error(bound):
    labels = np.zeros((6, 6, 10), np.uint8)
    labels[1:5, 1:5, 1:5], labels[1:5, 1:5, 5:9] = 1, 2
    small = simplify_complex(walls_of(labels), max_error=bound)
    assert [len(small.of_label(label).faces) for label in (1, 2)] == [12, 12]


def walls_of(labels):
    """The walls between samples, two triangles a side."""
    numbers, faces, sides = {}, [], []
    for axis in range(3):
        lower = [slice(None)] * 3
        lower[axis] = slice(None, -1)
        upper = [slice(None)] * 3
        upper[axis] = slice(1, None)
        first, last = labels[tuple(lower)], labels[tuple(upper)]
        for index in np.argwhere(first != last):
            corner = index + np.eye(3, dtype=int)[axis]
            u, v = np.eye(3, dtype=int)[(axis + 1) % 3], np.eye(3, dtype=int)[(axis + 2) % 3]
            square = [numbers.setdefault(tuple(corner + d), len(numbers)) for d in (0 * u, u, u + v, v)]
            faces += [[square[0], square[1], square[2]], [square[0], square[2], square[3]]]
            sides += [(int(first[tuple(index)]), int(last[tuple(index)]))] * 2
    return ComplexMesh(np.array(list(numbers), np.float32), np.array(faces, np.int32), np.array(sides, np.int32))
