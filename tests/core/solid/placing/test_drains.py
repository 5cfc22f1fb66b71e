# SPDX-License-Identifier: GPL-3.0-or-later
"""Drains of balls and boxes, whose cavities and walls have a closed form."""

import re

import numpy as np
import pytest
from meshes import as_mesh, icosphere, joined

from ctmc_addon.core import SettingsError, finish, marching_cubes
from ctmc_addon.core.mesh.distance.signed_distance import SignedSurface
from ctmc_addon.core.solid import Drain
from ctmc_addon.core.solid.fields.depth import depth_below
from ctmc_addon.core.solid.placing.cubes import deepest_steps
from ctmc_addon.core.solid.placing.drains import auto_diameter, drains_steps
from ctmc_addon.core.solid.placing.hollows import cavities_steps

pytestmark = pytest.mark.once

BALL = icosphere(5, 20.0, (3.0, -2.0, 7.0))
CENTER = np.array([3.0, -2.0, 7.0])
UP = np.array([0.0, 0.0, 1.0])
WAYS = pytest.mark.parametrize("way", [(0.0, 0.0, 1.0), (2.0, -3.0, 6.0), (-1.0, 0.2, 0.1)])


def extracted(depth, half, step=0.5):
    """The surface of a field of points (3, ...) about the origin, in mm."""
    along = np.arange(-half, half + step / 2, step)
    z, y, x = np.meshgrid(along, along, along, indexing="ij")
    mesh = marching_cubes(depth(np.stack([x, y, z])), 0.0, normals=False)
    return as_mesh(mesh.vertices * step + along[0], mesh.faces)


