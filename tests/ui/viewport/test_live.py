"""Preview and price follow the settings without writing to the file, and leave nothing behind."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

bpy = pytest.importorskip("bpy")

from ctmc_addon.core import CtmcError
from ctmc_addon.ui.properties import preferences
from ctmc_addon.ui.state import (
    session,
    volumes,
)
from ctmc_addon.ui.viewport import live


@pytest.fixture
def loaded(scene, ball_file):
    """The ball, loaded."""
    bpy.ops.ctmc.load(filepath=str(ball_file), spacing=(1, 1, 2))
    return scene


@pytest.fixture
def rested(monkeypatch):
    """Drive the timer by hand until everything has followed, as if the hand had rested."""
    monkeypatch.setattr(live, "REST", 0.0)

    def drive(most=500):
        for _ in range(most):
            if live.tick() is None:
                return
        raise AssertionError("the timer never ends")

    return drive


def blocks():
    """Everything the file holds."""
    return [len(getattr(bpy.data, kind)) for kind in ("objects", "meshes", "materials", "images", "collections")]


def test_a_slider_is_followed_first_and_priced_when_the_hand_rests(loaded, rested):
    before = blocks()
    loaded.ctmc.threshold = 100.0
    live.tick()
    first = live.live.shown
    assert first is not None
    assert session.of(loaded).price is None
    rested()
    bill = session.of(loaded).price
    assert live.live.shown is not first
    assert bill.fits
    bpy.ops.ctmc.reconstruct()
    assert bill.faces == len(bpy.context.object.data.polygons)
    assert blocks() != before
    assert live.live.shown is None  # the real one stands there now


def test_a_small_surface_beside_a_large_one_does_not_make_every_triangle_dear(loaded, rested, monkeypatch):
    found = {}
    loaded.ctmc.threshold = 100.0
    for stride in ((1, 1, 1), (2, 2, 1)):
        loaded.ctmc.stride = stride
        rested()
        (settings,), (price,) = session.of(loaded).price.settings, session.of(loaded).price.prices
        found[settings] = price
    session.of(loaded).price = live.Bill(tuple(found), tuple(found.values()))
    learnt = []
    monkeypatch.setattr(live.CALIBRATION, "learn", lambda price, _, placed: learnt.append(placed / price.faces))
    made = [SimpleNamespace(settings=settings) for settings in found]
    live.learn(loaded.session_uid, made, 6.0)
    each = 6.0 / sum(price.faces for price in found.values())
    assert learnt == pytest.approx([each, each])


def test_the_preview_writes_nothing_to_the_file(loaded, rested):
    before = blocks()
    for threshold in (90.0, 110.0, 130.0):
        loaded.ctmc.threshold = threshold
        rested()
        assert live.live.shown is not None
    assert blocks() == before


def test_it_is_hidden_when_switched_off_and_shown_again(loaded, rested):
    loaded.ctmc.threshold = 100.0
    rested()
    loaded.ctmc.preview = False
    assert live.live.shown is None
    loaded.ctmc.threshold = 120.0
    rested()
    assert live.live.shown is None
    assert session.of(loaded).price is not None
    loaded.ctmc.preview = True
    rested()
    assert live.live.shown is not None


def test_alpha_moves_the_preview_without_another_extraction(loaded, rested, monkeypatch):
    loaded.ctmc.threshold = 100.0
    rested()
    shown = live.live.shown
    before = shown.positions()
    monkeypatch.setattr(live, "follow", None)  # extraction would fail
    loaded.ctmc.alpha = 0.0
    assert live.live.shown is shown
    assert abs(shown.positions() - before).max() > 0.001


def test_a_change_stops_what_was_being_refined(loaded, monkeypatch):
    loaded.ctmc.threshold = 100.0
    monkeypatch.setattr(live, "REST", 0.0)
    monkeypatch.setattr(live, "TICK", -1.0)
    live.tick()
    live.tick()
    assert live.live.work
    loaded.ctmc.threshold = 110.0
    assert not live.live.work
    assert live.live.stale


def test_settings_without_a_surface_say_why_in_place_of_a_price(loaded, rested):
    loaded.ctmc.threshold = 5000.0
    rested()
    said = session.of(loaded).price
    assert isinstance(said, CtmcError)
    assert "5000" in str(said)
    assert live.live.shown is None
    with pytest.raises(RuntimeError, match="5000"):
        bpy.ops.ctmc.reconstruct()


def test_what_does_not_fit_cannot_be_started(loaded, rested, monkeypatch):
    loaded.ctmc.threshold = 100.0
    monkeypatch.setattr(live, "machine", lambda: preferences.Machine(memory_limit=100_000))
    live.live.preview = None
    rested()
    bill = session.of(loaded).price
    assert not bill.fits
    with pytest.raises(RuntimeError, match="GiB of memory"):
        bpy.ops.ctmc.reconstruct()
    assert not loaded.objects
    loaded.ctmc.stride = (4, 4, 2)  # another setting has another price
    monkeypatch.setattr(live, "machine", preferences.machine)
    assert bpy.ops.ctmc.reconstruct() == {"FINISHED"}


def test_another_file_ends_it_all(loaded, rested):
    loaded.ctmc.threshold = 100.0
    rested()
    bpy.ops.wm.read_homefile(use_empty=True)
    assert live.live.shown is None
    assert live.live.preview is None
    assert live.tick() is None
    assert volumes.current(bpy.context.scene) is None


def test_nothing_is_left_to_run_where_there_is_no_window(loaded):
    loaded.ctmc.threshold = 100.0
    assert not bpy.app.timers.is_registered(live.tick)
