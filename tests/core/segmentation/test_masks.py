# SPDX-License-Identifier: GPL-3.0-or-later
"""Masks by distance, by what hangs together, by slices: against brute force, floods and closed forms."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from ctmc_addon.core import SettingsError, Volume, finish
from ctmc_addon.core.segmentation import (
    Layers,
    between_slices_steps,
    change_of,
    combined,
    connected_steps,
    distance as distance_module,
    drawn_axis,
    holes_filled_steps,
    islands_steps,
    layers_of,
    margin_steps,
    range_mask_steps,
    sample_at,
)
from ctmc_addon.core.segmentation.distance import near_steps, squared_distances
from ctmc_addon.core.segmentation.packed import unpack_into

SPACING = (0.7, 1.1, 2.5)


def random_mask(seed: int, share: float, shape: tuple[int, int, int] = (6, 9, 11)) -> np.ndarray:
    return np.random.default_rng(seed).random(shape) < share


def brute_distances(mask: np.ndarray, spacing: tuple[float, float, float]) -> np.ndarray:
    """Distance from every sample to the nearest of the mask, by looking at all pairs."""
    side = np.array(spacing[::-1])
    everything = np.argwhere(np.ones(mask.shape, bool)) * side
    apart = everything[:, None] - (np.argwhere(mask) * side)[None]
    return np.sqrt((apart**2).sum(axis=2)).min(axis=1).reshape(mask.shape)


def flooded(mask: np.ndarray, starts: list[tuple[int, int, int]]) -> np.ndarray:
    """What a flood reaches, sample by sample."""
    found, waiting = np.zeros(mask.shape, bool), [start for start in starts if mask[start]]
    while waiting:
        at = waiting.pop()
        if found[at]:
            continue
        found[at] = True
        for axis in range(3):
            for step in (-1, 1):
                near = list(at)
                near[axis] += step
                if 0 <= near[axis] < mask.shape[axis] and mask[tuple(near)]:
                    waiting.append(tuple(near))
    return found


def ball(radius_mm: float, spacing: tuple[float, float, float], shape: tuple[int, int, int]) -> np.ndarray:
    z, y, x = ((np.arange(count) - count // 2) * side for count, side in zip(shape, reversed(spacing), strict=True))
    return z[:, None, None] ** 2 + y[:, None] ** 2 + x**2 <= radius_mm**2 + 1e-9


@pytest.mark.parametrize("seed", range(4))
def test_distances_are_those_of_all_pairs(seed):
    mask = random_mask(seed, 0.03)
    assert np.allclose(np.sqrt(squared_distances(mask, SPACING)), brute_distances(mask, SPACING), rtol=1e-6)


@pytest.mark.parametrize("limit", [0.7, 2.5, 4.0])
def test_what_is_near_is_near_in_any_blocks(limit, monkeypatch):
    mask = random_mask(7, 0.02)
    near = brute_distances(mask, SPACING) <= limit * (1 + 1e-6)
    assert (finish(near_steps(mask, SPACING, limit)) == near).all()
    monkeypatch.setattr(distance_module, "BLOCK", 1)
    assert (finish(near_steps(mask, SPACING, limit)) == near).all()


def test_nothing_is_near_an_empty_mask():
    empty = np.zeros((3, 4, 5), bool)
    assert not finish(near_steps(empty, SPACING, 9.0)).any()
    assert np.isinf(squared_distances(empty, SPACING)).all()


def test_far_distances_take_a_few_bytes_a_sample_and_a_step_for_every_block(monkeypatch):
    mask = np.zeros((60, 50, 40), bool)
    mask[30, 25, 20] = True
    monkeypatch.setattr(distance_module, "BLOCK", 5 * 50 * 40)
    fractions = []
    tracemalloc.start()
    try:
        near = finish(near_steps(mask, (0.5, 0.5, 0.5), 14.0), lambda step: fractions.append(step.fraction))
        assert tracemalloc.get_traced_memory()[1] < 16 * mask.size
    finally:
        tracemalloc.stop()
    assert len(fractions) == 2 * 60 / 5  # in its slices, and across them
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1
    z, y, x = np.indices(mask.shape) * 0.5
    assert (near == ((z - 15) ** 2 + (y - 12.5) ** 2 + (x - 10) ** 2 <= 14.0**2 * (1 + 1e-6))).all()


def test_a_margin_grows_and_shrinks_by_exact_distances():
    mask = random_mask(3, 0.7)
    assert (finish(margin_steps(mask, SPACING, 1.5)) == (brute_distances(mask, SPACING) <= 1.5)).all()
    assert (finish(margin_steps(mask, SPACING, -1.1)) == (brute_distances(~mask, SPACING) > 1.1 + 1e-6)).all()
    assert (finish(margin_steps(mask, SPACING, 0.0)) == mask).all()


def test_a_ball_with_a_margin_is_the_larger_ball_within_a_sample():
    small = ball(6.0, (1.0, 1.0, 2.0), (21, 41, 41))
    grown = finish(margin_steps(small, (1.0, 1.0, 2.0), 4.0))
    assert (grown <= ball(10.0, (1.0, 1.0, 2.0), small.shape)).all()
    assert (ball(9.0, (1.0, 1.0, 2.0), small.shape) <= grown).all()


def test_a_margin_stays_within_a_range_and_keeps_the_mask():
    mask, within = random_mask(1, 0.05), random_mask(2, 0.5)
    grown = finish(margin_steps(mask, SPACING, 2.5, within))
    assert (grown == mask | (within & (brute_distances(mask, SPACING) <= 2.5 * (1 + 1e-6)))).all()


def test_a_full_mask_does_not_shrink_from_the_border():
    assert finish(margin_steps(np.ones((3, 3, 3), bool), SPACING, -9.0)).all()


@pytest.mark.parametrize("seed", range(5))
def test_what_is_connected_is_what_a_flood_reaches(seed):
    mask = random_mask(seed, 0.45)
    starts = [tuple(int(part) for part in at) for at in np.argwhere(mask)[[0, -1]]]
    assert (finish(connected_steps(mask, starts, SPACING)) == flooded(mask, starts)).all()


def test_connected_ends_at_a_distance():
    reached = finish(connected_steps(np.ones((9, 21, 21), bool), [(4, 10, 10)], SPACING, max_mm=6.0))
    assert (reached == ball(6.0, SPACING, (9, 21, 21))).all()


@pytest.mark.parametrize(("opening", "passes"), [(2.0, True), (5.0, True), (7.0, False)])
def test_a_bridge_is_passed_if_it_is_as_wide_as_the_opening(opening, passes):
    mask = np.zeros((15, 15, 40), bool)
    mask[2:13, 2:13, 2:13] = True
    mask[2:13, 2:13, 27:38] = True
    mask[5:10, 5:10, 13:27] = True  # 5 mm wide and 14 mm long
    reached = finish(connected_steps(mask, [(7, 7, 7)], (1.0, 1.0, 1.0), opening_mm=opening))
    assert not (reached & ~mask).any()
    assert reached[7, 7, 30] == passes
    assert reached[7, 7, 20] == passes
    assert reached[3:12, 3:12, 3:12].all()


def test_a_click_beside_the_widest_part_still_counts():
    mask = ball(6.0, (1.0, 1.0, 1.0), (17, 17, 17))
    assert finish(connected_steps(mask, [(8, 8, 13)], (1.0, 1.0, 1.0), opening_mm=8.0)).sum() > 0.9 * mask.sum()


def test_connected_refuses_a_click_in_nothing_and_one_in_a_thread():
    mask = np.zeros((9, 9, 9), bool)
    with pytest.raises(SettingsError, match="no clicked point lies in the range"):
        finish(connected_steps(mask, [(4, 4, 4)], SPACING))
    mask[4, 4] = True
    with pytest.raises(SettingsError, match="6 mm wide; choose a narrower opening_mm"):
        finish(connected_steps(mask, [(4, 4, 4)], (1.0, 1.0, 1.0), opening_mm=6.0))
    with pytest.raises(SettingsError, match="max_mm must be above 0"):
        finish(connected_steps(mask, [(4, 4, 4)], SPACING, max_mm=0.0))


def islands_by_flood(mask: np.ndarray) -> list[np.ndarray]:
    left, islands = mask.copy(), []
    while left.any():
        islands.append(flooded(left, [tuple(int(part) for part in np.argwhere(left)[0])]))
        left &= ~islands[-1]
    return islands


@pytest.mark.parametrize("seed", range(4))
def test_islands_are_kept_by_their_volume(seed):
    mask = random_mask(seed, 0.3)
    large = sum((one for one in islands_by_flood(mask) if one.sum() * 0.5 >= 2.5), np.zeros(mask.shape, bool))
    assert (finish(islands_steps(mask, 0.5, at_least_mm3=2.5)) == large).all()
    assert (finish(islands_steps(mask, 0.5, at_least_mm3=2.5, drop=True)) == mask & ~large).all()
    sizes = sorted((int(one.sum()) for one in islands_by_flood(mask)), reverse=True)
    assert finish(islands_steps(mask, 1.0, largest=3)).sum() == sum(sizes[:3])


@pytest.mark.parametrize("seed", range(4))
def test_holes_are_what_no_flood_from_the_border_reaches(seed):
    mask = random_mask(seed, 0.7)
    border = np.ones(mask.shape, bool)
    border[1:-1, 1:-1, 1:-1] = False
    open_air = flooded(~mask, [tuple(int(part) for part in at) for at in np.argwhere(border & ~mask)])
    assert (finish(holes_filled_steps(mask, 1.0)) == ~open_air).all()
    small = sum((hole for hole in islands_by_flood(~mask & ~open_air) if hole.sum() <= 1), mask.copy())
    assert (finish(holes_filled_steps(mask, 1.0, at_most_mm3=1.0)) == small).all()


def test_a_full_and_an_empty_mask_have_no_holes():
    assert finish(holes_filled_steps(np.ones((3, 3, 3), bool), 1.0)).all()
    assert not finish(holes_filled_steps(np.zeros((3, 3, 3), bool), 1.0)).any()
    assert not finish(islands_steps(np.zeros((3, 3, 3), bool), 1.0)).any()


def test_a_cone_is_filled_between_its_first_and_last_slice():
    y, x = np.mgrid[:41, :41] - 20
    radius = np.hypot(y * 0.7, x * 0.7)
    mask = np.zeros((11, 41, 41), bool)
    mask[0], mask[10] = radius <= 4.0, radius <= 12.0
    filled = finish(between_slices_steps(mask, (0.7, 0.7, 3.0)))
    for number in range(11):
        true = 4.0 + 0.8 * number
        assert (filled[number][radius <= true - 0.7]).all()
        assert not (filled[number][radius >= true + 0.7]).any()
    assert (filled[[0, 10]] == mask[[0, 10]]).all()


@pytest.mark.parametrize("numbers", [list(range(3, 48, 7)), [2, 5, 13, 22, 36, 41, 47]])
def test_a_ball_is_filled_better_than_by_straight_lines_between_its_slices(numbers):
    z, y, x = np.mgrid[:51, :51, :51] - 25
    ball = z * z + y * y + x * x <= 24**2
    mask = np.zeros_like(ball)
    mask[numbers] = ball[numbers]
    filled = finish(between_slices_steps(mask, (1.0, 1.0, 1.0)))
    straight = np.interp(np.arange(51), numbers, np.sqrt(24.0**2 - (np.array(numbers) - 25.0) ** 2))
    lines = np.hypot(y, x) <= straight[:, None, None]
    part = slice(numbers[0], numbers[-1] + 1)
    assert (filled[numbers] == ball[numbers]).all()
    assert 3 * np.count_nonzero((filled ^ ball)[part]) < 2 * np.count_nonzero((lines ^ ball)[part])


def test_drawn_slices_stay_and_nothing_is_beyond_them():
    mask = np.zeros((9, 12, 12), bool)
    mask[2, 3:9, 3:9], mask[6, 5:8, 2:10] = True, True
    filled = finish(between_slices_steps(mask, SPACING))
    assert (filled[[2, 6]] == mask[[2, 6]]).all()
    assert filled[3:6].any(axis=(1, 2)).all()
    assert not filled[[0, 1, 7, 8]].any()


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_two_parts_in_a_plane_do_not_hide_the_axis_that_was_drawn_along(axis):
    """The slices between two vessels of a plane are left out too, and one voxel is in one plane of every kind."""
    mask = np.zeros((31, 20, 60), bool)
    mask[5:26:5, 5:11, [10, 11, 12, 13, 40, 41, 42, 43]] = True
    assert drawn_axis(np.moveaxis(mask, 0, axis)) == axis
    spots = np.zeros((9, 5, 5), bool)
    spots[[2, 6], 2, 2] = True
    assert drawn_axis(np.moveaxis(spots, 0, axis)) == axis


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_between_slices_works_along_every_axis(axis):
    spacing = (1.0, 1.0, 1.0)
    mask = np.zeros((9, 12, 12), bool)
    mask[2, 3:9, 3:9], mask[6, 5:8, 2:10] = True, True
    turned = finish(between_slices_steps(np.moveaxis(mask, 0, axis), spacing, axis=axis))
    assert (np.moveaxis(turned, axis, 0) == finish(between_slices_steps(mask, spacing))).all()


def test_towards_an_empty_slice_a_structure_ends():
    mask = np.zeros((9, 30, 30), bool)
    mask[0, 13:18, 13:18] = True
    filled = finish(between_slices_steps(mask, (1.0, 1.0, 1.0), drawn=[0, 8]))
    assert filled[0].sum() == 25
    assert not filled[4:].any()


@pytest.mark.parametrize(
    ("drawn", "words"), [([3], "two or more drawn slices, not 1"), ([1, 9], "slice 9 is not one of 0 to 4")]
)
def test_between_slices_refuses_what_it_cannot_fill(drawn, words):
    with pytest.raises(SettingsError, match=words):
        finish(between_slices_steps(np.zeros((5, 4, 4), bool), SPACING, drawn=drawn))


@pytest.mark.parametrize("seed", range(4))
def test_a_change_undoes_and_redoes(seed):
    before = random_mask(seed, 0.5)
    after = before ^ random_mask(seed + 9, 0.2)
    change, mask = change_of(before, after), before.copy()
    change.apply(mask)
    assert (mask == after).all()
    change.apply(mask)
    assert (mask == before).all()
    assert change.voxels == (before != after).sum()


def test_a_change_keeps_a_run_for_a_row_and_one_for_whole_rows():
    before = np.zeros((4, 50, 60), bool)
    after = before.copy()
    after[1, 10:20, 5:55] = True
    assert change_of(before, after).nbytes == 10 * 16
    after[:] = True
    assert change_of(before, after).nbytes == 16
    assert change_of(before, before).nbytes == 0
    window = (slice(1, 2), slice(0, 50), slice(0, 60))
    assert change_of(before, after, window).voxels == 3000


def test_a_change_refuses_another_mask():
    change = change_of(np.zeros((2, 2, 2), bool), np.ones((2, 2, 2), bool))
    with pytest.raises(SettingsError, match="cannot be undone"):
        change.apply(np.zeros((2, 2, 3), bool))


def test_a_range_holds_both_its_ends_and_no_nan():
    values = np.array([np.nan, -np.inf, 1.0, 2.0, 3.0, 4.0, np.inf, 2.5]).reshape(2, 2, 2)
    mask = finish(range_mask_steps(Volume(values, np.eye(4)), 2.0, 4.0))
    assert mask.ravel().tolist() == [False, False, False, True, True, True, False, True]
    with pytest.raises(SettingsError, match="not from 4 to 2"):
        finish(range_mask_steps(Volume(values, np.eye(4)), 4.0, 2.0))


def test_layers_hold_every_mask_whole():
    masks = [random_mask(seed, 0.3) for seed in range(5)]
    layers, used = layers_of(masks)
    for number, (mask, layer) in enumerate(zip(masks, used, strict=True), 1):
        assert ((layers[layer] == number) == mask).all()
    apart = [np.arange(24).reshape(2, 3, 4) % 3 == rest for rest in range(3)]
    assert layers_of(apart)[1] == [0, 0, 0]
    with pytest.raises(SettingsError, match="1 to 255 structures, not 0"):
        layers_of([])


def test_layers_are_as_few_as_fit_after_a_structure_has_moved():
    first, second = np.zeros((2, 3, 4), bool), np.zeros((2, 3, 4), bool)
    first[0], second[0] = True, True
    layers = Layers((2, 3, 4))
    layers.put(3, first)
    layers.put(8, second[0:1], (slice(0, 1), slice(None), slice(None)))
    assert layers.layer_of == {3: 0, 8: 1}
    layers.put(3, ~first)
    layers.compact()
    assert layers.layer_of == {3: 0, 8: 0}
    assert len(layers.labels) == 1
    assert (layers.mask(3) == ~first).all()
    assert (layers.mask(8) == second).all()
    assert layers.voxels() == {3: 12, 8: 12}


def test_slices_that_are_broken_or_of_another_grid_are_refused():
    mask = np.zeros((3, 4, 5), bool)
    for number, content, sentence in [(1, b"junk", "is broken"), (7, b"", "not drawn on a grid")]:
        with pytest.raises(SettingsError, match=sentence):
            unpack_into(mask, {number: content})


def test_combining_refuses_other_shapes_and_other_words():
    with pytest.raises(SettingsError, match="one grid"):
        combined(np.zeros((2, 2, 2), bool), np.zeros((2, 2, 3), bool), "or")
    with pytest.raises(SettingsError, match="not 'xor'"):
        combined(np.zeros((2, 2, 2), bool), np.zeros((2, 2, 2), bool), "xor")


def test_a_point_outside_is_refused_with_the_volume_s_box():
    volume = Volume(np.zeros((4, 5, 6)), np.diag([-2.0, 1.0, 3.0, 1.0]))
    assert sample_at(volume, (-9.9, 4.4, 0.0)) == (0, 4, 5)
    with pytest.raises(SettingsError, match="x -10 to 0 mm, y 0 to 4 mm, z 0 to 9 mm"):
        sample_at(volume, (3.0, 0.0, 0.0))
    with pytest.raises(SettingsError, match="three finite numbers"):
        sample_at(volume, (0.0, np.nan, 0.0))
