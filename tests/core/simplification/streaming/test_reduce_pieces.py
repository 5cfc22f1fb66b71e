# SPDX-License-Identifier: GPL-3.0-or-later
"""Simplification of surfaces that come in pieces: the promises of `simplify`, and its quality."""

import numpy as np
import pytest
from meshes import assert_sound, icosphere, joined, pieces_of, torus

from ctmc_addon.core import Step, TriangleMesh, finish, marching_cubes, simplify
from ctmc_addon.core.errors import MemoryLimitError, MeshError, SettingsError
from ctmc_addon.core.mesh import surface_distance
from ctmc_addon.core.simplification.streaming import reduce_pieces
from ctmc_addon.core.simplification.streaming.reduce_pieces import reduce_pieces_steps


def stream(mesh, count):
    """Pieces of a mesh as their maker yields them."""
    for number, piece in enumerate(pieces_of(mesh, count)):
        yield Step(number / count)
        yield piece
    return "info"


def foam(size=48, wavelength=24.0, noise=0.0, **options):
    z, y, x = np.indices((size, size, size), np.float32) * np.float32(2 * np.pi / wavelength)
    values = np.sin(x) * np.cos(y) + np.sin(1.03 * y) * np.cos(z) + np.sin(z) * np.cos(0.9 * x)
    values += np.random.default_rng(1).normal(0, noise, values.shape).astype(np.float32)
    return marching_cubes(values, 0.4, **{"close_border": True, "normals": False, **options})


def reduced(mesh, pieces, **goal):
    return finish(reduce_pieces_steps(stream(mesh, pieces), **goal)).simplification


@pytest.fixture(autouse=True)
def small_batches(monkeypatch):
    """So many batches, seams and strips in a small mesh."""
    monkeypatch.setattr(reduce_pieces, "BATCH_FACES", 4000)
    monkeypatch.setattr(reduce_pieces, "BOUNDED_BATCH_FACES", 4000)


@pytest.mark.once
@pytest.mark.parametrize(
    ("goal", "noise", "last_faces"),  # all at once, and in stretches
    [
        ({"reduction": 0.9}, 0.0, 1 << 20),
        ({"reduction": 0.95}, 0.25, 1 << 20),
        ({"reduction": 0.9}, 0.25, 5000),
        ({"reduction": 0.3}, 0.0, 5000),
        ({"target_faces": 3001}, 0.0, 5000),
        ({"target_faces": 3001}, 0.25, 1 << 20),
    ],
)
def test_the_goal_is_met_exactly_and_every_seam_is_closed(goal, noise, last_faces, monkeypatch):
    monkeypatch.setattr(reduce_pieces, "LAST_FACES", last_faces)
    mesh = foam(noise=noise)
    assert len(mesh.faces) > 8 * 4000
    result = reduced(mesh, 12, **goal)
    wanted = goal.get("target_faces") or round(len(mesh.faces) * (1 - goal["reduction"]))
    assert wanted - 1 <= len(result.mesh.faces) <= wanted
    assert_sound(result.mesh)
    assert result.mesh.closed
    assert not len(result.mesh.non_manifold_edges)
    if not noise:  # nothing small that may go
        assert result.mesh.euler == mesh.euler + 2 * result.handles_cut
        assert result.mesh.components == mesh.components - result.removed.count
        assert result.mesh.volume == pytest.approx(mesh.volume, rel=0.02)


@pytest.mark.once
@pytest.mark.parametrize("goal", [{"reduction": 0.9}, {"max_error": 0.3}])
def test_a_piece_much_larger_than_a_batch_is_simplified_in_bands(goal, monkeypatch):
    sizes = []
    reduce_part_steps = reduce_pieces.reduce_part_steps

    def noted(part, *rest):
        sizes.append(part.face_count)
        return reduce_part_steps(part, *rest)

    monkeypatch.setattr(reduce_pieces, "reduce_part_steps", noted)
    mesh = foam(40)
    result = reduced(mesh, 2, **goal)
    assert len(mesh.faces) > 5 * 4000
    assert max(sizes[:4]) < 1.1 * 4000
    if "reduction" in goal:
        wanted = round(len(mesh.faces) * 0.1)
        assert wanted - 1 <= len(result.mesh.faces) <= wanted
    else:
        assert surface_distance(result.mesh, mesh).largest <= 0.3
    assert_sound(result.mesh)
    assert result.mesh.closed
    assert result.mesh.euler == mesh.euler + 2 * result.handles_cut


