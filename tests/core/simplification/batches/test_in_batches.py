# SPDX-License-Identifier: GPL-3.0-or-later
"""Simplification in batches, of meshes and of pieces: the same bytes, the promises of `simplify`, and its quality."""

import hashlib
import threading
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from meshes import assert_sound, boundary_edges, icosphere, joined, layered, layered_pieces, non_manifold_edges, torus

from ctmc_addon.core import Budget, Step, TriangleMesh, finish, marching_cubes, simplify
from ctmc_addon.core.errors import MemoryLimitError, MeshError, SettingsError
from ctmc_addon.core.mesh import surface_distance
from ctmc_addon.core.mesh.intersections import self_intersections
from ctmc_addon.core.mesh.triangle_mesh import SurfacePiece
from ctmc_addon.core.simplification.batches import in_batches
from ctmc_addon.core.simplification.batches.pieces import (
    Batch,
    batches_steps,
    crossing_batches_steps,
    faces_near_other_batches,
)
from ctmc_addon.core.simplification.simplify import simplification_steps, simplified_pieces_steps
from ctmc_addon.core.simplification.whole import Goal

SMALL = Budget(whole_faces=4000)


def stream(mesh, cuts):
    """Pieces of a mesh in layers, cut before these layers, as their maker yields them."""
    for number, piece in enumerate(layered_pieces(mesh, cuts)):
        yield Step(number / (len(cuts) + 1))
        yield piece
    return "info"


@cache
def foam(size=48, wavelength=24.0, noise=0.0, **options):
    z, y, x = np.indices((size, size, size), np.float32) * np.float32(2 * np.pi / wavelength)
    values = np.sin(x) * np.cos(y) + np.sin(1.03 * y) * np.cos(z) + np.sin(z) * np.cos(0.9 * x)
    values += np.random.default_rng(1).normal(0, noise, values.shape).astype(np.float32)
    return layered(marching_cubes(values, 0.4, **{"close_border": True, "normals": False, **options}))


def reduced(mesh, budget=SMALL, **goal):
    return finish(simplification_steps(mesh, budget=budget, **goal))


def reduced_pieces(mesh, cuts, budget=SMALL, **goal):
    return finish(simplified_pieces_steps(stream(mesh, cuts), Goal(**goal), budget))


def in_pieces(mesh, **given):
    return reduced_pieces(mesh, range(4, 20, 4), **given).simplification


def digest(simplification):
    mesh = simplification.mesh
    normals = b"" if mesh.normals is None else mesh.normals.tobytes()
    return hashlib.sha256(mesh.vertices.tobytes() + mesh.faces.tobytes() + normals).hexdigest()


def batches_of(pieces, least):
    return [item for item in batches_steps(pieces, least, 0) if isinstance(item, Batch)]


def random_cuts(seed, layers):
    return np.flatnonzero(np.random.default_rng(seed).random(layers) < 0.3)


@pytest.mark.once
@pytest.mark.parametrize(("goal", "noise"), [({"reduction": 0.9}, 0.25), ({"target_faces": 501}, 0.0)])
def test_a_mesh_and_its_pieces_give_the_same_bytes_with_any_cut_threads_and_memory(goal, noise):
    mesh, small = foam(16, 12.0, noise, normals=True), Budget(whole_faces=2000)
    assert len(mesh.faces) > 5 * 500
    held = [
        digest(reduced(mesh, replace(small, threads=threads, bytes=memory), **goal))
        for threads, memory in ((1, None), (3, 1 << 20))
    ]
    pieces = [
        digest(reduced_pieces(mesh, cuts, replace(small, threads=threads), **goal).simplification)
        for cuts, threads in ((range(-1, 18), 1), (random_cuts(0, 16), 3))
    ]
    assert set(held + pieces) == {held[0]}


@pytest.mark.once
def test_a_maximum_error_too_gives_the_same_bytes():
    mesh, small = foam(12, 14.0), Budget(threads=1, whole_faces=1600)
    assert len(mesh.faces) > 4 * 400
    pieces = reduced_pieces(mesh, range(-1, 14), replace(small, threads=3), max_error=0.5)
    assert digest(pieces.simplification) == digest(reduced(mesh, small, max_error=0.5))


