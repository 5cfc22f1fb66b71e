"""What a person touches: properties, panels, operators."""

from typing import Any


def register() -> None:
    """Register every class, in order."""
    for module in modules():
        module.register()


def unregister() -> None:
    """Unregister every class, in the reverse order."""
    for module in reversed(modules()):
        module.unregister()


def modules() -> tuple[Any, ...]:
    """Everything that registers, in order; imported only when Blender asks."""
    from . import jobs, translations
    from .operators import export, figure, load, reconstruct, results, simplify, slice, threshold
    from .operators import rotation as rotation_test
    from .panels import figure as figure_panel
    from .panels import main as panels
    from .panels import presets, sub_panels
    from .properties import figure as figure_properties
    from .properties import preferences
    from .properties import settings as properties
    from .properties import view as view_properties
    from .state import session, volumes
    from .viewport import live, region
    from .viewport import overlays as viewport

    return (
        translations,
        preferences,
        session,
        volumes,
        properties,
        view_properties,
        figure_properties,
        jobs,
        live,
        load,
        threshold,
        reconstruct,
        simplify,
        rotation_test,
        results,
        export,
        figure,
        presets,
        panels,
        slice,
        region,
        sub_panels,
        figure_panel,
        viewport,
    )
