# SPDX-License-Identifier: GPL-3.0-or-later
"""What somebody new does with mouse and keys: from a CT on the disk to a rendered bone, then to one that is cut.

`make sidebar-pictures` goes through it for docs/sidebar.md and prints the seconds of each step, without those that the
test takes to look for a button: a person sees it. Clicks and notches of the wheel are those that a person needs.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from PIL import Image
from window.desk import NOTCHES, PAGES, Desk
from window.scenes import IDLE, LOADED, QUIET, choose_file

SIZE = (1180, 900)
ROW = (12, 22, 238)  # pixels from the sidebar's corner to the row of pages, and its width
BONE = 172  # pixels from the upper part of the combo to Bone in its list
YELLOW = "[0.8, 0.6, 0.1, 1.0]"
# File browser and render in the same window, as only that can be photographed, and a picture that a processor renders.
BEGIN = """
preferences, scene = bpy.context.preferences, bpy.context.scene
preferences.filepaths.use_auto_save_temporary_files = False
preferences.view.filebrowser_display_type = preferences.view.render_display_type = "SCREEN"
preferences.view.ui_scale, preferences.view.smooth_view = 1.0, 0
scene.render.resolution_x, scene.render.resolution_y = {size}
"""
SIDEBAR = "v = viewport(); b = v.sidebar; answer = [b.x, v.window.height - b.y - b.height, b.width, b.height]"
FREE = "v = viewport(); r = v.region; answer = [r.x + r.width // 3, v.window.height - r.y - r.height * 3 // 4]"
AREA = """
window = bpy.context.window_manager.windows[0]
views = [area for area in window.screen.areas if area.type == "VIEW_3D"]
answer = [[area.x, window.height - area.y - area.height, area.width, area.height] for area in views]
answer = answer[0] if answer else None
"""
RENDERED = (
    "any(area.type == 'IMAGE_EDITOR' for area in bpy.context.window_manager.windows[0].screen.areas)"
    " and not bpy.app.is_job_running('RENDER')"
)
SHOWN = "answer = bpy.context.window_manager.ctmc_page"
BACK = "any(area.type == 'VIEW_3D' for area in bpy.context.window_manager.windows[0].screen.areas)"
FIRST_SURFACE = "next(o for o in bpy.data.objects if ours('ui.state.results.surfaces').is_surface(o))"
SURFACE = "ours('ui.state.results.surfaces').active_surface(bpy.context)"


class Newcomer:
    """A person before a Blender that was just opened, who keeps `keep(number, picture)` of every step."""

    def __init__(self, desk: Desk, keep: Callable[[int, Image.Image], None]) -> None:
        self.desk, self.keep = desk, keep
        self.seconds: list[float] = []
        self.sought = 0.0
        self.clicks = self.notches = 0

    @contextmanager
    def step(self, text: str) -> Iterator[None]:
        """Time a step, then take its picture: the viewport."""
        start, self.sought = time.monotonic(), 0.0
        yield
        self.seconds.append(time.monotonic() - start - self.sought)
        number = len(self.seconds)
        print(f"{number}. {text}: {self.seconds[-1]:.1f} s, {self.clicks} clicks, {self.notches} notches", flush=True)
        picture = self.desk.look(f"newcomer-{number}")
        left, top, width, height = self.desk.ask(AREA) or (0, 0, *picture.size)
        self.keep(number, picture.crop((left, top, left + width, top + height)))

    def see(self, button: str, at: float = 0.65) -> tuple[int, int]:
        """Look for a button of the page that is shown; where it is, with the mouse on it."""
        start, shown = time.monotonic(), self.desk.ask(SHOWN)
        place = self.desk.find(button, at)
        assert self.desk.ask(SHOWN) == shown, f"{button} is on another page"
        self.notches += NOTCHES * self.desk.turned
        self.sought += time.monotonic() - start
        return place

    def click(self, *place: int) -> None:
        """Click, and count it."""
        self.desk.click(*place)
        self.clicks += 1

    def press(self, button: str, at: float = 0.65) -> None:
        """Click on a button of the page."""
        self.see(button, at)
        self.click()

    def turn_to(self, page: str) -> None:
        """Click on a page in the row at the top."""
        left, top, *_ = self.desk.ask(SIDEBAR)
        self.click(left + ROW[0] + round((PAGES.index(page) + 0.5) * ROW[2] / len(PAGES)), top + ROW[1])
        assert self.desk.ask(SHOWN) == page

    def over_view(self) -> None:
        """Bring the mouse over the viewport, where keys are the viewport's."""
        self.desk.move(*self.desk.ask(FREE))


