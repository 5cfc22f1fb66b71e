# SPDX-License-Identifier: GPL-3.0-or-later
"""Walls that are thickened to a least thickness: plates, bars and shells of a closed form, and bodies without any."""

import re
from dataclasses import replace

import numpy as np
import pytest
from meshes import as_mesh, icosphere, joined

from ctmc_addon.core import ReconstructionSettings, Volume, finish, marching_cubes
from ctmc_addon.core.mesh.distance.triangle_tree import TriangleTree
from ctmc_addon.core.solid import SolidRequest, solid_parts
from ctmc_addon.core.solid.placing.least_wall import thin_walls_steps
from ctmc_addon.core.solid.placing.near_cells import near_cells_steps
from ctmc_addon.readers import read_volume

pytestmark = pytest.mark.once

UNIT = np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0)
POSES = pytest.mark.parametrize("degrees", [0.0, 33.0, 70.0])


def turn(degrees):
    """The rotation about an oblique axis."""
    x, y, z = UNIT
    across = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.radians(degrees)
    return np.eye(3) + np.sin(angle) * across + (1 - np.cos(angle)) * across @ across


def box(half_sides):
    """A box with its exact distance, positive inside."""

    def depth(points):
        over = np.abs(points) - np.reshape(half_sides, (3, *[1] * (points.ndim - 1)))
        return -np.linalg.norm(np.maximum(over, 0), axis=0) - np.minimum(over.max(axis=0), 0)

    return depth


def capsule(radius, half):
    def depth(points):
        along = np.maximum(np.abs(points[0]) - half, 0)
        return radius - np.sqrt(along**2 + points[1] ** 2 + points[2] ** 2)

    return depth


def extracted(depth, half, degrees=0.0, step=0.4):
    """The surface of a body about the origin in a pose, mm."""
    along = [np.arange(-half, half + step, step) + offset * step for offset in (0.31, 0.17, 0.43)]
    z, y, x = np.meshgrid(along[2], along[1], along[0], indexing="ij")
    turned = np.tensordot(turn(degrees).T, np.stack([x, y, z]), 1)
    mesh = marching_cubes(depth(turned), 0.0, normals=False)
    return as_mesh(mesh.vertices * step + [each[0] for each in along], mesh.faces)


def thin_walls(mesh, least, spacing=0.4):
    return finish(thin_walls_steps(mesh, least, spacing, threads=1))


def at(found, degrees, *points):
    """The field of the shape at points of the body's own pose."""
    return found.shape.at(turn(degrees) @ np.array(points, float).T)


@POSES
def test_a_plate_gets_the_least_thickness_exactly(degrees):
    # Half of it is 10 mm wide along x and y: the middle is asked.
    found = thin_walls(extracted(box((10, 10, 0.6)), 17.0, degrees), 2.0)
    heights = np.array([-1.1, -1.0, 0.0, 1.0, 1.1])
    for x, y in ((0, 0), (5.3, -4.1), (-7.7, 7.2)):
        values = at(found, degrees, *((x, y, z) for z in heights))
        np.testing.assert_allclose(values, 1 - np.abs(heights), atol=0.02)
    assert found.thinnest == pytest.approx(1.2, abs=0.03)
    assert 0.75 < found.share < 1
    assert abs(turn(degrees).T[2] @ found.place) < 0.05
    assert "mm at" in found.notes[0]


@POSES
def test_a_plate_does_not_grow_at_its_rim_by_more_than_its_faces(degrees):
    found = thin_walls(extracted(box((10, 10, 0.6)), 17.0, degrees), 2.0)
    # The middle ends about 0.6 mm inside the rim, and the shape 1 mm farther.
    assert at(found, degrees, (10.6, 0, 0), (0, -10.6, 0)).max() < 0


@POSES
def test_edges_and_corners_of_a_thick_box_are_no_walls(degrees):
    found = thin_walls(extracted(box((5, 4, 6)), 10.0, degrees), 3.0)
    assert found.shape is None
    assert (found.share, found.thinnest, found.place) == (0, None, None)
    assert found.notes == ("No wall is thinner than 3 mm.",)


def test_a_box_of_twelve_triangles_has_no_thin_walls():
    corners = np.array([[x, y, z] for x in (-5, 5) for y in (-5, 5) for z in (-5, 5)], float)
    quads = np.array([(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])
    mesh = as_mesh(corners, np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]]))
    assert thin_walls(mesh, 3.0).shape is None


