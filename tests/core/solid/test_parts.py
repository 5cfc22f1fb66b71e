# SPDX-License-Identifier: GPL-3.0-or-later
"""Parts of solids made of volumes: gray balls and other shapes in voxels of 1 mm.

Marching Cubes makes a ball of a radius of 10 voxels 0.6 % too small, so volumes are compared with the plain surface's
where that matters.
"""

import math

import numpy as np
import pytest
from shapes import distance_mm
from solids import assert_parts, ball_volume, cap_volume, signed_distances, together
from volumes import bytes_of

from ctmc_addon.core import MeshError, ReconstructionSettings, SettingsError, Volume, reconstruct
from ctmc_addon.core.mesh.intersections import self_intersections
from ctmc_addon.core.solid import Bar, Combination, Cut, Drain, HalfSpace, Pegs, SolidRequest, solid_parts

GRAY = ReconstructionSettings(threshold=0.0)
MIDDLE = (11.5, 11.5, 11.5)
OBLIQUE_CUT = Cut(MIDDLE, (1, 2, 3))
SIZE = 24


def gray(values, spacing=(1, 1, 1), name="ball"):
    return Volume(np.asarray(values, np.float32), np.diag([*spacing, 1.0]), name=name)


def points():
    return np.indices((SIZE,) * 3)[::-1].reshape(3, -1).astype(float)


def capsule():
    return gray(Bar((7, 9, 12), (16, 14, 11), 6.0).at(points()).reshape((SIZE,) * 3))


def torus():
    x, y, z = points() - 11.5
    return gray((4.0 - np.hypot(np.hypot(x, y) - 6.5, z)).reshape((SIZE,) * 3))


def box():
    over = np.abs(points() - 11.5) - np.array([[8.3], [7.1], [6.2]])
    outside = np.linalg.norm(np.maximum(over, 0), axis=0)
    return gray((-outside - np.minimum(over.max(axis=0), 0)).reshape((SIZE,) * 3))


BALL = gray(9.3 - distance_mm((SIZE,) * 3))
PLAIN = reconstruct(BALL, GRAY).mesh
RADIUS = np.cbrt(PLAIN.volume * 3 / (4 * np.pi))  # 9.277: distances are from the plain surface, chords and all


def made(volume=BALL, settings=GRAY, labels=(), crossings=True, **solid):
    """The parts' meshes by name; all of them are closed and together do not cross."""
    parts = solid_parts(volume, settings, SolidRequest(**solid), labels)
    assert_parts([part.mesh for part in parts], crossings)
    assert all((part.part_number > 0) == part.label_name.endswith((" b", " c", " d")) for part in parts)
    return {part.label_name: part.mesh for part in parts}


def refused(error=SettingsError, volume=BALL, labels=(), settings=GRAY, **solid):
    with pytest.raises(error) as caught:
        solid_parts(volume, settings, SolidRequest(**solid), labels)
    text = str(caught.value)
    assert "\n" not in text
    return text


def rows(vertices):
    return set(map(tuple, vertices))


def inner_of(mesh, outer):
    """Vertices of a hollow part that are not those of the outer surface."""
    known = rows(outer.vertices)
    return np.array([each for each in mesh.vertices if tuple(each) not in known])


def assert_wall(mesh, outer, wall, voxel=1.0):
    walls = -signed_distances(inner_of(mesh, outer), outer) - wall
    assert len(walls) > 100
    assert np.abs(walls).mean() < 0.05 * voxel
    assert np.quantile(np.abs(walls), 0.95) < 0.15 * voxel
    assert walls.min() > -0.25 * voxel


@pytest.mark.parametrize("offset", [1.5, -2.5])
def test_a_thickened_ball_is_a_ball_of_the_offset_radius(offset):
    mesh = made(thicken=offset)["ball"]
    assert mesh.euler == 2
    radii = np.linalg.norm(mesh.vertices - np.array(MIDDLE), axis=1)
    assert radii.mean() == pytest.approx(9.3 + offset, abs=0.05)
    assert np.abs(radii - 9.3 - offset).max() < 0.1
    assert mesh.volume == pytest.approx(ball_volume(9.3 + offset), rel=0.006)  # Vertices make up for chords.


