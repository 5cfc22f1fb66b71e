# SPDX-License-Identifier: GPL-3.0-or-later
"""Four structures of patients made in the sidebar by mouse and keys, with the seconds of each and a picture.

`make sidebar-pictures CT=PATH ARGS="--draw NAME"` goes the way of a `Recipe` in a windowed Blender: the CT is loaded
and its slice in view before the first click, and the clock stops when the surface stands. The test takes seconds to
look for a button, which a person sees; they do not count. Places are RAS+ mm of the patients of docs/segmenting.md.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from PIL import Image
from window.desk import PAGES, Desk
from window.scenes import IDLE, QUIET, begin, load

Place = tuple[float, float, float]
SIZE = (1100, 1200)
ROW = (12, 38, 24)  # pixels from the sidebar's corner to the row of pages, and what is beside it
SIDES = {"A": 0.41, "P": 0.49, "L": 0.57, "R": 0.66, "S": 0.74, "I": 0.82}  # where the buttons of View CT stand
PICTURE = (560, 480)
RECONSTRUCTED = "any(ours('blender.surface').read_provenance(obj) for obj in bpy.data.objects)"


@dataclass(frozen=True)
class Click:
    """A click of Grow on the slice."""

    at: Place


@dataclass(frozen=True)
class Lasso:
    """A lasso from a side of the patient; what is inside stays."""

    side: str
    corners: tuple[Place, ...]


@dataclass(frozen=True)
class Press:
    """A button of the sidebar, pressed at a share of its width."""

    button: str
    at: float = 0.65


@dataclass(frozen=True)
class Recipe:
    """How a structure is made: the slice that is in view first, and what hands do.

    Parameters
    ----------
    side, plane : str
        From where one looks first, and at which slice; it runs through the first click.
    low : float or None
        The range begins there, HU, and Grow is In Range; None for To Borders.
    shown : str
        The plane of the slice in the picture; it runs through the first click too.
    turn, distance : float
        Radians about the patient's axis and Blender units of the eye, for the picture.
    """

    side: str
    plane: str
    low: float | None
    steps: tuple[Click | Lasso | Press, ...]
    shown: str
    turn: float
    distance: float


def of_index(x: float, row: float, z: float) -> Place:
    """Return a place in LIDC-IDRI-0314 by its column, row and slice."""
    return (201 - 0.78125 * x, 59 - 0.78125 * row, z - 679.8)


# Of the vertebra, seen from its right: (row, slice) along the discs, the arch and the spinous process.
ARCH = (
    *((341, 144), (352, 145), (388, 149), (394, 155), (400, 154), (407, 147), (412, 139), (417, 131), (421, 122)),
    *((432, 116), (432, 97), (420, 97), (413, 115), (408, 122), (403, 129), (397, 130), (392, 128), (389, 124.5)),
    (343, 124.5),
)
# From the front: (column, slice) around body and transverse processes, between the ribs.
BODY = (
    *((222, 124), (222, 134), (206, 134), (206, 146), (222, 148), (222, 158), (266, 158), (266, 148), (280, 147)),
    *((280, 134), (266, 134), (266, 124), (256, 124), (256, 94), (240, 94), (240, 124)),
)
# From the head: (column, row) around the lung, from its root to the ribs.
LUNG = (
    *((287, 322), (280, 360), (295, 380), (322, 380), (362, 350), (376, 300), (345, 255), (320, 250), (292, 285)),
    (290, 305),
)
# From the left: (row, slice) around the lung, behind and above the heart.
BEHIND_HEART = ((245, 220), (390, 220), (390, 80), (320, 80), (312, 120), (245, 124))
RECIPES = {
    "tumor": Recipe("S", "axial", None, (Click((60.4, -146.5, -489.8)),), "axial", 2.75, 3.2),
    "vertebra": Recipe(
        "S",
        "axial",
        180,
        (
            Click(of_index(249, 363, 129)),
            Lasso("R", tuple(of_index(249, row, z) for row, z in ARCH)),
            Lasso("A", tuple(of_index(x, 380, z) for x, z in BODY)),
            Press("bpy.ops.ctmc.draw_islands(largest=True)", 0.3),
            Press("bpy.ops.ctmc.draw_holes()", 0.75),
        ),
        "sagittal",
        1.2,
        2.2,
    ),
    "vessels": Recipe(
        "S",
        "axial",
        -400,
        (
            Click(of_index(299, 330, 152)),
            Lasso("S", tuple(of_index(x, row, 152) for x, row in LUNG)),
            Lasso("L", tuple(of_index(299, row, z) for row, z in BEHIND_HEART)),
            Press("bpy.ops.ctmc.draw_islands()", 0.3),
        ),
        "coronal",
        2.75,
        3.0,
    ),
    "kidney": Recipe(
        "A",
        "coronal",
        None,
        (Click((-87.96, 125.32, 322.3)), Click((-87.96, 125.32, 370.3)), Click((-51.96, 125.32, 379.3))),
        "coronal",
        2.75,
        2.8,
    ),
}
BEGIN = """
bpy.context.preferences.view.smooth_view = 0
scene, space = bpy.context.scene, viewport().space
space.overlay.show_floor = space.overlay.show_axis_x = space.overlay.show_axis_y = space.overlay.show_cursor = False
space.overlay.show_text = space.overlay.show_object_origins = space.show_gizmo = False
space.region_3d.view_perspective = "ORTHO"
volume = ours("ui.state.ct.volumes").current(scene)
scene.ctmc_view.show_slice, scene.ctmc_view.plane = True, {plane!r}
scene.ctmc_view.position = ours("core.volume").position_through(volume, {plane!r}, {at})
scene.ctmc.preview = True
view = viewport()
with bpy.context.temp_override(window=view.window, area=view.area, region=view.region):
    bpy.ops.ctmc.view(side={side!r})