def test_batches_do_not_hang_on_where_pieces_are_cut():
    mesh = foam(24, 12.0, 0.25)
    expected = None
    for cuts in ((), range(-1, 26), random_cuts(2, 24), random_cuts(3, 24)):
        batches = batches_of(stream(mesh, cuts), 1500)
        numbers = [batch.numbers[batch.mesh.faces].tobytes() for batch in batches]
        expected = expected or numbers
        assert numbers == expected
        assert len(batches) > 4
        assert all(batch.face_count >= 1500 for batch in batches[:-1])
    assert b"".join(expected) == mesh.faces.astype(np.int64).tobytes()


def test_a_triangle_that_lies_in_the_next_layer_ends_no_batch_before_it_is_known_what_follows():
    # Two layers of four vertices; the third triangle has its corners in the upper one, and so has the fifth.
    points = np.arange(24, dtype=np.float32).reshape(8, 3)
    faces = np.array([[0, 1, 2], [0, 1, 4], [5, 6, 7], [2, 3, 5], [1, 2, 5], [4, 5, 7]], np.int32)
    for rest in ([[4, 6, 7]], [[6, 5, 7]]):
        whole = np.concatenate([faces, np.array(rest, np.int32)])
        held = SurfacePiece(points, whole)
        cut = [SurfacePiece(points[:4], whole[:5]), SurfacePiece(points[4:], whole[5:] - 4)]
        first, second = (
            [batch.numbers[batch.mesh.faces].tolist() for batch in batches_of((p for p in pieces), 5)]
            for pieces in ([held], cut)
        )
        assert first == second == [whole.tolist()]
    faces = np.array([[0, 1, 4], [1, 2, 5], [2, 3, 5], [5, 6, 7]], np.int32)
    pieces = [SurfacePiece(points[:4], faces[:3]), SurfacePiece(points[4:], faces[3:] - 4)]
    assert [batch.face_count for batch in batches_of((p for p in pieces), 2)] == [2, 2]


@pytest.mark.once
def test_a_mesh_in_no_order_is_cut_into_bands():
    mesh = foam(16)
    shuffled = np.random.default_rng(4).permutation(len(mesh.faces))
    mesh = TriangleMesh(mesh.vertices, mesh.faces[shuffled])
    first, second = (reduced(mesh, Budget(threads, whole_faces=330), reduction=0.9) for threads in (1, 3))
    assert digest(first) == digest(second)
    assert len(first.mesh.faces) in (round(0.1 * len(mesh.faces)), round(0.1 * len(mesh.faces)) - 1)
    assert first.mesh.closed
    assert_sound(first.mesh)


