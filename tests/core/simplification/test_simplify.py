# SPDX-License-Identifier: GPL-3.0-or-later
"""Simplification: counts, invariants, closed forms, and peers where they are installed."""

import numpy as np
import pytest
from meshes import (
    as_mesh,
    assert_sound,
    boundary_edges,
    icosphere,
    joined,
    largest_error,
    non_manifold_edges,
    sheet,
    spread,
    torus,
)

from ctmc_addon.core import (
    Budget,
    CtmcError,
    Step,
    TriangleMesh,
    distances,
    finish,
    marching_cubes,
    simplify,
    simplify_steps,
)
from ctmc_addon.core.errors import MemoryLimitError, MeshError, SettingsError
from ctmc_addon.core.mesh.face_normals import face_vectors
from ctmc_addon.core.simplification.whole import Goal


def outward(mesh, center=(0.0, 0.0, 0.0)):
    middle = mesh.vertices[mesh.faces].mean(axis=1) - np.asarray(center)
    return (face_vectors(mesh.vertices, mesh.faces) * middle).sum(axis=1) > 0


def border_positions(mesh):
    return {mesh.vertices[v].tobytes() for v in boundary_edges(mesh).ravel()}


# Counts


@pytest.mark.parametrize("reduction", [0.0, 0.1, 0.5, 0.9, 0.97])
def test_a_closed_mesh_keeps_the_share_asked_for_within_one_collapse(reduction):
    mesh = icosphere(4)
    asked = round(len(mesh.faces) * (1 - reduction))
    assert asked - 1 <= len(simplify(mesh, reduction=reduction).faces) <= asked


@pytest.mark.parametrize("target", [4, 5, 100, 1001, 5119, 5120, 9999])
def test_a_triangle_budget_is_kept_within_one_collapse(target):
    count = len(simplify(icosphere(4), target_faces=target).faces)
    assert count == min(target - target % 2, 5120)


def test_many_closed_components_end_as_tetrahedra():
    balls = joined(*(icosphere(2, 1.0, (4 * i, 0, 0)) for i in range(5)))
    small = simplify(balls, target_faces=20)
    assert_sound(small)
    assert small.closed
    assert len(small.faces) in (19, 20)
    assert small.volume > 0


def test_where_only_whole_components_are_left_there_are_three_fewer_at_most():
    tetrahedra = joined(*(simplify(icosphere(1, 1.0, (4 * i, 0, 0)), target_faces=4) for i in range(12)))
    assert len(tetrahedra.faces) == 48
    assert [len(simplify(tetrahedra, target_faces=target).faces) for target in (47, 46, 45, 44)] == [44] * 4


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("goal", [{"reduction": 0.5}, {"target_faces": 10}, {"max_error": 0.1}])
def test_a_vertex_that_is_not_finite_is_refused(value, goal):
    mesh = icosphere(2)
    mesh.vertices[7, 1] = value
    with pytest.raises(MeshError, match=rf"\b7\b.*{value:g}"):
        simplify(mesh, **goal)


def test_what_cannot_be_reached_is_said_in_the_last_step():
    steps = []
    small = finish(simplify_steps(icosphere(3), target_faces=1), steps.append)
    assert len(small.faces) == 4
    assert steps[-1].fraction == 1.0
    assert steps[-1].message.startswith("4 triangles instead of 1: ")


def test_steps_rise_and_name_the_count_at_the_end():
    steps = []
    finish(simplify_steps(icosphere(4), reduction=0.9), steps.append)
    fractions = [step.fraction for step in steps]
    assert fractions == sorted(fractions)
    assert fractions[0] == 0.0
    assert steps[-1] == Step(1.0, "512 triangles")


# What never changes


@pytest.mark.parametrize("reduction", [0.5, 0.9, 0.98])
def test_a_sphere_stays_closed_and_every_triangle_faces_outward(reduction):
    mesh = simplify(icosphere(5, 10.0, (100.0, -50.0, 20.0)), reduction=reduction)
    assert_sound(mesh)
    assert mesh.closed
    assert mesh.euler == 2
    assert outward(mesh, (100.0, -50.0, 20.0)).all()


