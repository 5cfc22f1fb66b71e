# SPDX-License-Identifier: GPL-3.0-or-later
"""Thickness and gaps against closed forms, through the whole reconstruction, and against brute force."""

import numpy as np
import pytest

from benchmarks.walls import WALLS, mapped, plate, sampled, shell, surface_of, truth, tube, values_of
from ctmc_addon.core import ReconstructionSettings, TriangleMesh, Volume, reconstruct, reconstruct_labels
from ctmc_addon.core.errors import MeshError, SettingsError
from ctmc_addon.core.maps.quantities import QUANTITIES
from ctmc_addon.core.maps.thickness import Gap, Thickness
from ctmc_addon.core.mesh.distance import tangent_balls
from ctmc_addon.core.mesh.face_normals import vertex_normals
from ctmc_addon.core.progress import finish
from ctmc_addon.readers import read_volume

POSES = pytest.mark.parametrize("degrees", [0.0, 25.0, 70.0])
EVERY_WALL = pytest.mark.parametrize("wall", WALLS.values(), ids=lambda wall: wall.name)


def errors(wall, spacing, degrees, label, **settings):
    """Relative errors where there is a closed form; NaN where a value is missing."""
    volume = sampled(wall, spacing, degrees, label)
    mesh = surface_of(volume, label, **settings)
    true = truth(wall, mesh, degrees)
    known = np.isfinite(true)
    assert known.sum() > 400
    return values_of(Thickness(), mapped(mesh, volume, label=label))[known] / true[known] - 1


def middle_and_most(off):
    assert np.isfinite(off).all()
    return tuple(np.percentile(np.abs(off), (50, 95)))


@POSES
@EVERY_WALL
@pytest.mark.parametrize(
    ("spacing", "middle", "most"), [(1.0, 0.0015, 0.006), pytest.param(0.5, 0.0005, 0.002, marks=pytest.mark.once)]
)
def test_a_field_has_the_thickness_of_the_closed_form_in_any_pose(wall, degrees, spacing, middle, most):
    found = middle_and_most(errors(wall, spacing, degrees, label=False))
    assert found[0] < middle
    assert found[1] < most


@pytest.mark.parametrize("degrees", [25.0, 70.0])
@EVERY_WALL
@pytest.mark.parametrize(
    ("spacing", "middle", "most"), [(1.0, 0.02, 0.05), pytest.param(0.5, 0.0075, 0.0155, marks=pytest.mark.once)]
)
def test_a_smoothed_label_has_the_thickness_of_the_closed_form(wall, degrees, spacing, middle, most):
    found = middle_and_most(errors(wall, spacing, degrees, label=True))
    assert found[0] < middle
    assert found[1] < most


@EVERY_WALL
def test_a_label_whose_planes_lie_along_the_grid_is_known_to_half_a_voxel(wall):
    # All samples of a layer change sides at once, so nothing tells where between two layers the plane lies.
    found = middle_and_most(errors(wall, 1.0, 0.0, label=True))
    assert found[0] < 0.03
    assert found[1] < 0.05


def test_a_plate_is_as_thick_as_it_is_to_rounding():
    assert np.percentile(np.abs(errors(plate(5.0), 1.0, 25.0, label=False)), 99) < 1e-6


def test_a_plate_two_voxels_thin_keeps_its_thickness():
    # Here the surface itself is off, where an edge of the grid runs through the middle of the plate.
    assert np.percentile(np.abs(errors(plate(2.0), 1.0, 25.0, label=False)), 99) < 0.02


def test_a_ball_is_as_thick_as_its_diameter_though_all_of_it_touches():
    volume = sampled(shell(12.0, -12.0), 1.0)
    values = values_of(Thickness(), mapped(surface_of(volume), volume))
    assert np.abs(values / 24 - 1).max() < 0.005


def test_a_thickness_scales_with_the_spacing():
    volume = sampled(tube(), 1.0, 25.0)
    large = Volume(volume.values * 10, np.diag([10, 10, 10, 1.0]) @ volume.affine)
    small_values, large_values = (values_of(Thickness(), mapped(surface_of(each), each)) for each in (volume, large))
    assert np.allclose(large_values / 10, small_values, rtol=0.01)


def two_balls(gap_mm, radius_mm=8.0):
    count = 14
    z, y, x = np.meshgrid(*[np.arange(-n, n + 1) + 0.3 for n in (count, count, 2 * count)], indexing="ij")
    apart = radius_mm + gap_mm / 2
    depth = radius_mm - np.sqrt(np.minimum((x - apart) ** 2, (x + apart) ** 2) + y * y + z * z)
    affine = np.eye(4)
    affine[:3, 3] = 0.3 - np.array([2 * count, count, count])
    return Volume(depth.astype(np.float32), affine), apart


