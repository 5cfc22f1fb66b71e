# SPDX-License-Identifier: GPL-3.0-or-later
"""Brush, eraser and scissors, on grids that are turned, sheared and mirrored."""

from __future__ import annotations

import tracemalloc
from itertools import pairwise

import numpy as np
import pytest

from ctmc_addon.core import SettingsError, Volume, finish
from ctmc_addon.core.segmentation import brush, brushed_window, scissors_steps
from ctmc_addon.core.segmentation.tools import scissors as scissors_module, strokes as strokes_module

OBLIQUE = np.array([[-0.9, 0.1, 0.3, 12.0], [0.2, 0.8, -0.2, -5.0], [0.1, 0.3, 2.4, 7.0], [0.0, 0.0, 0.0, 1.0]])
SHAPE = (10, 24, 28)


def grid(affine: np.ndarray, shape: tuple[int, int, int] = SHAPE) -> Volume:
    return Volume(np.zeros(shape, np.uint8), affine)


def positions(affine: np.ndarray, shape: tuple[int, int, int] = SHAPE) -> np.ndarray:
    z, y, x = np.indices(shape)
    return np.stack([x, y, z], axis=-1) @ affine[:3, :3].T + affine[:3, 3]


def drawn_on(mask: np.ndarray, volume: Volume, stroke, radius_mm: float, **options) -> np.ndarray:
    """A copy of a mask with a stroke."""
    drawn = mask.copy()
    brush(drawn, volume, stroke, radius_mm, **options)
    return drawn