def test_a_torus_keeps_its_hole():
    mesh = simplify(torus(96, 40), reduction=0.95)
    assert_sound(mesh)
    assert mesh.closed
    assert mesh.euler == 0


def test_a_thin_torus_keeps_its_hole_while_errors_are_smaller_than_its_tube():
    mesh = simplify(torus(40, 8, 3.0, 0.2), target_faces=100)
    assert_sound(mesh)
    assert mesh.closed
    assert mesh.euler == 0


def test_a_border_stays_where_it_is_bit_for_bit():
    hills = sheet(40, 30, lambda x, y: 2 * np.sin(x / 5) * np.cos(y / 4))
    small = simplify(hills, reduction=0.8)
    assert_sound(small)
    assert len(small.faces) == round(0.2 * len(hills.faces))
    assert border_positions(small) == border_positions(hills)
    assert len(boundary_edges(small)) == len(boundary_edges(hills))
    assert small.euler == 1


def test_triangles_at_an_edge_with_three_of_them_are_left_alone():
    wings = icosphere(3)
    a, b = wings.faces[0, :2]
    vertices = np.concatenate([wings.vertices, [[9, 9, 9]]])
    mesh = as_mesh(vertices, np.concatenate([wings.faces, [[a, b, len(wings.vertices)]]]))
    small = simplify(mesh, reduction=0.8)
    kept = {face.tobytes() for face in small.vertices[small.faces]}
    at_edge = [f for f in mesh.faces if a in f and b in f]
    assert len(at_edge) == 3
    assert all(mesh.vertices[f].tobytes() in kept for f in at_edge)
    assert len(non_manifold_edges(small)) == 1


def test_needles_a_thousandth_wide_are_no_obstacle():
    """Marching cubes leaves edges 2^-10 long; here every second row of a torus is that close to the next."""
    mesh = torus(80, 60)
    row = np.arange(80).repeat(60)
    vertices = mesh.vertices.copy()
    odd, before = row % 2 == 1, np.flatnonzero(row % 2 == 1) - 60
    vertices[odd] = vertices[before] + (vertices[odd] - vertices[before]) * np.float32(2**-7)
    small = simplify(as_mesh(vertices, mesh.faces), reduction=0.95)
    assert_sound(small)
    assert small.closed
    assert len(small.faces) == round(0.05 * len(mesh.faces))
    assert small.volume == pytest.approx(mesh.volume, rel=0.03)


def test_triangles_without_area_and_repeated_vertices_do_no_harm():
    ball = icosphere(3)
    vertices = ball.vertices.copy()
    vertices[ball.faces[7, 1]] = vertices[ball.faces[7, 0]]
    faces = np.concatenate([ball.faces, [[3, 3, 4]]])
    small = simplify(as_mesh(vertices, faces), reduction=0.5)
    assert round(len(faces) / 2) - 1 <= len(small.faces) <= round(len(faces) / 2)
    assert np.isfinite(small.vertices).all()


# Closed forms


def test_a_flat_sheet_stays_in_its_plane_and_loses_nearly_every_inner_vertex():
    flat = sheet(30, 30)
    small = simplify(flat, target_faces=1)
    border = 4 * 29
    assert (small.vertices[:, 2] == 0).all()
    assert border <= len(small.vertices) <= border + 8  # of 28 * 28 inner ones
    assert len(small.faces) == 2 * len(small.vertices) - border - 2
    assert small.area == pytest.approx(29 * 29, rel=1e-6)


def test_a_sphere_stays_within_the_sagitta_of_its_coarser_triangles():
    mesh = simplify(icosphere(5), reduction=0.9)
    radii = np.sqrt((mesh.vertices.astype(float) ** 2).sum(axis=1))
    # A triangle of an even covering by F has its middle s = 4 pi / (3 sqrt(3) F) below the sphere.
    sagitta = 4 * np.pi / (3 * np.sqrt(3) * len(mesh.faces))
    assert np.abs(radii - 1).max() < 3 * sagitta
    assert mesh.volume == pytest.approx(icosphere(5).volume, rel=2 * sagitta)


