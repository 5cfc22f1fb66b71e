# SPDX-License-Identifier: GPL-3.0-or-later
"""Parts extracted from shapes of a closed form: closed, without crossings, along exact planes and rims.

Steps of the lattice are 1 mm unless an affine says otherwise. A ball of 10 steps is 0.6 % too small by its chords. A
plane through samples passes them by 1/256 of a step.
"""

import numpy as np
import pytest
from complexes import assert_labels_sound, edges_of, junction_edges
from solids import Ball, assert_parts, ball_volume, cap_volume, signed_distances

from ctmc_addon.core import MeshError, finish
from ctmc_addon.core.machine.budget import Budget
from ctmc_addon.core.mesh.intersections import self_intersections
from ctmc_addon.core.solid import Bar, HalfSpace, Lattice
from ctmc_addon.core.solid.cells.extract import extract_parts_steps
from ctmc_addon.core.solid.cells.recipe import Recipe
from ctmc_addon.core.solid.fields.lattice_fields import ShapeField
from ctmc_addon.core.solid.fields.shapes import Union
from ctmc_addon.core.solid.rule import PartRule

PASSES = 0.0041  # A plane passes samples by this.
MIDDLE = (11.8, 12.1, 12.3)
BALL = Ball(MIDDLE, 9.6)
OBLIQUE = np.array([[0.7, -0.2, 0.3, 5], [0.1, 0.8, -0.4, -9], [-0.2, 0.3, 1.4, 30], [0, 0, 0, 1]])
MIRRORED = OBLIQUE * [-1, 1, 1, 1]
AFFINES = pytest.mark.parametrize("affine", [np.eye(4), OBLIQUE, MIRRORED], ids=["plain", "oblique", "mirrored"])


def lattice(affine=None, count=25):
    along = np.arange(count, dtype=float)
    return Lattice(along, along, along, np.eye(4) if affine is None else affine)


def extracted(shapes, rule, on=None, threads=None):
    on = on or lattice()
    recipe = Recipe(on, [ShapeField(shape, on) for shape in shapes], rule, {})
    return finish(extract_parts_steps(recipe, Budget(threads=threads))).mesh


def assert_sound(mesh):
    """All parts are closed, and the triangles of all of them together do not cross."""
    assert_labels_sound(mesh)
    assert not len(self_intersections(mesh.vertices, mesh.faces))
    assert_parts([mesh.of_label(part) for part in mesh.labels], crossings=False)


def volumes(mesh):
    return [mesh.of_label(part).volume for part in mesh.labels]


def middle_of(on):
    """The middle of a lattice, and the radius of a ball that lies in it."""
    low, high = np.zeros(3), np.array([len(on.x) - 1] * 3)
    corner = on.affine[:3, :3] @ ((low + high) / 2) + on.affine[:3, 3]
    inverse = np.linalg.inv(on.affine[:3, :3])
    return tuple(corner.tolist()), float((high / 2 - 2).min() / np.sqrt((inverse**2).sum(axis=1)).max())


def test_a_shape_alone_is_as_large_as_its_closed_form_says():
    mesh = extracted([BALL], PartRule(1))
    assert_sound(mesh)
    assert volumes(mesh) == [pytest.approx(ball_volume(9.6), rel=0.008)]
    assert np.abs(BALL.at(mesh.vertices.T.astype(float))).max() < 0.05


@AFFINES
@pytest.mark.parametrize("normal", [(0, 0, 1), (1, 2, -3)])
def test_parts_of_a_cut_lie_on_their_sides_and_share_vertices(affine, normal):
    on = lattice(affine)
    middle, radius = middle_of(on)
    offset = 0.3 * radius
    plane = HalfSpace(tuple(np.array(middle) + offset * HalfSpace(middle, normal).unit), normal)
    ball = Ball(middle, radius)
    mesh = extracted([ball, plane], PartRule(1, cuts=[1]), on)
    assert_sound(mesh)
    first, second = (mesh.of_label(part) for part in mesh.labels)
    heights = [plane.at(each.vertices.T.astype(float)) for each in (first, second)]
    assert heights[0].min() > -0.01
    assert heights[1].max() < 0.01
    shared = set(map(tuple, first.vertices)) & set(map(tuple, second.vertices))
    on_plane = {tuple(each) for each, height in zip(first.vertices, heights[0], strict=True) if abs(height) < PASSES}
    assert len(shared) > 150
    assert on_plane >= shared
    assert len(on_plane) <= len(shared) + 3  # of the ball, by chance
    coarse = 0.02 if affine[0, 0] == 1 else 0.06  # larger steps in one direction
    assert first.volume == pytest.approx(cap_volume(radius, offset), rel=coarse)
    alone = extracted([ball], PartRule(1), on)
    assert first.volume + second.volume == pytest.approx(volumes(alone)[0], rel=2e-3)


