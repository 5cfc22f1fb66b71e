import numpy as np
import pytest

from ctmc_addon.core.errors import MeshError
from ctmc_addon.core.mesh import Surface
from ctmc_addon.core.parts import keep_parts, part_volumes

CORNERS = np.array([(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)], np.float32)
CUBE = np.array(
    [
        (0, 2, 1), (1, 2, 3), (4, 5, 6), (5, 7, 6), (0, 1, 4), (1, 5, 4),
        (2, 6, 3), (3, 6, 7), (0, 4, 2), (2, 4, 6), (1, 3, 5), (3, 7, 5),
    ],
    np.int32,
)  # fmt: skip


def cubes(*sides):
    """Cubes beside each other; a negative side is a cavity of that size."""
    vertices = [CORNERS * abs(side) + np.float32(1000 + 20 * at) for at, side in enumerate(sides)]
    faces = [(CUBE if side > 0 else CUBE[:, ::-1]) + 8 * at for at, side in enumerate(sides)]
    positions = np.concatenate(vertices)
    return Surface(positions, positions, np.concatenate(faces).astype(np.int32))


def kept_volumes(surface, **limits):
    return part_volumes(keep_parts(surface, surface.at(1.0), **limits).at(1.0)).tolist()


def test_every_part_has_its_signed_volume_far_from_the_origin():
    assert part_volumes(cubes(1, 3, -2).at(1.0)) == pytest.approx([1, 27, -8])


def test_an_open_cube_counts_nearly_as_much_as_a_closed_one():
    surface = cubes(2)
    open_top = surface.keeping(np.arange(12) != 2)
    assert part_volumes(open_top.at(1.0))[0] == pytest.approx(8, rel=0.2)


def test_the_largest_parts_are_kept_in_their_order():
    assert kept_volumes(cubes(1, 3, 2), largest=2) == pytest.approx([27, 8])
    assert kept_volumes(cubes(1, 3, 2), largest=9) == pytest.approx([1, 27, 8])


def test_of_equal_parts_the_first_is_kept():
    surface = cubes(2, 2, 2)
    assert (keep_parts(surface, surface.at(1.0), largest=1).faces == CUBE).all()


def test_a_cavity_counts_by_its_absolute_volume():
    assert kept_volumes(cubes(1, -3), largest=1) == pytest.approx([-27])
    assert kept_volumes(cubes(4, -1), largest=1) == pytest.approx([64])


def test_parts_below_the_smallest_volume_go_and_the_limit_itself_stays():
    assert kept_volumes(cubes(1, 3, 2), min_volume=7.999) == pytest.approx([27, 8])
    assert kept_volumes(cubes(1, 3, 2), min_volume=7.999, largest=1) == pytest.approx([27])


def test_nothing_left_is_refused_with_the_largest_volume():
    with pytest.raises(MeshError, match="largest of 2 has 27"):
        kept_volumes(cubes(1, 3), min_volume=100)


def test_without_limits_the_surface_is_returned_untouched():
    surface = cubes(1, 2)
    assert keep_parts(surface, surface.at(1.0)) is surface