def test_normals_are_carried_along_at_unit_length():
    mesh = simplify(icosphere(5), reduction=0.9)
    assert mesh.normals.dtype == np.float32
    assert np.abs(np.linalg.norm(mesh.normals, axis=1) - 1).max() < 1e-6
    radial = mesh.vertices / np.linalg.norm(mesh.vertices, axis=1)[:, None]
    assert (mesh.normals * radial).sum(axis=1).min() > np.cos(np.radians(6))


def test_the_unit_of_the_mesh_does_not_matter():
    mesh = torus(60, 30)
    meters = simplify(mesh, reduction=0.8)
    for power in (-60, 30):
        other = simplify(as_mesh(np.ldexp(mesh.vertices, power), mesh.faces), reduction=0.8)
        assert np.array_equal(other.faces, meters.faces)
        assert np.array_equal(other.vertices, np.ldexp(meters.vertices, power))


def test_the_same_input_gives_the_same_bytes():
    one, two = (simplify(torus(60, 30), reduction=0.8) for _ in range(2))
    assert one.vertices.tobytes() == two.vertices.tobytes()
    assert one.faces.tobytes() == two.faces.tobytes()


# A maximum error


@pytest.mark.once
@pytest.mark.parametrize("share", [0.005, 0.05])
def test_a_maximum_error_is_kept_both_ways_and_many_triangles_go(share):
    mesh = bumpy()
    small = simplify(mesh, max_error=share * 10)
    assert_sound(small)
    assert small.closed
    assert largest_error(mesh, small) <= share * 10
    assert len(small.faces) < 0.55 * len(mesh.faces)


def test_a_looser_bound_removes_more():
    mesh = icosphere(3, 10.0)
    counts = [len(simplify(mesh, max_error=bound).faces) for bound in (0.1, 0.3, 1.0)]
    assert counts[0] > counts[1] > counts[2]


@pytest.mark.once
def test_a_sphere_of_voxels_loses_well_over_half_within_a_quarter_voxel():
    z, y, x = np.ogrid[-23:24, -23:24, -23:24]
    ball = marching_cubes(np.sqrt(x * x + y * y + z * z).max() - np.sqrt(x * x + y * y + z * z), 39.837 - 20)
    assert 8000 < len(ball.faces) < 30000
    small = simplify(ball, max_error=0.25)
    assert small.closed
    assert small.euler == 2
    assert len(small.faces) < 0.1 * len(ball.faces)
    assert largest_error(ball, small) <= 0.25


def test_the_stairs_of_a_label_keep_the_bound():
    z, y, x = np.ogrid[-8:9, -16:17, -16:17]
    stairs = marching_cubes((x * x + y * y + 4 * z * z < 200).astype(np.uint8), 0.5, normals=False)
    small = simplify(stairs, max_error=0.25)
    assert small.closed
    assert len(small.faces) < 0.5 * len(stairs.faces)
    assert largest_error(stairs, small) <= 0.25


def test_a_bound_far_below_the_detail_removes_only_what_is_flat():
    box = sheet(20, 20, lambda x, y: np.maximum(0, x - 10) * 1.0)
    small = simplify(box, max_error=1e-4)
    assert len(small.faces) < 0.4 * len(box.faces)
    assert largest_error(box, small) <= 1e-4


def test_with_an_open_border_the_bound_is_kept_too():
    hills = sheet(40, 30, lambda x, y: 2 * np.sin(x / 5) * np.cos(y / 4))
    small = simplify(hills, max_error=0.2)
    assert border_positions(small) == border_positions(hills)
    assert len(small.faces) < 0.5 * len(hills.faces)
    assert largest_error(hills, small) <= 0.2


# Peers


def mean_error(mesh, small):
    """Mean over both ways of the distance at points spread over the surfaces."""
    both = []
    for one, other in ((mesh, small), (small, mesh)):
        both.append(distances(spread(one, 5000, 3)[:5000], other).mean())
    return sum(both) / 2


def bumpy():
    ball = icosphere(5, 10.0)
    x, y, z = ball.vertices.T
    return as_mesh(ball.vertices * (1 + 0.1 * np.sin(x) * np.sin(y) * np.sin(z))[:, None], ball.faces)


