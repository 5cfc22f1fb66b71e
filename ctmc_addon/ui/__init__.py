"""What a person touches: properties, panels, operators."""


def register() -> None:
    """Register every class, in order."""


def unregister() -> None:
    """Unregister every class, in the reverse order."""
