# SPDX-License-Identifier: GPL-3.0-or-later
"""Places of pegs and drains before a solid is made: those of the parts that are made then."""

from __future__ import annotations

import numpy as np
import pytest
from shapes import distance_mm

from ctmc_addon.core import ReconstructionSettings, Volume, finish, reconstruct
from ctmc_addon.core.mesh import SignedSurface
from ctmc_addon.core.solid import (
    Combination,
    Cut,
    Drain,
    HalfSpace,
    Pegs,
    SolidRequest,
    placed_cuts_pegs_steps,
    placed_drains_steps,
    solid_parts,
)

SIDE = 24
MIDDLE = (11.5, 11.5, 11.5)
CUT = Cut(MIDDLE, (1, 2, 3))
INSIDE = 9.3 - distance_mm((SIDE,) * 3)
BALL = Volume(INSIDE.astype(np.float32), np.eye(4), name="ball")
PEGS = Pegs(2, 3.0, 4.0)
GRAY = ReconstructionSettings(threshold=0.0)


def two_labels():
    """A ball cut by a plane in two labels that touch."""
    labels = (INSIDE > 0).astype(np.uint8)
    labels[:, :, 13:][INSIDE[:, :, 13:] > 0] = 2
    return Volume(labels, np.eye(4), name="two", kind="label", label_names={1: "left", 2: "right"})


def placed(volume=BALL, runs=(GRAY,), **solid):
    surfaces = {}
    for run in runs:
        surfaces[str(run.label)] = SignedSurface()
        finish(surfaces[str(run.label)].prepare_steps(reconstruct(volume, run).mesh))
    drains = finish(placed_drains_steps(surfaces, SolidRequest(**solid)))
    return finish(placed_cuts_pegs_steps(surfaces, SolidRequest(**solid), drains.bars)), drains


def assert_on(part, pegs, cut=CUT):
    """What of part a sticks out of the cut are the pegs, all of them, to a fifth of a voxel."""
    out = part.vertices.T.astype(float)
    out = out[:, HalfSpace(cut.point, cut.normal).at(out) < -0.5]
    distances = np.array([bar.at(out) for bar in pegs])
    assert np.abs(distances).min(axis=0).max() < 0.2
    assert (np.abs(distances) < 0.2).any(axis=1).all()


@pytest.mark.parametrize("hollow", [0.0, 3.0])
def test_pegs_and_drains_are_where_they_are_made(hollow):
    solid = {"cuts": (CUT,), "pegs": Pegs(2, 4.0, 4.0, 0.3), "hollow": hollow}
    if hollow:
        solid |= {"pegs": Pegs(2, 3.0, 2.5, 0.2), "drains": (Drain(3.0, (11.5, 11.5, 14.0)),)}
    pegs, drains = placed(**solid)
    parts = solid_parts(BALL, GRAY, SolidRequest(**solid))
    assert (len(pegs.bars), len(drains.bars)) == (2, 1 if hollow else 0)
    assert pegs.notes == drains.notes == ()
    assert_on(parts[0].mesh, pegs.bars)
    for drain in drains.bars:  # Its wall is a part's surface, and nothing of any part is within.
        way = np.linspace(drain.start, drain.end, 20)
        near = [np.linalg.norm(part.mesh.vertices[:, None] - way, axis=2).min() for part in parts]
        assert min(near) == pytest.approx(drain.radius, abs=0.1)


def test_what_does_not_fit_is_said_with_its_remedy():
    pegs, drains = placed(cuts=(CUT,), pegs=Pegs(2, 14.0, 12.0), drains=(Drain(2.0, (0.0, 0.0, 0.0)),))
    assert pegs.bars == drains.bars == ()
    assert len(drains.notes) == 1
    assert "no peg of 14 mm" in pegs.notes[0]
    assert "give --peg-mm 7.5 6.42 at most" in pegs.notes[0]


@pytest.mark.parametrize(("how", "count"), [(None, 4), ("merge", 2), ("subtract", 2)])
def test_pegs_stand_on_what_is_combined(how, count):
    labels = [ReconstructionSettings(label=label) for label in (1, 2)]
    combinations = () if how is None else (Combination(how, "new", ("1", "2")),)
    pegs, _ = placed(two_labels(), labels, cuts=(Cut(MIDDLE, (0, 0, 1)),), pegs=PEGS, combinations=combinations)
    assert len(pegs.bars) == count
    assert how != "subtract" or all(bar.start[0] < 12.5 for bar in pegs.bars)
