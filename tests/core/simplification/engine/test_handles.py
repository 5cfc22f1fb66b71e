# SPDX-License-Identifier: GPL-3.0-or-later
"""Small handles that are cut: which, how many, and what never changes."""

from dataclasses import replace

import numpy as np
import pytest
from meshes import as_mesh, assert_sound, icosphere, joined, torus

from ctmc_addon.core import distances, finish, marching_cubes
from ctmc_addon.core.mesh.face_normals import face_vectors, vertex_normals
from ctmc_addon.core.mesh.topology import edges_steps
from ctmc_addon.core.simplification.engine.edge_collapse import CollapsingMesh
from ctmc_addon.core.simplification.engine.handles import (
    handle_cuts_steps,
    least_face_cost,
    longest_loop_edge,
    pull_apart_steps,
)
from ctmc_addon.core.simplification.policy import POLICY
from ctmc_addon.core.simplification.simplify import simplification_steps

RINGS = np.linspace(0, 1, 6)[1:-1]  # on the way of a tube
FURTHER = [pytest.param(reduction, marks=pytest.mark.once) for reduction in (0.8, 0.9)]


def with_tubes(mesh, pairs):
    """The mesh with a triangular tube from one face to another for every pair."""
    vertices, faces, gone = list(mesh.vertices.astype(float)), mesh.faces.tolist(), []
    for start, end in pairs:
        ring, (d, e, f) = faces[start], faces[end]
        first, last = np.array([vertices[i] for i in ring]), np.array([vertices[i] for i in (d, f, e)])
        rings = []
        for way in RINGS:
            rings.append(list(range(len(vertices), len(vertices) + 3)))
            vertices.extend(((1 - way) * first + way * last) * (1 + 0.05 * np.sin(np.pi * way)))
        for following in (*rings, [d, f, e]):
            for i in range(3):
                j = (i + 1) % 3
                faces += [[ring[i], ring[j], following[j]], [ring[i], following[j], following[i]]]
            ring = following
        gone += [start, end]
    return as_mesh(np.array(vertices), np.delete(faces, gone, axis=0))


def noisy_sphere(count):
    """A sphere of radius 10 with so many thin handles, each between two faces that are near each other."""
    sphere = icosphere(5, 10.0)
    middle = sphere.vertices[sphere.faces].mean(axis=1)
    free, pairs = np.ones(len(sphere.vertices), bool), []
    for face in np.random.default_rng(0).permutation(len(middle))[: 4 * count]:
        usable = free[sphere.faces].all(axis=1)
        if usable[face] and len(pairs) < count:
            away = np.where(usable, np.linalg.norm(middle - middle[face], axis=1), np.inf)
            pairs.append((face, np.argmin(np.abs(away - 1.0))))
            free[sphere.faces[pairs[-1], :]] = False
    assert len(pairs) == count
    return with_tubes(sphere, pairs)


def cuts_of(mesh, longest=np.inf, locked=None):
    faces = np.ascontiguousarray(mesh.faces.T)
    edges, face_edges = finish(edges_steps(faces, len(mesh.vertices)))
    locked = np.zeros(len(mesh.vertices), bool) if locked is None else locked
    return finish(handle_cuts_steps(mesh.vertices.T, faces, edges, locked, longest)), faces, face_edges, edges


def simplification(mesh, **goal):
    steps = []
    return finish(simplification_steps(mesh, **goal), steps.append), steps[-1].message


# The cut


def test_a_cut_leaves_a_closed_manifold_with_an_euler_number_larger_by_two():
    mesh = noisy_sphere(20)
    assert mesh.euler == 2 - 2 * 20
    cuts, *arrays = cuts_of(mesh)
    assert len(cuts.loops) == 20
    faces, face_edges, edges = cuts.apply(*arrays, len(mesh.vertices))
    vertices = np.concatenate([mesh.vertices, mesh.vertices[cuts.loops.ravel()]])
    cut = as_mesh(vertices, faces.T)
    assert cut.closed
    assert cut.euler == 2
    assert cut.components == 1
    assert len(cut.faces) == len(mesh.faces) + 2 * 20
    assert cut.volume == pytest.approx(mesh.volume, rel=1e-6)
    ends = np.sort(np.take(edges, face_edges, axis=1), axis=0)  # (2, 3, F)
    assert np.array_equal(ends, np.sort(np.stack([faces, faces[[1, 2, 0]]]), axis=0))
    assert len(np.unique(np.sort(edges, axis=0), axis=1).T) == edges.shape[1] == 3 * faces.shape[1] // 2


