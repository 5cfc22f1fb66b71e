# SPDX-License-Identifier: GPL-3.0-or-later
"""An alpha of auto makes the surface of the number it chooses: held, written, simplified, with dropped components."""

import math
from dataclasses import replace

import numpy as np
import pytest
from volumes import AFFINE, in_file, waves

from ctmc_addon.core import (
    Budget,
    MemoryLimitError,
    ReconstructionSettings,
    SettingsError,
    Volume,
    Write,
    finish,
    reconstruct,
    reconstruct_labels,
    reconstruct_steps,
    result_and_full_steps,
    simplified_steps,
)

VOLUME = Volume(waves((20, 18, 24)), AFFINE)
AUTO = ReconstructionSettings(threshold=0.0, alpha="auto", normals="mesh")


@pytest.fixture(scope="module")
def result():
    """The surface of waves at the alpha that it chooses."""
    return reconstruct(VOLUME, AUTO)


def at(alpha, settings=AUTO, volume=VOLUME):
    return reconstruct(volume, replace(settings, alpha=alpha))


def test_the_next_larger_alpha_has_a_smaller_angle(result):
    choice = result.alpha_choice
    assert 0 < choice.alpha < 1
    assert result.measures.quality.smallest_angle_deg >= 5.0
    assert result.measures.quality.smallest_angle_deg == pytest.approx(choice.smallest_angle_deg, abs=1e-9)
    assert result.measures.quality.below_5 == 0
    larger = range(round(choice.alpha * 1000) + 1, 1001)
    assert all(at(number / 1000).measures.quality.smallest_angle_deg < 5.0 for number in (*larger[:3], *larger[-2:]))


def test_the_surface_has_the_bytes_of_the_number_given_by_hand(result):
    by_hand = at(result.alpha_choice.alpha)
    assert result.settings == by_hand.settings
    for name in ("vertices", "faces", "normals"):
        assert getattr(result.mesh, name).tobytes() == getattr(by_hand.mesh, name).tobytes()
    assert result.surface.linear.tobytes() == by_hand.surface.linear.tobytes()
    assert [stage.name for stage in result.stages][:3] == [
        "Preparing values",
        "Extracting the surface",
        "Choosing alpha",
    ]


def test_the_report_says_which_alpha_and_what_it_costs(result):
    report, choice = result.report(), result.alpha_choice
    assert report["alpha"] == report["settings"]["alpha"] == choice.alpha
    assert report["alpha_choice"] == choice.report()
    assert report["alpha_choice"]["reached"] is True
    assert choice.sentence() in report["notes"]
    moved = np.linalg.norm(result.mesh.vertices - result.surface.linear, axis=1)
    assert choice.mean_mm == pytest.approx(moved.mean(), rel=1e-4)
    assert choice.largest_mm == pytest.approx(moved.max(), rel=1e-4)
    by_hand = at(0.5).report()
    assert (by_hand["alpha"], by_hand["alpha_choice"]) == (0.5, None)
    assert 0 < by_hand["smallest_angle_deg"] < 60
    assert by_hand["median_radius_ratio"] > 1
    assert by_hand["below_5_deg"] <= by_hand["below_10_deg"]


@pytest.mark.parametrize("suffix", [".stl", ".ply"])
def test_a_file_that_is_written_piece_by_piece_has_the_bytes_of_the_number(result, tmp_path, suffix):
    auto, by_hand = tmp_path / f"auto{suffix}", tmp_path / f"hand{suffix}"
    few = Budget(slab_bytes=4096)
    written = finish(reconstruct_steps(in_file(VOLUME), AUTO, few, Write(auto)))
    settings = replace(AUTO, alpha=written.settings.alpha)
    finish(reconstruct_steps(VOLUME, settings, Budget(), Write(by_hand)))
    assert written.alpha_choice == result.alpha_choice
    assert auto.read_bytes() == by_hand.read_bytes()
    assert written.measures.quality == result.measures.quality


@pytest.mark.parametrize("drops", [{"keep_parts": 2}, {"min_part_mm3": 20.0}])
@pytest.mark.parametrize("held", [True, False])
def test_dropped_components_have_no_say(result, drops, held, tmp_path):
    settings = replace(AUTO, **drops)
    sink = () if held else (Write(tmp_path / "kept.stl"),)
    kept = finish(reconstruct_steps(VOLUME, settings, Budget(slab_bytes=8192), *sink))
    by_hand = at(kept.settings.alpha, settings)
    assert kept.measures.faces == by_hand.measures.faces < result.measures.faces
    assert kept.measures.quality == by_hand.measures.quality
    assert kept.measures.quality.smallest_angle_deg >= 5.0
    assert kept.settings.alpha >= result.settings.alpha
    assert all(stage.seconds >= 0 for stage in kept.stages)


