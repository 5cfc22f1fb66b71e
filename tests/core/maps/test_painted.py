# SPDX-License-Identifier: GPL-3.0-or-later
"""Painting a volume onto a surface: values, where there are none, depth, files, and the text of the flag."""

import numpy as np
import pytest
from volumes import FileReader

from ctmc_addon.core import Budget, ReconstructionSettings, SettingsError, Volume
from ctmc_addon.core.maps.painted import Painted
from ctmc_addon.core.maps.quantity import MappedSurface
from ctmc_addon.core.mesh.triangle_mesh import TriangleMesh
from ctmc_addon.core.progress import PAUSE, finish
from ctmc_addon.core.volume import to_index, transform_points
from ctmc_addon.core.volume.sampling import sampled

SLOPE = np.array([3.0, -2.0, 0.7])  # Of the linear field, per mm.


def turned(spacing, mirrored=False):
    """Return an oblique affine whose axes are turned about all three axes of the patient."""
    a, b, c = 0.4, -0.7, 0.25
    x = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    y = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    z = np.array([[np.cos(c), -np.sin(c), 0], [np.sin(c), np.cos(c), 0], [0, 0, 1]])
    affine = np.eye(4)
    affine[:3, :3] = z @ y @ x * np.array(spacing) * ([1, 1, -1] if mirrored else [1, 1, 1])
    affine[:3, 3] = -30.0, 12.0, 7.0
    return affine


def linear_volume(affine, shape=(19, 23, 31), dtype=np.float32, reader=np.asarray, **about):
    slices, rows, columns = shape
    index = np.stack(np.meshgrid(range(columns), range(rows), range(slices), indexing="ij"), -1).reshape(-1, 3)
    values = (transform_points(affine, index) @ SLOPE).reshape(columns, rows, slices).transpose(2, 1, 0)
    return Volume(reader(np.ascontiguousarray(values.astype(dtype))), affine, **about)


def points_around(volume, share, count=5000):
    """Return points in a box that is `share` times as large as that of the samples."""
    last = np.array(volume.size) - 1.0
    index = (np.random.default_rng(3).uniform(-0.5, 0.5, (count, 3)) * share + 0.5) * last
    return transform_points(volume.affine, index).astype(np.float32)


def surface_of(vertices, volume, normals=None, faces=None, budget=None):
    faces = np.zeros((0, 3), np.int32) if faces is None else faces
    mesh = TriangleMesh(np.asarray(vertices, np.float32), faces, normals)
    return MappedSurface(mesh, ReconstructionSettings(), volume, budget or Budget(threads=1), lambda settings: None)


def painted(surface, volume, **options):
    return finish(Painted(volume, "field", **options).values_steps(surface)).values


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("spacing", [(0.5, 0.5, 0.5), (0.4, 1.3, 3.0)])
def test_a_linear_field_from_an_oblique_grid_is_painted_exactly(spacing, mirrored):
    volume = linear_volume(turned(spacing, mirrored))
    points = points_around(volume, 1.0)
    values = painted(surface_of(points, volume), volume)
    exact = points.astype(np.float64) @ SLOPE
    assert values.dtype == np.float32
    assert not np.isnan(values).any()
    assert np.abs(values - exact).max() < 1e-5 * np.ptp(volume.values)


def test_vertices_beyond_the_outermost_samples_have_no_value_and_all_others_have_one():
    volume = linear_volume(turned((0.4, 1.3, 3.0), mirrored=True))
    points = points_around(volume, 1.4)
    index = to_index(volume.affine, points)
    inside = ((index >= 0) & (index <= np.array(volume.size) - 1)).all(axis=1)
    assert 1000 < inside.sum() < 4000
    assert ((~np.isnan(painted(surface_of(points, volume), volume))) == inside).all()


def test_the_outermost_samples_themselves_have_a_value():
    volume = linear_volume(turned((0.4, 1.3, 3.0)))
    x, y, z = volume.size
    corners = np.array([(i, j, k) for i in (0, x - 1) for j in (0, y - 1) for k in (0, z - 1)])
    points = transform_points(volume.affine, corners).astype(np.float32)
    values = painted(surface_of(points, volume), volume)
    assert np.allclose(values, volume.values[corners[:, 2], corners[:, 1], corners[:, 0]], atol=1e-3)


