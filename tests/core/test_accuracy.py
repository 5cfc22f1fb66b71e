# SPDX-License-Identifier: GPL-3.0-or-later
"""Area, volume and normals against closed forms: with which order they converge, and how far off they are."""

import numpy as np
import pytest

from benchmarks.shapes import EVEN, SHAPES, UNEVEN, angles, errors, extracted, order
from ctmc_addon.core import ReconstructionSettings, marching_cubes, reconstruct
from ctmc_addon.core.phantom.phantom import phantom
from ctmc_addon.core.volume.affine import determinant, transform_normals, transform_points

STEPS = [1.0, 0.5, 0.25]  # mm; the bodies measure 6 to 24
SMOOTH = [shape for shape in SHAPES.values() if shape.gradient is not None]
SPACINGS = pytest.mark.parametrize("spacings", [EVEN, UNEVEN], ids=["even", "uneven"])


def spaced(step, spacings):
    return tuple(step * side for side in spacings)


@SPACINGS
@pytest.mark.parametrize("shape", SHAPES.values(), ids=lambda shape: shape.name)
def test_area_and_volume_converge_with_the_square_of_the_spacing_and_area_at_edges_with_its_first_power(
    shape, spacings
):
    found = [errors(shape, spaced(step, spacings)) for step in STEPS]
    area, volume = (order(STEPS, [pair[number] for pair in found]) for number in range(2))
    assert area == pytest.approx(shape.area_order, abs=0.1)
    assert volume == pytest.approx(2, abs=0.1)


@SPACINGS
@pytest.mark.parametrize("name", ["sphere", "ellipsoid", "capsule"])
def test_a_convex_body_is_always_a_little_small_as_its_vertices_lie_on_it(name, spacings):
    for step in STEPS:
        area, volume = errors(SHAPES[name], spaced(step, spacings))
        assert -0.04 * step**2 < volume < area < 0


@SPACINGS
def test_midpoints_give_an_area_too_large_at_any_resolution_and_half_of_alpha_takes_three_quarters_away(spacings):
    too_large = 0.082 if spacings is EVEN else 0.15
    for step in STEPS:
        midpoint, half, linear = (errors(SHAPES["sphere"], spaced(step, spacings), alpha)[0] for alpha in (0, 0.5, 1))
        assert midpoint == pytest.approx(too_large, rel=0.03)
        assert half - linear == pytest.approx((midpoint - linear) / 4, rel=0.15)


@SPACINGS
def test_midpoints_keep_the_volume_all_the_same(spacings):
    for step in STEPS:
        assert abs(errors(SHAPES["sphere"], spaced(step, spacings), 0.0)[1]) < 0.0025 * step


@SPACINGS
@pytest.mark.parametrize("step", STEPS)
def test_normals_of_a_sphere_are_as_near_as_central_differences_and_interpolation_allow(step, spacings):
    # Third derivatives of the distance from the center are at most 2 / sqrt(3) / r^2. A central difference over two
    # spacings is off by s^2 / 6 times that, interpolation along an edge by s^2 / 8 times that at most.
    shape, sides = SHAPES["sphere"], np.array(spaced(step, spacings))
    mesh = extracted(shape, tuple(sides), normals=True)
    off = angles(transform_normals(np.diag([*sides, 1.0]), mesh.normals), mesh.vertices.astype(np.float64))
    nearest = shape.half[0] - 1.5 * sides.max()
    each = 2 / np.sqrt(3) / nearest**2 * (sides**2 / 6 + sides.max() ** 2 / 8)
    assert off.max() < np.degrees(np.arcsin(np.sqrt((each**2).sum())))


@SPACINGS
@pytest.mark.parametrize("shape", SMOOTH, ids=lambda shape: shape.name)
def test_normals_converge_with_the_square_of_the_spacing(shape, spacings):
    means, greatest = [], []
    for step in STEPS:
        sides = spaced(step, spacings)
        mesh = extracted(shape, sides, normals=True)
        normals = transform_normals(np.diag([*sides, 1.0]), mesh.normals)
        off = angles(normals, shape.gradient(mesh.vertices.astype(np.float64)))
        means.append(off.mean())
        greatest.append(off.max())
    assert order(STEPS, means) == pytest.approx(2, abs=0.3)
    # Where a capsule's side becomes its round end the curvature jumps, and the greatest error falls with the spacing.
    assert order(STEPS, greatest) == pytest.approx(1 if shape.name == "capsule" else 2, abs=0.15)
    assert means[-1] < 0.3


@pytest.mark.parametrize("towards", ["head", "feet"])
def test_a_sphere_on_an_oblique_tilted_grid_keeps_its_volume_and_its_normals(towards):
    # Columns and rows turned in their plane, and a gantry tilt of 18 degrees in the step between slices.
    step = np.array([0.0, -0.62, 1.9]) * (1 if towards == "head" else -1)
    affine = np.eye(4)
    affine[:3, :3] = np.stack([[0.48, 0.36, 0.0], [-0.36, 0.48, 0.0], step], axis=1)
    shape, size = SHAPES["sphere"], (15, 62, 62)
    center = transform_points(affine, np.array([[30.8, 30.4, 7.1]]))
    z, y, x = np.indices(size)
    places = transform_points(affine, np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)) - center
    mesh = marching_cubes(shape.depth(*places.T).reshape(size), 0.0)
    assert mesh.closed
    off = angles(transform_normals(affine, mesh.normals), transform_points(affine, mesh.vertices) - center)
    assert off.max() < 1.0
    assert -0.02 < abs(determinant(affine)) * mesh.volume / shape.volume - 1 < 0


@pytest.fixture(scope="module")
def made():
    return phantom(29, 256)


def tumour_error(made, side, alpha, soften):
    settings = ReconstructionSettings(label=2, stride=(side, side, 1), alpha=alpha, smoothing_mm=soften, normals="mesh")
    return reconstruct(made.labels, settings).mesh.volume / sum(made.tumour_volumes_mm3) - 1


@pytest.mark.parametrize("alpha", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("soften", [0.0, 1.5])
def test_tumors_lose_a_little_volume_and_more_on_larger_voxels(made, alpha, soften):
    one, two, three = (tumour_error(made, side, alpha, soften) for side in (1, 2, 3))
    assert -0.035 < one < 0
    assert -0.06 < three < two < one


def test_alpha_changes_a_tumour_only_where_its_label_is_softened(made):
    assert tumour_error(made, 1, 0.0, 0.0) == tumour_error(made, 1, 1.0, 0.0)
    assert tumour_error(made, 1, 0.0, 1.5) > tumour_error(made, 1, 0.5, 1.5) > tumour_error(made, 1, 1.0, 1.5)
