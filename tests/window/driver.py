# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs inside Blender, from its timers: does what the test asks between two events, and answers as JSON.

The test writes `ask-N.py` into the folder given after `--`; what it leaves in `answer` is written to `answer-N.json`.
Mouse and keys come from outside, through the window. A turn of Blender's main loop takes the events that have come,
runs the timers and draws. A question is therefore answered two turns after it is seen: whatever the mouse and the
keys did before it was asked has been handled and drawn by then, however slow the machine is. An answer that is a
generator goes on by one step in each turn, and what it returns is the answer.
"""

from __future__ import annotations

import importlib
import json
import sys
import traceback
from collections.abc import Generator, Sequence
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import bpy
from mathutils import Vector

FOLDER = Path(sys.argv[sys.argv.index("--") + 1])
ADDON = "bl_ext.user_default.ctmc.ctmc_addon"
PAUSE = 0.001
TURNS = 2
number, turns = 0, 0
steps: Generator[None, None, Any] | None = None


def ours(name: str) -> ModuleType:
    """A module of the extension, such as `ui.jobs`."""
    return importlib.import_module(f"{ADDON}.{name}")


def viewport() -> SimpleNamespace:
    """The 3D viewport: window, area, space, its region and its sidebar's."""
    window = bpy.context.window_manager.windows[0]
    area = next(area for area in window.screen.areas if area.type == "VIEW_3D")
    regions = {region.type: region for region in area.regions}
    return SimpleNamespace(
        window=window, area=area, space=area.spaces.active, region=regions["WINDOW"], sidebar=regions["UI"]
    )


def on_screen(place: Sequence[float]) -> tuple[float, float]:
    """Where a place in world space is seen: pixels from the window's top left."""
    from bpy_extras.view3d_utils import location_3d_to_region_2d

    view = viewport()
    at = location_3d_to_region_2d(view.region, view.space.region_3d, Vector(place))
    return (view.region.x + at.x, view.window.height - 1 - view.region.y - at.y)


def under_mouse() -> str:
    """What the sidebar has under the mouse: a property's path, an operator's call, or nothing that can be pressed."""
    view = viewport()
    with bpy.context.temp_override(window=view.window, area=view.area, region=view.sidebar):
        for copy in (bpy.ops.ui.copy_data_path_button, bpy.ops.ui.copy_python_command_button):
            if copy.poll():
                copy()
                return str(bpy.context.window_manager.clipboard)
    return ""


def rows(x: int, ys: Sequence[int], until: str | None = None) -> Generator[None, None, list[str]]:
    """Move the mouse to each of these heights, and what the sidebar has there; only up to a button, if named."""
    window, found = bpy.context.window_manager.windows[0], []
    for y in ys:
        window.cursor_warp(x, window.height - 1 - y)
        for _ in range(TURNS):
            yield
        found.append(under_mouse())
        if found[-1] == until:
            break
    return found


def redraw() -> None:
    """Draw the whole window again at the end of this turn."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            area.tag_redraw()


def browser() -> dict[str, list[int]] | None:
    """Left, top, width and height of each region of the file browser on the screen, if one is open in the window."""
    window = bpy.context.window_manager.windows[0]
    for area in (area for area in window.screen.areas if area.type == "FILE_BROWSER"):
        regions = [region for region in area.regions if region.width > 1]
        if area.spaces.active.params is not None:
            return {r.type: [r.x, window.height - r.y - r.height, r.width, r.height] for r in regions}
    return None


def open_fold(*names: str) -> None:
    """Let folds of a page begin open; before they are drawn for the first time."""
    ours("ui.panels.layout").OPEN.update(names)


def show_page(name: str) -> None:
    """Show a page of the tab."""
    bpy.context.window_manager.ctmc_page = name
    redraw()


def overflow() -> float:
    """How far the sidebar is scrolled down, pixels; its first line is in sight at 0."""
    view = viewport()
    return -view.sidebar.view2d.region_to_view(0, view.sidebar.height - 1)[1]


def bring_tab(name: str) -> bool:
    """Bring a tab of the sidebar to the front; False while it is not there, because the sidebar was not drawn yet."""
    try:
        viewport().sidebar.active_panel_category = name
    except TypeError:
        return False
    redraw()
    return True


def reset() -> None:
    """The preferences that tests may change as they shall be, and the first scene in a single viewport.

    What takes long to draw without a graphics card and no test looks at is left out.
    """
    preferences = bpy.context.preferences
    preferences.view.language = "en_US"
    preferences.view.ui_scale = 1.1
    preferences.view.smooth_view = 200
    preferences.view.filebrowser_display_type = "SCREEN"
    preferences.system.viewport_aa = "OFF"
    bpy.ops.wm.read_homefile(use_factory_startup=False)
    bpy.context.window_manager.ctmc_page = "CT"
    ours("ui.panels.layout").OPEN.clear()
    window = bpy.context.window_manager.windows[0]
    for area in [area for area in window.screen.areas if area.type != "VIEW_3D"]:
        with bpy.context.temp_override(window=window, area=area):
            bpy.ops.screen.area_close()
    overlay = viewport().space.overlay
    overlay.show_floor = overlay.show_axis_x = overlay.show_axis_y = overlay.show_outline_selected = False


NAMES = {
    **{"bpy": bpy, "ours": ours, "viewport": viewport, "on_screen": on_screen},
    **{"under_mouse": under_mouse, "redraw": redraw, "open_fold": open_fold, "bring_tab": bring_tab},
    **{"show_page": show_page, "overflow": overflow},
    **{"browser": browser, "rows": rows, "reset": reset},
}


def look() -> float:
    """Answer the next question, if there is one and its time has come."""
    global number, turns, steps
    question = FOLDER / f"ask-{number}.py"
    if steps is None:
        if not question.exists():
            return PAUSE
        turns += 1
        if turns <= TURNS:
            return PAUSE
    reply = answered(question)
    if reply is not None:
        part = FOLDER / "answer.part"
        part.write_text(json.dumps(reply, default=str), encoding="utf-8")
        part.rename(FOLDER / f"answer-{number}.json")
        number, turns, steps = number + 1, 0, None
    return PAUSE


def answered(question: Path) -> dict[str, Any] | None:
    """The answer to a question, or the traceback; nothing while its steps go on."""
    global steps
    names = {**NAMES, "answer": None}
    try:
        if steps is None:
            exec(compile(question.read_text(encoding="utf-8"), question.name, "exec"), names)
            if not isinstance(names["answer"], Generator):
                return {"answer": names["answer"]}
            steps = names["answer"]
        next(steps)
    except StopIteration as done:
        return {"answer": done.value}
    except Exception:  # noqa: BLE001  (the test shows it)
        return {"error": traceback.format_exc()}
    return None


bpy.context.preferences.view.show_splash = False
bpy.context.preferences.view.show_tooltips = False
bpy.context.preferences.inputs.use_mouse_emulate_3_button = False
bpy.context.preferences.view.ui_scale = 1.1
bpy.app.timers.register(look, first_interval=0.5, persistent=True)
