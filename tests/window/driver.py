"""Runs inside Blender, from its timers: does what the test asks between two events, and answers as JSON.

The test writes `ask-N.py` into the folder given after `--`; what it leaves in `answer` is written to `answer-N.json`.
Mouse and keys come from outside, through the window.
"""

from __future__ import annotations

import importlib
import json
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType, SimpleNamespace

import bpy
from mathutils import Vector

FOLDER = Path(sys.argv[sys.argv.index("--") + 1])
ADDON = "bl_ext.user_default.ctmc.ctmc_addon"
PAUSE = 0.05
number = 0


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


def look() -> float:
    """Answer the next question, if there is one."""
    global number
    question = FOLDER / f"ask-{number}.py"
    if question.exists():
        names = {"bpy": bpy, "ours": ours, "viewport": viewport, "on_screen": on_screen, "answer": None}
        try:
            exec(compile(question.read_text(encoding="utf-8"), question.name, "exec"), names)
            reply = {"answer": names["answer"]}
        except Exception:  # noqa: BLE001  (the test shows it)
            reply = {"error": traceback.format_exc()}
        part = FOLDER / "answer.part"
        part.write_text(json.dumps(reply, default=str), encoding="utf-8")
        part.rename(FOLDER / f"answer-{number}.json")
        number += 1
    return PAUSE


preferences = bpy.context.preferences
preferences.view.show_splash = False
preferences.view.ui_scale = 1.1
preferences.view.show_tooltips = False
preferences.inputs.use_mouse_emulate_3_button = False
bpy.app.timers.register(look, first_interval=0.5, persistent=True)
