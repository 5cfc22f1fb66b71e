# SPDX-License-Identifier: GPL-3.0-or-later
"""Pieces that linear fields leave of each other's planes in one tetrahedron, and how two tetrahedra agree."""

from collections import Counter
from itertools import product

import numpy as np
import pytest

from ctmc_addon.core.solid.cells.arrangement import pieces_of, signs_of, zero_of

PLACE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [1, 1, 1]], float)  # right-handed
WHOLE = 1 / 6


def pieces(values):
    """Pieces of fields (fields, 4) at the corners."""
    own = np.asarray(values, np.float32).astype(np.float64)[None]
    [bits] = signs_of(own)
    return pieces_of(bits.tobytes(), own.shape[1])


def point(node, values):
    """Where a node is, (3,)."""
    corners, fields = node
    of_corners = np.asarray(values, np.float32).astype(np.float64)[None][:, fields][:, :, corners]
    return (zero_of(of_corners)[0][:, None] * PLACE[list(corners)]).sum(axis=0)


def area_vector(piece, values):
    """Half the sum of cross products around a piece, (3,)."""
    points = np.array([point(node, values) for node in piece.nodes])
    return np.cross(points, np.roll(points, -1, axis=0)).sum(axis=0) / 2


def at(values, place):
    """Linear fields at a place, (fields,)."""
    x, y, z = place
    return np.asarray(values, np.float32).astype(np.float64) @ np.array([1 - x, x - y, y - z, z])


def sides(piece):
    return [frozenset(pair) for pair in zip(piece.nodes, piece.nodes[1:] + piece.nodes[:1], strict=True)]


def face_of(side):
    """The face that the side of a piece lies in; None for one that two fields share inside."""
    one, other = side
    corners = set(one[0]) | set(other[0])
    return tuple(sorted(corners)) if len(corners) == 3 else None


def assert_fits(values):
    """Sides within a face end there; any other side has two pieces of one field and two of another."""
    inner = {}
    for piece in pieces(values):
        for side in sides(piece):
            if face_of(side) is None:
                inner.setdefault(side, []).append(piece.field)
    for side, fields in inner.items():
        assert sorted(Counter(fields).values()) == [2, 2], side


def random_fields(count, seed):
    draw = np.random.default_rng(seed)
    while True:
        values = draw.normal(size=(count, 4))
        if (np.ptp(np.sign(values), axis=1) > 0).all():
            yield values


@pytest.mark.parametrize("signs", [each for each in product((1, -1), repeat=4) if len(set(each)) == 2])
def test_one_plane_is_one_piece_turned_outward(signs):
    values = np.array([signs], float) * [0.5, 1.0, 2.0, 0.75]
    [piece] = pieces(values)
    assert len(piece.nodes) == (4 if sum(signs) == 0 else 3)
    # All lies within the tetrahedron, on the plane, and the normal points to where the field falls.
    points = np.array([point(node, values) for node in piece.nodes])
    assert max(abs(at(values, each)[0]) for each in points) < 1e-9
    values = values[0]
    gradient = np.array([values[1] - values[0], values[2] - values[1], values[3] - values[2]])
    normal = area_vector(piece, [values])
    assert (normal * gradient).sum() == pytest.approx(-np.linalg.norm(normal) * np.linalg.norm(gradient), rel=1e-6)


def test_a_corner_cut_off_at_a_half_has_the_area_of_a_quarter_of_its_face():
    [piece] = pieces([[1, -1, -1, -1]])
    whole = np.cross(PLACE[2] - PLACE[1], PLACE[3] - PLACE[1]) / 2
    assert np.linalg.norm(area_vector(piece, [[1, -1, -1, -1]])) == pytest.approx(np.linalg.norm(whole) / 4)


def test_a_plane_that_has_one_sign_everywhere_has_no_piece():
    assert pieces([[1, 2, 3, 4]]) == ()
    assert pieces([[-1, -2, -3, -4]]) == ()


def test_two_planes_that_cross_have_two_pieces_each_and_parallel_ones_one():
    crossing = [[1, -1, -1, -1], [1, 2, -3, -3]]
    parallel = [[3, -1, -1, -1], [1, -3, -3, -3]]
    assert Counter(piece.field for piece in pieces(crossing)) == {0: 2, 1: 2}
    assert [(piece.field, piece.above) for piece in pieces(parallel)] == [(0, (False, False)), (1, (True, False))]


