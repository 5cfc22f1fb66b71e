# SPDX-License-Identifier: GPL-3.0-or-later
"""Pegs in solids of a closed form, in oblique poses."""

import re
from itertools import pairwise

import numpy as np
import pytest
from meshes import icosphere

from ctmc_addon.core import SettingsError, finish
from ctmc_addon.core.mesh.distance.signed_distance import SignedSurface
from ctmc_addon.core.solid import Cut, HalfSpace, Pegs
from ctmc_addon.core.solid.fields.depth import depth_below
from ctmc_addon.core.solid.placing.pegs import placed_pegs_steps, require_met

AXES = pytest.mark.parametrize("axis", [(0, 0, 1), (1, 2, -3), (-5, 1, 0)])
CORNERS = np.array([[x, y, z] for x in (-40, 40) for y in (-40, 40) for z in (-40, 40)], float)


def unit(axis):
    return np.array(axis, float) / np.linalg.norm(axis)


def steps_of(depth):
    """Return a depth in closed form as steps."""

    def depth_steps(points):
        yield from ()
        return depth(points)

    return depth_steps


def cylinder(axis, radius=10.0, half=30.0):
    """A cylinder about the origin."""
    along = unit(axis)

    def depth(points):
        height = along @ points
        return np.minimum(radius - np.linalg.norm(points - along[:, None] * height, axis=0), half - np.abs(height))

    return depth


def slab(half_sides):
    """A box about the origin."""
    return lambda points: (np.array(half_sides, float)[:, None] - np.abs(points)).min(axis=0)


def place(depth, axis=(0, 0, 1), point=(0, 0, 0), sides=(), extent=CORNERS, **pegs):
    request = Pegs(**{"count": 2, "diameter": 4.0, "length": 6.0, "clearance": 0.2} | pegs)
    return finish(placed_pegs_steps(Cut(point, axis), request, steps_of(depth), sides, extent))


def distances_between(places):
    return [np.linalg.norm(a - b) for number, a in enumerate(places) for b in places[:number]]


def on_holes(placed, plane):
    """Points on the surface of holes within part b, (3, n)."""
    points = np.random.default_rng(3).normal(size=(3, 4000))
    points *= 0.999 / np.linalg.norm(points, axis=0)
    found = []
    for bar in placed.holes.shapes:
        start, end = np.array(bar.start)[:, None], np.array(bar.end)[:, None]
        for at in np.linspace(0, 1, 21):
            shell = start + (end - start) * at + bar.radius * points
            found.append(shell[:, np.abs(bar.at(shell)) < 0.01])
    found = np.concatenate(found, axis=1)
    return found[:, plane.at(found) < 0]


@AXES
def test_two_pegs_stand_far_apart_in_a_round_section(axis):
    placed = place(cylinder(axis), axis)
    assert np.abs(unit(axis) @ placed.places.T).max() < 1e-9
    assert len(placed.places) == 2
    assert placed.notes == ()
    # Radius, hole and margin leave 10 - 2 - 0.2 - 0.8 = 7 mm from the axis at most.
    assert np.linalg.norm(placed.places, axis=1).max() <= 7
    assert distances_between(placed.places)[0] > 2 * 7 - 1.0


@AXES
def test_pegs_and_holes_end_where_they_should(axis):
    placed = place(cylinder(axis), axis, count=1)
    along, at = unit(axis), placed.places[0]

    def points(*heights):
        return at[:, None] + along[:, None] * np.array(heights)

    np.testing.assert_allclose(placed.pegs.at(points(-6.0, -7.0, 4.0)), [0, -1, 0], atol=1e-9)
    np.testing.assert_allclose(placed.holes.at(points(-6.2, -7.0, 0.0)), [0, -0.8, 2.2], atol=1e-9)
    aside = np.cross(along, [0.3, 0.5, 0.7])
    aside = (aside / np.linalg.norm(aside))[:, None]
    np.testing.assert_allclose(placed.pegs.at(points(0.0, -4.0) + 2 * aside), 0, atol=1e-9)
    np.testing.assert_allclose(placed.holes.at(points(0.0, -4.0) + 2.2 * aside), 0, atol=1e-9)


@AXES
def test_a_margin_of_material_is_left_around_holes(axis):
    depth, along = cylinder(axis, 9.0, 8.5), unit(axis)
    other = HalfSpace(tuple(np.cross(along, [1, 0, 1]) * 2), tuple(np.cross(along, [1, 0, 1])))
    placed = place(depth, axis, sides=(other,), diameter=2.0)
    holes = on_holes(placed, HalfSpace((0, 0, 0), axis))
    assert holes.shape[1] > 500
    assert depth(holes).min() > 0.4 - 0.02
    assert other.at(holes).min() > 0.4 - 0.02


def test_the_walls_between_many_holes_stay():
    placed = place(slab((12, 12, 10)), count=9, diameter=3.0, length=4.0)
    assert len(placed.places) == 9
    assert min(distances_between(placed.places)) >= 3 + 2 * 0.2 + 0.6


