# SPDX-License-Identifier: GPL-3.0-or-later
"""The alpha that is chosen is the one that giving every number by hand would find."""

import math
from itertools import pairwise

import numpy as np
import pytest

from ctmc_addon.core import Step, Surface, finish
from ctmc_addon.core.mesh.angles.alpha_choice import chosen_alpha_steps, kept_alpha_steps
from ctmc_addon.core.mesh.triangle_mesh import replayed_steps

ALPHAS = [thousandths / 1000 for thousandths in range(1001)]


def smallest_angle(mesh):
    """The smallest angle of a mesh by the law of cosines, degrees."""
    corners = mesh.vertices[mesh.faces].astype(float)
    a, b, c = (np.sqrt(((corners[:, i] - corners[:, i - 1]) ** 2).sum(axis=1)) for i in range(3))
    cosines = [
        (b**2 + c**2 - a**2) / (2 * b * c),
        (a**2 + c**2 - b**2) / (2 * a * c),
        (a**2 + b**2 - c**2) / (2 * a * b),
    ]
    return math.degrees(math.acos(min(1.0, np.max(cosines))))


def tried_by_hand(surface, angle, most=1.0):
    """The largest alpha of the grid at which the smallest angle is large enough, else that where it is largest."""
    angles = {alpha: smallest_angle(surface.at(alpha)) for alpha in ALPHAS if alpha <= most}
    enough = [alpha for alpha in angles if angles[alpha] >= angle]
    best = max(angles, key=lambda alpha: (angles[alpha], alpha))
    return max(enough, default=best), angles


def chosen(surface, angle, cuts=(), most=1.0):
    return finish(chosen_alpha_steps(lambda: replayed_steps(cut(surface, cuts)), angle, most))


def cut(surface, cuts):
    """A surface in pieces before these vertices, each triangle in the piece of its lowest corner."""
    ends = [0, *cuts, len(surface.linear)]
    lowest = surface.faces.min(axis=1)
    pieces = []
    for low, high in pairwise(ends):
        faces = surface.faces[(lowest >= low) & (lowest < high)] - np.int32(low)
        pieces.append(Surface(surface.midpoints[low:high], surface.linear[low:high], faces))
    return pieces


def loose_triangles(seed, count=40, near=0.3):
    """Triangles that go from even shapes at alpha 0 to any shape at alpha 1, most by a way with the worst inside."""
    random = np.random.default_rng(seed)
    even = np.array([[0, 0, 0], [1, 0, 0], [0.5, 0.9, 0]])
    midpoints = (even + random.normal(0, near, (count, 3, 3))).astype(np.float32)
    linear = random.normal(0, 1, (count, 3, 3)).astype(np.float32)
    return Surface(midpoints.reshape(-1, 3), linear.reshape(-1, 3), np.arange(3 * count, dtype=np.int32).reshape(-1, 3))


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("angle", [0.3, 3.0, 8.0, 60.0])
def test_the_choice_is_what_trying_every_alpha_finds(seed, angle):
    surface = loose_triangles(seed, near=0.1)
    alpha, angles = tried_by_hand(surface, angle)
    choice = chosen(surface, angle)
    assert choice.alpha == alpha
    assert choice.smallest_angle_deg == pytest.approx(angles[alpha], abs=1e-6)
    assert choice.reached == (angles[alpha] >= angle)


def test_angles_rise_and_fall_with_alpha_and_the_largest_good_one_counts():
    # One triangle is flat at alpha 0.5 and even at both ends; another is bad from 0.9 on.
    midpoints = np.array([[0, 0, 0], [1, 0, 0], [0.5, 1, 0], [0, 0, 0], [1, 0, 0], [0.5, 1, 0]], np.float32)
    linear = np.array([[0, 0, 0], [1, 0, 0], [0.5, -1, 0], [0, 0, 0], [1, 0, 0], [0.5, 0.01, 0]], np.float32)
    surface = Surface(midpoints, linear, np.arange(6, dtype=np.int32).reshape(-1, 3))
    alpha, angles = tried_by_hand(surface, 5.0)
    assert angles[0.5] == 0
    assert angles[0.9] > 5 > angles[1.0]
    choice = chosen(surface, 5.0)
    assert choice.alpha == alpha == 0.965
    # Below 0.9 they are bad together at 0.5; what is asked for above 22 degrees is found before that.
    assert chosen(surface, 40.0).alpha == tried_by_hand(surface, 40.0)[0] < 0.5


