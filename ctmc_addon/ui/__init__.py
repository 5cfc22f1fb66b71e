# SPDX-License-Identifier: GPL-3.0-or-later
"""Provide the user interface: properties, operators, panels, and previews in the viewport."""

from typing import Any


def modules() -> tuple[Any, ...]:
    """Return every module that registers, in order; imported only when Blender asks."""
    from . import jobs, operators, panels, translations
    from .properties import drawing, maps, page, preferences
    from .properties.ct import scans, view
    from .properties.render import figure, studio
    from .properties.surface import settings, solid
    from .state import session
    from .state.ct import scans as active_scan, stored_paths, volumes
    from .state.draw import drawing_files, drawings
    from .state.results import surfaces
    from .viewport import overlays
    from .viewport.ct import slice_objects, volume_objects
    from .viewport.draw import draw_tools, drawn
    from .viewport.results import rulers
    from .viewport.surface import histogram, live, region, solid_handles

    return (
        *(translations, preferences, session, volumes, stored_paths, settings, scans, active_scan),
        *(page, view, studio, maps, solid, drawing, drawings, drawing_files, figure, jobs, surfaces, live),
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
