# SPDX-License-Identifier: GPL-3.0-or-later
"""Simplified surfaces do not cross themselves: what made a crossing is undone exactly, and the count still holds."""

import numpy as np
import pytest
from meshes import assert_sound, icosphere, joined

from ctmc_addon.core import Budget, TriangleMesh, finish, marching_cubes, simplify
from ctmc_addon.core.mesh import self_intersections
from ctmc_addon.core.simplification import whole
from ctmc_addon.core.simplification.batches import in_batches
from ctmc_addon.core.simplification.bounds.crossing_check import crosses_steps
from ctmc_addon.core.simplification.bounds.uncrossing import restored, uncross_steps
from ctmc_addon.core.simplification.clustering import clustered_steps
from ctmc_addon.core.simplification.engine.collapse_log import CollapseLog
from ctmc_addon.core.simplification.engine.collapses import Collapses
from ctmc_addon.core.simplification.engine.edge_collapse import CollapsingMesh
from ctmc_addon.core.simplification.simplify import simplification_steps


def leaves(layers=3, width=34):
    """Thin wavy leaves close above each other, about 13,000 triangles, with noise."""
    z, y, x = np.indices((6 * layers, width, width)).astype(float)
    noise = np.random.default_rng(5).standard_normal(z.shape)
    values = np.sin((z + 1.5 * np.sin(x / 3.0) * np.cos(y / 4.0)) * (2 * np.pi / 4.0)) + 0.35 * noise
    return marching_cubes(values, 0.2, normals=False, close_border=True)


@pytest.fixture(scope="module")
def full():
    mesh = leaves()
    assert len(mesh.faces) > 10_000
    assert not len(self_intersections(mesh.vertices, mesh.faces))
    return mesh


def crossings(mesh):
    return len(self_intersections(mesh.vertices, mesh.faces))


def no_test(mesh, hold):
    return False
    yield


@pytest.mark.parametrize("reduction", [0.5, 0.9])
def test_a_simplified_surface_does_not_cross_itself_and_has_the_count(full, reduction, monkeypatch):
    result = finish(simplification_steps(full, reduction))
    target = round(len(full.faces) * (1 - reduction))
    assert target - 1 <= len(result.mesh.faces) <= target
    assert crossings(result.mesh) == result.self_intersections == 0
    assert_sound(result.mesh)
    monkeypatch.setattr(whole, "uncross_steps", no_test)
    assert crossings(simplify(full, reduction)) > 0