def test_a_plate_of_twelve_triangles_is_thickened_between_its_vertices():
    corners = np.array([[x, y, z] for x in (-5, 5) for y in (-5, 5) for z in (-0.5, 0.5)], float)
    quads = np.array([(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])
    mesh = as_mesh(corners, np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]]))
    found = thin_walls(mesh, 2.0, 0.2)
    assert found.thinnest == pytest.approx(1.0, abs=1e-3)
    values = found.shape.at(np.array([[0.0, 3, -2], [0, -3, 2.2], [0, 0, 0]]))
    # Samples of 0.4 mm edges: none is farther than 0.27 mm from a point of the middle.
    assert (values > 0.7).all()
    assert (values <= 1).all()


@POSES
def test_a_bar_gets_the_least_diameter(degrees):
    found = thin_walls(extracted(capsule(0.8, 6.0), 8.0, degrees, 0.25), 2.5)
    values = at(found, degrees, (0, 0, 0), (3, 1.25, 0), (-4, 0, -1.25), (1, 0.9, 0.9), (6 + 1.25, 0, 0))
    more = values - [1.25, 0, 0, 1.25 - 0.9 * np.sqrt(2), 0]
    assert more.min() > -0.02
    assert more.max() < 0.16  # a tenth of 1.6
    assert found.share > 0.9
    assert found.thinnest == pytest.approx(1.6, abs=0.15)


@POSES
def test_only_the_thinner_of_two_plates_is_thickened(degrees):
    def plates(points):
        up = np.array([0, 0, 5.0]).reshape(3, *[1] * (points.ndim - 1))
        return np.maximum(box((9, 9, 0.5))(points - up), box((9, 9, 1.6))(points + up))

    found = thin_walls(extracted(plates, 17.0, degrees), 2.0)
    np.testing.assert_allclose(at(found, degrees, (0, 0, 6), (4, 5, 4), (0, 0, 5)), [0, 0, 1], atol=0.02)
    assert at(found, degrees, (0, 0, -5), (5, 5, -5), (-4, 4, -3.4), (9, 9, -3.4)).max() < -0.79
    assert found.thinnest == pytest.approx(1.0, abs=0.05)
    assert 0.3 < found.share < 0.5


def test_a_shell_of_a_hollow_is_thickened_on_both_sides():
    outer, inner = icosphere(5, 12.0), icosphere(5, 11.0)
    found = thin_walls(joined(outer, as_mesh(inner.vertices, inner.faces[:, ::-1])), 1.6)
    points = np.array([[12.3, 10.7, 0], [0, 0, 11.5], [0, 0, 0]])
    np.testing.assert_allclose(found.shape.at(points), [0, 0, 0.8], atol=0.02)
    assert found.share == pytest.approx(1, abs=1e-3)


def test_a_wedge_is_thickened_up_to_where_it_is_thick_enough():
    """A wedge that opens by 20 degrees from x = -8: a ball with its center on x has the radius (x + 8) sin 10°."""

    def wedge(points):
        sine, cosine = np.sin(np.radians(10)), np.cos(np.radians(10))
        return np.minimum(
            np.minimum((points[0] + 8) * sine - np.abs(points[1]) * cosine, 8 - points[0]), 6 - np.abs(points[2])
        )

    found = thin_walls(extracted(wedge, 9.0), 1.5, 0.4)
    end = 0.75 / np.sin(np.radians(10)) - 8  # of the middle, -3.68
    inside = found.shape.at(np.array([[-6.0, end - 0.4, end + 0.95], [0, 0, 0], [0, 0, 0]]))
    np.testing.assert_allclose(inside[:2], 0.75, atol=0.03)
    assert inside[2] < 0


def test_the_field_is_the_distance_and_stops_far_away():
    found = thin_walls(extracted(capsule(0.8, 6.0), 8.0, step=0.25), 2.5, 1.0)
    points = np.array([[0.0, 0, 0, 30], [2.2, 3.0, 5.0, 0], [0, 0, 0, 0]])
    np.testing.assert_allclose(found.shape.at(points), [1.25 - 2.2, 1.25 - 3, -2, -2], atol=0.16)
    low, high = found.shape.box
    np.testing.assert_allclose(high - low, [12 + 2.5, 2.5, 2.5], atol=0.32)