@pytest.mark.parametrize("dtype", [np.uint8, np.int16, ">i2", np.int32, np.float64, bool])
@pytest.mark.parametrize("order", ["C", "F"])
def test_values_of_every_type_and_order_are_painted_alike(dtype, order):
    values = (np.random.default_rng(1).integers(0, 2, (6, 7, 8)) * (1 if dtype is bool else 200)).astype(dtype)
    volume = Volume(np.array(values, order=order), turned((1, 2, 3)))
    points = points_around(volume, 1.2, 500)
    plain = Volume(np.ascontiguousarray(values.astype(np.float32)), volume.affine)
    assert np.array_equal(sampled(volume, points), sampled(plain, points), equal_nan=True)


@pytest.mark.parametrize("depth", [0.0, 4.0])
@pytest.mark.parametrize("threads", [1, 3])
def test_a_file_read_by_few_slices_and_threads_give_the_same_bytes(depth, threads):
    affine = turned((0.4, 1.3, 3.0), mirrored=True)
    rng = np.random.default_rng(5)
    whole = Volume(rng.normal(0, 100, (19, 23, 31)).astype(np.float32), affine)
    reader = FileReader(np.array(whole.values))
    file = Volume(reader, affine)
    points = points_around(whole, 1.3, 40000)
    normals = rng.normal(size=points.shape).astype(np.float32)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    for how in ("mean", "max", "min") if depth else ("mean",):
        reader.slices.clear()
        expected = painted(surface_of(points, whole, normals), whole, depth_mm=depth, how=how)
        few = Budget(threads=threads, work_bytes=3 * 23 * 31 * 4 * 4)
        values = painted(surface_of(points, whole, normals, budget=few), file, depth_mm=depth, how=how)
        assert values.tobytes() == expected.tobytes()
        assert reader.slices == sorted(set(reader.slices)), "each slice is read once, in rising order"


def test_a_part_of_a_volume_is_painted_in_its_own_place():
    whole = linear_volume(turned((0.4, 1.3, 3.0)))
    part = whole.cropped((3, 4, 5), (20, 19, 15))
    points = points_around(part, 1.2)
    values = painted(surface_of(points, part), part)
    inside = ~np.isnan(values)
    assert 2000 < inside.sum() < 5000
    assert np.allclose(values[inside], sampled(whole, points)[inside], atol=1e-3)


def test_a_sample_that_is_nan_gives_no_value_but_does_not_touch_its_neighbors():
    values = np.zeros((4, 4, 4), np.float32)
    values[1, 1, 1] = np.nan
    volume = Volume(values, np.eye(4))
    points = np.array([[1, 1, 1], [1.5, 1, 1], [2, 1, 1], [0, 1, 1], [2.5, 1, 1], [1, 1, 0.5]], np.float32)
    assert np.isnan(painted(surface_of(points, volume), volume)).tolist() == [True, True, False, False, False, True]


def test_infinite_vertices_have_no_value():
    volume = linear_volume(np.eye(4))
    points = np.array([[np.nan, 1, 1], [np.inf, 1, 1], [1, 1, 1]], np.float32)
    assert np.isnan(painted(surface_of(points, volume), volume)).tolist() == [True, True, False]
    file = linear_volume(np.eye(4), reader=FileReader)
    assert np.isnan(painted(surface_of(points, file), file)).tolist() == [True, True, False]


def test_no_vertex_and_no_overlap_are_no_error():
    volume = linear_volume(np.eye(4), reader=FileReader)
    assert painted(surface_of(np.zeros((0, 3)), volume), volume).shape == (0,)
    assert np.isnan(painted(surface_of(np.full((5, 3), 1e6), volume), volume)).all()


@pytest.mark.parametrize(("how", "expected"), [("mean", -1.5), ("max", 0.0), ("min", -3.0)])
def test_depth_looks_inward_along_the_normal(how, expected):
    affine = np.diag([0.5, 0.7, 0.9, 1.0])
    values = np.broadcast_to(np.arange(21) * 0.5, (15, 15, 21)).astype(np.float32)  # x in mm
    volume = Volume(np.ascontiguousarray(values), affine)
    points = np.array([[7.0, 3.0, 4.0], [5.0, 1.0, 1.0]], np.float32)
    normals = np.array([[1, 0, 0], [1, 0, 0]], np.float32)
    found = painted(surface_of(points, volume, normals), volume, depth_mm=3.0, how=how)
    assert np.allclose(found - points[:, 0], expected, atol=1e-5)