def test_a_simplified_surface_chooses_on_its_full_one(result):
    simplified = reconstruct(VOLUME, replace(AUTO, reduction=0.5))
    by_hand = at(result.settings.alpha, replace(AUTO, reduction=0.5))
    assert simplified.settings.alpha == result.settings.alpha
    assert simplified.mesh.vertices.tobytes() == by_hand.mesh.vertices.tobytes()
    assert simplified.report()["alpha_choice"] == result.alpha_choice.report()
    again, full = finish(result_and_full_steps(VOLUME, replace(AUTO, reduction=0.5)))
    assert again.mesh.vertices.tobytes() == simplified.mesh.vertices.tobytes()
    assert full.mesh.vertices.tobytes() == result.mesh.vertices.tobytes()
    anew = finish(simplified_steps(full, replace(AUTO, reduction=0.5)))
    assert anew.settings.alpha == result.settings.alpha
    assert anew.mesh.vertices.tobytes() == simplified.mesh.vertices.tobytes()


def test_a_full_surface_that_does_not_fit_is_looked_at_piece_by_piece(result):
    settings, budget = replace(AUTO, reduction=0.5), Budget(slab_bytes=4096)
    here, full = finish(result_and_full_steps(in_file(VOLUME), settings, budget))
    assert full is not None

    class TooSmall(Budget):
        def require(self, needed_bytes, what, remedy):
            if what.startswith("a surface of at least"):
                raise MemoryLimitError("the surface does not fit")

    there, nothing = finish(result_and_full_steps(in_file(VOLUME), settings, TooSmall(slab_bytes=4096)))
    assert nothing is None
    assert there.alpha_choice == here.alpha_choice == result.alpha_choice
    assert there.mesh.vertices.tobytes() == here.mesh.vertices.tobytes()


def test_where_no_alpha_reaches_the_angle_the_best_is_taken_and_said():
    best = reconstruct(VOLUME, replace(AUTO, min_angle_deg=58.0))
    choice = best.alpha_choice
    assert not choice.reached
    angle = best.measures.quality.smallest_angle_deg
    assert angle == pytest.approx(choice.smallest_angle_deg, abs=1e-9)
    assert 5 < angle < 58
    others = [at(alpha).measures.quality.smallest_angle_deg for alpha in np.linspace(0, 1, 21).round(3)]
    assert angle >= max(others)
    assert any(note.startswith("No alpha keeps every angle at 58 degrees") for note in best.notes)


def test_samples_on_the_wrong_side_are_counted_once(tmp_path):
    values = (waves((12, 14, 16)) > 100).astype(np.uint8)
    volume = Volume(values, np.diag([0.7, 0.8, 2.5, 1.0]), kind="label")
    settings = ReconstructionSettings(label=1, smoothing_mm=1.5, alpha="auto")
    chosen = finish(reconstruct_steps(in_file(volume), settings, Budget(slab_bytes=1024), Write(tmp_path / "a.stl")))
    by_hand = reconstruct(volume, replace(settings, alpha=chosen.settings.alpha))
    assert chosen.wrong_side == by_hand.wrong_side == reconstruct(volume, settings).wrong_side > 0


def test_labels_choose_each_for_itself():
    values = np.zeros((12, 12, 24), np.uint8)
    z, y, x = np.indices(values.shape)
    values[(x - 6) ** 2 + (y - 6) ** 2 + (z - 6) ** 2 < 20] = 1
    values[(x - 17) ** 2 / 2 + (y - 5) ** 2 + 2 * (z - 6) ** 2 < 20] = 2
    volume = Volume(values, np.diag([0.7, 0.8, 2.5, 1.0]), kind="label")
    made = reconstruct_labels(volume, replace(AUTO, threshold=None, interfaces="separate")).surfaces
    assert [result.settings.label for result in made] == [1, 2]
    for result in made:
        alone = reconstruct(volume, replace(AUTO, threshold=None, label=result.settings.label))
        assert result.alpha_choice == alone.alpha_choice
        assert result.mesh.vertices.tobytes() == alone.mesh.vertices.tobytes()


def test_a_bare_label_has_no_alpha_to_choose():
    values = np.zeros((9, 9, 9), np.uint8)
    values[3:6, 3:6, 3:6] = 1
    settings = ReconstructionSettings(label=1, smoothing="none", alpha="auto")
    result = reconstruct(Volume(values, np.eye(4), kind="label"), settings)
    assert (result.settings.alpha, result.alpha_choice.largest_mm) == (1.0, 0.0)
    # Of the corner of a box at the midpoints: a triangle of sides of sqrt(1/2), and others of 45 degrees.
    assert result.alpha_choice.smallest_angle_deg == pytest.approx(math.degrees(math.atan(math.sqrt(0.5))))


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"alpha": "best"}, "alpha must be from 0 to 1 or auto, not 'best'"),
        ({"min_angle_deg": 0}, "min_angle_deg must be above 0 and at most 60, not 0"),
        ({"min_angle_deg": 61}, "min_angle_deg must be above 0 and at most 60, not 61"),
    ],
)
def test_a_wrong_word_or_angle_is_refused(values, words):
    with pytest.raises(SettingsError, match=words):
        ReconstructionSettings(**values)


def test_auto_is_not_a_number_before_there_is_a_surface():
    assert ReconstructionSettings(alpha=0.25).alpha_number == 0.25
    with pytest.raises(SettingsError, match="alpha auto depends on the surface; give a number from 0 to 1 here"):
        _ = ReconstructionSettings(alpha="auto").alpha_number