def test_no_loop_is_cut_whose_edges_are_longer_or_whose_vertices_are_locked():
    mesh = noisy_sphere(5)
    edge = np.linalg.norm(mesh.vertices[mesh.faces[:, 0]] - mesh.vertices[mesh.faces[:, 1]], axis=1)
    assert cuts_of(mesh, longest=edge.min() / 2)[0] is None
    assert cuts_of(mesh, locked=np.ones(len(mesh.vertices), bool))[0] is None


def test_handles_are_looked_for_only_where_the_euler_number_leaves_room_for_one():
    torn = icosphere(3, 10.0)
    for mesh, room in (
        (torus(24, 12), True),
        (joined(torus(24, 12), icosphere(2)), True),
        (joined(icosphere(2), icosphere(2, 1.0, (5.0, 0.0, 0.0))), False),
        (as_mesh(torn.vertices, torn.faces[1:]), True),  # a border takes as much as a handle
    ):
        collapsing = CollapsingMesh(mesh)
        finish(collapsing.prepare_steps())
        assert np.isfinite(collapsing.least_cost_of_cut) == room


def test_the_first_loops_that_are_cut_are_as_long_as_a_share_of_the_median_edge():
    positions = np.arange(100, dtype=np.float32) ** 2 * np.array([[1.0], [0.0], [0.0]], np.float32)
    edges = np.stack([np.zeros(99 * 16, np.int32), np.repeat(np.arange(1, 100, dtype=np.int32), 16)])
    assert longest_loop_edge(least_face_cost(positions, edges)) == pytest.approx(0.6 * 50.0**2)
    rarely = replace(POLICY, least_loop=0.3)
    assert longest_loop_edge(least_face_cost(positions, edges, rarely)) == pytest.approx(0.3 * 50.0**2)


def test_a_neck_is_not_a_handle():
    first, second = icosphere(3, 1.0), icosphere(3, 1.0, (5, 0, 0))
    both = as_mesh(
        np.concatenate([first.vertices, second.vertices]),
        np.concatenate([first.faces, second.faces + len(first.vertices)]),
    )
    necks = with_tubes(both, [(0, len(first.faces))])
    assert necks.components == 1
    assert necks.euler == 2
    assert cuts_of(necks)[0] is None
    # The second tube is a handle, whichever of the two is cut.
    handle = with_tubes(both, [(0, len(first.faces)), (640, len(first.faces) + 640)])
    assert handle.euler == 0
    assert len(cuts_of(handle)[0].loops) == 1


# While the surface is simplified


@pytest.mark.parametrize("reduction", [0.5, 0.9, 0.95])
def test_a_torus_keeps_its_hole(reduction):
    found, message = simplification(torus(80, 40), reduction=reduction)
    assert found.handles_cut == 0
    assert found.mesh.euler == 0
    assert found.mesh.closed
    assert message == f"{len(found.mesh.faces)} triangles"


def test_a_sphere_loses_its_thin_handle():
    found, message = simplification(noisy_sphere(1), reduction=0.95)
    assert found.handles_cut == 1
    assert found.mesh.euler == 2
    assert found.mesh.closed
    assert_sound(found.mesh)
    assert message.endswith("; 1 small handle removed")


@pytest.mark.parametrize("reduction", [0.5, *FURTHER, 0.95, 0.99])
def test_many_handles_are_counted_and_the_triangles_are_exactly_those_asked_for(reduction):
    mesh = noisy_sphere(100)
    found, _ = simplification(mesh, reduction=reduction)
    asked = round((1 - reduction) * len(mesh.faces))
    assert asked - 1 <= len(found.mesh.faces) <= asked
    assert found.mesh.euler == mesh.euler + 2 * found.handles_cut
    assert found.mesh.closed
    assert found.mesh.components == 1
    assert_sound(found.mesh)