@pytest.mark.parametrize("volume", [BALL, capsule(), torus(), box()], ids=["ball", "capsule", "torus", "box"])
def test_a_hollow_keeps_the_outer_surface_and_the_wall(volume):
    plain = reconstruct(volume, GRAY).mesh
    mesh = made(volume, hollow=2.0)["ball"]
    assert rows(plain.vertices) <= rows(mesh.vertices)
    assert mesh.components == 2
    assert mesh.euler == 2 * plain.euler
    assert_wall(mesh, plain, 2.0)


def test_a_hollow_ball_has_the_volume_of_its_shell():
    mesh = made(hollow=3.0)["ball"]
    assert PLAIN.volume - mesh.volume == pytest.approx(ball_volume(RADIUS - 3), rel=0.006)


def test_thicken_and_hollow_make_a_wall_below_the_thickened_surface():
    outer = made(thicken=1.5)["ball"]
    mesh = made(thicken=1.5, hollow=2.0)["ball"]
    radii = np.linalg.norm(mesh.vertices - np.array(MIDDLE), axis=1)
    outside = radii > 9.8
    assert radii[outside].mean() == pytest.approx(10.8, abs=0.05)
    assert radii[~outside].mean() == pytest.approx(8.8, abs=0.08)
    assert mesh.volume == pytest.approx(outer.volume - ball_volume(8.8), rel=0.03)


@pytest.mark.parametrize("cut", [OBLIQUE_CUT, Cut((11.5, 11.5, 14.2), (0, 0, 1))])
def test_a_cut_makes_two_parts_that_add_up(cut):
    parts = made(cuts=[cut])
    assert list(parts) == ["ball a", "ball b"]
    plane = HalfSpace(cut.point, cut.normal)
    heights = [plane.at(mesh.vertices.T.astype(float)) for mesh in parts.values()]
    assert heights[0].min() > -0.01
    assert heights[1].max() < 0.01
    assert sum(mesh.volume for mesh in parts.values()) == pytest.approx(PLAIN.volume, rel=1e-3)
    share = cap_volume(9.3, 2.7 if cut.point[2] > 12 else 0) / ball_volume(9.3)
    assert parts["ball a"].volume / PLAIN.volume == pytest.approx(share, abs=0.005)
    # Off the plane, vertices are those of the plain surface, apart from cells at the rim.
    away = rows(mesh for mesh in PLAIN.vertices if abs(plane.at(mesh[:, None].astype(float))[0]) > 2)
    assert away <= rows(parts["ball a"].vertices) | rows(parts["ball b"].vertices)


def test_pegs_stand_a_clearance_from_their_holes():
    parts = made(cuts=[OBLIQUE_CUT], pegs=Pegs(2, 4, 4, 0.3))
    plane = HalfSpace(MIDDLE, OBLIQUE_CUT.normal)
    vertices = parts["ball a"].vertices.astype(float)
    heights = plane.at(vertices.T)
    gaps = signed_distances(vertices[heights < -0.5], parts["ball b"])
    assert len(gaps) > 50
    assert np.abs(gaps - 0.3).max() < 0.1
    assert heights.min() == pytest.approx(-4, abs=0.1)
    without = made(cuts=[OBLIQUE_CUT])
    # Two bars of 2 mm and half balls, 3 % to 8 % too small by their chords of a voxel.
    peg = np.pi * 2**2 * 2 + ball_volume(2) / 2
    assert parts["ball a"].volume - without["ball a"].volume == pytest.approx(2 * peg, rel=0.08)
    hole = np.pi * 2.3**2 * 2 + ball_volume(2.3) / 2
    assert without["ball b"].volume - parts["ball b"].volume == pytest.approx(2 * hole, rel=0.08)


def test_pegs_without_clearance_fill_their_holes():
    parts = made(cuts=[OBLIQUE_CUT], pegs=Pegs(1, 4, 4, 0))
    assert sum(mesh.volume for mesh in parts.values()) == pytest.approx(PLAIN.volume, rel=2e-3)


@pytest.mark.parametrize(("drain", "euler"), [(Drain(3, (11.5, 11.5, 14)), 2), (Drain(3), 0)])
def test_a_drain_joins_cavity_and_surface_and_two_make_a_handle(drain, euler):
    fine = gray(9.3 - distance_mm((47,) * 3, spacing=(0.5,) * 3), (0.5,) * 3)
    mesh = made(fine, hollow=2.0, drains=[drain])["ball"]
    assert (mesh.components, mesh.euler) == (1, euler)
    holes = 1 if euler == 2 else 2
    expected = ball_volume(9.3) - ball_volume(7.3) - holes * np.pi * 1.5**2 * 2
    assert mesh.volume == pytest.approx(expected, abs=4)


