"""Runs inside Blender, from its timers: does what the test asks between two events, and answers as JSON.

The test writes `ask-N.py` into the folder given after `--`; what it leaves in `answer` is written to `answer-N.json`.
Mouse and keys come from outside, through the window.
"""

from __future__ import annotations

import json
import sys
import traceback
from pathlib import Path

import bpy

FOLDER = Path(sys.argv[sys.argv.index("--") + 1])
PAUSE = 0.05
number = 0


def look() -> float:
    """Answer the next question, if there is one."""
    global number
    question = FOLDER / f"ask-{number}.py"
    if question.exists():
        names = {"bpy": bpy, "answer": None}
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
preferences.view.ui_scale = 1.2
preferences.view.show_tooltips = False
preferences.inputs.use_mouse_emulate_3_button = False
bpy.app.timers.register(look, first_interval=0.5, persistent=True)