def test_where_handles_can_go_the_rest_is_nearer():
    mesh = noisy_sphere(100)
    found, _ = simplification(mesh, target_faces=800)
    assert found.handles_cut > 90
    radius = np.linalg.norm(found.mesh.vertices[np.unique(found.mesh.faces)], axis=1)
    assert abs(np.median(radius) - 10) < 0.2
    assert distances(icosphere(5, 10.0).vertices, found.mesh).mean() < 0.15


@pytest.fixture(scope="module")
def sponge():
    """Smoothed noise at a threshold: hundreds of small handles, closed, no two vertices at the same place."""
    noise = np.random.default_rng(1).normal(size=(40, 40, 40))
    noise = sum(np.roll(noise, shift, axis) for axis in range(3) for shift in (-1, 0, 1))
    samples = np.pad(noise / noise.std(), 1, constant_values=-3.0).astype(np.float32)
    mesh = marching_cubes(samples, 0.5)
    assert mesh.closed
    assert len(np.unique(mesh.vertices, axis=0)) == len(mesh.vertices)
    return mesh


@pytest.mark.parametrize("reduction", [0.5, *FURTHER, pytest.param(0.95, marks=pytest.mark.once)])
def test_the_two_sides_of_a_cut_are_not_at_the_same_place(sponge, reduction):
    found, _ = simplification(sponge, reduction=reduction)
    assert found.handles_cut > 20
    places, number = np.unique(found.mesh.vertices, axis=0, return_inverse=True)
    assert len(places) == len(found.mesh.vertices)
    # As a file that stores triangles by position reads it back.
    welded = as_mesh(places, number.reshape(-1)[found.mesh.faces])
    assert_sound(welded)
    assert welded.closed


def test_no_triangle_turns_over_where_a_cut_is_pulled_apart():
    mesh = noisy_sphere(60)
    cuts, *arrays = cuts_of(mesh, longest=1.0)
    count = len(mesh.vertices)
    faces, _, edges = cuts.apply(*arrays, count)
    before = np.concatenate([mesh.vertices, mesh.vertices[cuts.loops.ravel()]])
    after = before.T.copy()
    finish(pull_apart_steps(after, faces, edges, cuts.loops))
    moved = np.linalg.norm(after.T - before, axis=1)
    assert (np.flatnonzero(moved) == np.union1d(cuts.loops, np.arange(count, len(before)))).all()
    assert moved.max() <= 0.1 * 1.001
    assert (after[:, cuts.loops.ravel()] != after[:, count:]).any(axis=0).all()
    assert (face_vectors(before, faces.T) * face_vectors(after.T, faces.T)).sum(axis=1).min() >= 0


@pytest.mark.once
def test_within_a_maximum_error_every_handle_stays():
    mesh = noisy_sphere(10)
    found, _ = simplification(mesh, max_error=1.0)
    assert found.handles_cut == 0
    assert found.mesh.euler == mesh.euler


def test_normals_are_carried_along():
    mesh = noisy_sphere(20)
    mesh = as_mesh(mesh.vertices, mesh.faces, vertex_normals(mesh.vertices, mesh.faces))
    found, _ = simplification(mesh, reduction=0.95)
    assert found.handles_cut > 0
    assert found.mesh.normals.shape == found.mesh.vertices.shape
    assert np.allclose(np.linalg.norm(found.mesh.normals, axis=1), 1, atol=1e-5)


@pytest.mark.once
def test_the_same_input_gives_the_same_bytes_in_any_unit():
    mesh = noisy_sphere(60)
    one, two = (simplification(mesh, reduction=0.93)[0] for _ in range(2))
    small, _ = simplification(as_mesh(np.ldexp(mesh.vertices, -30), mesh.faces), reduction=0.93)
    assert one.mesh.vertices.tobytes() == two.mesh.vertices.tobytes()
    assert one.mesh.faces.tobytes() == two.mesh.faces.tobytes() == small.mesh.faces.tobytes()
    assert one.handles_cut == two.handles_cut == small.handles_cut > 0
