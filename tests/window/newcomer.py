# SPDX-License-Identifier: GPL-3.0-or-later
"""What somebody new does with mouse and keys: from a CT on the disk to a cut, colored and rendered bone.

`make sidebar-pictures` goes through it for docs/sidebar.md and prints the seconds of each step, without those that the
test takes to look for a button: a person sees it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from PIL import Image
from window.desk import Desk
from window.scenes import IDLE, LOADED, QUIET, choose_file

SIZE = (1180, 900)
RENDER_MENU = ((126, 14), (168, 38))  # of the bar at the top, and its first line, Render Image
PICKER = (28, -220)  # pixels from the field of a color to a yellow in the wheel that opens above it
WHEEL = 130  # pixels that the wheel reaches beyond the viewport
# File browser and render in the same window, as only that can be photographed, and a picture that a processor renders.
BEGIN = """
preferences, scene = bpy.context.preferences, bpy.context.scene
preferences.filepaths.use_auto_save_temporary_files = False
preferences.view.filebrowser_display_type = preferences.view.render_display_type = "SCREEN"
preferences.view.ui_scale, preferences.view.smooth_view = 1.0, 0
scene.render.engine, scene.cycles.samples, scene.cycles.use_denoising = "CYCLES", 32, False
scene.render.resolution_x, scene.render.resolution_y = 800, 600
"""
SIDEBAR = "v = viewport(); b = v.sidebar; answer = [b.x, v.window.height - b.y - b.height, b.width, b.height]"
FREE = "v = viewport(); r = v.region; answer = [r.x + r.width // 3, v.window.height - r.y - r.height * 3 // 4]"
AREA = """
window = bpy.context.window_manager.windows[0]
views = [area for area in window.screen.areas if area.type == "VIEW_3D"]
answer = [[area.x, window.height - area.y - area.height, area.width, area.height] for area in views]
answer = answer[0] if answer else None
"""
LINES = """
view, module, scene = viewport(), ours("ui.viewport.histogram"), bpy.context.scene
strip = module.strip_of(view.area, scene)
y = view.window.height - 1 - view.region.y - round((strip.bottom + strip.top) / 2)
values = (ours("ui.operators.ct.threshold").used_threshold(scene), {threshold})
answer = [[round(view.region.x + strip.x_of(value)), y] for value in values]
"""
RENDERED = (
    "any(area.type == 'IMAGE_EDITOR' for area in bpy.context.window_manager.windows[0].screen.areas)"
    " and not bpy.app.is_job_running('RENDER')"
)
SURFACE = "ours('ui.state.surfaces').active_surface(bpy.context)"


class Newcomer:
    """A person before a Blender that was just opened, who keeps `keep(number, picture)` of every step."""

    def __init__(self, desk: Desk, keep: Callable[[int, Image.Image], None]) -> None:
        self.desk, self.keep = desk, keep
        self.seconds: list[float] = []
        self.sought = 0.0

    @contextmanager
    def step(self, text: str, beside: int = 0) -> Iterator[None]:
        """Time a step, then take its picture: the viewport, and so many pixels beside it."""
        start, self.sought = time.monotonic(), 0.0
        yield
        self.seconds.append(time.monotonic() - start - self.sought)
        number = len(self.seconds)
        print(f"{number}. {text}: {self.seconds[-1]:.1f} s", flush=True)
        picture = self.desk.look(f"newcomer-{number}")
        left, top, width, height = self.desk.ask(AREA) or (0, 0, *picture.size)
        self.keep(number, picture.crop((left, top, left + width + beside, top + height)))

    def see(self, button: str, at: float = 0.65) -> tuple[int, int]:
        """Look for a button; where it is, with the mouse on it."""
        start = time.monotonic()
        place = self.desk.find(button, at)
        self.sought += time.monotonic() - start
        return place

    def press(self, button: str, at: float = 0.65) -> None:
        """Click on a button of the sidebar."""
        self.see(button, at)
        self.desk.click()

    def over_view(self) -> None:
        """Bring the mouse over the viewport, where keys are the viewport's."""
        self.desk.move(*self.desk.ask(FREE))


def install(desk: Desk, package: Path) -> float:
    """Install the zip by Blender's own command, and the seconds that took."""
    start = time.monotonic()
    desk.install(package)
    print(f"Install the zip: {time.monotonic() - start:.1f} s", flush=True)
    return time.monotonic() - start


