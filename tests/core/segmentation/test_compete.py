# SPDX-License-Identifier: GPL-3.0-or-later
"""Clicks that compete: times against Dijkstra's, borders against closed forms, one click on a noisy body."""

from __future__ import annotations

import heapq
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from ctmc_addon.core import SettingsError, Volume, finish
from ctmc_addon.core.segmentation import Click, compete_steps
from ctmc_addon.core.segmentation.competition.blocks import factors_of
from ctmc_addon.core.segmentation.competition.border import _least_steps, _prices
from ctmc_addon.core.segmentation.competition.claims import _first_cut, _is_bone, _reach_mm
from ctmc_addon.core.segmentation.competition.geodesic import BLOCKED, NEVER, cost_of, heights_of, sweep_steps

REAL = Path(__file__).resolve().parents[4] / "shared" / "data" / "ts_nifti"


def dijkstra(starts: list[tuple[int, int, int]], heights: np.ndarray, spacing: tuple[float, float, float]):
    """Least times; neighbors are the 18 by faces and edges."""
    side = np.array(spacing[::-1])
    steps = [step for step in product((-1, 0, 1), repeat=3) if 0 < sum(map(abs, step)) < 3]
    times = np.full(heights.shape, NEVER, np.int64)
    queue = [(0, at) for at in starts]
    for _, at in queue:
        times[at] = 0
    heapq.heapify(queue)
    while queue:
        time, at = heapq.heappop(queue)
        if time > times[at]:
            continue
        for step in steps:
            near = tuple(int(a + s) for a, s in zip(at, step, strict=True))
            if all(0 <= a < count for a, count in zip(near, heights.shape, strict=True)):
                length = float(np.sqrt(((np.array(step) * side) ** 2).sum()))
                later = time + cost_of(length) + abs(int(heights[near]) - int(heights[at]))
                if later < times[near]:
                    times[near] = later
                    heapq.heappush(queue, (later, near))
    return times


@pytest.mark.parametrize("seed", range(3))
def test_sweeps_find_the_least_times(seed):
    random = np.random.default_rng(seed)
    heights = heights_of(random.normal(0, 20, (5, 7, 8)).astype(np.float32), 2.0)
    heights[random.random(heights.shape) < 0.2] += BLOCKED
    starts = [(1, 2, 3), (4, 6, 7), (0, 0, 7)]
    times = np.full(heights.shape, NEVER, np.uint32)
    for at in starts:
        heights[at] &= BLOCKED - 1
        times[at] = 0
    swept = finish(sweep_steps(times, heights, (0.8, 1.1, 2.0), rounds=20))
    assert (swept == dijkstra(starts, heights, (0.8, 1.1, 2.0))).all()


def dice(first: np.ndarray, second: np.ndarray) -> float:
    return float(2 * (first & second).sum() / (first.sum() + second.sum()))


def body(
    shape: tuple[int, int, int],
    spacing: tuple[float, float, float],
    center_mm: tuple[float, float, float],
    radius: float,
) -> np.ndarray:
    axes = np.indices(shape) * np.array(spacing[::-1])[:, None, None, None]
    return ((axes - np.array(center_mm)[:, None, None, None]) ** 2).sum(axis=0) <= radius**2


def scan(inside: np.ndarray, spacing: tuple[float, float, float], noise: float = 12.0) -> Volume:
    values = np.where(inside, 100, 40) + np.random.default_rng(5).normal(0, noise, inside.shape)
    return Volume(values.round().astype(np.int16), np.diag([*spacing, 1.0]), kind="HU")


@pytest.mark.parametrize("spacing", [(0.8, 0.8, 0.8), (0.7, 0.7, 3.0), (2.5, 2.5, 2.5)])
def test_one_click_takes_a_noisy_ball(spacing):
    shape = tuple(int(56 / side) for side in reversed(spacing))
    inside = body(shape, spacing, (27.0, 26.0, 29.0), 14.0)
    sample = np.rint(np.array([27.0, 26.0, 29.0]) / spacing[::-1]).astype(int).tolist()
    click = Click(tuple(sample), 1)
    labels = finish(compete_steps(scan(inside, spacing), [click]))
    assert labels.max() == 1
    assert dice(labels == 1, inside) > 0.93