def test_fewer_pegs_are_placed_where_no_more_fit():
    # Between -3 and 3 along x centers fit; holes of 4.4 mm and 0.8 mm between them take 5.2 mm from each to the next.
    placed = place(slab((6.0, 3.3, 10)), count=4)
    assert len(placed.places) == 2
    assert distances_between(placed.places)[0] >= 5.2
    assert placed.notes == ("Only 2 of 4 pegs fit on the cut at 0 0 0; thinner pegs may leave room for more",)


def test_pegs_that_fit_only_away_from_the_deepest_place_are_all_found():
    # Centers from -5.5 to 5.5, 5.2 apart at least: none may stand at 1.5, where it is deepest.
    box = slab((8.5, 3.2, 10))
    bulge = np.array([[1.5], [0.0]])
    placed = place(lambda points: np.maximum(box(points), 3.6 - np.linalg.norm(points[:2] - bulge, axis=0)), count=3)
    assert [round(x) for x in sorted(placed.places[:, 0])] in ([-6, 0, 6], [-5, 0, 5], [-6, 0, 5], [-5, 0, 6])
    assert min(distances_between(placed.places)) >= 5.2


def test_a_narrow_neck_of_a_large_structure_is_found():
    neck = cylinder((0, 0, 1), 3.2)

    def moved(points):
        return neck(points - np.array([[31.3], [-17.7], [0]]))

    placed = place(moved, count=1)
    assert np.linalg.norm(placed.places[0] - (31.3, -17.7, 0)) <= 0.2


def test_holes_that_are_there_are_kept_clear():
    depth = cylinder((0, 0, 1), 12)
    first = place(depth, count=1)
    request = Pegs(1, 4.0, 6.0, 0.2)
    cut = Cut((0, 0, 0), (0, 0, 1))
    steps = placed_pegs_steps(cut, request, steps_of(depth), (), CORNERS, avoid=(first.holes,))
    second = finish(steps)
    assert distances_between([*first.places, *second.places])[0] >= 2 * 2.2 + 0.8


@pytest.mark.parametrize("length", [6.0, 9.0])
def test_a_refusal_names_the_largest_peg_that_fits(length):
    depth = cylinder((1, 2, 3), 4.0)
    with pytest.raises(SettingsError) as refused:
        place(depth, (1, 2, 3), diameter=7.0, length=length)
    largest = float(re.search(r"--peg-mm ([\d.]+) ", str(refused.value))[1])
    assert 5.2 <= largest <= 5.43  # 2 * (4 - 0.2) / (1 + 2 * 0.2), less what squares of 0.1 mm lose
    assert len(place(depth, (1, 2, 3), count=1, diameter=largest, length=length).places) == 1


def test_a_refusal_says_that_none_fits():
    with pytest.raises(SettingsError, match=r"nor does one of 0.8 mm; make pegs much smaller"):
        place(slab((10, 10, 0.4)), point=(0, 0, 0.1))


def test_a_plane_beside_the_structure_says_where_it_lies():
    box = np.array([[-5, -5, 2], [5, 5, 12]], float)
    with pytest.raises(SettingsError, match=r"lies 2 to 12 mm along its normal .* such as to 0 0 7$"):
        place(lambda points: -np.ones(points.shape[1]), extent=box)
    require_met(Cut((0, 0, 7), (0, 0, 1)), box)
    with pytest.raises(SettingsError, match=r"1\.5 to 12\.5"):
        require_met(Cut((0, 0, 0), (0, 0, 1)), box, beyond=0.5)


def test_a_plane_between_pieces_says_so():
    balls = lambda points: 5 - np.sqrt(points[0] ** 2 + points[1] ** 2 + (np.abs(points[2]) - 20) ** 2)  # noqa: E731
    with pytest.raises(SettingsError, match="between the pieces"):
        place(balls)


def test_pegs_of_a_mesh_stand_in_its_wall_where_it_is_hollow():
    surface = SignedSurface()
    finish(surface.prepare_steps(icosphere(5, 20.0)))
    cut, pegs = Cut((0, 0, 3), (1, 1, 4)), Pegs(3, 2.0, 3.0, 0.1)
    placed = finish(placed_pegs_steps(cut, pegs, depth_below(surface, 1.0, 6.0, threads=1), (), surface.mesh.vertices))
    radii = np.linalg.norm(placed.places, axis=1)
    # A wall from 15 to 21 mm, less 1 + 0.1 + 0.4 on both sides.
    assert radii.min() > 15 + 1.4
    assert radii.max() < 21 - 1.5
    assert min(distances_between(placed.places)) > 25
    assert np.abs(HalfSpace(cut.point, cut.normal).at(placed.places.T)).max() < 1e-9


def test_the_same_places_come_out_again():
    first, second = (place(cylinder((1, 2, 3)), (1, 2, 3), count=5).places for _ in range(2))
    assert (first == second).all()
    assert all(a.tolist() != b.tolist() for a, b in pairwise(first))
