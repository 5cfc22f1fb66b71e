# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures against closed forms, whatever the size of a block, and the same bits wherever a surface is cut."""

from dataclasses import astuple

import numpy as np
import pytest
from meshes import layered, layered_pieces, sheet

from ctmc_addon.core import Step, finish, marching_cubes
from ctmc_addon.core.mesh import measures, measures_steps, topology_steps
from ctmc_addon.core.mesh.measures import PieceMeasures
from ctmc_addon.core.mesh.pieces.completed_pieces import completed_pieces_steps
from ctmc_addon.core.volume.affine import transform_points


@pytest.fixture(params=[1 << 18, 50])
def block(request, monkeypatch):
    """Faces in a step: all of them, and few."""
    monkeypatch.setattr(measures, "FACES_PER_STEP", request.param)


@pytest.mark.parametrize("close", [True, False])
def test_a_box_of_voxels_has_its_closed_form_measures(block, close):
    values = np.zeros((9, 10, 11), np.uint8)
    values[: 9 if not close else 6, 2:7, 3:8] = 1
    mesh = marching_cubes(values, 0.5, alpha=0, close_border=close)
    found = finish(measures_steps(mesh.vertices, mesh.faces))
    assert (found.faces, found.components, found.closed) == (len(mesh.faces), 1, close)
    assert found.euler == (2 if close else 0)
    # At the midpoints every edge loses a prism of half a square of 0.5 x 0.5, every corner 5/6 of a cube of 0.5.
    chamfer = np.sqrt(0.5)
    if close:
        assert found.enclosed_volume == found.volume == pytest.approx(6 * 5 * 5 - 4 * (5 + 4 + 4) / 8 - 8 * 5 / 48)
    else:
        assert found.enclosed_volume is None
        assert found.area == pytest.approx(8 * (4 * 4 + 4 * chamfer))


def test_a_mesh_with_one_triangle_turned_over_is_not_closed(block):
    mesh = marching_cubes(np.pad(np.ones((2, 2, 2), np.uint8), 2), 0.5)
    faces = mesh.faces.copy()
    faces[0] = faces[0, ::-1]
    assert finish(measures_steps(mesh.vertices, mesh.faces)).closed
    assert not finish(measures_steps(mesh.vertices, faces)).closed


def test_measures_are_the_same_with_a_topology_that_someone_else_found(block):
    mesh = marching_cubes(np.random.default_rng(3).integers(0, 100, (6, 9, 8)).astype(np.uint8), 50.5)
    topology = finish(topology_steps(mesh.faces, len(mesh.vertices)))
    found = finish(measures_steps(mesh.vertices, mesh.faces))
    assert astuple(finish(measures_steps(mesh.vertices, mesh.faces, topology))) == astuple(found)


def with_specks(count):
    """A ball of 8 voxels radius, and so many single voxels around it."""
    z, y, x = np.indices((20, 40, 40))
    values = ((z - 10) ** 2 + (y - 20) ** 2 + (x - 20) ** 2 <= 64).astype(np.uint8)
    corner = np.argwhere((z % 3 == 1) & (y % 3 == 1) & (x % 3 == 1) & ((y - 20) ** 2 + (x - 20) ** 2 > 150))
    values[tuple(corner[:count].T)] = 1
    return values


def test_walls_of_cavities_are_counted_apart(block):
    values = np.pad(np.ones((13, 13, 13), np.uint8), 1)
    values[3:12:3, 3:12:3, 3:12:3] = 0
    values[0, 0, 0] = 1
    mesh = marching_cubes(values, 0.5, close_border=True, normals=False)
    found = finish(measures_steps(mesh.vertices, mesh.faces))
    assert (found.components, found.cavities, found.bodies) == (29, 27, 2)
    inside_out = finish(measures_steps(mesh.vertices, mesh.faces[:, ::-1].copy()))
    assert (inside_out.components, inside_out.cavities) == (29, 2)


