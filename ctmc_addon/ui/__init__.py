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
        jobs,
        load,
        panels,
        preferences,
        properties,
        reconstruct,
        region,
        session,
        simplify,
        slice,
        translations,
        view_properties,
        viewport,
        volumes,
    )

    return (
        *(translations, preferences, session, volumes, properties, view_properties, jobs),
        *(load, reconstruct, simplify, export, panels, slice, region, viewport),
    )
