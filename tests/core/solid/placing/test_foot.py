# SPDX-License-Identifier: GPL-3.0-or-later
"""Feet of balls, boxes and cut solids in voxels of 1 mm: flat, below the center of mass, apart from each other."""

import re

import numpy as np
import pytest
from meshes import icosphere
from solids import assert_parts, together

from ctmc_addon.core import ReconstructionSettings, Volume, finish
from ctmc_addon.core.mesh.intersections import self_intersections
from ctmc_addon.core.solid import Bar, Cut, Drain, Pegs, SolidRequest, solid_parts
from ctmc_addon.core.solid.fields.lattice import Lattice
from ctmc_addon.core.solid.placing.foot import foot_steps
from ctmc_addon.core.solid.placing.standing import pieces_steps

pytestmark = pytest.mark.once

GRAY = ReconstructionSettings(threshold=0.0)
LATTICE = Lattice(*(np.arange(3.0) for _ in range(3)), np.eye(4))
SIZE = 24
MIDDLE = (11.5, 11.5, 11.5)
RADIUS = 9.277  # Of the plain surface of a ball of 9.3 voxels, chords and all.
TURNED = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])


def points():
    return np.indices((SIZE,) * 3)[::-1].reshape(3, -1).astype(float)


def gray(depth, affine=None):
    affine = np.eye(4) if affine is None else affine
    places = affine[:3, :3] @ points() + affine[:3, 3:]
    return Volume(np.asarray(depth(places), np.float32).reshape((SIZE,) * 3), affine, name="part")


BALL = gray(lambda at: 9.3 - np.linalg.norm(at - 11.5, axis=0))


def made(volume=BALL, settings=GRAY, labels=(), **solid):
    parts = solid_parts(volume, settings, SolidRequest(**solid), labels)
    assert_parts([part.mesh for part in parts])
    return {part.label_name: part for part in parts}


def standing_notes(part):
    return [note for note in part.notes if re.search("stand|pegs reach|hang", note)]


def beside(mesh):
    """How far the center of mass lies beside the hull of all that is lowest, from 3600 sides; below 0 within."""
    a, b, c = (mesh.vertices[mesh.faces[:, corner]].astype(float) for corner in range(3))
    volumes = (a * np.cross(b, c)).sum(axis=1)
    center = (volumes[:, None] * (a + b + c)).sum(axis=0) / (4 * volumes.sum())
    rest = mesh.vertices[mesh.vertices[:, 2] < mesh.vertices[:, 2].min() + 0.02]
    angles = np.linspace(0, 2 * np.pi, 3600)
    ways = np.stack([np.cos(angles), np.sin(angles)])
    return (center[:2] @ ways - (rest[:, :2] @ ways).max(axis=0)).max()


def foot_of(mesh, base):
    center = finish(pieces_steps(mesh)).center
    return finish(foot_steps(mesh, center, base, LATTICE, is_single=True))


def test_the_foot_of_a_ball_is_a_disc():
    foot = foot_of(icosphere(5, 20.0, (1.0, 2.0, 3.0)), 3.0)
    assert foot.low == pytest.approx(-17 - 1 / 64, abs=1e-3)
    assert foot.high - foot.low == 3.0
    # At 3 mm the ball has a radius of sqrt(20² - 17²); the outline of 64 sides is up to 0.12 % wider.
    at = np.random.default_rng(2).uniform((-16, -15, -15.9), (17, 18, -13), (3000, 3)).T
    from_middle = np.linalg.norm(at[:2] - [[1.0], [2.0]], axis=0)
    exact = np.minimum(np.minimum(at[2] - foot.low, foot.high - at[2]), np.sqrt(111) + 3 - from_middle)
    np.testing.assert_allclose(foot.at(at), exact, atol=0.06)
    low, high = foot.box
    np.testing.assert_allclose(high - low, [2 * (np.sqrt(111) + 3), 2 * (np.sqrt(111) + 3), 3], atol=0.06)


def test_a_foot_reaches_under_the_center_of_mass():
    """A post at one end of a beam."""

    def depth(at):
        return np.maximum(Bar((4, 12, 4), (4, 12, 17), 2.5).at(at), Bar((4, 12, 17), (19, 12, 17), 3.5).at(at))

    plain = made(gray(depth))["part"]
    part = made(gray(depth), base=1.5)["part"]
    assert beside(plain.mesh) > 3
    assert beside(part.mesh) < -0.4
    assert not standing_notes(part)
    assert part.mesh.components == 1