def distance_to_line(points: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    along = end - start
    share = np.clip((points - start) @ along / max(along @ along, 1e-30), 0, 1)
    return np.linalg.norm(points - start - share[..., None] * along, axis=-1)


@pytest.mark.parametrize("affine", [np.diag([0.8, 0.8, 2.0, 1.0]), OBLIQUE], ids=["straight", "oblique"])
def test_a_stroke_is_what_lies_near_its_line(affine):
    volume, points = grid(affine), positions(affine)
    start, end = points[3, 8, 9], points[6, 15, 20]
    drawn = drawn_on(np.zeros(SHAPE, bool), volume, [start, end], 2.3)
    assert (drawn == (distance_to_line(points, start, end) <= 2.3)).all()
    assert drawn.sum() > 50


def test_a_ball_has_its_volume():
    volume = grid(np.diag([0.5, 0.5, 1.0, 1.0]), (40, 70, 70))
    ball = drawn_on(np.zeros((40, 70, 70), bool), volume, [(17.3, 17.1, 19.6)], 12.0)
    assert ball.sum() * 0.25 == pytest.approx(4 / 3 * np.pi * 12**3, rel=0.01)


def test_a_stroke_of_several_lines_is_what_lies_near_one_of_them_however_it_is_cut(monkeypatch):
    volume, points = grid(OBLIQUE), positions(OBLIQUE)
    stroke = [points[3, 4, 5], points[6, 15, 20], points[6, 20, 3], points[0, 22, 27]]
    near = [distance_to_line(points, *ends) <= 2.3 for ends in pairwise(stroke)]
    for samples in (1, 50, 1 << 13):
        monkeypatch.setattr(strokes_module, "SAMPLES", samples)
        assert (drawn_on(np.zeros(SHAPE, bool), volume, stroke, 2.3) == np.logical_or.reduce(near)).all()


def test_a_large_ball_takes_no_more_memory_than_a_few_bytes_a_sample():
    volume = grid(np.diag([0.5, 0.5, 0.5, 1.0]), (90, 90, 90))
    tracemalloc.start()
    try:
        _, touched = brushed_window(volume, [(22, 22, 22), (23, 22, 22)], 20.0)
        assert tracemalloc.get_traced_memory()[1] < 6 * touched.size
    finally:
        tracemalloc.stop()


def test_a_disc_stays_on_its_slice():
    volume = grid(OBLIQUE)
    points = positions(OBLIQUE)
    normal = np.cross(OBLIQUE[:3, 0], OBLIQUE[:3, 1])
    disc = drawn_on(np.zeros(SHAPE, bool), volume, [points[4, 12, 14]], 3.0, normal=normal)
    assert disc.any(axis=(1, 2)).tolist() == [number == 4 for number in range(10)]
    assert (disc[4] == (np.linalg.norm(points[4] - points[4, 12, 14], axis=-1) <= 3.0)).all()


@pytest.mark.parametrize("normal", [(0, 0, 1), (1, 0, 0), (1, 2, 3), (-2, 1, 0.5)])
def test_the_window_of_a_disc_holds_all_of_it_and_little_else(normal):
    volume, points = grid(OBLIQUE), positions(OBLIQUE)
    axis = np.array(normal) / np.linalg.norm(normal)
    start = points[5, 12, 10] + 0.22 * axis  # so that no sample lies on the disc's edge
    end = points[5, 12, 16]
    end = end - ((end - start) @ axis) * axis
    along = np.abs(axis @ OBLIQUE[:3, :3])  # mm along the normal, of a step along each axis
    half = along[(along / np.linalg.norm(OBLIQUE[:3, :3], axis=0)).argmax()] / 2
    above = (points - start) @ axis
    flat = points - start - above[..., None] * axis
    share = np.clip(flat @ (end - start) / ((end - start) @ (end - start)), 0, 1)
    apart = np.linalg.norm(flat - share[..., None] * (end - start), axis=-1)
    assert min(np.abs(np.abs(above) - half).min(), np.abs(apart - 3.15).min()) > 1e-3
    disc = (above >= -half) & (above < half) & (apart <= 3.15)
    assert (drawn_on(np.zeros(SHAPE, bool), volume, [start, end], 3.15, normal=normal) == disc).all()
    window, touched = brushed_window(grid(np.eye(4)), [(14, 12, 5)], 4.0, normal=(0, 0, 1))
    assert (window, touched.shape) == ((slice(5, 6), slice(8, 17), slice(10, 19)), (1, 9, 9))


def test_the_eraser_takes_away_and_both_stay_within_a_range():
    values = np.random.default_rng(0).integers(0, 100, SHAPE).astype(np.int16)
    volume, within = Volume(values, np.eye(4)), (values >= 20) & (values <= 60)
    full = drawn_on(np.zeros(SHAPE, bool), volume, [(14, 12, 5)], 4.0)
    assert (drawn_on(np.zeros(SHAPE, bool), volume, [(14, 12, 5)], 4.0, limits=(20, 60)) == (full & within)).all()
    assert (drawn_on(full, volume, [(14, 12, 5)], 4.0, limits=(20, 60), erase=True) == (full & ~within)).all()


def test_only_the_window_of_a_stroke_is_looked_at():
    window, touched = brushed_window(grid(np.eye(4)), [(14, 12, 5)], 2.0)
    assert touched.shape == (5, 5, 5)
    assert window == (slice(3, 8), slice(10, 15), slice(12, 17))
    _, missed = brushed_window(grid(np.eye(4)), [(99, 12, 5)], 2.0)
    assert missed.size == 0


@pytest.mark.parametrize(
    ("stroke", "radius", "words"),
    [([(0, 0, 0)], 0.0, "above 0 mm, not 0"), ([], 2.0, "one point or more"), ([(0, 0, np.nan)], 2.0, "finite")],
)
def test_a_brush_refuses_what_is_no_stroke(stroke, radius, words):
    with pytest.raises(SettingsError, match=words):
        drawn_on(np.zeros(SHAPE, bool), grid(np.eye(4)), stroke, radius)


def orthographic(scale: float = 0.1) -> np.ndarray:
    """A view from above, along -z: x and y of the lasso are a tenth of those in mm, depth grows downwards."""
    return np.diag([scale, scale, -scale, 1.0])


def square(low: float, high: float) -> np.ndarray:
    return np.array([[low, low], [high, low], [high, high], [low, high]])


def test_a_lasso_cuts_through_everything():
    affine = np.diag([1.0, 1.0, 2.0, 1.0])
    mask = np.ones(SHAPE, bool)
    cut = finish(scissors_steps(mask, grid(affine), orthographic(), square(0.45, 1.05)))
    expected = mask.copy()
    expected[:, 5:11, 5:11] = False
    assert (cut == expected).all()
    kept = finish(scissors_steps(mask, grid(affine), orthographic(), square(0.45, 1.05), keep_inside=True))
    assert (kept == ~expected).all()


def test_a_lasso_cuts_to_a_depth_below_what_is_seen_first(monkeypatch):
    mask = np.zeros(SHAPE, bool)
    mask[2:8] = True  # from above the slice 7 is seen first
    monkeypatch.setattr(scissors_module, "SAMPLES_PER_STEP", 1)
    volume = grid(np.diag([1.0, 1.0, 2.0, 1.0]))
    cut = finish(scissors_steps(mask, volume, orthographic(), square(0.45, 1.05), depth_mm=4.5))
    expected = mask.copy()
    expected[5:8, 5:11, 5:11] = False
    assert (cut == expected).all()


@pytest.mark.parametrize("depth_mm", [np.inf, 4.5])
def test_a_lasso_of_many_corners_cuts_the_same_in_shorter_steps(monkeypatch, depth_mm):
    turn = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    lasso = np.stack([0.8 + 0.45 * np.cos(turn), 0.8 + 0.45 * np.sin(turn)], axis=1)
    volume, mask = grid(np.diag([1.0, 1.0, 2.0, 1.0])), np.ones(SHAPE, bool)
    at_once = finish(scissors_steps(mask, volume, orthographic(), lasso, depth_mm=depth_mm))
    layer, column, row = np.indices(SHAPE)
    inside = (row - 8.0) ** 2 + (column - 8.0) ** 2 < 4.5**2
    assert (at_once == ~(inside & (layer * 2 >= 18 - depth_mm))).all()
    monkeypatch.setattr(scissors_module, "SIDES_PER_STEP", 400 * 100)
    fractions = []
    cut = finish(scissors_steps(mask, volume, orthographic(), lasso, depth_mm=depth_mm), fractions.append)
    assert (cut == at_once).all()
    turns = 1 if depth_mm == np.inf else 2
    assert len(fractions) == turns * -(-mask.size // 100)
    assert fractions == sorted(fractions)


def test_in_a_perspective_view_a_lasso_is_a_cone():
    eye_height = 30.0
    # x / w and y / w with w the depth below an eye at (12, 12, 30).
    view = np.array([[1.0, 0, 0, -12.0], [0, 1.0, 0, -12.0], [0, 0, -1.0, 0], [0, 0, -1.0, eye_height]])
    points = positions(np.eye(4))
    depth = eye_height - points[..., 2]
    inside = (np.abs(points[..., :2] - 12) < 0.2 * depth[..., None]).all(axis=-1)
    cut = finish(scissors_steps(np.ones(SHAPE, bool), grid(np.eye(4)), view, square(-0.2, 0.2)))
    edge = np.isclose(np.abs(points[..., :2] - 12), 0.2 * depth[..., None]).any(axis=-1)
    assert (cut == ~inside)[~edge].all()


def test_what_lies_behind_the_eye_is_not_cut():
    view = np.array([[1.0, 0, 0, -12.0], [0, 1.0, 0, -12.0], [0, 0, -1.0, 0], [0, 0, -1.0, 4.5]])
    cut = finish(scissors_steps(np.ones(SHAPE, bool), grid(np.eye(4)), view, square(-9, 9)))
    assert cut[5:].all()
    assert not cut[:5, 12, 12].any()


def test_a_lasso_that_crosses_itself_has_inside_what_is_enclosed_once():
    pentagram = np.array([[np.sin(turn), np.cos(turn)] for turn in np.arange(5) * 4 * np.pi / 5])
    x, y = np.array([0.0, 0.0]), np.array([0.0, 0.7])
    assert scissors_module.inside_polygon(x, y, pentagram).tolist() == [False, True]


@pytest.mark.parametrize(
    ("lasso", "depth", "words"),
    [(np.zeros((2, 2)), 1.0, "three corners"), (square(0, 1), 0.0, "above 0 mm"), (square(0, np.inf), 1.0, "finite")],
)
def test_scissors_refuse_what_is_no_lasso(lasso, depth, words):
    with pytest.raises(SettingsError, match=words):
        finish(scissors_steps(np.ones(SHAPE, bool), grid(np.eye(4)), np.eye(4), lasso, depth_mm=depth))