@pytest.mark.parametrize("gap_mm", [3.0, 6.0])
def test_the_gap_between_two_balls_is_the_ball_between_them(gap_mm):
    # A ball of radius r touches the right ball, in the direction u from its center C, and the left one about -C:
    # |2 C + (R + r) u| = R + r, so R + r = C·C / -(C·u). It grows with the angle, until there is none.
    radius = 8.0
    volume, apart = two_balls(gap_mm, radius)
    mesh = surface_of(volume)
    values = values_of(Gap(), mapped(mesh, volume))
    points = mesh.vertices.astype(np.float64)
    side = np.sign(points[:, :1])
    along = (points - side * [apart, 0, 0]) / radius
    toward = -(along * side)[:, 0]  # cosine to the other ball
    with np.errstate(divide="ignore"):
        true = 2 * (apart / toward - radius)
    near = (toward > 0) & (true < 40)
    assert np.isnan(values[toward < 0]).all()
    assert np.percentile(np.abs(values[near] / true[near] - 1), 95) < 0.02
    assert np.nanmin(values) == pytest.approx(gap_mm, rel=0.02)


def test_a_gap_beyond_the_limit_has_no_value_and_a_note_says_up_to_where():
    volume, _ = two_balls(6.0)
    surface = mapped(surface_of(volume), volume)
    values = values_of(Gap(up_to_mm=5.0), surface)
    assert np.isnan(values).all()
    assert finish(Gap(up_to_mm=5.0).values_steps(surface)).notes == ("Gaps wider than 5 mm have no value.",)


def test_the_cavity_of_a_shell_is_its_gap():
    volume = sampled(shell(), 1.0)
    mesh = surface_of(volume)
    inside = np.sqrt((mesh.vertices**2).sum(axis=1)) < 14
    values = values_of(Gap(), mapped(mesh, volume))
    assert np.abs(values[inside] / 20 - 1).max() < 0.01
    assert np.isnan(values[~inside]).all()


@pytest.mark.parametrize("reduction", [0.5, 0.9])
def test_a_simplified_surface_has_the_same_thickness(reduction):
    wall = plate(6.0)
    volume = sampled(wall, 1.0, 25.0)
    mesh = surface_of(volume, reduction=reduction)
    true = truth(wall, mesh, 25.0)
    known = np.isfinite(true)
    values = values_of(Thickness(), mapped(mesh, volume))
    assert np.abs(values[known] / true[known] - 1).max() < 0.01


def test_a_box_of_twelve_triangles_is_as_thick_as_it_is():
    # The corners alone say nothing: samples stand in the triangles.
    low, high = np.zeros(3), np.array([40.0, 40.0, 6.0])
    corners = np.array([[(low, high)[i >> axis & 1][axis] for axis in range(3)] for i in range(8)], np.float32)
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    faces = [(a, b, c) for a, b, c, _ in quads] + [(a, c, d) for a, _, c, d in quads]
    middle = np.array([[20, 20, 6]], np.float32)  # A vertex in the middle of the top, with triangles to its corners.
    faces = [face for face in faces if not set(face) <= {4, 5, 6, 7}]
    faces += [(8, 4, 5), (8, 5, 7), (8, 7, 6), (8, 6, 4)]
    vertices, faces = np.concatenate([corners, middle]), np.array(faces, np.int32)
    mesh = TriangleMesh(vertices, faces, vertex_normals(vertices, faces))
    assert mesh.closed
    assert mesh.volume == pytest.approx(40 * 40 * 6)
    values = values_of(Thickness(), mapped(mesh, Volume(np.zeros((2, 2, 2), np.float32), np.eye(4))))
    assert values[8] == pytest.approx(6, rel=1e-3)


def test_without_normals_those_of_the_triangles_serve():
    volume = sampled(plate(5.0), 1.0, 25.0)
    mesh = surface_of(volume)
    bare = TriangleMesh(mesh.vertices, mesh.faces)
    known = np.isfinite(truth(plate(5.0), mesh, 25.0))
    assert np.abs(values_of(Thickness(), mapped(bare, volume))[known] / 5 - 1).max() < 0.002


def noisy_foam():
    chance = np.random.Generator(np.random.PCG64(3))
    volume = Volume(chance.standard_normal((20, 22, 24)).astype(np.float32), np.diag([0.7, 0.7, 1.5, 1.0]))
    return surface_of(volume, smoothing_mm=1.2), volume


