# SPDX-License-Identifier: GPL-3.0-or-later
"""What the sidebar draws; the closed panels stand in this order."""

from typing import Any


def modules() -> tuple[Any, ...]:
    """Every module that registers, in order; imported only when Blender asks."""
    from . import figure, main, presets, region, results, rotation, rulers, settings, slice, surface, volume_object

    return (presets, surface, main, slice, volume_object, region, settings, rotation, results, rulers, figure)