def go(desk: Desk, ct: str, threshold: float, before: float, keep: Callable[[int, Image.Image], None]) -> None:
    """Go all the way with the CT at a path, and print the seconds; so many went by before."""
    desk.ask(BEGIN)
    person = Newcomer(desk, keep)
    with person.step("Delete the cube, show the sidebar with N, choose its tab"):
        person.over_view()
        desk.key("Delete")
        desk.key("n")
        desk.wait("viewport().sidebar.width > 100")
        choose_tab(desk)
    with person.step("Load CT, its path typed, Remove Patient Table"):
        person.press("bpy.ops.ctmc.load()")
        choose_file(desk, ct)
        desk.wait(f"{IDLE} and {LOADED}")
        person.press("bpy.ops.ctmc.remove_table()")
        desk.wait(f"{IDLE} and bpy.context.scene.ctmc.remove_table")
        desk.wait(QUIET)
    with person.step("Drag the histogram's line to the bone"):
        person.press("bpy.ops.ctmc.histogram()")
        start, end = desk.ask(LINES.format(threshold=threshold))
        desk.drag(start, end)
        desk.wait(QUIET)
    with person.step("Reconstruct Surface"):
        person.over_view()
        desk.key("Escape")
        person.press("bpy.ops.ctmc.reconstruct()")
        desk.wait(f"{IDLE} and {SURFACE} is not None")
    with person.step("Remove Small"):
        person.press("bpy.ops.ctmc.remove_small()")
        desk.wait(f"{IDLE} and bpy.context.scene.ctmc.min_part_mm3 > 0")
    with person.step("Choose a color", WHEEL):
        choose_color(desk, *person.see("ctmc.color", 0.77))
    with person.step("Open Slice, Cut at Slice"):
        x, y = person.see("ctmc_view.show_slice", 0.155)
        desk.click(x + 100, y)
        person.press("bpy.ops.ctmc.cut_at_slice()")
        desk.wait("any(m.name.startswith('CTMC Cut') for o in bpy.data.objects for m in o.modifiers)")
    with person.step("Coronal, Add Slice"):
        x, y = person.see("ctmc_view.plane", 0.5)
        desk.click()
        person.press("bpy.ops.ctmc.add_slice()", 0.3)
    with person.step("Frame it, put the camera where the viewport looks, render"):
        person.over_view()
        for key in ("n", "KP_Decimal"):  # without the sidebar, what is selected stands in the middle
            desk.key(key)
            desk.ask("answer = 'seen'")
        desk.turn_wheel(*desk.ask(FREE), up=False, clicks=2)  # and leaves room around it
        desk.hand("keydown", "ctrl", "keydown", "alt", "key", "KP_0")
        desk.ask("answer = 'pressed'")
        for words in (("keyup", "alt"), ("keyup", "ctrl"), ("key", "alt")):  # held until it comes alone, in 5.2
            desk.hand(*words)
            desk.ask("answer = 'let go'")
        for place in RENDER_MENU:
            desk.move(*place)
            desk.click()
            desk.ask("answer = 'open'")
        desk.wait(RENDERED)
    print(f"From the zip to the render: {before + sum(person.seconds):.0f} s", flush=True)


def choose_color(desk: Desk, x: int, y: int) -> None:
    """Click on a color's field, and on a yellow in the wheel that opens."""
    color = "answer = list(bpy.context.scene.ctmc.color)"
    before = desk.ask(color)
    desk.turn_wheel(x, y, up=True, clicks=8)  # room for the wheel above it
    y = next(lower for lower in range(y + 40, y + 500, 8) if desk.under(x, lower) == "ctmc.color")
    desk.click(x, y + 4)
    desk.click(x + PICKER[0], y + PICKER[1])
    desk.move(x - 500, y)  # a popup that the mouse leaves closes
    assert desk.ask(color) != before


def choose_tab(desk: Desk) -> None:
    """Click down the sidebar's tabs until ours is in front."""
    left, top, width, height = desk.ask(SIDEBAR)
    for y in range(top + 20, top + height, 30):
        desk.click(left + width - 8, y)
        if desk.ask("answer = viewport().sidebar.active_panel_category") == "CTMC":
            return
    raise AssertionError("the sidebar has no tab CTMC")
