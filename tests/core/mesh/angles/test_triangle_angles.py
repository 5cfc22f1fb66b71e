# SPDX-License-Identifier: GPL-3.0-or-later
"""Angles and radius ratios of triangles against closed forms, and the same numbers wherever a surface is cut."""

import math

import numpy as np
import pytest

from ctmc_addon.core import TriangleMesh, marching_cubes
from ctmc_addon.core.mesh.angles.triangle_angles import QualitySums


def quality_of(*corners):
    """The quality of triangles without common vertices."""
    vertices = np.array(corners, np.float32).reshape(-1, 3)
    return TriangleMesh(vertices, np.arange(len(vertices), dtype=np.int32).reshape(-1, 3)).measures.quality


def with_angle(degrees):
    """An isosceles triangle with one angle, its legs 1."""
    angle = math.radians(degrees)
    return (0, 0, 0), (1, 0, 0), (math.cos(angle), math.sin(angle), 0)


def test_an_equilateral_triangle_is_the_best_there_is():
    quality = quality_of((1, 0, 0), (0, 1, 0), (0, 0, 1))
    assert quality.smallest_angle_deg == pytest.approx(60, abs=1e-12)
    assert (quality.below_5, quality.below_10, quality.median_radius_ratio) == (0, 0, 1)


@pytest.mark.parametrize("degrees", [0.01, 3.0, 25.0, 59.0])
def test_a_narrow_isosceles_triangle_has_its_closed_form(degrees):
    quality = quality_of(*with_angle(degrees))
    half = math.sin(math.radians(degrees) / 2)
    assert quality.smallest_angle_deg == pytest.approx(degrees, rel=1e-4)
    # r / R = 4 sin(A/2) sin(B/2) sin(C/2), with B and C half of what A leaves of 180 degrees.
    assert quality.median_radius_ratio == pytest.approx(1 / (4 * half * (1 - half)), rel=5e-4)


def test_the_smallest_angle_of_an_obtuse_triangle_counts_not_the_largest():
    quality = quality_of(*with_angle(170))
    assert quality.smallest_angle_deg == pytest.approx(5, rel=1e-4)


def test_shares_count_triangles_below_five_and_ten_degrees():
    quality = quality_of(*(corner for degrees in (4.9, 5.1, 9.9, 10.1) for corner in with_angle(degrees)))
    assert (quality.below_5, quality.below_10) == (0.25, 0.75)


def test_a_triangle_without_area_has_an_angle_of_zero_and_no_finite_ratio():
    line, point = ((0, 0, 0), (1, 0, 0), (2, 0, 0)), ((3, 3, 3),) * 3
    for flat in (line, point):
        quality = quality_of(*flat)
        assert (quality.smallest_angle_deg, quality.below_5, quality.median_radius_ratio) == (0, 1, math.inf)
    quality = quality_of(*line, *point, *(corner for _ in range(3) for corner in with_angle(60)))
    assert quality.median_radius_ratio == pytest.approx(1, abs=3e-4)


def test_without_a_triangle_there_is_no_quality():
    assert QualitySums().quality() is None


def test_the_median_is_that_of_all_triangles_within_a_4096th():
    mesh = marching_cubes(np.random.default_rng(5).random((9, 9, 9)).astype(np.float32), 0.5, normals=False)
    corners = mesh.vertices[mesh.faces].astype(float)
    a, b, c = (np.linalg.norm(corners[:, i] - corners[:, i - 1], axis=1) for i in range(3))
    half = (a + b + c) / 2
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    ratios = (a * b * c / (4 * area)) / (2 * area / half)
    quality = mesh.measures.quality
    lower = np.sort(ratios)[(len(ratios) - 1) // 2]
    assert lower / (1 + 1 / 4096) < quality.median_radius_ratio <= lower * (1 + 1e-6)
    cosine = [
        (b**2 + c**2 - a**2) / (2 * b * c),
        (a**2 + c**2 - b**2) / (2 * a * c),
        (a**2 + b**2 - c**2) / (2 * a * b),
    ]
    angle = np.degrees(np.arccos(np.clip(cosine, -1, 1))).min(axis=0)
    assert quality.smallest_angle_deg == pytest.approx(angle.min(), rel=1e-3)
    assert (quality.below_5, quality.below_10) == ((angle < 5).mean(), (angle < 10).mean())