@pytest.mark.parametrize("count", [2, 3, 4])
def test_pieces_add_up_to_the_plane_and_lie_on_their_sides(count):
    sources = random_fields(count, count)
    several = 0
    for _ in range(60):
        values = next(sources)
        assert_fits(values)
        found = pieces(values)
        several += len(found) > count
        for field in range(count):
            [alone] = pieces(values[[field]])
            whole = area_vector(alone, values[[field]])
            own = [piece for piece in found if piece.field == field]
            np.testing.assert_allclose(sum(area_vector(piece, values) for piece in own), whole, atol=1e-9)
            # None is turned against the plane, so that areas add up too.
            assert min((area_vector(piece, values) * whole).sum() for piece in own) > -1e-12
            assert len({piece.above for piece in own}) == len(own)
            for piece in own:
                sign = np.where(piece.above, 1, -1)
                sign[field] = 0
                assert all((at(values, point(node, values)) * sign > -1e-7).all() for node in piece.nodes)
    assert several > 30


@pytest.mark.parametrize("count", [1, 2])
def test_regions_between_planes_have_the_volume_of_the_tetrahedron(count):
    """The volume above all fields, by cones over pieces and over faces, is what random points say."""
    draw = np.random.default_rng(9)
    weights = draw.dirichlet(np.ones(4), 200_000)
    for values, _ in zip(random_fields(count, 5), range(6), strict=False):
        inside = (weights @ values.T > 0).all(axis=1)
        share = _volume_above(values) / WHOLE
        assert share == pytest.approx(inside.mean(), abs=0.005)


def _volume_above(values):
    """Volume where all fields are above 0: cones from corner 0 over the pieces and over the face across from it."""
    total = 0.0
    for piece in pieces(values):
        if all(above or number == piece.field for number, above in enumerate(piece.above)):
            total += (area_vector(piece, values) * (point(piece.nodes[0], values) - PLACE[0])).sum() / 3
    corners = [PLACE[number] for number in (1, 2, 3)]
    for own in values:  # clip the face
        heights = [at([own], place)[0] for place in corners]
        clipped = []
        for number, (place, height) in enumerate(zip(corners, heights, strict=True)):
            following, next_height = corners[(number + 1) % len(corners)], heights[(number + 1) % len(corners)]
            clipped += [place] if height > 0 else []
            if (height > 0) != (next_height > 0):
                clipped.append(place + (following - place) * (height / (height - next_height)))
        corners = clipped
        if not corners:
            return total
    points = np.array(corners)
    area = np.cross(points, np.roll(points, -1, axis=0)).sum(axis=0) / 2
    return total + (area * (points[0] - PLACE[0])).sum() / 3


EQUAL = [[1.0, -1.0, -1.0, -1.0], [1.0, -2.0, 3.0, -1.0], [2.0, 1.0, -1.0, -2.0], [-1.0, 2.0, 2.0, -3.0]]


@pytest.mark.parametrize("first", EQUAL)
@pytest.mark.parametrize("scale", [1.0, 0.3, -1.0, 1 + 2.0**-22])
def test_fields_that_are_the_same_or_nearly_so_still_fit(first, scale):
    """The order of their zeros is undecided; whatever is chosen, pieces end at faces or meet in fours.

    With a third field they may not, which extraction notices (test_extract.py).
    """
    values = np.array([first, np.array(first) * scale])
    assert_fits(values)
    assert {piece.field for piece in pieces(values)} == {0, 1}


@pytest.mark.parametrize("count", [2, 3])
def test_both_tetrahedra_at_a_face_have_the_same_sides_of_pieces_there(count):
    """Corners 0 to 4: one tetrahedron has 0, 1, 2, 3 and the other 1, 2, 3, 4; 1, 2, 3 are common."""
    draw = np.random.default_rng(count)
    compared = 0
    for turn in range(150):
        values = draw.normal(size=(count, 5))
        if turn % 3 == 0:  # many equal zeros on edges
            values = draw.choice([-2.0, -1.0, 1.0, 2.0], (count, 5))
        low = _sides_on_face(values[:, :4], (1, 2, 3), 0)
        high = _sides_on_face(values[:, 1:], (0, 1, 2), 1)
        assert low == high
        compared += bool(low)
    assert compared > 100


def _sides_on_face(values, face, shift):
    """Sides of pieces on a face, with their field and what lies behind, by corners as both tetrahedra know them."""
    found = Counter()
    for piece in pieces(values):
        for side in sides(piece):
            if all(set(corners) <= set(face) for corners, _ in side):
                nodes = frozenset((tuple(corner + shift for corner in corners), fields) for corners, fields in side)
                found[piece.field, piece.above, nodes] += 1
    return found