def box(half_sides, center=(0, 0, 0)):
    """A box with its faces pointing outward, of twelve triangles."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    quads = np.array([(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])
    return as_mesh(corners * half_sides + center, np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]]))


def turned(mesh):
    """The same mesh as a cavity."""
    return as_mesh(mesh.vertices, mesh.faces[:, ::-1])


def placed(mesh, drains, wall=0.0, thicken=0.0):
    surface = SignedSurface()
    finish(surface.prepare_steps(mesh))
    return finish(drains_steps(drains, surface, depth_below(surface, thicken, threads=1), wall, thicken))


def depth_of(mesh):
    surface = SignedSurface()
    finish(surface.prepare_steps(mesh))
    return depth_below(surface, threads=1)


def unit(way):
    return np.array(way) / np.linalg.norm(way)


@WAYS
@pytest.mark.parametrize("thicken", [0.0, 1.5, -1.5])
@pytest.mark.parametrize("below", [2.0, 6.0, 0.5])
def test_a_drain_goes_straight_out_from_the_cavity_of_a_ball(way, thicken, below):
    """The cavity begins 3 mm below the surface: the first point lies in the wall, the second in the cavity."""
    surface = 20 + thicken
    point = CENTER + unit(way) * (surface - below)
    (bar,) = placed(BALL, [Drain(4.0, tuple(point))], 3.0, thicken).bars
    begin, end = np.array(bar.start) - CENTER, np.array(bar.end) - CENTER
    # The facets of the ball of triangles turn the shortest way a little.
    assert unit(begin) @ unit(way) > 0.999
    assert unit(end) @ unit(way) > 0.999
    from_middle = surface - 6 if below == 6 else surface - 3
    assert from_middle - 0.25 < np.linalg.norm(begin) <= from_middle + 0.02
    assert surface + 2 - 0.03 < np.linalg.norm(end) < surface + 3
    assert bar.radius == 2


def test_a_drain_opens_the_whole_of_a_wall():
    (bar,) = placed(box((20, 15, 10)), [Drain(5.0, (2.0, 3.0, 6.0))], 2.0).bars
    assert bar.start == (2.0, 3.0, 6.0 + (2.5 - 2.0))  # its first half ball reaches 4 mm below the surface
    np.testing.assert_allclose(bar.end, (2.0, 3.0, 12.5), atol=1e-9)
    across = np.array([[2.0, 4.4, 2.0], [3.0, 3.0, 5.4], [8.5, 9.99, 9.99]])
    assert (bar.at(across) > 0).all()


def test_a_wide_drain_keeps_out_of_the_wall_behind_a_flat_cavity():
    # From -2 to 2 it is hollow; the half ball of a bar that began at 0 would reach 3 mm.
    (bar,) = placed(box((20, 20, 5)), [Drain(6.0, (0.0, 0.0, 0.5))], 3.0).bars
    np.testing.assert_allclose(bar.start, (0, 0, 2.0), atol=1e-9)


def test_a_cavity_that_is_there_is_opened_outward_and_not_into_the_cavity():
    shell = joined(BALL, turned(icosphere(5, 12.0, CENTER)))
    (bar,) = placed(shell, [Drain(3.0, tuple(CENTER + 9.0 * UP))]).bars
    np.testing.assert_allclose(bar.start, CENTER + 9.0 * UP, atol=0.1)
    assert np.linalg.norm(np.array(bar.end) - CENTER) > 21.4
    (bar,) = placed(shell, [Drain(3.0, tuple(CENTER + 15.0 * UP))]).bars
    assert 11.7 < np.linalg.norm(np.array(bar.start) - CENTER) < 12


def test_a_point_outside_is_refused_with_one_that_works():
    with pytest.raises(SettingsError, match=r"a drain at 3 -2 40 lies 13 mm outside the surface; give") as refused:
        placed(BALL, [Drain(4.0, (3.0, -2.0, 40.0))], 3.0)
    better = tuple(float(each) for each in str(refused.value).rpartition("such as ")[2].split())
    (bar,) = placed(BALL, [Drain(4.0, better)], 3.0).bars
    np.testing.assert_allclose(bar.start, better, atol=1.1)
    assert 10 < better[2] < 24


def test_a_solid_without_a_cavity_says_so():
    with pytest.raises(SettingsError, match="reaches no cavity of the solid, which is not hollow; add --hollow"):
        placed(BALL, [Drain(4.0, tuple(CENTER + 3))])


@pytest.mark.parametrize("drain", [Drain(4.0), Drain(4.0, (1.0, 1.0, 1.0))])
def test_a_wall_that_leaves_no_cavity_is_refused_with_one_that_does(drain):
    mesh = box((20, 15, 6.3))
    with pytest.raises(SettingsError, match=r"deepest place lies 6\.3 mm below the surface") as refused:
        placed(mesh, [drain], 7.0)
    thinner = float(re.search(r"such as --hollow ([\d.]+)$", str(refused.value))[1])
    assert thinner == 3
    assert len(placed(mesh, [Drain(4.0)], thinner).bars) == 2


def test_drains_by_themselves_go_down_and_up_from_the_ends_of_a_ball():
    low, high = placed(BALL, [Drain(4.0)], 3.0).bars
    for bar, up in ((low, -1), (high, 1)):
        begin, end = np.array(bar.start) - CENTER, np.array(bar.end) - CENTER
        np.testing.assert_allclose(begin[:2], end[:2])
        assert np.abs(begin[:2]).max() < 1.0
        assert 14 < begin[2] * up < 17
        assert 21.9 < end[2] * up < 23


def test_drains_of_a_flat_floor_stand_in_its_middle():
    low, high = placed(box((20, 12, 15), (5, 5, 5)), [Drain(4.0)], 2.0).bars
    for bar, end in ((low, -12), (high, 22)):
        np.testing.assert_allclose(bar.start[:2], (5, 5), atol=0.6)
        np.testing.assert_allclose(bar.end, (*bar.start[:2], end), atol=0.11)


def test_a_spike_below_a_cavity_is_not_drilled_from_end_to_end():
    def depth(points):
        ball = 12 - np.linalg.norm(points, axis=0)
        spike = np.minimum(2 - np.linalg.norm(points[:2], axis=0), np.minimum(0 - points[2], points[2] + 28))
        return np.maximum(ball, spike)

    found = placed(extracted(depth, 29.0, 1.0), [Drain(3.0)], 2.5)
    low, high = found.bars
    assert found.notes == (
        "The drain at the lowest point takes the shortest way out; the straight way passes through more material.",
    )
    assert low.end[2] > -16
    assert high.end[2] > 13


def test_other_cavities_without_a_drain_are_told():
    # Balls of 10 and 7 mm, connected by a bar that stays solid with a wall of 3 mm, and one for itself.
    def depth(points):
        at = np.array([12, 0, 0]).reshape(3, 1, 1, 1)
        balls = 10 - np.linalg.norm(points + at, axis=0), 7 - np.linalg.norm(points - at, axis=0)
        neck = np.minimum(2.5 - np.linalg.norm(points[1:], axis=0), 12 - np.abs(points[0]))
        return np.maximum(np.maximum(*balls), neck)

    mesh = joined(extracted(depth, 23.0, 1.0), icosphere(4, 5.0, (0, 40, 0)))
    found = placed(mesh, [Drain(4.0)], 3.0)
    assert found.notes == ("--drain auto opens the largest cavity; 2 other cavities have no drain",)
    assert all(abs(bar.start[0] + 12) < 1.5 for bar in found.bars)


def test_the_drains_of_one_component_leave_the_others():
    other = icosphere(4, 10.0, (60, 0, 0))
    (bar,) = placed(joined(BALL, other), [Drain(3.0, (67.0, 0.0, 0.0))], 2.0).bars
    np.testing.assert_allclose(bar.end, (71.5, 0, 0), atol=0.3)


def test_the_deepest_place_is_found():
    depth = depth_of(box((8, 7, 5.43), (1, 2, 3)))
    point, deepest = finish(deepest_steps(depth, np.array([-10.0, -10, -10]), np.array([10.0, 10, 10])))
    assert 5.43 - 0.01 <= deepest <= 5.43 + 1e-6
    assert abs(point[2] - 3) <= 0.01


def test_cavities_fill_the_volume_that_they_have():
    found = finish(cavities_steps(depth_of(BALL), 4.0, CENTER - 20, CENTER + 20))
    assert found.further == 0
    assert found.points.shape[1] * found.side**3 == pytest.approx(4 / 3 * np.pi * 16**3, rel=0.01)


def test_the_diameter_of_drains_grows_with_the_wall():
    assert [auto_diameter(wall) for wall in (1.0, 8.0, 10.0)] == [4.0, 4.0, 5.0]