@pytest.mark.once
@pytest.mark.parametrize("noise", [0.0, 0.25])
def test_the_surface_is_as_near_as_that_of_a_whole_mesh(noise):
    mesh = foam(noise=noise)
    whole, streamed = simplify(mesh, reduction=0.9), reduced(mesh, 12, reduction=0.9).mesh
    assert surface_distance(streamed, mesh).mean < 1.1 * surface_distance(whole, mesh).mean


@pytest.mark.once
@pytest.mark.parametrize("goal", [{"reduction": 0.9}, {"target_faces": 2000}, {"max_error": 0.3}])
def test_the_result_does_not_depend_on_the_threads(goal, monkeypatch):
    monkeypatch.setattr(reduce_pieces, "LAST_FACES", 2500)  # so the last pass has stretches
    mesh = foam(32, noise=0.1)
    first, second = (reduced(mesh, 8, threads=threads, **goal).mesh for threads in (1, 3))
    assert first.vertices.tobytes() == second.vertices.tobytes()
    assert first.faces.tobytes() == second.faces.tobytes()


@pytest.mark.once
@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_a_maximum_error_holds_both_ways(noise):
    mesh = foam(32, 16.0, noise)
    result = reduced(mesh, 8, max_error=0.4).mesh
    assert result.closed
    assert not len(result.non_manifold_edges)
    assert len(result.faces) < 0.5 * len(mesh.faces)
    assert surface_distance(result, mesh).largest <= 0.4
    assert surface_distance(mesh, result).largest <= 0.4


def test_a_small_surface_is_simplified_as_a_whole_mesh_would_be():
    mesh = foam(16)
    assert len(mesh.faces) < 4000
    order = np.argsort(mesh.vertices[:, 2], kind="stable")  # as the pieces have them
    place = np.empty(len(order), np.int32)
    place[order] = np.arange(len(order))
    mesh = TriangleMesh(mesh.vertices[order], place[mesh.faces])
    whole, streamed = simplify(mesh, reduction=0.8), reduced(mesh, 1, reduction=0.8).mesh
    assert streamed.vertices.tobytes() == whole.vertices.tobytes()
    assert streamed.faces.tobytes() == whole.faces.tobytes()


def test_an_open_border_stays_where_it_is():
    mesh = foam(40, close_border=False)
    assert len(mesh.boundary_edges)
    result = reduced(mesh, 10, reduction=0.7).mesh
    border = {mesh.vertices[vertex].tobytes() for vertex in mesh.boundary_edges.ravel()}
    assert {result.vertices[vertex].tobytes() for vertex in result.boundary_edges.ravel()} <= border
    assert len(result.boundary_edges) == len(mesh.boundary_edges)
    assert not len(result.non_manifold_edges)


def test_normals_are_carried_along_and_stay_of_length_one():
    result = reduced(foam(40, normals=True), 10, reduction=0.8).mesh
    assert result.normals.shape == result.vertices.shape
    assert np.allclose((result.normals**2).sum(axis=1), 1, atol=1e-5)


def test_a_component_across_a_seam_stays_one_piece():
    mesh = joined(icosphere(5, 20.0), icosphere(4, 6.0, (60, 0, 0)), torus(60, 30))
    result = reduced(mesh, 6, reduction=0.9).mesh
    assert result.closed
    assert (result.components, result.euler) == (mesh.components, mesh.euler)


def test_what_is_done_is_handed_on_with_what_the_maker_returned():
    mesh = foam(32)
    steps, result = [], None
    generator = reduce_pieces_steps(stream(mesh, 8), reduction=0.9)
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
            yield from stream(foam(32), 8)
        finally:
            ended.append(True)

    steps = reduce_pieces_steps(pieces(), reduction=0.9, threads=2)
    for _ in range(4):
        next(steps)
    steps.close()
    assert ended == [True]


def test_refusals_are_those_of_a_whole_mesh():
    with pytest.raises(SettingsError, match="exactly one"):
        reduced(foam(16), 2)
    with pytest.raises(MemoryLimitError):
        reduced(foam(32), 8, reduction=0.9, memory_limit=100_000)
    broken = foam(32)
    broken.vertices[7, 0] = np.nan
    with pytest.raises(MeshError, match="nan"):
        reduced(broken, 8, reduction=0.9)
    with pytest.raises(MeshError, match="no surface"):
        finish(reduce_pieces_steps((piece for piece in []), reduction=0.5))


def test_pieces_that_do_not_fit_are_refused():
    first = next(pieces_of(foam(16), 3))
    with pytest.raises(MeshError, match="in order"):
        finish(reduce_pieces_steps((piece for piece in [first]), reduction=0.5))