def test_only_samples_in_the_grid_are_kept_along_the_depth():
    values = np.broadcast_to(np.arange(5.0), (5, 5, 5)).astype(np.float32)  # x in mm
    volume = Volume(np.ascontiguousarray(values), np.eye(4))
    points = np.array([[5.0, 2, 2], [1.0, 2, 2], [9.0, 2, 2]], np.float32)  # outside, inside, too far
    surface = surface_of(points, volume, np.tile(np.array([[1, 0, 0]], np.float32), (3, 1)))
    found = painted(surface, volume, depth_mm=2.0)  # at 5, 4.5, 4, 3.5, 3 and 1, 0.5, 0, -0.5, -1 mm
    assert found[:2].tolist() == [3.5, 0.5]
    assert np.isnan(found[2])


def test_normals_are_worked_out_where_a_surface_has_none():
    volume = linear_volume(np.eye(4))
    vertices = np.array([[8, 8, 9], [12, 8, 9], [8, 12, 9]], np.float32)
    faces = np.array([[0, 1, 2]], np.int32)  # counter-clockwise seen from above: the normal is +z
    lower = painted(surface_of(vertices, volume, faces=faces), volume, depth_mm=2.0)
    assert np.allclose(lower, vertices @ SLOPE - SLOPE[2] * 1.0, atol=1e-3)


@pytest.mark.parametrize(("kind", "unit"), [("HU", "HU"), ("Gy", "Gy"), ("SUVbw", "g/ml"), ("gray value", "")])
def test_the_unit_is_that_of_the_volume(kind, unit):
    quantity = Painted(linear_volume(np.eye(4), kind=kind), "dose")
    assert (quantity.name, quantity.unit) == ("dose", unit)


class Files:
    """A front end that opens one volume."""

    def __init__(self, volume):
        self.volume, self.asked = volume, []

    def volume_steps(self, path):
        yield PAUSE
        self.asked.append(path)
        return self.volume


def test_the_text_of_the_flag_names_the_map_and_the_file():
    inputs = Files(linear_volume(np.eye(4), kind="Gy"))
    steps = Painted.from_text_steps("my dose = a=b/RD.dcm", inputs, {"paint_depth": 2, "paint_how": "max"})
    quantity = finish(steps)
    assert (quantity.name, quantity.unit, quantity.depth_mm, quantity.how) == ("my dose", "Gy", 2.0, "max")
    assert inputs.asked == ["a=b/RD.dcm"]


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("RD.dcm", "--paint takes NAME=PATH, not 'RD.dcm'; such as --paint dose=RTDOSE.dcm"),
        ("=RD.dcm", "--paint takes NAME=PATH, not '=RD.dcm'; such as --paint dose=RTDOSE.dcm"),
        ("dose=", "--paint takes NAME=PATH, not 'dose='; such as --paint dose=RTDOSE.dcm"),
        ("x_mm=RD.dcm", "the name 'x_mm' is reserved for positions, normals and colors; choose another"),
        ("n" * 61 + "=RD.dcm", f"the name '{'n' * 61}' has 61 letters; use at most 60"),
    ],
)
def test_a_wrong_text_is_one_sentence_before_anything_is_read(text, sentence):
    inputs = Files(None)
    with pytest.raises(SettingsError) as error:
        finish(Painted.from_text_steps(text, inputs, {}))
    assert str(error.value) == sentence
    assert not inputs.asked


@pytest.mark.parametrize("wrong", [{"depth_mm": -1.0}, {"depth_mm": np.nan}, {"how": "median"}])
def test_wrong_options_are_refused(wrong):
    with pytest.raises(SettingsError):
        Painted(linear_volume(np.eye(4)), "dose", **wrong)


def test_long_work_can_be_cancelled_often():
    volume = linear_volume(np.eye(4))
    points = np.random.default_rng(0).uniform(0, 18, (100_000, 3)).astype(np.float32)
    surface = surface_of(points, volume, np.tile(np.array([[0, 0, 1]], np.float32), (len(points), 1)))
    steps = list(Painted(volume, "field", depth_mm=18.0).values_steps(surface))
    assert len(steps) >= 100_000 * 37 // (1 << 19)