def install(desk: Desk, package: Path) -> float:
    """Install the zip by Blender's own command, and the seconds that took."""
    start = time.monotonic()
    desk.install(package)
    print(f"Install the zip: {time.monotonic() - start:.1f} s", flush=True)
    return time.monotonic() - start


def go(
    desk: Desk, ct: str, before: float, keep: Callable[[int, Image.Image], None], size: tuple[int, int] = (800, 600)
) -> Newcomer:
    """Go from a CT at a path to a render of this size, and print the seconds; so many went by before."""
    desk.ask(BEGIN.format(size=size))
    person = Newcomer(desk, keep)
    with person.step("Show the sidebar with N, choose its tab"):
        person.over_view()
        desk.key("n")
        desk.wait("viewport().sidebar.width > 100")
        choose_tab(desk)
        person.clicks += 1  # A person sees the tab at once.
    with person.step("Load CT, its path typed"):
        person.press("bpy.ops.ctmc.load()", 0.3)
        choose_file(desk, ct)
        person.clicks += 1  # into the field of the path
        desk.wait(f"{IDLE} and {LOADED}")
        desk.wait(QUIET)
    with person.step("Choose Bone"):
        if desk.ask(SHOWN) != "SURFACE":
            person.turn_to("SURFACE")
        x, y = person.see("ctmc.threshold_from", 0.5)
        person.click()
        person.click(x, y + BONE)
        assert desk.ask("answer = bpy.context.scene.ctmc.threshold_from") == "bone"
        desk.wait(QUIET)
    with person.step("Reconstruct Surface"):
        person.press("bpy.ops.ctmc.reconstruct()")
        desk.wait(f"{IDLE} and {SURFACE} is not None")
    with person.step("Results, Remove Small"):
        person.turn_to("RESULTS")
        person.press("bpy.ops.ctmc.remove_small()")
        desk.wait(f"{IDLE} and bpy.context.scene.ctmc.min_part_mm3 > 0")
        desk.wait(QUIET)
    with person.step("Render, Render"):
        person.turn_to("RENDER")
        person.press("bpy.ops.ctmc.render()")
        desk.wait(RENDERED)
    print(f"From the zip to the render: {before + sum(person.seconds):.0f} s", flush=True)
    return person


def go_on(person: Newcomer) -> None:
    """Back from the render, give the bone a color and cut it open at a coronal slice."""
    desk = person.desk
    with person.step("Esc, Results, a color"):
        desk.move(*(side // 2 for side in SIZE))
        desk.key("Escape")
        desk.wait(BACK)
        person.turn_to("RESULTS")
        person.see("ctmc.color", 0.77)
        choose_color(desk)
    with person.step("CT, Coronal, Add Slice"):
        person.turn_to("CT")
        person.press("ctmc_view.plane", 0.5)
        person.press("bpy.ops.ctmc.add_slice()", 0.3)
    with person.step("Results, Cut, Cut at Slice"):
        desk.ask(f"o = {FIRST_SURFACE}; o.select_set(True); bpy.context.view_layer.objects.active = o")
        person.turn_to("RESULTS")
        person.press("bpy.ops.ctmc.cut_at_slice()")
        desk.wait("any(m.name.startswith('CTMC Cut') for o in bpy.data.objects for m in o.modifiers)")


def choose_color(desk: Desk) -> None:
    """Give the field of a color under the mouse a yellow, by Ctrl V."""
    color = "answer = list(bpy.context.scene.ctmc.color)"
    before = desk.ask(color)
    desk.ask(f"bpy.context.window_manager.clipboard = {YELLOW!r}")
    desk.key("ctrl+v")
    assert desk.ask(color) != before


def choose_tab(desk: Desk) -> None:
    """Click down the sidebar's tabs until ours is in front."""
    left, top, width, height = desk.ask(SIDEBAR)
    front = "answer = viewport().sidebar.active_panel_category"
    if desk.ask(front) == "CTMC":  # A click on the tab in front would fold the sidebar, in 5.2.
        return
    for y in range(top + 20, top + height, 30):
        desk.click(left + width - 8, y)
        if desk.ask(front) == "CTMC":
            return
    raise AssertionError("the sidebar has no tab CTMC")