@pytest.mark.parametrize("base", [0.3, 1.0, 1.7, 3.0])
@pytest.mark.parametrize("turn", [np.eye(3), TURNED], ids=["straight", "turned"])
def test_a_foot_of_any_height_is_flat_below(base, turn):
    affine = np.eye(4)
    affine[:3, :3] = turn
    affine[:3, 3] = 11.5 - turn @ np.full(3, 11.5)
    mesh = made(gray(lambda at: 9.3 - np.linalg.norm(at - 11.5, axis=0), affine), base=base)["part"].mesh
    low = mesh.vertices[:, 2].min()
    assert low == pytest.approx(11.5 - RADIUS, abs=0.06)
    rest = mesh.vertices[mesh.vertices[:, 2] < low + 0.01]
    height = max(base, 1.0 if turn is not TURNED else 0.64)  # Not less than a step along z.
    radius = np.sqrt(RADIUS**2 - (RADIUS - height) ** 2) + base
    bevel = 1.5 if turn is not TURNED else 2.1
    assert radius - bevel < np.linalg.norm(rest[:, :2] - 11.5, axis=1).max() < radius + 0.1
    # The flat side is a whole: no hole is in it, nor does anything but its rim rise.
    faces = mesh.faces[(mesh.vertices[mesh.faces][:, :, 2] < low + 0.01).all(axis=1)]
    a, b, c = mesh.vertices[faces].transpose(1, 0, 2).astype(float)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    assert area > np.pi * (radius - bevel) ** 2


def test_a_part_on_a_level_cut_has_no_foot_and_says_so():
    parts = made(base=2.0, cuts=[Cut(MIDDLE, (0, 0, 1))])
    plain = made(cuts=[Cut(MIDDLE, (0, 0, 1))])
    assert standing_notes(parts["part a"]) == ["The part stands on its level cut and has no foot."]
    assert not standing_notes(parts["part b"])
    assert parts["part a"].mesh.volume == pytest.approx(plain["part a"].mesh.volume, rel=1e-6)
    assert parts["part b"].mesh.volume > plain["part b"].mesh.volume + 100
    assert beside(parts["part a"].mesh) < 0 > beside(parts["part b"].mesh)


def test_a_part_that_leans_over_its_level_cut_has_a_foot():
    def depth(at):
        return np.maximum(Bar((4, 12, 4), (4, 12, 17), 2.5).at(at), Bar((4, 12, 17), (19, 12, 17), 3.5).at(at))

    part = made(gray(depth), base=2.0, cuts=[Cut((4, 12, 8), (0, 0, 1))])["part a"]
    assert part.mesh.vertices[:, 2].min() == pytest.approx(8, abs=0.02)
    assert beside(part.mesh) < -0.5
    assert not standing_notes(part)


def test_beside_a_slanted_cut_a_note_says_how_far_the_center_of_mass_is_off():
    parts = made(base=2.0, cuts=[Cut(MIDDLE, (1, 0, 2))])
    (note,) = standing_notes(parts["part a"])
    assert "The part does not stand: its center of mass lies" in note
    told = float(re.search(r"lies ([\d.]+) mm outside its foot", note)[1])
    assert told == pytest.approx(beside(parts["part a"].mesh), abs=0.15)
    # The center of half a ball is 3/8 of its radius from its flat side, whose rim is lowest at 2 / sqrt(5) of it.
    assert told == pytest.approx((2 - 3 / 8) / np.sqrt(5) * RADIUS, abs=0.5)
    assert beside(parts["part b"].mesh) < -0.5
    assert not standing_notes(parts["part b"])


@pytest.mark.parametrize("normal", [(1, 0, 2), (1, 0, 0), (2, 1, -1)])
def test_feet_of_two_parts_neither_overlap_nor_join(normal):
    cut = Cut(MIDDLE, normal)
    plain, parts = made(cuts=[cut]), made(base=3.0, cuts=[cut])
    meshes = [part.mesh for part in parts.values()]
    assert not len(self_intersections(*together(meshes)))
    unit = np.array(normal) / np.linalg.norm(normal)
    for sign, name in ((1, "part a"), (-1, "part b")):
        mesh = parts[name].mesh
        assert mesh.components == 1
        assert mesh.volume > plain[name].mesh.volume + 1
        assert (sign * ((mesh.vertices - MIDDLE) @ unit)).min() > -0.01


