# SPDX-License-Identifier: GPL-3.0-or-later
"""Define the page that the tab shows: `window_manager.ctmc_page`.

It is kept in this module alone, because undo, saving and opening a file must not change it behind a user's back. As in
settings.py, this module must not hold `bpy` itself, nor anything that does.
"""

from __future__ import annotations

from typing import Any

from bpy.types import WindowManager

from .kinds import choice

PAGES = {
    "CT": ("CT", "Load a CT and its labels, and look at its slices"),
    "SURFACE": ("Surface", "Choose what becomes a surface, and reconstruct it"),
    "DRAW": ("Draw", "Draw structures on the CT"),
    "RESULTS": ("Results", "Measure, repair, compare and export the active surface"),
    "RENDER": ("Render", "Set up camera, lights and background, render, and make figures for print"),
}
"""Name and tooltip of each page, in the order of the work."""

_shown = {"page": 0}


def show(context: Any, page: str) -> None:
    """Show a page of the tab in every window.

    Parameters
    ----------
    context : bpy.types.Context
    page : str
        A key of `PAGES`.
    """
    context.window_manager.ctmc_page = page


def _get_page(_manager: Any) -> int:
    return _shown["page"]


def _set_page(_manager: Any, number: int) -> None:
    _shown["page"] = number


def register() -> None:
    """Give the window manager its page: the CT's."""
    _shown["page"] = 0
    WindowManager.ctmc_page = choice(
        "Page",
        "Page of the tab CTMC",
        items=[(key, name, text) for key, (name, text) in PAGES.items()],
        get=_get_page,
        set=_set_page,
        options={"SKIP_SAVE"},
    )


def unregister() -> None:
    """Take it away."""
    del WindowManager.ctmc_page
