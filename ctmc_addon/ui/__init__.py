# SPDX-License-Identifier: GPL-3.0-or-later
"""Provide the user interface: properties, operators, panels, and previews in the viewport."""

from typing import Any


def modules() -> tuple[Any, ...]:
    """Return every module that registers, in order; imported only when Blender asks."""
    from . import jobs, operators, panels, translations
    from .properties import drawing, figure, maps, page, preferences, scans, settings, solid, studio, view
    from .state import drawing_files, drawings, label_looks, scans as active_scan, session, solids, structures, volumes
    from .viewport import (
        draw_tools,
        drawn,
        histogram,
        live,
        overlays,
        region,
        rulers,
        slice_objects,
        solid_handles,
        volume_objects,
    )

    return (
        *(translations, preferences, session, volumes, structures, solids, settings, scans, active_scan),
        *(page, view, studio, maps, solid, drawing, drawings, drawing_files, figure, jobs, label_looks, live),
        *operators.modules(),
        *panels.modules(),
        *(region, solid_handles, overlays, drawn, draw_tools, slice_objects, volume_objects, histogram, rulers),
    )


def register() -> None:
    """Register every class, in order."""
    for module in modules():
        module.register()


def unregister() -> None:
    """Unregister every class, in the reverse order."""
    for module in reversed(modules()):
        module.unregister()