def test_steps_are_divided_around_pegs_and_nowhere_else():
    cuts = [Cut((11.5, 11.5, 11.5), (0, 0, 1))]
    plain, pegged = (made(cuts=cuts, **more) for more in ({}, {"pegs": Pegs(1, 2, 3)}))
    for name, mesh in plain.items():
        kept = rows(pegged[name].vertices)
        far = mesh.vertices[(np.abs(mesh.vertices - 11.5) > 3.0).all(axis=1)]  # beyond the peg and a step around it
        assert len(far) > 30
        assert rows(far) <= kept
        assert len(pegged[name].faces) < 3 * len(mesh.faces)  # 4 times if steps were halved everywhere


def test_thick_slices_and_strides_keep_walls_and_sums():
    shape, spacing = (11, 46, 46), (1, 1, 5)
    thick = gray(20.0 - distance_mm(shape, spacing=spacing), spacing)
    plain = reconstruct(thick, GRAY).mesh
    mesh = made(thick, hollow=3.0)["ball"]
    # Steps along z are divided, so that the outer surface has more vertices; all are on the plain one.
    depths = -signed_distances(mesh.vertices, plain)
    assert np.abs(depths[depths < 1.5]).max() < 0.05
    walls = depths[depths >= 1.5] - 3
    assert np.abs(walls).mean() < 0.1
    assert walls.min() > -0.4
    parts = made(thick, cuts=[Cut((22, 22, 24), (1, 2, 3))])
    assert sum(each.volume for each in parts.values()) == pytest.approx(plain.volume, rel=2e-3)


@pytest.mark.parametrize("settings", [{"stride": (2, 2, 2)}, {"alpha": 0.5}, {"region": (3, 3, 3, 21, 21, 21)}])
def test_other_surfaces_are_hollow_and_cut_too(settings):
    settings = ReconstructionSettings(threshold=0.0, close_border=True, **settings)
    plain = reconstruct(BALL, settings).mesh
    parts = made(settings=settings, cuts=[OBLIQUE_CUT])
    assert sum(mesh.volume for mesh in parts.values()) == pytest.approx(plain.volume, rel=0.005)
    mesh = made(settings=settings, hollow=4.0)["ball"]  # more than a cell's diagonal, so without rims
    assert rows(plain.vertices) <= rows(mesh.vertices)
    assert_wall(mesh, plain, 4.0, voxel=settings.stride[0])


def test_a_base_is_a_flat_foot():
    mesh = made(base=2.0)["ball"]
    low = mesh.vertices[mesh.vertices[:, 2] < mesh.vertices[:, 2].min() + 0.02]
    # The lowest point of the ball is at 2.2; the foot is as wide as the ball 2 mm higher, and 2 mm more.
    assert low[:, 2].mean() == pytest.approx(2.2, abs=0.05)
    radius = np.sqrt(9.3**2 - 7.3**2) + 2
    assert np.linalg.norm(low[:, :2] - 11.5, axis=1).max() == pytest.approx(radius, abs=1)
    grown = np.pi * radius**2 * 2 - cap_volume(9.3, 7.3)
    assert mesh.volume - PLAIN.volume == pytest.approx(grown, rel=0.15)  # its edges are cut by up to a voxel


def test_a_ball_at_the_border_is_closed_there_and_thickened_beyond_it():
    volume = gray(9.3 - distance_mm((SIZE,) * 3, (11.5, 11.5, 2)))
    parts = solid_parts(volume, GRAY, SolidRequest(thicken=2.0))
    assert any("closed at the border" in note for note in parts[0].notes)
    assert_parts([parts[0].mesh])
    # It is closed just beyond the first slice, and 2 mm farther after that.
    closed = reconstruct(volume, ReconstructionSettings(threshold=0.0, close_border=True)).mesh
    end = float(closed.vertices[:, 2].min())
    assert -1 <= end <= 0
    assert parts[0].mesh.vertices[:, 2].min() == pytest.approx(end - 2, abs=0.1)


