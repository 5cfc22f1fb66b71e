# SPDX-License-Identifier: GPL-3.0-or-later
"""Simplified parts: what was cut flat stays flat, up to its rim. A gray ball in voxels of 1 mm."""

import numpy as np
import pytest
from shapes import distance_mm
from solids import assert_parts

from ctmc_addon.core import ReconstructionSettings, Volume
from ctmc_addon.core.solid import Cut, HalfSpace, Pegs, SolidRequest, solid_parts

RADIUS = 9.3
MIDDLE = (11.5, 11.5, 11.5)
BALL = Volume(np.float32(RADIUS - distance_mm((24, 24, 24))), np.eye(4), name="ball")
OBLIQUE = Cut(MIDDLE, (1, 2, 3))
ACROSS = Cut((10.7, 12.2, 11.5), (3, 0, -1))  # At right angles to `OBLIQUE`.
FLAT_MM = 1e-3
BESIDE_MM = 4e-3  # No vertex is nearer to a sample than a 256th of a step, so some of the full surface lie beside.


def made(reduction, **solid):
    settings = ReconstructionSettings(threshold=0.0, reduction=reduction)
    meshes = [part.mesh for part in solid_parts(BALL, settings, SolidRequest(**solid))]
    assert_parts(meshes)
    return meshes


def heights(mesh, cut):
    return HalfSpace(cut.point, cut.normal).at(mesh.vertices.T.astype(float))


def flat_area(mesh, heights, near=FLAT_MM):
    """Area of the triangles whose corners are all at height 0."""
    a, b, c = mesh.vertices[mesh.faces[(np.abs(heights) < near)[mesh.faces].all(axis=1)]].transpose(1, 0, 2)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def thinnest(mesh):
    """Least height of a triangle, as a share of its longest side."""
    a, b, c = mesh.vertices[mesh.faces].astype(float).transpose(1, 0, 2)
    longest = np.max([np.linalg.norm(side, axis=1) for side in (b - a, c - b, a - c)], axis=0)
    return (np.linalg.norm(np.cross(b - a, c - a), axis=1) / longest**2).min()


@pytest.mark.parametrize(
    "solid",
    [{}, {"pegs": Pegs(1, 4, 4, 0.3)}, {"hollow": 3, "pegs": Pegs(1, 2, 3, 0.2)}],
    ids=["solid", "with a peg", "hollow with a peg"],
)
def test_a_cut_stays_flat(solid):
    full = made(None, cuts=[OBLIQUE], **solid)
    above, below = made(0.9, cuts=[OBLIQUE], **solid)
    assert len(above.faces) + len(below.faces) < 0.11 * sum(len(mesh.faces) for mesh in full)
    assert heights(below, OBLIQUE).max() < FLAT_MM
    if not solid:
        assert heights(above, OBLIQUE).min() > -FLAT_MM
    area = flat_area(full[1], heights(full[1], OBLIQUE), 2 * BESIDE_MM)
    assert flat_area(below, heights(below, OBLIQUE)) == pytest.approx(area, rel=0.01)
    for before, after in zip(full, (above, below), strict=True):
        assert after.volume == pytest.approx(before.volume, rel=0.01)


def test_cuts_that_cross_stay_flat_up_to_their_line():
    parts = made(0.9, cuts=[OBLIQUE, ACROSS])
    assert len(parts) == 4
    for number, mesh in enumerate(parts):
        on_both = np.ones(len(mesh.vertices), bool)
        for bit, cut in enumerate((OBLIQUE, ACROSS)):
            side = (-1) ** (number >> bit & 1)
            assert (side * heights(mesh, cut)).min() > -BESIDE_MM
            on_both &= np.abs(heights(mesh, cut)) < BESIDE_MM
        # The line where both cuts meet ends at the ball.
        along = mesh.vertices[on_both].astype(float) @ np.cross(OBLIQUE.normal, ACROSS.normal)
        length = np.ptp(along) / np.linalg.norm(np.cross(OBLIQUE.normal, ACROSS.normal))
        away = np.dot(np.subtract(ACROSS.point, MIDDLE), ACROSS.normal) / np.linalg.norm(ACROSS.normal)
        assert length == pytest.approx(2 * np.sqrt(RADIUS**2 - away**2), rel=0.02)


def test_no_triangle_is_left_on_a_line_where_flats_meet():
    """A cut through a foot has three lines that are straight, on which vertices have no error."""
    assert min(map(thinnest, made(0.9, cuts=[Cut(MIDDLE, (4, 2, 1))], base=2))) > 1e-4


def test_a_foot_stays_flat():
    """Its lower side has no fewer square millimeters; a bevel of Marching Cubes around it becomes narrower."""
    [full], [part] = (made(reduction, base=2) for reduction in (None, 0.9))
    before, after = (mesh.vertices[:, 2] - mesh.vertices[:, 2].min() for mesh in (full, part))
    assert 1 < flat_area(part, after, 2 * BESIDE_MM) / flat_area(full, before, 2 * BESIDE_MM) < 1.15
    assert part.volume == pytest.approx(full.volume, rel=0.01)
