# SPDX-License-Identifier: GPL-3.0-or-later
"""Collapses within a maximum error that are undone: what remains is sound, and the check sees what exceeds."""

import tracemalloc

import numpy as np
import pytest
from meshes import icosphere, non_manifold_edges

from ctmc_addon.core import TriangleMesh, distances, finish, marching_cubes, simplify
from ctmc_addon.core.simplification.bounds.error_check import ErrorCheck
from ctmc_addon.core.simplification.bounds.uncrossing import restored
from ctmc_addon.core.simplification.engine.edge_collapse import CollapsingMesh
from ctmc_addon.core.simplification.whole import Goal


def bumpy():
    """A ball with hills, about 5,000 triangles."""
    z, y, x = (np.indices((26, 26, 26)) - 12.5) * 0.8
    return marching_cubes(8 + np.sin(x) * np.sin(y) * np.sin(z) - np.sqrt(x * x + y * y + z * z), 0.0, normals=False)


def ring():
    """A torus, about 4,000 triangles."""
    z, y, x = np.indices((12, 30, 30)) - np.array([5.5, 14.5, 14.5])[:, None, None, None]
    return marching_cubes(4.0 - np.sqrt((np.sqrt(x * x + y * y) - 9.5) ** 2 + z * z), 0.0, normals=False)


def sampled(mesh):
    """Middles of all faces cut in four, and all vertices."""
    a, b, c = mesh.vertices[mesh.faces].astype(float).transpose(1, 0, 2)
    shares = [(1, 1, 1), (4, 1, 1), (1, 4, 1), (1, 1, 4), (1, 1, 0), (0, 1, 1), (1, 0, 1)]
    return np.concatenate([mesh.vertices, *((i * a + j * b + k * c) / (i + j + k) for i, j, k in shares)])


def largest_error(mesh, small):
    return max(distances(sampled(mesh), small).max(), distances(sampled(small), mesh).max())


def collapsed(mesh, max_error, rounds=60):
    """A mesh in which some rounds of edges have collapsed, its bound not yet checked."""
    work = CollapsingMesh(mesh, max_error)
    finish(work.prepare_steps())
    for _ in range(rounds):
        if finish(work.can_collapse_steps()):
            finish(work.collapse_round_steps(len(mesh.faces)))
    return work


@pytest.mark.parametrize("share", [0.001, 0.1, 1.0])
@pytest.mark.parametrize("shape", [bumpy, ring])
def test_whatever_is_undone_the_surface_stays_closed_and_manifold(shape, share):
    mesh = shape()
    work = collapsed(mesh, 0.5)
    count = sum(each.count for each in work.log.rounds)
    assert len(work.mesh().faces) == len(mesh.faces) - 2 * count
    draw, moved, left = np.random.default_rng(1), np.zeros(len(work.locked), bool), np.arange(count)
    for _ in range(3):
        some = draw.choice(left, max(1, round(share * len(left))), replace=False)
        _, moved = restored(work, work.log, work.log.undo(some), moved)
        left = np.unique(work.log.last_changes(np.arange(len(mesh.faces))))
        left = left[left >= 0]
        again = work.mesh()
        assert again.closed
        assert not len(non_manifold_edges(again))
        rows = np.sort(again.faces, axis=1)
        assert (np.diff(rows, axis=1) > 0).all()
        assert len(np.unique(rows, axis=0)) == len(rows)
        assert again.euler == mesh.euler
        assert len(again.faces) > len(mesh.faces) - 2 * count
        if not len(left):
            break
    if share == 1.0:
        order = np.argsort(work.log.face_number)
        assert (work.positions.T[work.faces.T[order]] == work.scale * mesh.vertices[mesh.faces]).all()


def test_what_nothing_was_undone_at_stays():
    work = collapsed(bumpy(), 0.5)
    before = work.mesh()
    last = sum(each.count for each in work.log.rounds) - 1
    back, _ = restored(work, work.log, work.log.undo(np.array([last])), np.zeros(len(work.locked), bool))
    assert 0 < back.sum() < 0.5 * len(back)
    corners = {face.tobytes() for face in before.vertices[before.faces]}
    kept = np.flatnonzero(~back)
    assert all((work.positions.T[face] / work.scale).tobytes() in corners for face in work.faces.T[kept])


def checked(original, surface, limit):
    check = ErrorCheck(limit)
    finish(check.prepare_steps(np.ascontiguousarray(original.vertices.T), np.ascontiguousarray(original.faces.T)))
    finish(check.compare_with_steps(np.ascontiguousarray(surface.vertices.T), np.ascontiguousarray(surface.faces.T)))
    faces = finish(check.faces_exceeding_steps(np.arange(len(surface.faces))))
    return faces, finish(check.original_exceeding_steps(np.arange(len(original.faces))))


def test_a_face_that_leaves_the_bound_between_its_corners_is_found():
    """All corners lie on both surfaces; only the middles of large faces, or of a ridge, are apart."""
    mesh = bumpy()
    small = simplify(mesh, reduction=0.97)
    exact = largest_error(mesh, small)
    faces, original = checked(mesh, small, 1.01 * exact)
    assert len(faces) + len(original) <= 2  # it may see what samples miss
    faces, original = checked(mesh, small, 0.9 * exact)
    assert len(faces) + len(original) > 0
    assert len(faces) < 0.2 * len(small.faces)


def test_the_same_surface_cut_otherwise_is_near_everywhere():
    y, x = np.divmod(np.arange(30 * 30), 30)
    corner = np.flatnonzero((x < 29) & (y < 29))
    faces = np.concatenate(
        [np.stack([corner, corner + 1, corner + 30], axis=1), np.stack([corner + 1, corner + 31, corner + 30], axis=1)]
    )
    flat = TriangleMesh(np.stack([x, y, 0 * x], axis=1).astype(np.float32), faces.astype(np.int32))
    two = TriangleMesh(flat.vertices[[0, 29, 870, 899]], np.array([[0, 1, 3], [0, 3, 2]], np.int32))
    assert [len(found) for found in checked(flat, two, 1e-3)] == [0, 0]
    lifted = TriangleMesh(two.vertices + np.float32([0, 0, 2e-3]), two.faces)
    assert [len(found) for found in checked(flat, lifted, 1e-3)] == [2, len(flat.faces)]


@pytest.mark.once
@pytest.mark.parametrize("edges", [0.5, 4.0])
def test_memory_stays_within_what_is_asked_for_however_many_samples_a_triangle_gets(edges):
    mesh = icosphere(5)
    a, b, _ = mesh.vertices[mesh.faces].transpose(1, 0, 2)
    max_error = edges * float(np.linalg.norm(a - b, axis=1).mean())
    tracemalloc.start()
    try:
        small = simplify(mesh, max_error=max_error)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert len(small.faces) < len(mesh.faces) / 50
    assert peak <= Goal(max_error=max_error).bytes_at_once(len(mesh.faces))
