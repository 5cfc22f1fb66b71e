# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels of the sidebar, in their order."""

from typing import Any


def modules() -> tuple[Any, ...]:
    """Return every module that registers, in order; imported only when Blender asks."""
    from . import draw, figure, main, presets, results, rotation, settings, structures, table
    from .ct import region, slice
    from .scene import rulers, volume_object

    viewing = (slice, volume_object, region)
    return (presets, structures, draw, main, results, table, rulers, *viewing, settings, rotation, figure)
