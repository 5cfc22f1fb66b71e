# SPDX-License-Identifier: GPL-3.0-or-later
"""Distances of a lattice's samples against closed forms and against every sample measured in turn."""

import numpy as np
import pytest
from meshes import as_mesh, icosphere, joined

from ctmc_addon.core import MeshError, ReconstructionSettings, TriangleMesh, Volume, finish, reconstruct
from ctmc_addon.core.machine.budget import Budget
from ctmc_addon.core.mesh.distance.signed_distance import SignedSurface
from ctmc_addon.core.mesh.distance.triangle_tree import TriangleTree
from ctmc_addon.core.solid.fields import distances as module
from ctmc_addon.core.solid.fields.distances import at_samples_steps, distances_bytes, distances_steps
from ctmc_addon.core.solid.fields.lattice import Lattice
from ctmc_addon.core.solid.fields.lattice_edges import edge_vertices_steps, inside_steps
from ctmc_addon.core.solid.fields.nearby import nearby_steps, packed, unpacked
from ctmc_addon.core.volume.affine import to_index

pytestmark = pytest.mark.once

THRESHOLD = 0.0
TURNED = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
TILTED = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.3], [0.0, 0.0, 1.0]])  # by the gantry
CUBE = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
QUADS = np.array([(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])


def affine(spacing=(1.0, 1.0, 1.0), origin=(0.0, 0.0, 0.0), turn=None):
    matrix = np.eye(4)
    matrix[:3, :3] = (np.eye(3) if turn is None else turn) * np.array(spacing)
    matrix[:3, 3] = origin
    return matrix


def box(low, high):
    low, high = np.array(low), np.array(high)
    return as_mesh(low + CUBE * (high - low), np.concatenate([QUADS[:, :3], QUADS[:, [0, 2, 3]]]))


def box_distance(points, low, high):
    """Closed form, positive inside; points (n, 3)."""
    beyond = np.maximum(np.array(low) - points, points - np.array(high))
    outside = np.sqrt((np.maximum(beyond, 0) ** 2).sum(axis=1))
    return np.where(outside > 0, -outside, -beyond.max(axis=1))


def signed(mesh):
    surface = SignedSurface()
    finish(surface.prepare_steps(mesh))
    return surface


def places(lattice):
    """All samples, (n, 3) RAS+ mm."""
    z, y, x = np.unravel_index(np.arange(np.prod(lattice.shape)), lattice.shape)
    return lattice.points(x, y, z).T


def corners_of_passed(distances, level):
    """Samples of cells with corners above the level and others that are not, or at it and others that are not."""
    corners = np.zeros(distances.shape, bool)
    for above in (distances > level, distances >= level):
        shape = [size - 1 for size in distances.shape]
        parts = [tuple(slice(i, i + n) for i, n in zip(at, shape, strict=True)) for at in np.ndindex(2, 2, 2)]
        count = sum(above[part].astype(int) for part in parts)
        for part in parts:
            corners[part] |= (count > 0) & (count < 8)
    return corners


def require_right(found, exact, levels):
    """Compare what cells of the levels need with the exact distances, and the side of all samples."""
    assert found.dtype == np.float32
    assert np.isfinite(found).all()
    for level in levels:
        needed = corners_of_passed(exact, level)
        assert needed.any()
        np.testing.assert_allclose(found[needed], exact[needed], rtol=2e-7, atol=2e-6)
        clear = np.abs(exact - level) > 1e-5
        np.testing.assert_array_equal((found > level)[clear], (exact > level)[clear])


def noise(shape, seed, smooth=1):
    """Smoothed noise: a surface of many thin walls and small components."""
    values = np.random.default_rng(seed).normal(size=shape)
    for axis in (0, 1, 2) * smooth:
        values = values + np.roll(values, 1, axis) + np.roll(values, -1, axis)
    return (values / values.std()).astype(np.float32)


def blob(shape, seed):
    """A thick, rough solid."""
    z, y, x = (np.linspace(-1, 1, size) for size in shape)
    return (0.7 - np.sqrt(z[:, None, None] ** 2 + y[:, None] ** 2 + x**2) + 0.1 * noise(shape, seed)).astype(np.float32)


def extracted(values, matrix, stride=1):
    """A surface with closed borders, the lattice of its samples, and which of these are inside."""
    settings = ReconstructionSettings(threshold=THRESHOLD, close_border=True, stride=stride)
    mesh = reconstruct(Volume(values, matrix), settings).mesh
    axes, flags = [], values >= THRESHOLD
    for axis, size in enumerate(values.shape):
        index = [*range(0, size - 1, stride), size - 1]
        flags = np.pad(flags.take(index, axis), [(2 * (each == axis),) * 2 for each in range(3)])
        axes.append(np.array([-2, -1, *index, size, size + 1], np.float64))
    return mesh, Lattice(*axes[::-1], matrix), flags


OBLIQUE = affine((-0.7, 0.8, 1.5), (100.3, -50.2, 700.1), TURNED)
CASES = [
    (noise((9, 12, 70), 1), affine(), 1),
    (noise((9, 12, 11), 2), OBLIQUE, 1),
    (noise((14, 13, 16), 3), affine((0.7, 0.8, 1.5), turn=TILTED), 3),
    (blob((20, 26, 24), 4), OBLIQUE, 1),
    (blob((20, 26, 24), 5), affine((0.7, 0.8, 1.5), turn=TILTED), 1),
]


@pytest.mark.parametrize(("values", "matrix", "stride"), CASES)
def test_a_surface_extracted_on_the_lattice_tells_its_samples_and_edges(values, matrix, stride):
    mesh, lattice, flags = extracted(values, matrix, stride)
    inside = finish(inside_steps(mesh, lattice))
    np.testing.assert_array_equal(inside, flags)
    by_sign = finish(signed(mesh).distances_steps(places(lattice)))[0] < 0
    np.testing.assert_array_equal(inside.ravel(), by_sign)
    keys, vertex = finish(edge_vertices_steps(mesh, lattice))
    numbers = np.arange(flags.size).reshape(flags.shape)
    crossed = []
    for axis, along in enumerate((2, 1, 0)):
        ends = numbers.take(range(flags.shape[along] - 1), along)
        crossed.append(3 * ends[np.diff(flags, axis=along)] + axis)
    np.testing.assert_array_equal(keys, np.sort(np.concatenate(crossed)))
    z, y, x = np.unravel_index(keys // 3, flags.shape)
    low = np.stack([lattice.x[x], lattice.y[y], lattice.z[z]], axis=1)
    way = to_index(matrix, mesh.vertices[vertex].astype(float)) - low
    along = way[np.arange(len(keys)), keys % 3]
    assert along.min() > 0
    assert along.max() < 3
    way[np.arange(len(keys)), keys % 3] = 0
    assert np.abs(way).max() < 1e-3


def test_a_vertex_that_is_stored_twice_counts_once_and_one_off_the_edges_is_left_out():
    mesh, lattice, flags = extracted(*CASES[1])
    keys, vertex = finish(edge_vertices_steps(mesh, lattice))
    extra = mesh.vertices.mean(axis=0, keepdims=True) + np.float32(0.123)
    vertices = np.concatenate([mesh.vertices, mesh.vertices[:50], extra])
    more = TriangleMesh(vertices, mesh.faces)
    again, of_more = finish(edge_vertices_steps(more, lattice))
    np.testing.assert_array_equal(again, keys)
    np.testing.assert_array_equal(of_more, vertex)
    np.testing.assert_array_equal(finish(inside_steps(more, lattice)), flags)


def test_surfaces_that_do_not_tell_the_inside_are_refused():
    mesh, lattice, _ = extracted(*CASES[1])
    moved = TriangleMesh(mesh.vertices + np.float32(0.11), mesh.faces)
    with pytest.raises(MeshError, match=f"{len(mesh.vertices)} of {len(mesh.vertices)} vertices are off the edges"):
        finish(inside_steps(moved, lattice))
    keys, vertex = finish(edge_vertices_steps(mesh, lattice))
    some = TriangleMesh(np.delete(mesh.vertices, vertex[keys % 3 == 0][0], axis=0), mesh.faces[:1])
    with pytest.raises(MeshError, match="edges contradict others"):
        finish(inside_steps(some, lattice))
    surface = signed(TriangleMesh(mesh.vertices, mesh.faces[1:]))
    with pytest.raises(MeshError, match="an open surface has no inside"):
        finish(distances_steps(surface, lattice, [0.0], None))


@pytest.mark.parametrize(("values", "matrix", "stride"), CASES)
@pytest.mark.parametrize("levels", [(0.0,), (0.6,), (-1.5,), (0.4, -1.0), (1.1, 0.3, 0.0, -0.5, -2.0)])
def test_cells_of_a_level_are_exact_and_the_rest_is_on_the_right_side(values, matrix, stride, levels):
    mesh, lattice, flags = extracted(values, matrix, stride)
    surface = signed(mesh)
    exact = -finish(surface.distances_steps(places(lattice)))[0].reshape(lattice.shape)
    levels = [level for level in levels if exact.max() > level]
    found = finish(distances_steps(surface.tree, lattice, levels, flags))
    require_right(found, exact, levels)
    np.testing.assert_array_equal(found > 0, flags)
    require_right(finish(distances_steps(surface, lattice, levels, None)), exact, levels)


@pytest.mark.parametrize("level", [2.0, 0.0, -1.5])
def test_a_box_in_an_irregular_oblique_lattice_has_its_closed_form(level):
    low, high = (-6.0, -5.0, -7.0), (6.5, 6.0, 5.0)
    draw = np.random.default_rng(5)
    axes = (np.cumsum(draw.uniform(0.1, 1.5, count)) for count in (33, 26, 18))
    x, y, z = (each - each.mean() for each in axes)
    lattice = Lattice(x, y, z, affine((0.9, -0.8, 1.4), (0.2, 0.1, -0.3), TURNED))
    exact = box_distance(places(lattice), low, high).reshape(lattice.shape)
    require_right(finish(distances_steps(signed(box(low, high)), lattice, [level], None)), exact, [level])


@pytest.mark.parametrize("levels", [[2.0], [-1.5], [0.0], [2.0, 0.0, -1.5]])
def test_a_ball_has_its_radius_at_the_cells_of_a_level(levels):
    ball = icosphere(5, radius=9.0, center=(1.0, 2.0, -3.0))
    lattice = Lattice(*(np.arange(count) - count / 2 for count in (41, 38, 23)), affine((0.7, 0.75, 1.3), turn=TURNED))
    exact = 9.0 - np.linalg.norm(places(lattice) - (1.0, 2.0, -3.0), axis=1).reshape(lattice.shape)
    found = finish(distances_steps(signed(ball), lattice, levels, None))
    for level in levels:
        needed = corners_of_passed(found, level)
        assert needed.sum() > 1000
        deviation = found[needed] - exact[needed]  # 20480 triangles lie below the sphere by 0.01 at most
        assert deviation.min() > -0.011
        assert deviation.max() < 1e-5
        clear = np.abs(exact - level) > 0.02
        np.testing.assert_array_equal((found > level)[clear], (exact > level)[clear])


class _Counted(TriangleTree):
    """Counts the points that are measured."""

    count = 0

    def nearest_steps(self, points, limit=np.inf, threads=None):
        self.count += len(points)
        return super().nearest_steps(points, limit, threads)


@pytest.mark.parametrize(("level", "most"), [(2.0, 2.3), (-2.0, 2.3), (0.0, 1.0)])
def test_few_samples_are_measured_that_no_cell_needs(level, most):
    z, y, x = np.ogrid[-30:31, -30:31, -30:31]
    mesh, lattice, flags = extracted((20.3 - np.sqrt(x * x + y * y + z * z)).astype(np.float32), affine())
    tree = _Counted(mesh)
    found = finish(distances_steps(tree, lattice, [level], flags))
    assert 0 < tree.count <= most * corners_of_passed(found, level).sum()


def test_the_result_does_not_depend_on_threads(monkeypatch):
    for name, value in (("BLOCKS_AT_ONCE", 3), ("POINTS_AT_ONCE", 500), ("SAMPLES_AT_ONCE", 1000)):
        monkeypatch.setattr(module, name, value)
    mesh, lattice, flags = extracted(*CASES[3])
    surface = signed(mesh)
    exact = -finish(surface.distances_steps(places(lattice)))[0].reshape(lattice.shape)
    for inside in (flags, None):
        one, three = (
            finish(distances_steps(surface, lattice, [0.9, -0.5], inside, Budget(threads=threads)))
            for threads in (1, 3)
        )
        assert one.tobytes() == three.tobytes()
        require_right(one, exact, [0.9, -0.5])
    one, three = (
        [finish(steps(mesh, lattice, Budget(threads=threads))) for steps in (inside_steps, edge_vertices_steps)]
        for threads in (1, 3)
    )
    assert one[0].tobytes() == three[0].tobytes()
    assert one[1][1].tobytes() == three[1][1].tobytes()


def test_samples_are_measured_by_their_flat_numbers():
    mesh, lattice, flags = extracted(*CASES[3])
    surface = signed(joined(mesh, box((-50, -50, 500), (-40, -40, 510))))
    flat = np.random.default_rng(7).permutation(flags.size)[:300]
    expected = -finish(surface.distances_steps(places(lattice)[flat]))[0].astype(np.float32)
    np.testing.assert_array_equal(finish(at_samples_steps(surface, lattice, flat, None)), expected)
    np.testing.assert_array_equal(finish(at_samples_steps(surface.tree, lattice, flat, flags)), expected)
    limited = finish(at_samples_steps(surface.tree, lattice, flat, flags, limit=1.0))
    beyond = np.abs(expected) > 1.0
    np.testing.assert_array_equal(limited[~beyond], expected[~beyond])
    np.testing.assert_array_equal(limited[beyond], np.where(expected[beyond] > 0, np.inf, -np.inf))


@pytest.mark.parametrize("sizes", [(2, 2, 2), (3, 9, 17), (2, 16, 5)])
def test_small_lattices_have_cells_at_their_ends(sizes):
    low, high = (-0.3, 0.2, 0.2), tuple(size - 1.2 for size in sizes)
    lattice = Lattice(*(np.arange(float(size)) for size in sizes), affine())
    exact = box_distance(places(lattice), low, high).reshape(lattice.shape)
    surface = signed(box(low, high))
    found = finish(distances_steps(surface, lattice, [-0.3], None))
    require_right(found, exact, [-0.3])
    assert finish(distances_steps(surface.tree, lattice, [], exact > 0)).shape == lattice.shape


def test_bytes_hold_the_result_a_state_and_two_masks():
    lattice = Lattice(np.arange(512.0), np.arange(512.0), np.arange(275.0), np.eye(4))
    assert 7 * 512 * 512 * 275 < distances_bytes(lattice) < 7 * 512 * 512 * 275 + (1 << 29)


@pytest.mark.parametrize("distance", [0.5, 0.7, 2.0, 5.5, 9.0])
@pytest.mark.parametrize("turn", [None, TURNED, TILTED])
def test_nearby_samples_are_within_the_distance(distance, turn):
    lattice = Lattice(*(np.arange(float(size)) for size in (70, 14, 9)), affine((0.7, 0.8, 1.5), turn=turn))
    flags = np.random.default_rng(3).random(lattice.shape) < 0.003
    found = unpacked(finish(nearby_steps(packed(flags), lattice, distance)), lattice.shape[2]).ravel()
    points = places(lattice)
    least = np.full(len(points), np.inf)
    for point in points[flags.ravel()]:
        np.minimum(least, ((points - point) ** 2).sum(axis=1), out=least)
    within = np.sqrt(least) < distance * (1 - 1e-4)
    assert not (found & (np.sqrt(least) > distance)).any()
    if turn is TILTED or distance > 5.6:
        assert found[within].mean() > 0.8
    else:
        np.testing.assert_array_equal(found, within)


def test_a_finer_lattice_divides_the_steps_that_a_box_reaches():
    coarse = Lattice(np.arange(0.0, 20), np.arange(0.0, 20) * 2, np.array([0.0, 1, 3, 6, 10, 15]), np.eye(4))
    fine = coarse.refined((np.array([5.2, -9, 4]), np.array([7.9, -7, 5])), 0.6)
    assert coarse.refined((np.full(3, -99.0), np.full(3, -90.0)), 0.6).shape == coarse.shape
    assert fine.y.tolist() == coarse.y.tolist()
    for before, after in ((coarse.x, fine.x), (coarse.z, fine.z)):
        assert set(before.tolist()) <= set(after.tolist())
        assert (np.diff(after) > 0).all()
    np.testing.assert_allclose(np.diff(fine.x), np.repeat([1, 0.5, 1], [4, 10, 10]))
    inner = (fine.z[1:] > 4) & (fine.z[:-1] < 5)
    assert np.diff(fine.z)[inner].max() == pytest.approx(0.6)