@pytest.mark.parametrize("normal", [(0, 0, 1), (1, 1, 0), (1, 2, -3)])
@pytest.mark.parametrize("offset", [0.0, 4.7])
def test_the_rim_of_a_cut_is_the_exact_circle(normal, offset):
    plane = HalfSpace(tuple(np.array(MIDDLE) + offset * HalfSpace(MIDDLE, normal).unit), normal)
    mesh = extracted([BALL, plane], PartRule(1, cuts=[1]))
    rim = np.unique(junction_edges(mesh))
    radius = np.sqrt(9.6**2 - offset**2)
    places = mesh.vertices[rim].astype(float)
    assert len(rim) > 2 * np.pi * radius
    assert np.abs(plane.at(places.T)).max() < PASSES
    off = np.linalg.norm(places - np.array(plane.point), axis=1)
    assert np.abs(off - radius).max() < 0.1
    # The circle itself lies on both parts.
    along = np.linalg.svd(plane.unit[None])[2][1:]
    turn = np.linspace(0, 2 * np.pi, 200)[:, None]
    circle = plane.point + radius * (np.cos(turn) * along[0] + np.sin(turn) * along[1])
    for part in mesh.labels:
        assert np.abs(signed_distances(circle, mesh.of_label(part))).max() < 0.1


@AFFINES
def test_a_wall_thinner_than_a_cell_is_whole_and_cut(affine):
    on = lattice(affine)
    middle, radius = middle_of(on)
    inner = Ball(middle, radius - 0.35 * on.shortest_mm)
    plane = HalfSpace(middle, (1, 2, 3))
    mesh = extracted([Ball(middle, radius), inner, plane], PartRule(1, hollow=1, cuts=[2]), on)
    assert_sound(mesh)
    expected = (ball_volume(radius) - ball_volume(inner.radius)) / 2
    assert volumes(mesh) == pytest.approx([expected, expected], rel=0.04)
    # An open half shell is one surface without a handle.
    assert [mesh.of_label(part).euler for part in mesh.labels] == [2, 2]


@pytest.mark.parametrize("count", [2, 3])
def test_several_planes_make_parts_that_add_up(count):
    normals = [(1, 0.3, -0.2), (-0.1, 1, 0.4), (0.2, -0.3, 1)][:count]
    planes = [HalfSpace((12.5, 11.2, 12.9), normal) for normal in normals]
    rule = PartRule(1, cuts=list(range(1, count + 1)))
    mesh = extracted([BALL, *planes], rule)
    assert_sound(mesh)
    assert len(mesh.labels) == 2**count
    assert sum(volumes(mesh)) == pytest.approx(volumes(extracted([BALL], PartRule(1)))[0], rel=2e-3)
    for part in mesh.labels:
        vertices = mesh.of_label(part).vertices.T.astype(float)
        for bit, plane in enumerate(planes):
            sign = -1 if part - 1 >> bit & 1 else 1
            assert (sign * plane.at(vertices)).min() > -0.01


@pytest.mark.parametrize("normal", [(0, 0, 1), (1, 2, -3)])
def test_a_peg_and_its_hole_a_tenth_of_a_step_apart(normal):
    plane = HalfSpace(MIDDLE, normal)
    start, end = np.array(MIDDLE) + 3 * plane.unit, np.array(MIDDLE) - 3 * plane.unit
    peg, hole = (Bar(tuple(start), tuple(end), radius) for radius in (2.5, 2.6))
    rule = PartRule(1, cuts=[1], pegs=[(2, 3)])
    mesh = extracted([BALL, plane, Union([peg]), Union([hole])], rule)
    assert_sound(mesh)
    first, second = (mesh.of_label(part) for part in mesh.labels)
    # Below the plane are 3 mm of a bar and a half ball; of 2.5 steps they are up to 6 % too small by their chords.
    stands_out = np.pi * 2.5**2 * 3 + ball_volume(2.5) / 2
    half = volumes(extracted([BALL, plane], PartRule(1, cuts=[1])))[0]
    assert first.volume - half == pytest.approx(stands_out, rel=0.06)
    gap = np.pi * (2.6**2 - 2.5**2) * 3 + (ball_volume(2.6) - ball_volume(2.5)) / 2
    whole = volumes(extracted([BALL], PartRule(1)))[0]
    assert whole - first.volume - second.volume == pytest.approx(gap, rel=0.25)
    of_peg = first.vertices[plane.at(first.vertices.T.astype(float)) < -0.5]
    distances = signed_distances(of_peg, second)
    assert len(of_peg) > 100
    assert distances.min() > 0
    assert np.abs(distances - 0.1).max() < 0.1


