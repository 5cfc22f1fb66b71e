# SPDX-License-Identifier: GPL-3.0-or-later
"""Every surface that a voxel can have, against what a surface must be."""

from collections import Counter

import numpy as np
from oracles.triangles import is_closed_manifold, sides, topology

from ctmc_addon.core.extraction.case_table import FACES_OF_EDGE, loops
from ctmc_addon.core.extraction.trilinear.cases import INTERIOR, ambiguous_faces, contours, spread, surface, tunnels
from ctmc_addon.core.extraction.trilinear.decider import NEEDS_DECISION


def every_surface():
    """Case, connected faces, rims and (triangles, groups) of everything a voxel can have."""
    for case in np.flatnonzero(NEEDS_DECISION).tolist():
        faces = ambiguous_faces(case)
        for decisions in range(1 << len(faces)):
            connected = sum(1 << face for bit, face in enumerate(faces) if decisions >> bit & 1)
            for rims in [(), *(rims for _, rims in tunnels(case, connected))]:
                yield case, connected, rims, surface(case, connected, rims)


def test_every_surface_is_a_manifold_that_ends_in_its_loops():
    for case, connected, rims, (triangles, _) in every_surface():
        count = Counter(sides(triangles))
        assert set(count.values()) == {1}
        found = contours(case, connected)
        rim = {(a, b): loop for loop in found for a, b in zip(loop, loop[1:] + loop[:1], strict=True)}
        assert {side for side in count if side[::-1] not in count} == set(rim)
        lids = [(b, a, loop) for (a, b), loop in rim.items()]  # a loop names its lid's middle
        assert is_closed_manifold([*triangles, *lids])
        assert topology(triangles) == (len(found) - len(rims), len(found) - len(rims) // 2)


def test_no_inner_edge_of_any_surface_lies_in_a_face_of_the_cube():
    for _, _, _, (triangles, _) in every_surface():
        both_ways = set(sides(triangles)) & {(b, a) for a, b in sides(triangles)}
        assert not [(a, b) for a, b in both_ways if max(a, b) < INTERIOR and FACES_OF_EDGE[a] & FACES_OF_EDGE[b]]


def test_without_a_connected_face_the_contours_are_the_classic_loops():
    for case in range(256):
        assert sorted(contours(case, 0)) == sorted(loops(case))


def test_the_spread_of_edges_is_a_whole_number():
    assert {type(spread(edges)) for edges in ((0, 1, 2), (0, 1, 2, 3, 4, 5, 6))} == {int}
