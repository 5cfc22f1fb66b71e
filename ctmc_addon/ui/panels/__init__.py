# SPDX-License-Identifier: GPL-3.0-or-later
"""Pages of the tab in the sidebar."""

from typing import Any


def modules() -> tuple[Any, ...]:
    """Return every module that registers, in order; imported only when Blender asks."""
    from . import draw, main, presets
    from .surface import structures

    return (presets, structures, draw, main)