def test_a_drain_opens_a_hollow_and_two_are_a_handle():
    inner = Ball(MIDDLE, 8.1)
    closed = extracted([BALL, inner], PartRule(1, hollow=1))
    assert [closed.of_label(1).components, closed.of_label(1).euler] == [2, 4]
    for ends, euler in (((8.0,), 2), ((8.0, -8.0), 0)):
        bars = [Bar((11.8, 12.1, 12.3 + end / 2), (11.8, 12.1, 12.3 + 1.6 * end), 2.0) for end in ends]
        mesh = extracted([BALL, inner, Union(bars)], PartRule(1, hollow=1, drains=2))
        assert_sound(mesh)
        own = mesh.of_label(1)
        assert (own.components, own.euler) == (1, euler)
        # Each takes a disc of wall, about a cylinder of radius 2 and length 1.5.
        taken = closed.of_label(1).volume - own.volume
        assert taken == pytest.approx(len(ends) * np.pi * 2**2 * 1.5, rel=0.06)


def random_recipe(seed):
    """Shapes in a random pose, and a rule in which any of them may matter."""
    draw = np.random.default_rng(seed)
    ball = Ball(tuple(draw.uniform(11.5, 12.5, 3)), draw.uniform(7, 9.5))
    shapes = [ball]
    rule = PartRule(1)
    if draw.random() < 0.6:
        rule.hollow = len(shapes)
        shapes.append(Ball(ball.center, ball.radius - draw.uniform(0.2, 2)))
    if draw.random() < 0.4:
        rule.drains = len(shapes)
        end = np.array(ball.center) + draw.normal(size=3) * 8
        shapes.append(Union([Bar(ball.center, tuple(end), draw.uniform(0.8, 2))]))
    for _ in range(draw.integers(1, 3)):
        rule.cuts.append(len(shapes))
        shapes.append(HalfSpace(tuple(draw.uniform(10, 14, 3)), tuple(draw.normal(size=3))))
    return shapes, rule


@pytest.mark.parametrize("seed", range(6))
def test_parts_of_random_recipes_are_closed_and_add_up(seed):
    shapes, rule = random_recipe(seed)
    mesh = extracted(shapes, rule)
    assert_sound(mesh)
    uncut = PartRule(1, rule.hollow, {}, rule.drains)
    kept = shapes[: rule.cuts[0]]
    whole = extracted(kept, uncut)
    assert sum(volumes(mesh)) == pytest.approx(sum(volumes(whole)), rel=0.01)


@pytest.mark.parametrize("factor", [1, 2.5])
def test_planes_that_coincide_leave_no_part_open(factor):
    """Three surfaces of which two coincide have no order on an edge; the second is moved a little."""
    normal = np.array([1.0, 2.0, 3.0])
    planes = [HalfSpace(MIDDLE, tuple(normal)), HalfSpace(MIDDLE, tuple(normal * factor))]
    mesh = extracted([BALL, *planes], PartRule(1, cuts=[1, 2]))
    assert_sound(mesh)
    sizes = sorted(volumes(mesh))
    assert sizes[-2:] == pytest.approx([ball_volume(9.6) / 2] * 2, rel=0.012)
    assert sum(sizes[:-2]) < np.pi * 9.6**2 / 40  # a sheet of a fortieth of a step at most


def test_surfaces_that_coincide_however_shapes_are_moved_are_an_error():
    on = lattice()
    ball, plane = ShapeField(BALL, on), ShapeField(HalfSpace(MIDDLE, (0, 0, 1)), on)
    held = Fixed(ball)
    rule = PartRule(1, hollow=1, cuts=[2])
    with pytest.raises(MeshError, match=r"surfaces of a solid coincide.* change its lengths or places by 0\.1 mm"):
        finish(extract_parts_steps(Recipe(on, [held, held, plane], rule, {}), Budget()))


class Fixed:
    """A field that is not moved."""

    def __init__(self, field):
        self.above, self.values_steps, self.keeps_volume = field.above, field.values_steps, False


def test_results_do_not_hang_on_threads():
    shapes, rule = random_recipe(3)
    one, several = (extracted(shapes, rule, threads=threads) for threads in (1, 4))
    assert one.vertices.tobytes() == several.vertices.tobytes()
    assert one.faces.tobytes() == several.faces.tobytes()
    assert one.sides.tobytes() == several.sides.tobytes()
    assert len(edges_of(one.faces)[0]) > 1000
