# SPDX-License-Identifier: GPL-3.0-or-later
import numpy as np
import pytest

from ctmc_addon.core import finish
from ctmc_addon.core.errors import MeshError
from ctmc_addon.core.mesh.components import keep_components_steps
from ctmc_addon.core.mesh.measures import component_volumes_steps
from ctmc_addon.core.mesh.triangle_mesh import Surface

CORNERS = np.array([(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)], np.float32)
CUBE = np.array(
    [
        (0, 2, 1), (1, 2, 3), (4, 5, 6), (5, 7, 6), (0, 1, 4), (1, 5, 4),
        (2, 6, 3), (3, 6, 7), (0, 4, 2), (2, 4, 6), (1, 3, 5), (3, 7, 5),
    ],
    np.int32,
)  # fmt: skip


def boxes(*walls):
    """Boxes (lowest corner, side); a negative side is a cavity of that size."""
    vertices = [CORNERS * abs(side) + np.float32(low) for low, side in walls]
    faces = [(CUBE if side > 0 else CUBE[:, ::-1]) + 8 * at for at, (_, side) in enumerate(walls)]
    positions = np.concatenate(vertices)
    return Surface(positions, positions, np.concatenate(faces).astype(np.int32))


def cubes(*sides):
    """Boxes beside each other, far from the origin."""
    return boxes(*((1000 + 20 * at, side) for at, side in enumerate(sides)))


def component_volumes(mesh):
    return finish(component_volumes_steps(mesh.vertices, mesh.faces, mesh.component_of_face))


def keep_components(surface, mesh, largest=0, min_volume=0.0):
    return finish(keep_components_steps(surface, mesh, largest, min_volume))


def kept_volumes(surface, **limits):
    return component_volumes(keep_components(surface, surface.at(1.0), **limits).at(1.0)).tolist()


def test_every_component_has_its_signed_volume_far_from_the_origin():
    assert component_volumes(cubes(1, 3, -2).at(1.0)) == pytest.approx([1, 27, -8])


def test_an_open_cube_counts_nearly_as_much_as_a_closed_one():
    surface = cubes(2)
    open_top = surface.with_faces(np.arange(12) != 2)
    assert component_volumes(open_top.at(1.0))[0] == pytest.approx(8, rel=0.2)


def test_the_largest_components_are_kept_in_their_order():
    assert kept_volumes(cubes(1, 3, 2), largest=2) == pytest.approx([27, 8])
    assert kept_volumes(cubes(1, 3, 2), largest=9) == pytest.approx([1, 27, 8])


def test_of_equal_components_the_first_is_kept():
    surface = cubes(2, 2, 2)
    assert (keep_components(surface, surface.at(1.0), largest=1).faces == CUBE).all()


@pytest.mark.parametrize("order", [(0, 1, 2, 3, 4), (4, 3, 2, 1, 0), (2, 0, 4, 1, 3)])
def test_the_largest_component_keeps_its_cavities_and_nothing_else(order):
    # A hollow body with an island in its hole, itself hollow, beside a body smaller than the hole.
    walls = [((0, 0, 0), 10), ((1, 1, 1), -8), ((2, 2, 2), 5), ((3, 3, 3), -2), ((20, 0, 0), 6)]
    surface = boxes(*(walls[at] for at in order))
    assert sorted(kept_volumes(surface, largest=1)) == pytest.approx([-512, 1000])
    assert sorted(kept_volumes(surface, largest=2)) == pytest.approx([-512, 216, 1000])
    assert sorted(kept_volumes(surface, largest=3)) == pytest.approx([-512, -8, 125, 216, 1000])


def test_small_cavities_are_filled_and_large_ones_stay():
    surface = boxes(((0, 0, 0), 10), ((1, 1, 1), -2), ((5, 5, 5), -3))
    assert sorted(kept_volumes(surface, min_volume=9)) == pytest.approx([-27, 1000])
    assert sorted(kept_volumes(surface, min_volume=28, largest=1)) == pytest.approx([1000])


def test_the_cavity_of_a_component_that_goes_goes_with_it():
    surface = boxes(((0, 0, 0), 10), ((20, 0, 0), 6), ((21, 1, 1), -4))
    assert kept_volumes(surface, largest=1) == pytest.approx([1000])


def test_a_cavity_with_nothing_around_it_is_a_component_of_its_own():
    assert kept_volumes(cubes(1, -3), largest=1) == pytest.approx([-27])
    assert kept_volumes(cubes(4, -1), largest=1) == pytest.approx([64])


def test_components_below_the_smallest_volume_go_and_the_limit_itself_stays():
    assert kept_volumes(cubes(1, 3, 2), min_volume=7.999) == pytest.approx([27, 8])
    assert kept_volumes(cubes(1, 3, 2), min_volume=7.999, largest=1) == pytest.approx([27])


def test_nothing_left_is_refused_with_the_largest_volume():
    with pytest.raises(MeshError, match="largest of 2 has 27"):
        kept_volumes(cubes(1, 3), min_volume=100)


def test_without_limits_the_surface_is_returned_untouched():
    surface = cubes(1, 2)
    assert keep_components(surface, surface.at(1.0)) is surface
