# SPDX-License-Identifier: GPL-3.0-or-later
"""Preview and cost estimate follow the settings without writing to the file, and leave nothing behind."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ui.drawing import meshes_in

from ctmc_addon.core import Budget
from ctmc_addon.core.solid import solid_cost
from ctmc_addon.core.volume.statistics import thresholding
from ctmc_addon.ui import jobs
from ctmc_addon.ui.properties import preferences
from ctmc_addon.ui.state import session
from ctmc_addon.ui.state.ct import volumes
from ctmc_addon.ui.state.surface import cost_estimates
from ctmc_addon.ui.state.surface.cost_estimates import CostEstimates
from ctmc_addon.ui.viewport.surface import live, preview


@pytest.fixture
def loaded(scene, ball_file):
    """The ball, loaded."""
    bpy.ops.ctmc.load(filepath=str(ball_file), spacing=(1, 1, 2))
    return scene


@pytest.fixture
def rested(monkeypatch):
    """Drive the timer by hand until everything has followed, as if the hand had rested."""
    monkeypatch.setattr(live, "IDLE", 0.0)

    def drive(most=500):
        for _ in range(most):
            if live.tick() is None:
                return
        raise AssertionError("the timer never ends")

    return drive


def blocks():
    """Everything the file holds."""
    return [len(getattr(bpy.data, kind)) for kind in ("objects", "meshes", "materials", "images", "collections")]


def test_a_slider_is_followed_first_and_its_cost_counted_when_idle(loaded, rested):
    before = blocks()
    loaded.ctmc.threshold = 100.0
    live.tick()
    first = preview.state.shown
    assert first is not None
    assert session.of(loaded).cost is None
    rested()
    cost = session.of(loaded).cost
    assert preview.state.shown is not first
    assert cost.refusal == ""
    bpy.ops.ctmc.reconstruct()
    assert cost.faces == len(bpy.context.object.data.polygons)
    assert blocks() != before
    assert preview.state.shown is None  # the real one stands there now


def test_a_finished_surface_corrects_the_prediction_by_the_seconds_of_its_stages(loaded, rested, monkeypatch):
    learned = []
    monkeypatch.setattr(cost_estimates.CALIBRATION, "learn", lambda *what, **seconds: learned.append((what, seconds)))
    loaded.ctmc.threshold = 100.0
    rested()
    cost = session.of(loaded).cost
    bpy.ops.ctmc.reconstruct()
    (((estimates, (result,)), seconds),) = learned
    assert estimates == cost.estimates
    assert result.settings == cost.settings[0]
    own = sum(stage.seconds for stage in result.stages)
    assert 0 < own + seconds["measuring"] + seconds["adding"] <= seconds["seconds"]
    loaded.ctmc.reduction = 0.5
    rested()
    bpy.ops.ctmc.simplify()  # Its seconds lack the extraction.
    assert len(learned) == 1


def test_a_solid_adds_its_own_cost_which_its_parts_correct(loaded, rested, monkeypatch):
    monkeypatch.setattr(cost_estimates.CALIBRATION, "learned", {})
    loaded.ctmc.threshold = 100.0
    rested()
    plain = cost_estimates.of_scene(loaded)
    assert plain is session.of(loaded).cost
    loaded.ctmc_solid.hollow = 2.0
    solid = cost_estimates.of_scene(loaded)
    assert solid.faces > plain.faces
    assert solid.seconds > plain.seconds
    assert solid.memory >= plain.memory
    bpy.ops.ctmc.reconstruct()
    taken = {stage: seconds for (way, stage), seconds in cost_estimates.CALIBRATION.learned.items() if way == "solid"}
    assert len(taken) == 2


def test_a_surface_whose_cost_was_not_counted_teaches_nothing(loaded, monkeypatch):
    monkeypatch.setattr(cost_estimates.CALIBRATION, "learn", lambda *_, **__: pytest.fail("learned"))
    session.of(loaded).cost = CostEstimates((), error="refused")
    bpy.ops.ctmc.reconstruct()


def test_the_preview_writes_nothing_to_the_file(loaded, rested):
    before = blocks()
    for threshold in (90.0, 110.0, 130.0):
        loaded.ctmc.threshold = threshold
        rested()
        assert preview.state.shown is not None
    assert blocks() == before


def test_it_is_hidden_when_switched_off_and_shown_again(loaded, rested):
    loaded.ctmc.threshold = 100.0
    rested()
    loaded.ctmc.preview = False
    assert preview.state.shown is None
    loaded.ctmc.threshold = 120.0
    rested()
    assert preview.state.shown is None
    assert session.of(loaded).cost is not None
    loaded.ctmc.preview = True
    rested()
    assert preview.state.shown is not None


def test_alpha_moves_the_preview_without_another_extraction(loaded, rested, monkeypatch):
    loaded.ctmc.threshold = 100.0
    rested()
    shown = preview.state.shown
    before = shown.positions()
    monkeypatch.setattr(preview, "follow", None)  # extraction would fail
    loaded.ctmc.alpha = 0.0
    assert preview.state.shown is shown
    assert abs(shown.positions() - before).max() > 0.001


def test_a_change_stops_what_was_being_refined(loaded, monkeypatch):
    loaded.ctmc.threshold = 100.0
    monkeypatch.setattr(live, "IDLE", 0.0)
    monkeypatch.setattr(live, "TICK", -1.0)
    live.tick()
    live.tick()
    assert live.live.work
    loaded.ctmc.threshold = 110.0
    assert not live.live.work
    assert live.live.stale


def test_settings_without_a_surface_say_why_in_place_of_a_cost(loaded, rested):
    loaded.ctmc.threshold = 5000.0
    rested()
    assert "5000" in session.of(loaded).cost.refusal
    assert preview.state.shown is None


def test_a_threshold_without_a_surface_is_said_and_the_button_blocked(loaded, rested):
    for threshold in (100.0, 5000.0):
        loaded.ctmc.threshold = threshold
        rested()
    assert "5000" in session.of(loaded).cost.refusal
    with pytest.raises(RuntimeError, match="5000"):
        bpy.ops.ctmc.reconstruct()
    assert not bpy.ops.ctmc.reconstruct.poll()
    loaded.ctmc.threshold = 100.0
    rested()
    assert bpy.ops.ctmc.reconstruct.poll()


def test_what_does_not_fit_cannot_be_started(loaded, rested, monkeypatch):
    loaded.ctmc.threshold = 100.0
    monkeypatch.setattr(live, "machine", lambda: preferences.Machine(budget=Budget(bytes=100_000)))
    preview.state.maker = None
    rested()
    cost = session.of(loaded).cost
    assert "GiB of memory" in cost.refusal
    with pytest.raises(RuntimeError, match="GiB of memory"):
        bpy.ops.ctmc.reconstruct()
    assert not meshes_in(loaded)
    loaded.ctmc.stride = (4, 4, 2)  # another setting has another cost
    monkeypatch.setattr(live, "machine", preferences.machine)
    assert bpy.ops.ctmc.reconstruct() == {"FINISHED"}


def test_a_limit_that_is_lifted_in_the_preferences_refuses_no_longer(loaded, rested, monkeypatch):
    loaded.ctmc.threshold = 100.0
    with monkeypatch.context() as limited:
        limited.setattr(live, "machine", lambda: preferences.Machine(budget=Budget(bytes=100_000)))
        rested()
        assert not bpy.ops.ctmc.reconstruct.poll()
    preferences.limits_changed(None, bpy.context)  # as Blender calls it when the limit gets a value
    rested()
    assert session.of(loaded).cost.refusal == ""
    assert bpy.ops.ctmc.reconstruct.poll()


def test_too_little_memory_is_said_and_the_next_change_is_followed(loaded, rested, monkeypatch):
    def no_memory_steps(*_):
        raise MemoryError
        yield

    with monkeypatch.context() as patched:
        patched.setattr(live, "estimate_steps", no_memory_steps)
        loaded.ctmc.threshold = 100.0
        rested()
    assert session.of(loaded).cost.refusal == jobs.NO_MEMORY
    assert live.live.changed is None
    assert not live.live.work
    loaded.ctmc.threshold = 110.0
    rested()
    assert session.of(loaded).cost.faces > 0


def test_a_surface_whose_threshold_is_counted_first_is_shown_then(loaded, rested, monkeypatch):
    monkeypatch.setattr(thresholding, "QUICK_VALUES", 1)
    monkeypatch.setattr(thresholding, "is_counted", lambda *_: False)
    monkeypatch.setattr(thresholding, "_otsu", WeakKeyDictionary())
    loaded.ctmc.use_threshold = False
    live.tick()
    assert preview.state.shown is None
    rested()
    assert preview.state.shown is not None


@pytest.mark.parametrize(
    ("change", "is_made"),
    [
        (lambda settings: bpy.ops.ctmc.auto_threshold(), True),
        (lambda settings: setattr(settings, "smoothing", "none"), True),
        (lambda settings: bpy.ops.ctmc.fit_region(), True),
        (lambda settings: setattr(settings, "smoothing_mm", 1.0), False),
        (lambda settings: setattr(settings, "threshold", 120.0), False),
    ],
)
def test_it_is_not_drawn_where_a_surface_lies_already_whatever_its_settings_are_called(loaded, rested, change, is_made):
    bpy.ops.ctmc.reconstruct()  # at Otsu's threshold
    change(loaded.ctmc)
    rested()
    assert preview.is_made(bpy.context) == is_made


def test_another_file_ends_it_all(loaded, rested):
    loaded.ctmc.threshold = 100.0
    rested()
    bpy.ops.wm.read_homefile(use_empty=True)
    assert preview.state.shown is None
    assert preview.state.maker is None
    assert live.tick() is None
    assert volumes.current(bpy.context.scene) is None


def test_nothing_is_left_to_run_where_there_is_no_window(loaded):
    loaded.ctmc.threshold = 100.0
    assert not bpy.app.timers.is_registered(live.tick)


def test_the_preview_stays_that_of_the_present_scene_when_memory_is_freed(loaded, rested):
    rested()
    other = bpy.data.scenes.new("zz the last")
    try:
        bpy.ops.ctmc.free_ct()
        assert bpy.data.scenes[-1] == other
        assert live.live.scene == loaded.session_uid
    finally:
        bpy.data.scenes.remove(other)


@pytest.fixture
def labels(scene, tmp_path):
    """Three cubes, labels 1 to 3; the first is ticked."""
    values = np.zeros((12, 12, 36), np.uint8)
    for at in range(3):
        values[3:9, 3:9, 3 + 11 * at : 9 + 11 * at] = at + 1
    np.save(tmp_path / "labels.npy", values)
    bpy.ops.ctmc.load(filepath=str(tmp_path / "labels.npy"), spacing=(1, 1, 1))
    scene.ctmc.use_label = True
    for at, item in enumerate(scene.ctmc.labels):
        item.chosen = at == 0
    return scene


def counted_labels(scene):
    return [settings.label for settings in session.of(scene).cost.settings]


def test_labels_that_only_a_combination_names_are_counted(labels, rested):
    rested()
    assert counted_labels(labels) == [1]
    alone = session.of(labels).cost
    bpy.ops.ctmc.combination_add(how="merge")
    for operand, name in zip(labels.ctmc_solid.combinations[0].of, ("1", "3"), strict=False):
        operand.structure = name
    assert session.of(labels).cost is None
    rested()
    assert counted_labels(labels) == [1, 3]
    assert session.of(labels).cost.faces == 2 * alone.faces
    labels.ctmc_solid.combinations[0].how = "subtract"
    assert session.of(labels).cost is not None  # The same surfaces.
    bpy.ops.ctmc.solid_remove(kind="combinations", index=0)
    rested()
    assert counted_labels(labels) == [1]


def test_the_cost_of_a_solid_in_a_region_is_that_of_a_volume_of_its_size(scene, rested, tmp_path):
    values = np.zeros((12, 12, 60), np.uint8)
    for at, first in enumerate((1, 13, 25, 37)):  # The boxes of the two labels overlap.
        values[1:11, 1:11, first : first + 8] = 1 + at % 2
    np.save(tmp_path / "labels.npy", values)
    bpy.ops.ctmc.load(filepath=str(tmp_path / "labels.npy"), spacing=(1, 1, 1))
    scene.ctmc.use_label = True
    for item in scene.ctmc.labels:
        item.chosen = True
    scene.ctmc.use_region, scene.ctmc.region = True, (0, 0, 0, 47, 11, 11)
    scene.ctmc_solid.hollow = 2.0
    rested()
    cost, solid = cost_estimates.of_scene(scene), scene.ctmc_solid.to_request()
    assert cost.solid == solid_cost(cost.estimates, solid, 48 * 12 * 12)
    assert cost.solid.work < solid_cost(cost.estimates, solid, values.size).work
