# SPDX-License-Identifier: GPL-3.0-or-later
"""CTMC: CT stacks to surfaces by the improved Marching Cubes of Su and Ma, in Blender and outside it.

Importing this package needs no Blender; only `register` does.
"""

from __future__ import annotations

import atexit
from typing import Any

_commands: list[Any] = []


def register() -> None:
    """Register operators, panels, menus and the command `blender -b --command ctmc` with Blender."""
    import bpy

    from . import ui

    ui.register()
    _commands.append(bpy.utils.register_cli_command("ctmc", run_command))
    if not bpy.app.binary_path:
        # The bpy module crashes at exit while anything is still registered; Blender itself tidies up before that.
        atexit.register(unregister)


def unregister() -> None:
    """Take everything away that `register` added; nothing, if that has been done."""
    import bpy

    from . import ui

    atexit.unregister(unregister)
    if _commands:
        bpy.utils.unregister_cli_command(_commands.pop())
        ui.unregister()


def run_command(arguments: list[str]) -> int:
    """Run `blender -b --command ctmc ...` and return its exit code."""
    from .cli import main

    return main(arguments)
