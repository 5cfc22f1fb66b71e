# SPDX-License-Identifier: GPL-3.0-or-later
"""Every page of the tab fits a window of 1366 x 768 without the wheel, and its depth opens in place."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from window.conftest import CT
from window.desk import PAGES, Desk
from window.scenes import IDLE, QUIET, load

pytestmark = pytest.mark.window

SIZE = (1366, 768)
NOTCHES = 60  # of the wheel, more than any page has
MADE = "any(o.name.startswith('Bone') for o in bpy.data.objects)"
RECONSTRUCT = """
view = viewport()
with bpy.context.temp_override(window=view.window, area=view.area, region=view.region):
    bpy.ops.ctmc.reconstruct("INVOKE_DEFAULT")
"""


@pytest.fixture(scope="module")
def small(opened: Callable[[], Desk], package: Path, phantom: Path) -> Iterator[Desk]:
    """A Blender as it begins, in a small window at scale 1 with all its editors; a CT is loaded, a surface active."""
    desk = Desk(opened().root, opened().pictures / "small", SIZE)
    try:
        desk.install(package)
        desk.bring(phantom / CT)
        desk.open()
        desk.ask("v = bpy.context.preferences.view; v.ui_scale, v.smooth_view = 1.0, 0")
        desk.ask("viewport().space.show_region_ui = True")
        desk.wait("viewport().sidebar.width > 100")
        desk.wait("bring_tab('CTMC')")
        load(desk, f"{desk.inside}/{CT}")
        desk.ask("s = bpy.context.scene.ctmc; s.threshold = 200; s.stride = (4, 4, 1); s.min_part_mm3 = 1.0")
        desk.ask(RECONSTRUCT)
        desk.wait(f"{IDLE} and {MADE}")
        desk.wait(QUIET)
        yield desk
    finally:
        desk.close()


def hidden(desk: Desk) -> float:
    """Pixels of the page below the window, by turning the wheel as far as it goes."""
    left, top, _, height = desk.sidebar()
    desk.turn_wheel(left + 12, top + height // 2, up=False, clicks=NOTCHES)
    pixels = desk.ask("answer = overflow()")
    desk.turn_wheel(left + 12, top + height // 2, up=True, clicks=NOTCHES)
    return float(pixels)


@pytest.mark.parametrize(
    "language", ["en_US", *(pytest.param(each, marks=pytest.mark.once) for each in ("de_DE", "zh_HANS"))]
)
def test_no_page_needs_the_wheel(small, language):
    small.ask(f"bpy.context.preferences.view.language = {language!r}")
    pixels = {}
    for page in PAGES:
        small.show(page)
        small.look(f"{language}-{page}")
        pixels[page] = hidden(small)
    assert pixels == dict.fromkeys(PAGES, 0.0)


def test_with_two_structures_the_page_surface_does_not_need_it_either(small):
    small.ask("bpy.context.preferences.view.language = 'en_US'")
    small.ask("for _ in range(2): bpy.ops.ctmc.add_threshold()")
    small.show("SURFACE")
    small.look("structures")
    assert hidden(small) == 0.0
    small.ask("bpy.context.scene.ctmc.use_label = False")


def test_a_click_on_the_row_shows_another_page(small):
    small.show("CT")
    left, top, width, _ = small.sidebar()
    for share, page in ((0.9, "RENDER"), (0.3, "SURFACE")):
        small.click(left + round(share * (width - 26)), top + 22)
        assert small.ask("answer = bpy.context.window_manager.ctmc_page") == page


def test_the_console_is_silent(small):
    log = small.printed()
    for word in ("Traceback", "Error:", "rna_uiItem", "layout panel"):
        assert word not in log