def test_parts_are_simplified_together():
    full = made(cuts=[OBLIQUE_CUT], pegs=Pegs(1, 4, 4, 0.3))
    settings = ReconstructionSettings(threshold=0.0, reduction=0.9)
    small = made(settings=settings, cuts=[OBLIQUE_CUT], pegs=Pegs(1, 4, 4, 0.3))
    count = sum(len(mesh.faces) for mesh in small.values())
    assert count < 0.2 * sum(len(mesh.faces) for mesh in full.values())
    for name, mesh in small.items():
        assert mesh.volume == pytest.approx(full[name].volume, rel=0.01)
    assert len(rows(small["ball a"].vertices) & rows(small["ball b"].vertices)) > 10


def two_labels():
    """A ball cut by a plane in two labels that touch."""
    inside = distance_mm((SIZE,) * 3) < 9.3
    labels = inside.astype(np.uint8)
    labels[:, :, 13:][inside[:, :, 13:]] = 2
    return Volume(labels, np.eye(4), name="two", kind="label", label_names={1: "left", 2: "right"})


LABELS = ReconstructionSettings(label=1)


@pytest.mark.parametrize("reduction", [None, 0.9])
def test_labels_that_touch_share_the_walls_between_their_parts(reduction):
    settings = ReconstructionSettings(label=1, reduction=reduction)
    parts = made(two_labels(), settings, (1, 2), cuts=[OBLIQUE_CUT])
    assert list(parts) == ["left a", "left b", "right a", "right b"]
    for side in "ab":
        left, right = parts[f"left {side}"], parts[f"right {side}"]
        shared = rows(left.vertices) & rows(right.vertices)
        assert len(shared) > (100 if reduction is None else 5)
        wall = np.array(sorted(shared))[:, 0]
        assert np.abs(wall - 12.5).max() < 0.75  # The last voxel of one is at 12, the first of the other at 13.
    # Triangles that they share are there once; no others touch: `made` has looked for crossings of all together.
    vertices, faces = together(list(parts.values()))
    assert len(faces) < sum(len(mesh.faces) for mesh in parts.values())
    assert not len(self_intersections(vertices, faces))
    both = made(two_labels(), settings, (1, 2), combinations=[Combination("merge", "both", ("left", "right"))])
    assert sum(mesh.volume for mesh in parts.values()) == pytest.approx(both["both"].volume, rel=0.01)


def test_structures_are_merged_subtracted_and_intersected():
    """Two labels that touch: one without the other is itself, and what both have is nothing."""
    alone = {name: made(two_labels(), LABELS, (label,)) for name, label in (("left", 1), ("right", 2))}
    sizes = {name: mesh[name].volume for name, mesh in alone.items()}
    merged = made(two_labels(), LABELS, (1, 2), combinations=[Combination("merge", "both", ("left", "right"))])
    assert merged["both"].volume == pytest.approx(sum(sizes.values()), rel=0.01)
    assert merged["both"].euler == 2
    rest = made(two_labels(), LABELS, (1, 2), combinations=[Combination("subtract", "rest", ("left", "2"))])
    assert rest["rest"].volume == pytest.approx(sizes["left"], rel=0.01)
    # Thickened by 1.5 mm, they overlap by a disc of 3 mm, round at its rim.
    thick = {
        how: made(two_labels(), LABELS, (1, 2), thicken=1.5, combinations=[Combination(how, "new", ("left", "right"))])
        for how in ("merge", "subtract")
    }
    assert thick["merge"]["new"].volume == pytest.approx(ball_volume(10.8), rel=0.03)
    nothing = Combination("intersect", "both", ("left", "right"))
    assert "left and right do not overlap" in refused(MeshError, two_labels(), (1, 2), LABELS, combinations=[nothing])
    unknown = Combination("merge", "both", ("left", "middle"))
    assert "needs middle; the structures are left, right" in refused(
        volume=two_labels(), labels=(1, 2), settings=LABELS, combinations=[unknown]
    )


def test_the_result_does_not_hang_on_order_of_making():
    first, second = (made(hollow=2.0, cuts=[OBLIQUE_CUT]) for _ in range(2))
    for name, mesh in first.items():
        assert bytes_of(mesh.vertices) == bytes_of(second[name].vertices)
        assert bytes_of(mesh.faces) == bytes_of(second[name].faces)