"""
SHOWN = "answer = bpy.context.window_manager.ctmc_page"
PROCESSOR = "import time; answer = time.process_time()"
VOLUME = """
scene, drawings, masks = bpy.context.scene, ours("ui.state.draw.drawings"), ours("ui.state.draw.masks")
answer = masks.mm3_of(scene, next(drawings.structures(scene))) / 1000
"""
# From the patient's front and head, turned about the patient's axis; the surface in the middle.
LOOK_AT = """
from mathutils import Euler, Vector
view = viewport()
with bpy.context.temp_override(window=view.window, area=view.area, region=view.region):
    bpy.ops.wm.tool_set_by_id(name="builtin.select_box")
about, surfaces = view.space.region_3d, [o for o in bpy.data.objects if ours("blender.surface").read_provenance(o)]
corners = [o.matrix_world @ Vector(corner) for o in surfaces for corner in o.bound_box]
for obj in bpy.context.selected_objects:
    obj.select_set(False)
about.view_rotation = Euler((1.05, 0, {turn})).to_quaternion()
about.view_location = sum(corners, Vector()) / len(corners)
about.view_distance = {distance}
scene, volume = bpy.context.scene, ours("ui.state.ct.volumes").current(bpy.context.scene)
scene.ctmc_view.plane = {shown!r}
scene.ctmc_view.position = ours("core.volume").position_through(volume, {shown!r}, {at})
view.space.show_region_ui = view.space.show_region_toolbar = False
"""


class Person:
    """Who makes a structure, with a watch that stands while a button is looked for."""

    def __init__(self, desk: Desk) -> None:
        self.desk, self.start, self.sought = desk, time.monotonic(), 0.0

    @property
    def seconds(self) -> float:
        """Seconds since the first click."""
        return time.monotonic() - self.start - self.sought

    def see(self, button: str, at: float) -> None:
        """Look for a button, click on its page in the row if that was not shown; the mouse is on the button then."""
        start, shown = time.monotonic(), self.desk.ask(SHOWN)
        place = self.desk.find(button, at)
        page = self.desk.ask(SHOWN)
        self.sought += time.monotonic() - start
        if page != shown:
            left, top, width, _ = self.desk.sidebar()
            share = (PAGES.index(page) + 0.5) / len(PAGES)
            self.desk.click(left + ROW[0] + round(share * (width - ROW[1])), top + ROW[2])
            self.desk.move(*place)

    def press(self, button: str, at: float) -> None:
        """Press a button of the sidebar, and wait for what it begins."""
        self.see(button, at)
        self.desk.click()
        self.desk.wait(IDLE)

    def take(self, tool: str, at: float) -> None:
        """Take a tool."""
        self.press(f'bpy.ops.ctmc.draw_tool(tool="ctmc.{tool}")', at)

    def choose_range(self, low: float) -> None:
        """Let Grow stay in a range, by the wheel over its menu, and type where the range begins."""
        self.see("ctmc_draw.method", 0.65)
        self.desk.hand("keydown", "ctrl", "click", "5", "keyup", "ctrl")
        self.desk.wait("bpy.context.scene.ctmc_draw.method == 'connected'")
        self.desk.places.clear()
        self.see("ctmc_draw.low", 0.65)
        self.desk.key("Return")
        self.desk.key("ctrl+a")
        self.desk.write(f"{low:g}")
        self.desk.key("Return")
        assert self.desk.ask("answer = bpy.context.scene.ctmc_draw.low") == low

    def seen(self, place: Place) -> tuple[int, int]:
        """Return the pixel of a place."""
        x, y = self.desk.ask(f"answer = on_screen([value * 0.01 for value in {place}])")
        return round(x), round(y)

    def do(self, step: Click | Lasso | Press) -> None:
        """Do a step, and wait for Blender's answer."""
        desk = self.desk
        if isinstance(step, Press):
            self.press(step.button, step.at)
        elif isinstance(step, Click):
            desk.click(*self.seen(step.at))
        else:
            self.press(f"bpy.ops.ctmc.view(side='{step.side}')", SIDES[step.side])
            self.take("scissors", 0.75)
            corners = [self.seen(corner) for corner in step.corners]
            desk.move(corners[0][0] - 2, corners[0][1])
            desk.move(*corners[0])
            desk.hand("keydown", "ctrl", "mousedown", "1")
            desk.ask("answer = 'pressed'")  # a press is where the mouse is when Blender sees it
            for corner in corners[1:]:
                desk.move(*corner)
            desk.hand("mouseup", "1", "keyup", "ctrl")
            desk.ask("answer = 'cut'")
        desk.wait(IDLE)