def test_two_structures_of_one_value_part_halfway():
    volume = Volume(np.zeros((20, 20, 41), np.int16), np.eye(4), kind="HU")
    labels = finish(compete_steps(volume, [Click((10, 10, 10), 1), Click((10, 10, 30), 2)]))
    assert (labels[:, :, :20] == 1).all()
    assert (labels[:, :, 22:] == 2).all()  # a block is two voxels


def test_a_click_in_the_surroundings_closes_a_leak():
    shape, spacing = (24, 40, 70), (1.0, 1.0, 1.0)
    first = body(shape, spacing, (12.0, 20.0, 20.0), 11.0)
    second = body(shape, spacing, (12.0, 20.0, 46.0), 11.0)
    bridge = body(shape, (0.0, 1.0, 1.0), (0.0, 20.0, 33.0), 6.0)
    volume = scan(first | second | bridge, spacing, noise=4.0)
    clicks = [Click((12, 20, 20), 1), Click((12, 20, 48), 0)]
    labels = finish(compete_steps(volume, clicks))
    assert labels[12, 20, 46] == 0
    assert labels[12, 20, 22] == 1
    assert dice(labels == 1, first) > 0.85


def test_no_click_is_ignored():
    """Clicks in the ball and around it, each for the side that the values speak against; a later one wins."""
    spacing = (0.9, 0.9, 2.0)
    inside = body((18, 44, 44), spacing, (18.0, 20.0, 20.0), 11.0)
    samples = [(9, 22, 22), (9, 24, 29), (8, 11, 22), (11, 33, 33), (9, 31, 20), (7, 20, 21), (9, 21, 35)]
    clicks = [Click(samples[0], 1), *(Click(sample, int(not inside[sample])) for sample in samples[1:])]
    labels = finish(compete_steps(scan(inside, spacing), clicks))
    at = np.indices(inside.shape)
    for click in clicks:
        away = (at - np.reshape(click.sample, (3, 1, 1, 1))) * np.reshape(spacing[::-1], (3, 1, 1, 1))
        assert (labels[np.sqrt((away**2).sum(axis=0)) <= 1.5] == click.structure).all()


def test_a_correction_beside_the_border_stays_beside_the_border():
    """The second click lies in the last voxel of a ball, where it sees as much of the shell around the ball."""
    spacing, center = (1.5, 1.5, 1.5), (30.0, 30.0, 30.0)
    inside = body((41, 41, 41), spacing, center, 12.0)
    shell = body(inside.shape, spacing, center, 26.0) & ~inside
    volume = scan(inside, spacing, noise=6.0)
    volume = Volume(volume.values + np.int16(20) * shell, volume.affine, kind="HU")
    clicks = [Click((20, 20, 20), 1), Click((20, 20, 28), 1)]
    for number in (1, 2):
        assert dice(finish(compete_steps(volume, clicks[:number])) == 1, inside) > 0.98


@pytest.mark.parametrize("radius", [4.0, 6.0, 10.0])
def test_one_click_takes_a_small_body_in_a_larger_one(radius):
    """As a tumor in a liver, whose own border is far sharper."""
    spacing, center = (1.0, 1.0, 1.5), (33.0, 33.0, 33.0)
    shape = (44, 66, 66)
    small, large = body(shape, spacing, center, radius), body(shape, spacing, center, 27.0)
    noise = np.random.default_rng(3).normal(0, 12, shape)
    values = np.where(small, 60, np.where(large, 105, -100)) + noise
    volume = Volume(values.round().astype(np.int16), np.diag([*spacing, 1.0]), kind="HU")
    labels = finish(compete_steps(volume, [Click((22, 33, 33), 1)]))
    assert dice(labels == 1, small) > 0.75


def test_one_click_takes_a_bone_with_its_hard_shell():
    spacing, center = (1.5, 1.5, 1.5), (30.0, 30.0, 30.0)
    marrow, bone = body((41, 41, 41), spacing, center, 13.0), body((41, 41, 41), spacing, center, 18.0)
    noise = np.random.default_rng(4).normal(0, 15, bone.shape)
    values = np.where(marrow, 200, np.where(bone, 800, 40)) + noise
    volume = Volume(values.round().astype(np.int16), np.diag([*spacing, 1.0]), kind="HU")
    assert dice(finish(compete_steps(volume, [Click((20, 20, 20), 1)])) == 1, bone) > 0.93