def test_where_triangles_crossed_collapses_are_tested_and_vertices_stay_free():
    mesh = CollapsingMesh(leaves(2, 24))
    finish(whole.collapse_steps(mesh, mesh.face_count // 4))
    assert mesh.crossing_count == 0
    assert mesh.locked.sum() < 0.1 * mesh.doubtful.sum()


@pytest.mark.parametrize("reduction", [0.9, 0.97])
def test_what_crossed_before_and_has_gone_is_not_counted(reduction):
    pairs = [icosphere(2, 0.05, (1.5 * number + shift, 3.0, 0.0)) for number in range(5) for shift in (0.0, 0.05)]
    mesh = joined(icosphere(4), *pairs)
    assert crossings(mesh) > 100
    result = finish(simplification_steps(mesh, reduction))
    assert result.self_intersections == crossings(result.mesh)


def fans(count, distance=1.0):
    """Fans of six triangles round vertices 7 k, one above the other: positions (3, V) and faces (3, F)."""
    positions = np.zeros((3, 7 * count), np.float32)
    angles = np.arange(6) * np.pi / 3
    for number in range(count):
        rim = slice(7 * number + 1, 7 * number + 7)
        positions[0, rim], positions[1, rim] = np.cos(angles), np.sin(angles)
        positions[2, 7 * number : 7 * number + 7] = number * distance
    fan = np.array([[0, 1 + k, 1 + (k + 1) % 6] for k in range(6)], np.int32)
    return positions, np.concatenate([fan + 7 * number for number in range(count)]).T


def raised(faces, targets):
    """A collapse of every fan's first edge to its target."""
    count = len(targets)
    middle = 7 * np.arange(count, dtype=np.int32)
    owner = np.repeat(np.arange(count, dtype=np.int32), 6)
    gone = (faces == middle[owner] + 1).any(axis=0)
    target = np.array(targets, np.float32).T
    return Collapses(np.arange(count), middle, middle + 1, target, np.arange(6 * count), owner, gone)


@pytest.mark.parametrize(("height", "crosses"), [(0.5, False), (1.5, True)])
@pytest.mark.parametrize("asked", [False, True])
def test_a_collapse_through_another_triangle_is_refused_where_it_is_asked_for(height, crosses, asked):
    positions, faces = fans(2)
    collapses = raised(faces[:, :6], [(0.2, 0.1, height)])
    flags = np.ones(12, bool), np.array([True]), np.array([asked])
    assert finish(crosses_steps(collapses, positions, faces, *flags)).tolist() == [crosses and asked]


def test_a_collapse_is_refused_that_meets_what_another_leaves_where_it_was():
    # The middle of the lower fan goes up to 1.5, that of the upper from 1 to 3: both together cross nothing.
    positions, faces = fans(2)
    positions[2, 8:] = 3.0  # the rim of the upper fan
    collapses = raised(faces, [(0.2, 0.1, 1.5), (0.2, 0.1, 3.0)])
    alive, both = np.ones(12, bool), np.ones(2, bool)
    assert not finish(crosses_steps(collapses, positions, faces, alive, both, both)).any()
    lower, upper = np.array([True, False]), np.array([False, True])
    assert finish(crosses_steps(collapses, positions, faces, alive, lower, upper)).tolist() == [True, False]


def test_collapses_that_are_tested_leave_nothing_to_undo():
    mesh = CollapsingMesh(leaves(2, 24))
    target = mesh.face_count // 4
    finish(whole.collapse_steps(mesh, target))
    assert mesh.doubtful.any()
    assert not mesh.log.untested
    assert crossings(mesh.mesh()) == 0


@pytest.mark.once
def test_batches_and_clusters_do_not_cross_and_threads_change_nothing():
    full = leaves(3, 24)
    budgets = [Budget(threads=threads, whole_faces=3000) for threads in (1, 3)]
    results = [finish(simplification_steps(full, 0.9, budget=budget)) for budget in budgets]
    assert crossings(results[0].mesh) == results[0].self_intersections == 0
    assert len(results[0].mesh.faces) <= 0.6 * len(full.faces)
    first, second = (result.mesh.vertices.tobytes() + result.mesh.faces.tobytes() for result in results)
    assert first == second


def test_clusters_alone_make_no_crossing(full):
    batch = in_batches.Batch(full, np.arange(len(full.vertices)))
    clustered = finish(clustered_steps(batch, 2000))[0].mesh
    assert len(clustered.faces) < 0.6 * len(full.faces)
    assert crossings(clustered) == 0


@pytest.mark.once
def test_within_a_maximum_error_nothing_crosses():
    mesh = leaves(2, 20)
    result = finish(simplification_steps(mesh, max_error=0.8))
    assert len(result.mesh.faces) < 0.7 * len(mesh.faces)
    assert crossings(result.mesh) == result.self_intersections == 0


def test_a_surface_that_crosses_itself_is_simplified_and_its_crossings_are_counted():
    balls = joined(icosphere(4), icosphere(4, center=(1.0, 0.1, 0.2)))
    assert crossings(balls) > 100
    steps, messages = simplification_steps(balls, 0.5), []
    result = finish(steps, lambda step: messages.append(step.message))
    assert len(result.mesh.faces) == len(balls.faces) // 2
    assert crossings(result.mesh) == result.self_intersections > 50
    assert f"pairs of triangles that cross each other: {result.self_intersections}" in messages[-1]


def test_what_is_not_simplified_is_not_tested():
    assert finish(simplification_steps(icosphere(1), 0.0)).self_intersections is None


def changed_mesh(full, rounds):
    """A mesh after some rounds of collapses and cuts, and its log."""
    mesh = CollapsingMesh(full)
    finish(mesh.prepare_steps())
    for _ in range(rounds):
        finish(mesh.cut_handles_steps())
        finish(mesh.collapse_round_steps(len(full.faces)))
    assert mesh.log is not None
    return mesh, mesh.log


def triangles_of(mesh):
    """All triangles as corner positions, each from its lowest corner on, sorted."""
    faces = mesh.faces[:, mesh.faces[0] != mesh.dummy]
    corners = mesh.positions.T[faces.T]  # (f, 3, 3)
    keys = np.array([[tuple(corner) for corner in triangle] for triangle in corners.tolist()])
    first = np.lexsort(keys.reshape(len(keys), 3, 3).transpose(2, 0, 1)[::-1], axis=-1)[:, 0]
    turned = np.stack([np.roll(triangle, -start, axis=0) for triangle, start in zip(keys, first, strict=True)])
    return turned.reshape(-1, 9)[np.lexsort(turned.reshape(-1, 9).T)]


@pytest.mark.once
def test_undoing_every_change_brings_back_the_surface_as_it_was(full):
    mesh, log = changed_mesh(full, 30)
    count = sum(each.count for each in log.rounds)
    assert mesh.face_count < 0.5 * len(full.faces)
    assert mesh.handles_cut > 0
    undone = log.undo(np.arange(count))
    restored(mesh, log, undone, np.zeros(len(mesh.locked), bool))
    start = CollapsingMesh(full)
    assert mesh.face_count == start.face_count
    assert mesh.handles_cut == 0
    assert (triangles_of(mesh) == triangles_of(start)).all()


@pytest.mark.once
def test_undoing_some_changes_leaves_a_sound_surface_and_others_as_they_are(full):
    mesh, log = changed_mesh(full, 6)
    before = {tuple(row) for row in triangles_of(mesh)}
    some = np.random.default_rng(2).choice(sum(each.count for each in log.rounds), 30, replace=False)
    restored(mesh, log, log.undo(some), np.zeros(len(mesh.locked), bool))
    after = {tuple(row) for row in triangles_of(mesh)}
    assert len(after - before) > 30
    assert len(after & before) > 0.5 * len(before)
    assert_sound(mesh.mesh())


def test_nothing_is_tested_twice_where_nothing_has_changed():
    mesh = CollapsingMesh(icosphere(3))
    finish(mesh.prepare_steps())
    assert finish(uncross_steps(mesh, hold=True)) is False
    assert mesh.crossing_count == 0
    assert isinstance(mesh.log, CollapseLog)
    assert list(uncross_steps(mesh, hold=True)) == []


def test_a_mesh_is_the_same_in_any_unit(full):
    small = TriangleMesh(full.vertices * np.float32(2.0**-10), full.faces)
    one, other = simplify(full, 0.9), simplify(small, 0.9)
    assert one.faces.tobytes() == other.faces.tobytes()
    assert (one.vertices * np.float32(2.0**-10)).tobytes() == other.vertices.tobytes()
