# SPDX-License-Identifier: GPL-3.0-or-later
"""The largest diameter is that of comparing all pairs, to the last bit."""

import math

import numpy as np
import pytest
from shapes import distance_mm

from ctmc_addon.core import marching_cubes
from ctmc_addon.core.mesh import diameter, largest_diameter


def compared(vertices):
    """The largest distance over all pairs."""
    points = vertices.astype(np.float64)
    best = 0.0
    for point in points:
        x, y, z = (points - point).T
        best = max(best, float(((x * x + y * y) + z * z).max(initial=0.0)))
    return math.sqrt(best)


SHAPES = {
    "cloud": lambda points: points * (1.0, 3.0, 0.2),
    "ball": lambda points: points / np.linalg.norm(points, axis=1)[:, None],
    "ellipsoid": lambda points: points / np.linalg.norm(points, axis=1)[:, None] * (1.0, 1.001, 0.999),
    "grid": lambda points: np.round(2 * points),
    "plane": lambda points: points * (1, 1, 0),
    "line": lambda points: points * (0, 0, 1),
    "one place": lambda points: points * 0 + 7,
    "far away": lambda points: points + 5000,
}


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("count", [2, 3, 17, 150, 1500])
def test_it_is_that_of_all_pairs(shape, count, monkeypatch):
    monkeypatch.setattr(diameter, "IN_BOX", 2)  # more levels of boxes
    monkeypatch.setattr(diameter, "AT_ONCE", 100)
    monkeypatch.setattr(diameter, "MOST_COMPARED", 300)
    points = SHAPES[shape](np.random.default_rng(count).normal(size=(count, 3))).astype(np.float32)
    assert largest_diameter(points) == compared(points)


def test_a_surface_of_a_ball_compares_few_of_its_vertices(monkeypatch):
    vertices = marching_cubes(-distance_mm((40, 40, 40)), -17.3).vertices
    pairs = []
    products = diameter._products
    monkeypatch.setattr(diameter, "_products", lambda *each: pairs.append(products(*each)) or pairs[-1])
    assert largest_diameter(vertices) == compared(vertices)
    assert sum(len(first) for first, _ in pairs) < len(vertices) ** 2 / 10


@pytest.mark.parametrize("count", [0, 1])
def test_fewer_than_two_vertices_have_none(count):
    assert largest_diameter(np.ones((count, 3), np.float32)) == 0.0