@pytest.mark.parametrize(("radius", "times"), [(4.0, 2.0), (12.0, 3.0), (28.0, 6.0)])
def test_a_correction_of_a_small_structure_reaches_less_far(radius, times):
    labels = body((71, 71, 71), (1.0, 1.0, 1.0), (35.0, 35.0, 35.0), radius).astype(np.uint8)
    reach = _reach_mm(labels, (35, 35, 35 + int(radius) + 3), 1, (1.0, 1.0, 1.0), 65.0)
    assert reach == pytest.approx(min(6.0, radius) + times * 3, abs=0.2)


def test_the_first_cut_is_where_all_rises_and_nothing_does_behind():
    sharpness = np.array([6.0, 8.0, 9.0, 5.0, 4.0, 12.0, 14.0])
    assert _first_cut(sharpness, sharpness) == 2
    assert _first_cut(sharpness, sharpness * 0.5) is None  # here it rises, and there it falls
    assert _first_cut(sharpness[:4], sharpness[:4]) is None  # the valley is not deep enough
    assert _first_cut(sharpness / 4, sharpness / 4) is None  # noise


def price_of(inside: np.ndarray, gain: np.ndarray, prices: np.ndarray, sides: tuple[float, float, float]) -> float:
    total = -float(gain[inside].sum())
    for axis, side in enumerate(sides):
        differs = np.diff(inside.astype(int), axis=axis) != 0
        total += min(sides) / side * float(prices[(slice(None),) * axis + (slice(None, -1),)][differs].sum())
    return total


@pytest.mark.parametrize("seed", range(3))
def test_the_border_is_the_cheapest_of_all(seed):
    random = np.random.default_rng(seed)
    shape, sides = (2, 2, 2), (2.0, 1.0, 1.0)
    gain = random.normal(0, 1, shape).astype(np.float32)
    prices = random.uniform(0.2, 1.5, shape).astype(np.float32)
    found = finish(_least_steps(gain, prices, np.zeros(shape, np.int8), sides)) > 0.5
    every = [np.array(choice).reshape(shape) for choice in product((False, True), repeat=gain.size)]
    cheapest = min(price_of(inside, gain, prices, sides) for inside in every)
    assert price_of(found, gain, prices, sides) == pytest.approx(cheapest, abs=1e-4)


def test_nothing_is_outside_of_the_range_or_farther_than_allowed():
    spacing = (1.0, 1.0, 1.0)
    volume = scan(body((30, 30, 30), spacing, (15.0, 15.0, 15.0), 10.0), spacing)
    allowed = volume.values > 60
    labels = finish(compete_steps(volume, [Click((15, 15, 15), 3)], allowed))
    assert set(np.unique(labels)) == {0, 3}
    assert not labels[~allowed].any()
    near = finish(compete_steps(volume, [Click((15, 15, 15), 1)], max_mm=6.0))
    far = np.sqrt(((np.indices(near.shape) - 15) ** 2).sum(axis=0)) > 6.0
    assert near.any()
    assert not near[far].any()


def test_gray_values_compete_as_hu_do():
    inside = body((24, 24, 24), (1.5, 1.5, 1.5), (18.0, 18.0, 18.0), 10.0)
    values = np.where(inside, 0.8, 0.2).astype(np.float32) + np.random.default_rng(1).normal(0, 0.03, inside.shape)
    values[0, 0, 0] = np.nan
    volume = Volume(values.astype(np.float32), np.diag([1.5, 1.5, 1.5, 1.0]))
    assert dice(finish(compete_steps(volume, [Click((12, 12, 12), 1)])) == 1, inside) > 0.88


def test_the_same_clicks_give_the_same_bytes_in_a_larger_volume():
    spacing = (1.0, 1.0, 1.0)
    volume = scan(body((40, 44, 48), spacing, (20.0, 22.0, 24.0), 8.0), spacing)
    labels = finish(compete_steps(volume, [Click((20, 22, 24), 1)], max_mm=15.0))
    part = volume.cropped((9, 7, 5), (40, 38, 36))
    inner = finish(compete_steps(part, [Click((15, 15, 15), 1)], max_mm=15.0))
    assert (labels[5:36, 7:38, 9:40] == inner).all()
    assert labels.sum() == inner.sum()


