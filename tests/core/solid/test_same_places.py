# SPDX-License-Identifier: GPL-3.0-or-later
"""Shapes whose surfaces are at the same places: pegs without clearance, and a cut given twice."""

import numpy as np
import pytest
from shapes import distance_mm

from ctmc_addon.core import ReconstructionSettings, SettingsError, Volume
from ctmc_addon.core.solid import Cut, Pegs, SolidRequest, solid_parts

RADIUS = 14.0
SETTINGS = ReconstructionSettings(threshold=100.0)
CUT = Cut((0.0, 0.0, 0.0), (0.1, 0.05, 1.0))


@pytest.fixture(scope="module")
def ball():
    """A ball about the origin, in samples of 1 mm."""
    values = np.clip(100 + 50 * (RADIUS - distance_mm((36, 36, 36))), 0, 200).astype(np.float32)
    affine = np.eye(4)
    affine[:3, 3] = -17.5
    return Volume(values, affine)


@pytest.mark.parametrize("count", [1, 2])
def test_pegs_without_clearance_fill_their_holes(ball, count):
    plain = solid_parts(ball, SETTINGS, SolidRequest(cuts=(CUT,)))
    parts = solid_parts(ball, SETTINGS, SolidRequest(cuts=(CUT,), pegs=Pegs(count, 4.0, 5.0, 0.0)))
    assert all(part.mesh.closed for part in parts)
    volumes = [[part.mesh.volume for part in each] for each in (plain, parts)]
    assert sum(volumes[1]) == pytest.approx(sum(volumes[0]), rel=1e-6)
    peg = np.pi * 4 * (3 + 4 / 3)  # 3 mm of a bar of 2 mm, and half a ball
    assert volumes[1][0] - volumes[0][0] == pytest.approx(count * peg, rel=0.1)


@pytest.mark.parametrize("sign", [1, -1])
def test_the_same_plane_given_twice_is_refused(ball, sign):
    again = Cut((0.5, 1.0, -0.1), tuple(sign * 3 * each for each in CUT.normal))
    with pytest.raises(SettingsError, match="is given twice"):
        solid_parts(ball, SETTINGS, SolidRequest(cuts=(CUT, again)))
    apart = Cut((0.5, 1.0, 0.9), again.normal)
    assert len(solid_parts(ball, SETTINGS, SolidRequest(cuts=(CUT, apart)))) == 3