def test_a_drain_goes_on_through_a_foot():
    """The drain beside the middle ends 6 mm above the ground, where a foot of 8 mm is."""
    drain = Drain(3.0, (15.0, 11.5, 6.0))
    part = made(hollow=2.0, drains=[drain], base=8.0)["part"]
    assert (part.mesh.components, part.mesh.euler) == (1, 2)
    assert part.printing.closed_cavities == 0


def test_pegs_below_a_foot_are_told():
    parts = made(base=2.0, cuts=[Cut(MIDDLE, (0, 0, 1))], pegs=Pegs(1, 4.0, 5.0, 0.2))
    (note,) = standing_notes(parts["part a"])
    assert "below the level cut; flip the normal of the cut, so that the other part has the pegs." in note
    assert float(re.search(r"The pegs reach ([\d.]+) mm", note)[1]) == pytest.approx(5, abs=0.05)
    parts = made(base=2.0, cuts=[Cut(MIDDLE, (0, 0, -1))], pegs=Pegs(1, 4.0, 5.0, 0.2))
    assert standing_notes(parts["part b"]) == ["The part stands on its level cut and has no foot."]


def test_a_piece_above_its_foot_is_told_with_the_base_that_reaches_it():
    def depth(at):
        return np.maximum(4 - np.linalg.norm(at - [[7], [7], [6]], axis=0), 4 - np.linalg.norm(at - 16, axis=0))

    part = made(gray(depth), base=2.0)["part"]
    assert part.mesh.components == 2
    note = standing_notes(part)[-1]
    assert "1 piece hangs above the foot" in note
    base = float(re.search(r"--base ([\d.]+) reaches all", note)[1])
    assert base == pytest.approx(10.25, abs=0.1)
    assert made(gray(depth), base=base)["part"].mesh.components == 1


def test_what_another_structure_cuts_off_from_a_foot_is_gone():
    """A box beside a wall of another label: the foot would go on behind the wall, and cannot."""
    labels = np.zeros((SIZE,) * 3, np.uint8)
    labels[4:20, 4:20, 6:10] = 1  # z, y, x
    labels[2:20, :, 11] = 2
    volume = Volume(labels, np.eye(4), kind="label", label_names={1: "box", 2: "wall"})
    parts = made(volume, ReconstructionSettings(label=1), (1, 2), base=3.0)
    assert [part.mesh.components for part in parts.values()] == [1, 1]
    assert parts["box"].mesh.vertices[:, 0].max() < 10.6


def test_pieces_are_measured():
    center = np.array([3.0, -2.0, 7.0])
    pieces = finish(pieces_steps(icosphere(4, 5.0, center)))
    np.testing.assert_allclose(pieces.center, center, atol=1e-4)
    assert pieces.volumes == pytest.approx([4 / 3 * np.pi * 125], rel=0.01)
    assert (pieces.low[0], pieces.high[0]) == pytest.approx((2, 12), abs=0.02)


@pytest.mark.parametrize("degrees", [8, 20, 45])
def test_a_foot_below_a_leaning_volume_is_whole(degrees):
    turned = np.eye(4)
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turned[1:3, 1:3] = [[cosine, -sine], [sine, cosine]]
    rods = np.zeros((20, 60, 24), np.uint8)
    rods[5:13, 5:55, 5:11], rods[5:13, 5:55, 11:17] = 1, 2
    volume = Volume(rods, turned, name="rods", kind="label")
    for labels in ([1], [1, 2]):
        parts = solid_parts(volume, ReconstructionSettings(), SolidRequest(base=3.0), labels)
        assert_parts([part.mesh for part in parts])
        assert not any("does not stand" in note for note in parts[0].notes)


def test_a_part_on_a_level_cut_has_no_foot_where_pegs_divide_steps():
    ball = Volume(BALL.values, np.diag([3.0, 3.0, 3.0, 1.0]), name="ball")
    cut = Cut((34.5, 34.5, 34.5), (0, 0, 1))
    parts = solid_parts(ball, GRAY, SolidRequest(cuts=(cut,), pegs=Pegs(2, 3, 5), base=4.0))
    wide = parts[0].mesh.vertices[:, 0].max() - parts[0].mesh.vertices[:, 0].min()
    assert wide == pytest.approx(6 * 9.3, abs=1.0)