@pytest.mark.parametrize("count", [0, 5, 9, 200])
def test_small_components_are_counted_where_there_are_many(count):
    mesh = marching_cubes(with_specks(count), 0.5, normals=False)
    assert mesh.components == count + 1
    assert mesh.measures.small_components == (count if count >= 9 else 0)
    assert mesh.measures.has_many_small_components == (count >= 10)
    grown = finish(measures_steps(mesh.vertices * np.float32(10), mesh.faces))
    assert grown.small_components == mesh.measures.small_components  # small is a share, not a size


def measured(pieces):
    found = PieceMeasures()
    for item in completed_pieces_steps(pieces):
        if not isinstance(item, Step):
            finish(found.add_steps(item.mesh.vertices, item.mesh.faces, item.own))
    return found


def noise(threshold, **options):
    """Many components, cavities and open borders, far from the origin."""
    values = np.random.default_rng(3).integers(0, 100, (24, 20, 18)).astype(np.uint8)
    affine = np.diag([0.7, 0.8, 1.3, 1.0])
    affine[:3, 3] = 900, -700, 1200
    mesh = layered(marching_cubes(values, threshold, normals=False, **options))
    return mesh, lambda cuts: (moved(piece, affine) for piece in layered_pieces(mesh, cuts)), moved(mesh, affine)


def moved(mesh, affine):
    return type(mesh)(transform_points(affine, mesh.vertices), mesh.faces, mesh.normals)


@pytest.mark.parametrize("threshold", [50.0, 80.0, 95.0])
@pytest.mark.parametrize("more", [{}, {"close_border": True}, {"topology": "trilinear"}])
def test_measures_of_pieces_have_the_bits_of_the_whole_wherever_it_is_cut(threshold, more):
    _, pieces_at, whole = noise(threshold, **more)
    expected = astuple(whole.measures)
    for cuts in ((), range(1, 24), (5, 6, 17), (23,)):
        found = finish(measured(as_steps(pieces_at(cuts))).measures_steps())
        np.testing.assert_equal(astuple(found)[:6], expected[:6])  # not one bit apart; NaN is NaN
        assert astuple(found)[6:] == expected[6:]
    assert whole.measures.closed == bool(more.get("close_border"))


def as_steps(pieces):
    yield Step()
    yield from pieces


def test_borders_and_vertices_without_a_triangle_are_counted_across_seams():
    mesh = sheet(6, 7)
    assert (mesh.measures.borders, mesh.measures.euler, mesh.measures.vertices) == (1, 1, 42)
    assert np.isnan(mesh.measures.volume)
    assert mesh.measures.area == pytest.approx(30)
    cut = mesh.measures.faces
    holed = type(mesh)(mesh.vertices, mesh.faces[np.arange(cut) != 12])
    assert (holed.measures.borders, holed.measures.euler) == (2, 0)


@pytest.mark.parametrize("scale", [0.3, 1.0, 80.0])
def test_small_is_a_thousandth_of_the_largest_component_rounded_down_to_one_digit(scale):
    mesh = marching_cubes(with_specks(200), 0.5, normals=False)
    measures = finish(measures_steps(mesh.vertices * np.float32(scale / 8), mesh.faces))
    largest = (mesh.measures.volume - 200 / 6) * (scale / 8) ** 3  # a speck is an octahedron of a sixth of a voxel
    assert 0.5 * largest < 1000 * measures.small <= largest
    assert float(f"{measures.small:.0e}") == measures.small
    assert measures.small_components == 200  # a speck has a thirteen thousandth of the ball


def test_the_size_is_that_of_the_box_around_the_triangles():
    vertices = np.array([[1, 2, 3], [4, 2, 3], [1, 4, 3], [1, 2, 10], [99, 99, 99]], np.float32)
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], np.int32)
    assert finish(measures_steps(vertices, faces)).size == (3.0, 2.0, 7.0)
    assert finish(measures_steps(vertices, faces[:0])).size is None
