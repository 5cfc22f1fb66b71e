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
    from . import (
        export,
        figure,
        figure_panel,
        figure_properties,
        jobs,
        live,
        load,
        panels,
        preferences,
        presets,
        properties,
        reconstruct,
        region,
        results,
        rotation_test,
        session,
        simplify,
        slice,
        sub_panels,
        threshold,
        translations,
        view_properties,
        viewport,
        volumes,
    )

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