def make_structure(desk: Desk, ct: str, name: str, keep: Callable[[str, Image.Image], None]) -> None:
    """Make a structure of the CT at a path in the sidebar, print the seconds from the first click, keep its picture."""
    recipe = RECIPES[name]
    first = recipe.steps[0]
    assert isinstance(first, Click), "a structure begins with a click"
    begin(desk)
    load(desk, ct)
    desk.ask(BEGIN.format(plane=recipe.plane, at=first.at, side=recipe.side))
    desk.show("DRAW")
    desk.wait(QUIET)
    person, busy = Person(desk), desk.ask(PROCESSOR)
    person.take("grow", 0.3)
    if recipe.low is not None:
        person.choose_range(recipe.low)
    for step in recipe.steps:
        person.do(step)
    person.press("bpy.ops.ctmc.reconstruct()", 0.5)
    desk.wait(RECONSTRUCTED)
    seconds, busy = person.seconds, desk.ask(PROCESSOR) - busy
    print(f"{name}: {seconds:.0f} s, {desk.ask(VOLUME):.0f} ml; Blender's processor time {busy:.0f} s", flush=True)
    desk.ask(LOOK_AT.format(turn=recipe.turn, distance=recipe.distance, shown=recipe.shown, at=first.at))
    picture = desk.look(name)
    middle = desk.ask("v = viewport(); answer = v.window.height - v.region.y - v.region.height // 2")
    left, top = (picture.width - PICTURE[0]) // 2, middle - PICTURE[1] // 2
    keep(f"draw-{name}", picture.crop((left, top, left + PICTURE[0], top + PICTURE[1])))