@pytest.mark.once
def test_what_cannot_be_made_is_refused_with_a_remedy_that_works():
    text = refused(hollow=12.0)
    assert "a wall of 12 mm leaves no hollow in ball, which is 9.26 mm deep at most" in text
    wall = float(text.rsplit("--hollow ", 1)[1])
    assert made(hollow=wall)["ball"].components == 2
    text = refused(cuts=[Cut((11, 11, 90), (0, 0, 1))])
    assert "the cut at 11 11 90 misses the structure" in text
    point = tuple(map(float, text.rsplit("such as to ", 1)[1].split()))
    assert len(made(cuts=[Cut(point, (0, 0, 1))])) == 2
    text = refused(cuts=[OBLIQUE_CUT], pegs=Pegs(2, 14, 8, 0.2))
    assert "no peg of 14 mm and 8 mm length fits" in text
    diameter, length = map(float, text.split("--peg-mm ")[1].split(" at most")[0].split())
    made(cuts=[OBLIQUE_CUT], pegs=Pegs(1, diameter, length, 0.2))
    text = refused(hollow=2.0, drains=[Drain(3, (0, 0, 0))])
    assert "a drain at 0 0 0 lies 10.6 mm outside the surface" in text
    point = tuple(map(float, text.rsplit("such as ", 1)[1].split()))
    assert made(hollow=2.0, drains=[Drain(3, point)])["ball"].euler == 2


def test_pegs_in_a_thin_hollow_stand_on_the_wall():
    whole = made(hollow=1.0, cuts=[OBLIQUE_CUT])
    parts = made(hollow=1.0, cuts=[OBLIQUE_CUT], pegs=Pegs(2, 3.0, 4.0, 0.2))
    for name, mesh in parts.items():
        assert mesh.closed
        assert mesh.components == 1, name
        assert len(self_intersections(mesh.vertices, mesh.faces)) == 0
        assert mesh.volume > whole[name].volume + 2 * math.pi * 2.3 * 2.3  # Material is around every peg and hole.


def two_balls(apart=0.0):
    """Balls of 5 and 4 mm, one above the other, which touch if they are not apart."""
    at = points()
    low = 5.2 - np.linalg.norm(at - [[11.5], [11.5], [6.5]], axis=0)
    high = 4.2 - np.linalg.norm(at - [[11.5], [11.5], [15.4 + apart]], axis=0)
    return gray(np.maximum(low, high).reshape((SIZE,) * 3))


@pytest.mark.parametrize("apart", [0.0, 2.0], ids=["one solid", "two solids"])
def test_of_several_hollows_the_facts_and_a_note_say_which_have_no_drain(apart):
    """In voxels of 1 mm the neck has a radius of 2.5 mm, less than the wall, so each has a cavity of its own."""
    (part,) = solid_parts(two_balls(apart), GRAY, SolidRequest(hollow=2.8, drains=(Drain(2.0),)))
    assert part.printing.closed_cavities == 1
    assert any("opens the largest cavity; 1 other cavity has no drain" in note for note in part.notes)
    assert part.mesh.euler == (0 if apart == 0.0 else 2) + 2  # The lower ball with two drains has genus 1.
    assert part.mesh.closed
    upper = Drain(2.0, (11.5, 11.5, 15.4 + apart))
    (part,) = solid_parts(two_balls(apart), GRAY, SolidRequest(hollow=2.8, drains=(Drain(2.0), upper)))
    assert part.printing.closed_cavities == 0


def test_a_drain_at_a_cut_is_told_with_the_distance_that_helps():
    drain = Drain(3.0, (17.0, 11.5, 12.5))
    (note,) = {
        note
        for part in solid_parts(BALL, GRAY, SolidRequest(hollow=2.0, drains=(drain,), cuts=(Cut(MIDDLE, (0, 0, 1)),)))
        for note in part.notes
    }
    assert "meets the cut at 11.5 11.5 11.5; move the cut along its normal by -" in note
    move = float(note.rsplit(" ", 2)[1])
    far = Cut((11.5, 11.5, 11.5 + move), (0, 0, 1))
    assert not solid_parts(BALL, GRAY, SolidRequest(hollow=2.0, drains=(drain,), cuts=(far,)))[0].notes


def test_a_foot_that_touches_a_rough_surface_leaves_no_crossing():
    """Where the foot ends, its plane crosses the structure beside cells of Marching Cubes and changes no part there."""
    rough = np.random.default_rng(6).normal(size=(12, 16, 16))
    for axis in range(3):
        for _ in range(2):
            rough = (rough + np.roll(rough, 1, axis) + np.roll(rough, -1, axis)) / 3
    settings = ReconstructionSettings(threshold=0.05)
    made(gray(rough), settings, base=2.0, cuts=[Cut((7.5, 7.5, 5.0), (0.3, 0.2, 1.0))])