def test_blocks_are_about_as_long_as_wide():
    assert factors_of((129, 512, 512), (0.57, 0.57, 1.6)) == (2, 5, 5)
    assert factors_of((10, 10, 10), (5.0, 5.0, 5.0)) == (1, 1, 1)


def test_competing_refuses_what_cannot_be():
    volume = Volume(np.zeros((8, 8, 8), np.int16), np.eye(4), kind="HU")
    with pytest.raises(SettingsError, match="no click marks a structure"):
        finish(compete_steps(volume, [Click((4, 4, 4), 0)]))
    with pytest.raises(SettingsError, match="lies outside the range"):
        finish(compete_steps(volume, [Click((4, 4, 4), 1)], np.zeros((8, 8, 8), bool)))
    with pytest.raises(SettingsError, match="256 clicks are too many"):
        finish(compete_steps(volume, [Click((4, 4, 4), 1)] * 256))
    with pytest.raises(SettingsError, match=r"hu_per_mm must be from 0\.01 to 10000, not 0"):
        finish(compete_steps(volume, [Click((4, 4, 4), 1)], hu_per_mm=0.0))
    with pytest.raises(SettingsError, match=r"max_mm must be from 0\.01 to 10000, not 1e"):
        finish(compete_steps(volume, [Click((4, 4, 4), 1)], max_mm=1e300))
    with pytest.raises(SettingsError, match="names structure 300"):
        finish(compete_steps(volume, [Click((4, 4, 4), 300)]))
    with pytest.raises(SettingsError, match="the volume, which has"):
        finish(compete_steps(volume, [Click((9, 4, 4), 1)]))


def patient(label: int) -> tuple[Volume, np.ndarray]:
    """Return the CT of TotalSegmentator's example, and where a label is."""
    nibabel = pytest.importorskip("nibabel")
    ct = nibabel.load(REAL / "example_ct.nii.gz")
    labels = np.asarray(nibabel.load(REAL / "example_seg_fast_force_split.nii.gz").dataobj).T
    return Volume(np.asarray(ct.dataobj).T.astype(np.int16), ct.affine, kind="HU"), labels == label


@pytest.mark.skipif(not REAL.is_dir(), reason="real CT 'ts_nifti' is not beside the checkout")
@pytest.mark.parametrize(("label", "share"), [(1, 0.7), (2, 0.5), (28, 0.5)], ids=["spleen", "kidney", "vertebra"])
def test_one_click_in_a_patient(label, share):
    volume, inside = patient(label)
    at = np.argwhere(inside)
    middle = at[((at - at.mean(axis=0)) ** 2).sum(axis=1).argmin()]
    drawn = finish(compete_steps(volume, [Click(tuple(int(part) for part in middle), 1)]))
    assert dice(drawn == 1, inside) > share


@pytest.mark.skipif(not REAL.is_dir(), reason="real CT 'ts_nifti' is not beside the checkout")
def test_further_clicks_in_a_hip_go_on_behind_the_edges_inside_it():
    volume, hip = patient(77)
    clicks = [Click(sample, 1) for sample in [(24, 41, 32), (35, 33, 36), (43, 21, 42)]]
    assert dice(finish(compete_steps(volume, clicks)) == 1, hip) > 0.55  # 0.44 where they end at the nearest


def test_a_bone_is_told_by_a_tenth_of_its_values():
    known = np.repeat(np.float32([60, 120]), [89, 11])
    assert _is_bone(known, 94.0)
    assert not _is_bone(known[:-2], 94.0)
    assert not _is_bone(known, np.inf)  # values that are not HU


def test_a_border_costs_less_where_values_change_by_a_gaussian_of_the_change():
    changes = np.concatenate([[0], np.linspace(0, 90, 500)]).astype(np.float32)
    values = np.stack([0 * changes, changes, 2 * changes])[:, None]  # along z by `changes`, along x by little
    prices = _prices(np.repeat(values, 2, axis=1))[1, 0]
    along_x = np.gradient(values[1, 0])
    exact = 0.1 + 0.9 * np.exp(-(changes.astype(float) ** 2 + along_x**2) / 400)
    assert np.abs(prices - exact).max() < 0.9 / 256
    assert (prices[0], prices[-1]) == (1.0, np.float32(0.1))