@pytest.mark.once
def test_up_to_whole_faces_a_surface_is_simplified_as_a_whole():
    mesh = foam(16)
    count = len(mesh.faces)
    whole = digest(reduced(mesh, Budget(), reduction=0.8))
    assert digest(reduced(mesh, Budget(whole_faces=count), reduction=0.8)) == whole
    assert digest(reduced_pieces(mesh, (3, 9, 10), Budget(whole_faces=count), reduction=0.8).simplification) == whole
    assert digest(reduced(mesh, Budget(whole_faces=count // 3), reduction=0.8)) != whole


@pytest.mark.parametrize("goal", [{"reduction": 0.0}, {"target_faces": 100_000}])
def test_where_nothing_shall_go_the_surface_stays_as_it_is(goal):
    mesh = foam(32)
    small = Budget(whole_faces=1000)
    assert reduced(mesh, small, **goal).mesh is mesh
    same = reduced_pieces(mesh, (3, 9, 10), small, **goal).simplification.mesh
    assert same.vertices.tobytes() == mesh.vertices.tobytes()
    assert same.faces.tobytes() == mesh.faces.tobytes()


@pytest.mark.once
@pytest.mark.parametrize(
    ("goal", "noise", "whole_faces"),
    [
        ({"reduction": 0.9}, 0.0, 2400),
        ({"reduction": 0.9}, 0.25, 2200),
        ({"reduction": 0.3}, 0.0, 2400),
        ({"target_faces": 701}, 0.0, 2400),
    ],
)
def test_the_goal_is_met_exactly_and_every_seam_is_closed(goal, noise, whole_faces):
    mesh = foam(24 if noise else 28, noise=noise)
    assert len(mesh.faces) > 5 * whole_faces
    result = reduced(mesh, Budget(whole_faces=whole_faces), **goal)
    wanted = goal.get("target_faces") or round(len(mesh.faces) * (1 - goal["reduction"]))
    assert wanted - 1 <= len(result.mesh.faces) <= wanted
    assert_sound(result.mesh)
    assert result.mesh.closed
    assert not len(non_manifold_edges(result.mesh))
    if not noise:  # nothing small that may go
        assert result.mesh.euler == mesh.euler + 2 * result.handles_cut
        assert result.mesh.components == mesh.components - result.collapsed.count
        assert result.mesh.volume == pytest.approx(mesh.volume, rel=0.02)


@pytest.mark.once
def test_batches_whose_triangles_lie_along_seams_are_merged_before_the_last_pass(monkeypatch):
    """Of 36,864 triangles 1,844 are wanted, and 84 % would be held: a batch is two layers, and its seams stay."""
    z, y, x = (np.cos(2 * np.pi / 32 * np.arange(count)) for count in (40, 64, 64))
    values = 127.5 + 42.5 * (z[:, None, None] + y[:, None] + x)
    mesh = layered(marching_cubes(values.astype(np.uint8), 150, normals=False))
    held = []
    regions = in_batches.regions

    def noted(surface, most, axis):
        held.append(surface.face_count)
        return regions(surface, most, axis)

    monkeypatch.setattr(in_batches, "regions", noted)
    results = [reduced(mesh, Budget(threads, whole_faces=6000), reduction=0.95) for threads in (1, 2)]
    assert max(held) < 0.3 * len(mesh.faces)
    assert digest(results[0]) == digest(results[1])
    assert len(results[0].mesh.faces) in (1842, 1843)
    assert_sound(results[0].mesh)
    assert not results[0].self_intersections


@pytest.mark.once
@pytest.mark.parametrize(("goal", "whole_faces"), [({"reduction": 0.9}, 3000), ({"max_error": 0.3}, 4000)])
def test_a_layer_much_larger_than_a_batch_is_simplified_in_bands(goal, whole_faces, monkeypatch):
    sizes = []
    reduce_batch_steps = in_batches.reduce_batch_steps

    def noted(batch, *rest, **more):
        if "by_box" not in more:  # of merged batches and regions
            sizes.append(batch.face_count)
        return reduce_batch_steps(batch, *rest, **more)

    monkeypatch.setattr(in_batches, "reduce_batch_steps", noted)
    mesh = foam(28 if "reduction" in goal else 20)
    mesh = TriangleMesh(mesh.vertices, mesh.faces[::-1].copy())  # as if it were one layer
    result = reduced(mesh, Budget(1, whole_faces=whole_faces), **goal)
    batch = whole_faces // 4
    assert len(mesh.faces) > 5 * batch
    assert max(sizes[:4]) < 1.1 * batch
    if "reduction" in goal:
        wanted = round(len(mesh.faces) * 0.1)
        assert wanted - 1 <= len(result.mesh.faces) <= wanted
    else:
        assert surface_distance(result.mesh, mesh).largest <= 0.3
        assert surface_distance(mesh, result.mesh).largest <= 0.3
    assert_sound(result.mesh)
    assert result.mesh.closed
    assert result.mesh.euler == mesh.euler + 2 * result.handles_cut


@pytest.mark.once
@pytest.mark.parametrize("noise", [0.0, 0.25])
def test_the_surface_is_as_near_as_that_of_a_whole_mesh(noise):
    mesh = foam(32 if noise else 48, noise=noise)
    budget = Budget(whole_faces=len(mesh.faces) * 4 // 7)
    whole, batched = simplify(mesh, reduction=0.9), reduced(mesh, budget, reduction=0.9).mesh
    assert surface_distance(batched, mesh).mean < 1.1 * surface_distance(whole, mesh).mean


@pytest.mark.once
def test_regions_that_cross_each_other_are_simplified_again_as_one(monkeypatch):
    rounds, sizes = [], []
    reduce_batch_steps = in_batches.reduce_batch_steps

    def crossing_steps(batches):
        rounds.append((list(sizes), [batch.face_count for batch in batches]))
        sizes.clear()
        return np.array([[0, 1]] if len(rounds) == 1 else np.empty((0, 2)), np.int64)
        yield

    def noted(batch, *rest, **more):
        sizes.append(batch.face_count)
        return reduce_batch_steps(batch, *rest, **more)

    monkeypatch.setattr(in_batches, "crossing_batches_steps", crossing_steps)
    monkeypatch.setattr(in_batches, "reduce_batch_steps", noted)
    mesh = foam(28)
    result = reduced(mesh, Budget(1, whole_faces=len(mesh.faces) // 2), reduction=0.9)
    (before, left), (again, left_again) = rounds[:2]
    first, second, *others = before[-len(left) :]
    assert len(left) >= 3
    assert again == [first + second]
    assert left_again[1:] == left[2:]
    assert len(others) == len(left_again) - 1
    assert len(result.mesh.faces) in (round(0.1 * len(mesh.faces)), round(0.1 * len(mesh.faces)) - 1)
    assert result.mesh.closed
    assert result.mesh.euler == mesh.euler + 2 * result.handles_cut


def test_triangles_of_two_batches_that_cross_are_found_and_those_of_one_are_not():
    crossing = joined(icosphere(2, 5.0), icosphere(2, 5.0, (20, 0, 0)), icosphere(2, 5.0, (24, 0, 0)))
    other = icosphere(2, 5.0, (6, 1, 0))
    batches = [
        Batch(mesh, np.arange(first, first + len(mesh.vertices)))
        for first, mesh in ((0, crossing), (10_000, other), (20_000, icosphere(2, 5.0, (60, 0, 0))))
    ]
    pairs = finish(crossing_batches_steps(batches))
    alone = [len(self_intersections(batch.mesh.vertices, batch.mesh.faces)) for batch in batches]
    both = joined(crossing, other)
    assert np.unique(pairs, axis=0).tolist() in ([[0, 1]], [[0, 1], [1, 0]])
    assert alone[1:] == [0, 0]
    assert len(pairs) == len(self_intersections(both.vertices, both.faces)) - alone[0] > 0


@pytest.mark.once
def test_a_maximum_error_holds_both_ways():
    mesh = foam(14, 14.0, 0.1)
    assert len(mesh.faces) > 2 * 1200
    result = reduced(mesh, Budget(whole_faces=1200), max_error=0.4).mesh
    assert result.closed
    assert not len(non_manifold_edges(result))
    assert len(result.faces) < 0.5 * len(mesh.faces)
    assert surface_distance(result, mesh).largest <= 0.4
    assert surface_distance(mesh, result).largest <= 0.4


@pytest.mark.once
def test_an_open_border_stays_where_it_is():
    mesh = foam(24, close_border=False)
    assert len(boundary_edges(mesh))
    result = reduced(mesh, Budget(whole_faces=1000), reduction=0.7).mesh
    border = {mesh.vertices[vertex].tobytes() for vertex in boundary_edges(mesh).ravel()}
    assert {result.vertices[vertex].tobytes() for vertex in boundary_edges(result).ravel()} <= border
    assert len(boundary_edges(result)) == len(boundary_edges(mesh))
    assert not len(non_manifold_edges(result))


@pytest.mark.once
def test_normals_are_carried_along_and_stay_of_length_one():
    result = reduced(foam(20, normals=True), Budget(whole_faces=1000), reduction=0.8).mesh
    assert result.normals.shape == result.vertices.shape
    assert np.allclose((result.normals**2).sum(axis=1), 1, atol=1e-5)


def test_a_component_across_a_seam_stays_one_piece():
    mesh = layered(joined(icosphere(4, 20.0), icosphere(3, 6.0, (60, 0, 0)), torus(40, 20)))
    result = reduced(mesh, Budget(whole_faces=1200), reduction=0.9).mesh
    assert result.closed
    assert (result.components, result.euler) == (mesh.components, mesh.euler)


@pytest.mark.once
def test_what_is_done_is_handed_on_with_what_the_maker_returned():
    mesh = foam(20)
    steps, result = [], None
    generator = simplified_pieces_steps(stream(mesh, range(4, 20, 4)), Goal(0.9), Budget(whole_faces=1200))
    while result is None:
        try:
            steps.append(next(generator))
        except StopIteration as end:
            result = end.value
    assert result.info == "info"
    assert result.full_faces == len(mesh.faces)
    assert all(0 <= step.fraction <= 1 for step in steps)
    assert steps[-1].message.startswith(f"{len(result.simplification.mesh.faces)} triangles")


def test_closing_ends_the_maker_of_the_pieces():
    ended = []

    def pieces():
        try:
            yield from stream(foam(32), range(4, 32, 4))
        finally:
            ended.append(True)

    before = threading.active_count()
    steps = simplified_pieces_steps(pieces(), Goal(0.9), Budget(2, whole_faces=1000))
    for _ in range(9):
        next(steps)
    steps.close()
    assert threading.active_count() == before
    assert ended == [True]


@pytest.mark.once
def test_refusals_are_those_of_a_whole_mesh():
    mesh, small = foam(20), Budget(whole_faces=1200)
    for work in (reduced, in_pieces):
        with pytest.raises(SettingsError, match="exactly one"):
            work(mesh)
        little, enough = Goal(reduction=0.5).bytes_at_once(150), Goal(reduction=0.5).bytes_at_once(2400)
        with pytest.raises(MemoryLimitError, match=r"simplifying \d+ triangles at once needs about .* are available; "):
            work(mesh, budget=replace(small, bytes=little), reduction=0.9)
        assert len(work(mesh, budget=replace(small, bytes=enough), reduction=0.9).mesh.faces) < 1200
    broken = TriangleMesh(mesh.vertices.copy(), mesh.faces)
    broken.vertices[2007, 0] = np.nan
    for work in (reduced, in_pieces):
        with pytest.raises(MeshError, match=r"vertex 2007 is at \(nan"):
            work(broken, budget=small, reduction=0.9)
    with pytest.raises(MeshError, match="no surface"):
        finish(simplified_pieces_steps((piece for piece in []), Goal(0.5)))


def test_pieces_that_do_not_fit_are_refused():
    first = next(layered_pieces(foam(16), (5, 10)))
    with pytest.raises(MeshError, match="in order"):
        finish(simplified_pieces_steps((piece for piece in [first]), Goal(0.5)))


@pytest.mark.once
def test_a_layer_larger_than_a_batch_is_simplified_to_the_goal_all_the_same():
    values = np.random.default_rng(1).normal(size=(14, 14, 14))
    for axis in range(3):
        values = (values + np.roll(values, 1, axis)) / 2
    mesh = marching_cubes(300 * values, 20)
    result = finish(simplification_steps(mesh, target_faces=900, budget=Budget(threads=1, whole_faces=150)))
    assert len(mesh.faces) > 4000
    assert len(result.mesh.faces) <= 900


def test_no_triangle_is_near_a_batch_that_has_lost_all_of_its_own():
    mesh = TriangleMesh(np.eye(3, dtype=np.float32), np.array([[0, 1, 2]], np.int32))
    empty = TriangleMesh(np.empty((0, 3), np.float32), np.empty((0, 3), np.int32))
    batches = [Batch(mesh, np.arange(3)), Batch(empty, np.arange(0)), Batch(mesh, np.arange(3, 6))]
    near, owner = faces_near_other_batches(batches)
    assert near.face_count == 2
    assert owner.tolist() == [0, 2]