@pytest.mark.parametrize("reduction", [0.5, 0.9])
def test_the_mean_error_is_no_worse_than_that_of_vtk(reduction):
    vtk = pytest.importorskip("vtk", reason="vtk is not installed")
    support = pytest.importorskip("vtk.util.numpy_support")
    mesh = bumpy()
    poly = vtk.vtkPolyData()
    points = vtk.vtkPoints()
    points.SetData(support.numpy_to_vtk(mesh.vertices))
    poly.SetPoints(points)
    cells = vtk.vtkCellArray()
    offsets = np.arange(0, 3 * len(mesh.faces) + 1, 3)
    cells.SetData(
        support.numpy_to_vtkIdTypeArray(offsets), support.numpy_to_vtkIdTypeArray(mesh.faces.ravel().astype(np.int64))
    )
    poly.SetPolys(cells)
    decimation = vtk.vtkQuadricDecimation()
    decimation.SetInputData(poly)
    decimation.SetTargetReduction(reduction)
    decimation.Update()
    out = decimation.GetOutput()
    peer = as_mesh(
        support.vtk_to_numpy(out.GetPoints().GetData()),
        support.vtk_to_numpy(out.GetPolys().GetConnectivityArray()).reshape(-1, 3),
    )
    ours = simplify(mesh, target_faces=len(peer.faces))
    assert mean_error(mesh, ours) < mean_error(mesh, peer)


def test_the_mean_error_is_no_worse_than_that_of_fast_simplification():
    peer = pytest.importorskip("fast_simplification", reason="fast-simplification is not installed")
    mesh = bumpy()
    theirs = as_mesh(*peer.simplify(mesh.vertices, mesh.faces, 0.9))
    ours = simplify(mesh, target_faces=len(theirs.faces))
    assert mean_error(mesh, ours) < mean_error(mesh, theirs)


# Goals


@pytest.mark.parametrize(
    ("goals", "words"),
    [
        ({}, "none"),
        ({"reduction": 0.5, "target_faces": 10}, "reduction and target_faces"),
        ({"reduction": 1.0}, r"reduction 1 is outside \[0, 1\)"),
        ({"reduction": -0.1}, r"reduction -0.1 is outside"),
        ({"reduction": float("nan")}, r"reduction nan is outside"),
        ({"target_faces": 0}, "target_faces 0 is below 1"),
        ({"max_error": 0.0}, "max_error 0 is not above 0"),
        ({"max_error": float("inf")}, "max_error inf is not"),
    ],
)
def test_a_goal_outside_its_limits_is_refused_with_its_value(goals, words):
    with pytest.raises(SettingsError, match=words) as refusal:
        simplify(icosphere(0), **goals)
    assert isinstance(refusal.value, CtmcError)


def test_an_empty_mesh_stays_empty():
    empty = as_mesh(np.empty((0, 3)), np.empty((0, 3)))
    assert len(simplify(empty, reduction=0.5).faces) == 0


@pytest.mark.parametrize("shift", [0.0, 500.0, 5000.0])
def test_a_maximum_error_below_the_rounding_of_the_positions_leaves_the_surface_alone(shift):
    radius = np.sqrt(((np.indices((14, 14, 14)) - 6.5) ** 2).sum(axis=0)).astype(np.float32)
    ball = marching_cubes(-radius, -4.6)
    moved = TriangleMesh(ball.vertices + np.float32(shift), ball.faces)
    found = simplify(moved, max_error=1e-9)
    assert found.closed
    assert np.isclose(found.volume, moved.volume, rtol=1e-6)
    assert len(found.faces) == len(moved.faces)


def test_too_much_for_the_memory_is_refused_before_the_work():
    mesh = icosphere(3)
    needed = Goal(reduction=0.5).bytes_at_once(len(mesh.faces))
    assert len(simplify(mesh, reduction=0.5, budget=Budget(bytes=needed)).faces) == len(mesh.faces) // 2
    with pytest.raises(MemoryLimitError):
        simplify(mesh, reduction=0.5, budget=Budget(bytes=needed - 1))
    assert simplify(mesh, reduction=0.0, budget=Budget(bytes=0)) is mesh