@pytest.mark.parametrize("angle", [3.0, 8.0, 50.0])
@pytest.mark.parametrize("cuts", [(1,), (7, 60), (6, 12, 60, 90)])
def test_pieces_choose_as_the_whole_does(angle, cuts):
    whole = loose_triangles(11)
    linked = Surface(whole.midpoints, whole.linear, whole.faces[:-2] + np.array([0, 4, 2], np.int32))
    assert chosen(linked, angle, cuts) == chosen(linked, angle)


def test_larger_alphas_than_the_most_are_not_chosen():
    surface = loose_triangles(2, near=0.1)
    free = chosen(surface, 3.0)
    bound = chosen(surface, 3.0, most=free.alpha - 0.001)
    assert bound.alpha == tried_by_hand(surface, 3.0, most=free.alpha - 0.001)[0] < free.alpha


def test_a_good_surface_keeps_alpha_one_and_costs_nothing():
    surface = loose_triangles(1)
    good = Surface(surface.midpoints, surface.midpoints, surface.faces)
    choice = chosen(good, 0.01)
    assert (choice.alpha, choice.mean_mm, choice.largest_mm, choice.reached) == (1.0, 0.0, 0.0, True)


def test_the_cost_is_the_way_of_the_vertices_back_from_alpha_one():
    surface = loose_triangles(3, near=0.1)
    choice = chosen(surface, 3.0)
    way = np.linalg.norm(surface.at(choice.alpha).vertices - surface.linear, axis=1)
    assert choice.alpha < 1
    assert choice.mean_mm == pytest.approx(way.mean(), rel=1e-5)
    assert choice.largest_mm == pytest.approx(way.max(), rel=1e-5)


def test_a_piece_without_a_triangle_is_passed_over():
    surface = loose_triangles(4, near=0.1)
    empty = Surface(np.empty((0, 3), np.float32), np.empty((0, 3), np.float32), np.empty((0, 3), np.int32))
    with_gaps = finish(chosen_alpha_steps(lambda: replayed_steps([empty, surface, empty]), 3.0))
    assert with_gaps == chosen(surface, 3.0)


def test_few_passes_are_needed_and_the_steps_never_pass_the_end():
    passes = []

    def one_pass():
        passes.append(1)
        return replayed_steps(cut(loose_triangles(5, count=400, near=0.1), range(30, 1200, 30)))

    fractions = [step.fraction for step in chosen_alpha_steps(one_pass, 3.0) if isinstance(step, Step)]
    assert 2 <= len(passes) <= 5
    assert max(fractions) <= 1


def test_what_is_kept_at_the_chosen_alpha_is_looked_at_too():
    thin, even = loose_triangles(6, near=0.1), loose_triangles(7, near=0.1)
    asked = []

    def pass_at(alpha):
        """A surface of which another part is kept below alpha 1."""
        asked.append(alpha)
        return replayed_steps([even if alpha == 1 else thin])

    choice = finish(kept_alpha_steps(pass_at, 3.0))
    first = chosen(even, 3.0).alpha
    assert choice.alpha == tried_by_hand(thin, 3.0, most=first)[0]
    assert asked[0] == 1.0
    assert asked[-1] == choice.alpha
    assert smallest_angle(thin.at(choice.alpha)) >= 3.0 or not choice.reached


def test_the_sentence_says_what_was_chosen_and_what_it_costs():
    surface = loose_triangles(3, near=0.1)
    reached, missed = chosen(surface, 3.0), chosen(surface, 60.0)
    assert f"Alpha {reached.alpha:g} was chosen: the largest at which no triangle" in reached.sentence()
    assert f"{reached.mean_mm:.3g} mm on average and {reached.largest_mm:.3g} mm at most" in reached.sentence()
    assert missed.sentence().startswith("No alpha keeps every angle at 60 degrees or more: the best is ")
    assert f"{missed.smallest_angle_deg:.3g} degrees at alpha {missed.alpha:g}, which was taken" in missed.sentence()
