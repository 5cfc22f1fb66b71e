"""What is measured on meshes, against closed forms and SciPy-free obvious answers."""

import numpy as np
import pytest

from ctmc_addon.core import Surface, TriangleMesh, finish, marching_cubes
from ctmc_addon.core.mesh.triangle_mesh import finding_edges, part_numbers, vertex_normals

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
TETRAHEDRON = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.int32)


def tetrahedra(*places):
    vertices = np.concatenate([CORNERS + place for place in places]).astype(np.float32)
    faces = np.concatenate([TETRAHEDRON + 4 * number for number in range(len(places))])
    return TriangleMesh(vertices, faces)


def test_a_tetrahedron_has_its_closed_form_measures():
    mesh = tetrahedra((100.0, -50.0, 7.0))
    assert mesh.area == pytest.approx(1.5 + np.sqrt(3) / 2)
    assert mesh.volume == pytest.approx(1 / 6)
    assert (mesh.euler, mesh.parts, mesh.closed) == (2, 1, True)
    assert (len(mesh.boundary_edges), len(mesh.non_manifold_edges)) == (0, 0)


def test_turned_inside_out_the_volume_is_negative():
    mesh = tetrahedra((0, 0, 0))
    assert TriangleMesh(mesh.vertices, mesh.faces[:, ::-1]).volume == pytest.approx(-1 / 6)


def test_a_missing_face_opens_three_edges():
    mesh = TriangleMesh(CORNERS, TETRAHEDRON[:3])
    assert not mesh.closed
    assert mesh.enclosed is None
    assert sorted(map(tuple, mesh.boundary_edges)) == [(1, 2), (1, 3), (2, 3)]


def test_a_face_turned_over_is_not_closed():
    faces = TETRAHEDRON.copy()
    faces[0] = faces[0, ::-1]
    assert not TriangleMesh(CORNERS, faces).closed


def test_three_triangles_at_an_edge_are_non_manifold():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1]], np.float32)
    faces = np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]], np.int32)
    assert TriangleMesh(vertices, faces).non_manifold_edges.tolist() == [[0, 1]]


def test_an_empty_mesh_measures_nothing():
    mesh = TriangleMesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    assert (mesh.area, mesh.volume, mesh.parts, mesh.closed, mesh.euler) == (0, 0, 0, False, 0)


def test_parts_are_numbered_by_their_first_face():
    mesh = tetrahedra((0, 0, 0), (5, 0, 0), (9, 0, 0))
    shuffled = TriangleMesh(mesh.vertices, mesh.faces[[8, 0, 4, 9, 1, 5, 2, 3, 6, 7, 10, 11]])
    assert shuffled.parts == 3
    assert shuffled.part_of_face.tolist() == [0, 1, 2, 0, 1, 2, 1, 1, 2, 2, 0, 0]


@pytest.mark.parametrize("at_once", [7, 1 << 18])
@pytest.mark.parametrize("seed", range(5))
def test_parts_are_those_of_a_walk_from_face_to_face(seed, at_once, monkeypatch):
    monkeypatch.setattr("ctmc_addon.core.mesh.triangle_mesh.FACES_AT_ONCE", at_once)
    rng = np.random.default_rng(seed)
    faces = rng.integers(0, 200, (120, 3)).astype(np.int32)
    parents = list(range(200))

    def root(vertex):
        while parents[vertex] != vertex:
            vertex = parents[vertex]
        return vertex

    for a, b, c in faces.tolist():
        parents[root(a)] = root(b)
        parents[root(b)] = root(c)
    roots = [root(a) for a, _, _ in faces.tolist()]
    order = {}
    expected = [order.setdefault(r, len(order)) for r in roots]
    assert part_numbers(faces, 200).tolist() == expected


def test_a_long_strip_is_one_part():
    n = 20000
    strip = np.stack([np.arange(n), np.arange(n) + 1, np.arange(n) + 2], axis=1).astype(np.int32)
    assert part_numbers(strip, n + 2).max() == 0


def test_vertex_normals_of_a_square_point_up():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    np.testing.assert_array_equal(vertex_normals(vertices, faces), [[0, 0, 1]] * 4)


def test_a_surface_keeps_what_it_is_told_and_nothing_unused():
    mesh = tetrahedra((0, 0, 0), (5, 0, 0))
    surface = Surface(mesh.vertices, mesh.vertices + np.float32(0.25), mesh.faces)
    kept = surface.keeping(mesh.part_of_face == 1)
    np.testing.assert_array_equal(kept.midpoints, CORNERS + np.float32([5, 0, 0]))
    np.testing.assert_array_equal(kept.at(1.0).vertices, kept.linear)
    np.testing.assert_array_equal(kept.faces, TETRAHEDRON)


@pytest.mark.parametrize("shelf", [1, 50, 1 << 19])
def test_edges_found_shelf_by_shelf_are_those_found_at_once(monkeypatch, shelf):
    monkeypatch.setattr("ctmc_addon.core.mesh.triangle_mesh.SHELF", shelf)
    values = np.random.default_rng(2).integers(0, 100, (4, 5, 6)).astype(np.uint8)
    faces = np.ascontiguousarray(marching_cubes(values, 50.5).faces.T)
    found, number = finish(finding_edges(faces, faces.max() + 3))
    ends = faces, faces[[1, 2, 0]]
    sides = np.stack([np.minimum(*ends), np.maximum(*ends)]).reshape(2, -1)
    edges, at = np.unique(sides, axis=1, return_inverse=True)
    np.testing.assert_array_equal(found, edges)
    np.testing.assert_array_equal(number, at.reshape(faces.shape))