def test_points_outside_near_cells_are_far_from_all_triangles():
    tree = TriangleTree(joined(icosphere(1, 10.0), icosphere(3, 1.5, (14.0, 2, -3))))
    cells = finish(near_cells_steps(tree, 1.7))
    points = np.random.default_rng(5).uniform(-20, 20, (3, 20000))
    far = np.ones(20000, bool)
    far[cells.of(points)] = False
    distances = tree.distances(points.T)
    assert far.sum() > 3000
    assert distances[far].min() > cells.side >= 1.7
    assert (~far)[distances <= 1.7].all()


def test_a_mesh_without_triangles_has_no_thin_walls():
    assert thin_walls(as_mesh(np.zeros((0, 3)), np.zeros((0, 3))), 1.0).shape is None


def neck(points):
    """Two balls and a bar of 2.2 mm between them."""

    def ball(x, radius):
        return radius - np.sqrt((points[0] - x) ** 2 + points[1] ** 2 + points[2] ** 2)

    return np.maximum(np.maximum(ball(7.2, 5.0), ball(-7.7, 4.0)), capsule(1.1, 7.0)(points))


def made(depth, least, degrees):
    """A body in voxels of 1 mm, with a least wall."""
    half = 15
    at = np.indices((2 * half,) * 3)[::-1].astype(float) - half + 0.4
    values = depth(np.tensordot(turn(degrees).T, at, 1)).astype(np.float32)
    volume = Volume(values, np.eye(4), name="body")
    (part,) = solid_parts(volume, ReconstructionSettings(threshold=0.0), SolidRequest(least_wall=least))
    return part


def told(note):
    """How thin a note says that walls are, where, and by how much they are thickened."""
    found = re.search(r"down to ([\d.]+) mm at (\S+) (\S+) (\S+); they are thickened, by up to ([\d.]+) mm", note)
    assert found, note
    thinnest, *place, more = map(float, found.groups())
    return thinnest, np.array(place), more


@pytest.mark.parametrize("degrees", [0.0, 33.0])
@pytest.mark.parametrize("least", [2.5, 4.0])
@pytest.mark.parametrize(("depth", "thickness"), [(box((10, 9, 0.8)), 1.6), (neck, 2.2)], ids=["plate", "neck"])
def test_no_wall_is_thinner_than_asked_afterward_and_a_note_says_where_it_was(depth, thickness, least, degrees):
    part = made(depth, least, degrees)
    thinnest, place, more = told(part.notes[0])
    assert thinnest == pytest.approx(thickness, abs=0.35)  # In voxels of 1 mm the bar is 1.9 to 2 mm thick.
    assert more == pytest.approx(least - thinnest, abs=0.01)
    inside = turn(degrees).T @ (place - 15 + 0.4)
    assert depth(inside) == pytest.approx(thickness / 2, abs=0.3)  # In the middle of the wall, where it is thin.
    if depth is neck:
        assert -4.5 < inside[0] < 3.0
    assert part.printing.thinnest_wall_mm > least - 0.25
    assert part.printing.below_least_wall < 0.005
    assert part.mesh.closed
    assert part.self_intersections == 0


@pytest.mark.parametrize(("label", "least"), [(64, 3.0), (64, 7.0), (29, 4.0)], ids=["vein", "vein 7", "vertebra"])
def test_no_wall_of_a_patient_is_thinner_than_asked_afterward(real, label, least):
    labels = replace(read_volume(real("ts_nifti") / "example_seg_fast_force_split.nii.gz"), kind="label")
    (part,) = solid_parts(labels, ReconstructionSettings(), SolidRequest(least_wall=least), [label])
    assert part.printing.thinnest_wall_mm > least - 0.25 * 3
    assert part.self_intersections == 0


def test_every_ball_between_the_sides_of_a_coarse_plate_is_found():
    """Samples of both sides share patches, in which their normals cancel."""
    at = np.indices((30, 30, 30))[::-1].astype(float) - 14.6
    mesh = marching_cubes(box((10, 9, 0.8))(at), 0.0, normals=False)
    found = thin_walls(as_mesh(mesh.vertices - 14.6, mesh.faces), 2.5, 1.0)
    assert found.share > 0.83
