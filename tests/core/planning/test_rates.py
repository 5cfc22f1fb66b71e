# SPDX-License-Identifier: GPL-3.0-or-later
"""Predicted seconds: a sum over stages, each in proportion to its last run."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from ctmc_addon.core import CostEstimate, ReconstructionSettings
from ctmc_addon.core.measures.reconstruction import Stage
from ctmc_addon.core.planning import rates
from ctmc_addon.core.planning.rates import Calibration


def counted(faces=100_000, left=None, preparing=2.0, counting=0.5, **settings):
    """A surface that was counted."""
    chosen = ReconstructionSettings(**settings)
    return CostEstimate(chosen, faces, faces // 2, faces, 0, faces if left is None else left, preparing, counting)


def made(*stages, full_faces=100_000):
    """A surface that took these seconds."""
    return SimpleNamespace(stages=tuple(Stage(name, seconds) for name, seconds in stages), full_faces=full_faces)


def work():
    return Calibration(unit=1e-6, collapse=1e-5, measured=True)


def test_the_machine_is_measured_in_steps_so_that_a_window_answers_meanwhile():
    calibration = Calibration()
    assert sum(1 for _ in calibration.measure_steps()) > 10
    assert calibration.measured
    assert min(calibration.unit, calibration.collapse) > 0
    assert list(calibration.measure_steps()) == []


def test_another_program_that_delays_a_count_or_an_extraction_changes_no_speed(monkeypatch):
    def unit(*seconds):
        """Seconds of a unit of work, where counting and extracting thrice, then simplifying take these seconds."""
        left = iter(seconds)

        def timed_steps(steps):
            return (yield from steps), next(left)

        monkeypatch.setattr(rates, "timed_steps", timed_steps)
        calibration = Calibration()
        list(calibration.measure_steps())
        return calibration.unit

    delayed = unit(0.5, 0.03, 0.01, 0.5, 0.01, 0.03, 0.2)
    assert delayed == unit(0.01, 0.03, 0.01, 0.03, 0.01, 0.03, 0.2)


@pytest.mark.parametrize(
    ("estimates", "stages"),
    [
        ([counted(threshold=100.0)], ["Extracting the surface"]),
        ([counted(threshold=100.0, min_part_mm3=5.0)], ["Extracting the surface", "Selecting components"]),
        ([counted(label=1, reduction=0.9, left=10_000)], ["Preparing values", "Simplifying"]),
        ([counted(label=label, interfaces="separate") for label in (1, 2, 3)], ["Preparing values"]),
        (
            [counted(label=label, interfaces="shared", reduction=0.5, left=50_000) for label in (1, 2)],
            ["Extracting the surface", "Simplifying", "Averaging normals"],
        ),
    ],
)
def test_the_next_prediction_of_the_same_surfaces_is_the_time_they_took(estimates, stages):
    calibration = work()
    own = made(*((name, 3.0 + number) for number, name in enumerate(stages)))
    calibration.learn(estimates, [own] * len(estimates), measuring=2.0, adding=1.0, seconds=17.5)
    shown = {name for _, name in calibration.stage_seconds(estimates)}
    assert set(stages) <= shown
    learned = sum(
        seconds for key, seconds in calibration.stage_seconds(estimates).items() if key in calibration.learned
    )
    assert learned == pytest.approx(17.5)


def test_a_stage_follows_its_own_work():
    calibration, small = work(), counted(100_000, preparing=0.0, counting=0.0, threshold=100.0, min_part_mm3=5.0)
    took = made(("Extracting the surface", 1.0), ("Selecting components", 4.0))
    calibration.learn([small], [took], measuring=2.0, adding=1.0, seconds=8.0)
    large = counted(300_000, preparing=0.0, counting=0.0, threshold=100.0, min_part_mm3=5.0)
    found = calibration.stage_seconds([large])
    assert found["threshold", "Extracting the surface"] == pytest.approx(3.0)
    assert found["threshold", "Selecting components"] == pytest.approx(12.0)
    assert found["threshold", "Measuring"] == pytest.approx(6.0)
    assert 1.0 < found["", "Adding the surface"] < 3.0
    plain = counted(100_000, preparing=0.0, counting=0.0, threshold=100.0)
    assert calibration.seconds([plain]) == pytest.approx(4.0)


def test_the_share_of_triangles_that_components_leave_is_learned():
    calibration, largest = work(), counted(preparing=0.0, threshold=100.0, keep_parts=1)
    took = made(("Extracting the surface", 1.0), ("Selecting components", 1.0), full_faces=40_000)
    calibration.learn([largest], [took], measuring=2.0, adding=1.0, seconds=5.0)
    assert calibration.kept == {True: 0.4, False: rates.RATIOS.kept}
    assert calibration.seconds([largest]) == pytest.approx(5.0)
    everything = calibration.stage_seconds([counted(threshold=100.0)])
    assert everything["threshold", "Measuring"] == pytest.approx(2.0 / 0.4)


def test_components_simplification_and_shared_walls_each_add_their_seconds():
    calibration = work()
    plain = calibration.seconds([counted(threshold=100.0)])
    assert calibration.seconds([counted(threshold=100.0, min_part_mm3=5.0)]) > plain
    assert calibration.seconds([counted(threshold=100.0, reduction=0.9, left=10_000)]) > plain
    separate = [counted(label=label, interfaces="separate") for label in (1, 2)]
    shared = [counted(label=label, interfaces="shared") for label in (1, 2)]
    assert calibration.seconds(shared) > calibration.seconds(separate)


def test_a_complex_is_learned_once_though_each_of_its_labels_has_its_stages():
    calibration = work()
    pair = [counted(label=label, interfaces="shared") for label in (1, 2)]
    took = made(("Extracting the surface", 6.0))
    calibration.learn(pair, [took, took], measuring=3.0, adding=1.0, seconds=10.0)
    assert calibration.stage_seconds(pair)["shared", "Extracting the surface"] == pytest.approx(6.0)


def test_labels_side_by_side_share_the_time_that_all_took_together():
    calibration = work()
    labels = [counted(label=label, interfaces="separate", counting=0.0) for label in range(1, 5)]
    took = [made(("Preparing values", 3.0), ("Extracting the surface", 1.0)) for _ in labels]
    calibration.learn(labels, took, measuring=2.0, adding=2.0, seconds=5.0)
    assert calibration.seconds(labels) == pytest.approx(5.0)
    found = calibration.stage_seconds(labels)
    assert found["labels", "Preparing values"] == pytest.approx(3.0)
    assert found["labels", "Extracting the surface"] == pytest.approx(1.0)


def test_a_stage_that_has_not_run_in_this_way_follows_its_last_run_in_another():
    calibration = work()
    bone = counted(threshold=100.0, reduction=0.9, left=10_000)
    took = made(("Extracting the surface", 1.0), ("Simplifying", 9.0))
    calibration.learn([bone], [took], measuring=2.0, adding=1.0, seconds=13.0)
    label = counted(label=1, reduction=0.9, left=10_000)
    assert calibration.stage_seconds([label])["label", "Simplifying"] == pytest.approx(9.0)


def test_a_surface_of_few_triangles_teaches_nothing():
    calibration = work()
    calibration.learn([counted(900)], [made(("Extracting the surface", 9.0))], measuring=9.0, adding=9.0, seconds=30.0)
    assert calibration.learned == {}