@pytest.mark.parametrize("side", [-1, 1])
def test_the_search_finds_the_least_radius_that_brute_force_finds(side):
    mesh, volume = noisy_foam()
    gap = np.sqrt(mesh.area / len(mesh.vertices))
    depth = tangent_balls.DEPTH * gap
    points, normals = mesh.vertices.astype(np.float64), side * mesh.normals.astype(np.float64)
    quantity = Thickness() if side < 0 else Gap()
    values = values_of(quantity, mapped(mesh, volume))
    close = 0
    for number in range(0, len(points), 7):
        offset = points - points[number]
        distance = np.sqrt((offset**2).sum(axis=1))
        height = (offset * normals[number]).sum(axis=1) - tangent_balls.SLOPE * distance - depth
        radius = np.where(height > 0, distance**2 / (2 * np.where(height > 0, height, 1)), np.inf)
        best = radius.argmin()
        if not np.isfinite(radius[best]):
            assert np.isnan(values[number])
            continue
        n, m = normals[number], normals[best]
        planar = -(offset[best] * m).sum() / max(1 - (n * m).sum(), 1e-9)
        touched = planar * (n - m) - offset[best]
        near = planar > 0 and (touched**2).sum() < (tangent_balls.FAR * gap) ** 2
        true = 2 * (planar if near else distance[best] ** 2 / (2 * (offset[best] * n).sum()))
        close += bool(np.isclose(values[number], true, rtol=0.03)) or (np.isnan(values[number]) and true > 10)
    # Two samples within the tolerance of each other may be told apart by other planes.
    assert close / len(range(0, len(points), 7)) > 0.9


@pytest.mark.parametrize("quantity", [Thickness(), Gap()])
def test_threads_change_no_bit(quantity, monkeypatch):
    mesh, volume = noisy_foam()
    monkeypatch.setattr(tangent_balls, "BLOCK", 64)
    one, many = (values_of(quantity, mapped(mesh, volume, threads)) for threads in (1, 3))
    assert one.tobytes() == many.tobytes()


def test_quantities_say_what_they_are():
    assert {Thickness, Gap} <= set(QUANTITIES)
    assert [(each.flag, each().name, each().unit) for each in (Thickness, Gap)] == [
        ("thickness", "thickness_mm", "mm"),
        ("gap", "gap_mm", "mm"),
    ]


@pytest.mark.parametrize("width", [0.0, -1.0, np.nan, np.inf])
def test_a_width_that_no_gap_can_have_is_refused(width):
    with pytest.raises(SettingsError, match=r"above 0 mm, not .*; 50 mm is usual"):
        Gap(up_to_mm=width)


def test_a_mesh_without_triangles_is_refused():
    empty = TriangleMesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    with pytest.raises(MeshError, match="without triangles"):
        values_of(Thickness(), mapped(empty, Volume(np.zeros((2, 2, 2), np.float32), np.eye(4))))


@pytest.mark.once
def test_bones_of_a_patient_have_a_thickness_nearly_everywhere(real):
    volume = read_volume(real("ts_nifti") / "example_ct.nii.gz")
    mesh = reconstruct(volume, ReconstructionSettings(threshold=200.0)).mesh
    values = values_of(Thickness(), mapped(mesh, volume))
    assert np.isnan(values).mean() < 0.001
    low, middle, high = np.nanpercentile(values, (5, 50, 95))
    assert 0.3 < low < middle < high < 12


@pytest.mark.parametrize("quantity", [Thickness(), Gap()])
@pytest.mark.parametrize("corners", [np.zeros((3, 3)), [[0, 0, 0], [1, 0, 0], [2, 0, 0]], np.eye(3)])
def test_triangles_that_enclose_nothing_have_no_value(quantity, corners):
    vertices = np.asarray(corners, np.float32)
    mesh = TriangleMesh(vertices, np.array([[0, 1, 2]], np.int32))
    values = values_of(quantity, mapped(mesh, Volume(np.zeros((2, 2, 2), np.float32), np.eye(4))))
    assert np.isnan(values).all()


@pytest.mark.parametrize("interfaces", ["shared", "separate"])
@pytest.mark.parametrize("reduction", [None, 0.7, 0.9])
def test_labels_of_one_volume_are_as_thick_as_their_balls(interfaces, reduction):
    # Normals of shared walls and of simplified surfaces are means of triangles.
    z, y, x = np.indices((40, 40, 40))
    values = np.zeros((40, 40, 40), np.uint8)
    for label, middle, radius in ((1, 10, 6), (2, 28, 7)):
        values[(x - middle) ** 2 + (y - 20) ** 2 + (z - 20) ** 2 <= radius * radius] = label
    settings = ReconstructionSettings(interfaces=interfaces, reduction=reduction)
    surfaces = reconstruct_labels(Volume(values, np.eye(4), kind="label"), settings, maps=[Thickness()]).surfaces
    for surface, diameter in zip(surfaces, (12, 14), strict=True):
        off = np.abs(surface.maps[0].values / diameter - 1)
        assert np.isfinite(off).all()
        assert np.percentile(off, 95) < 0.02
        assert off.max() < 0.06
