"""CTMC: CT stacks to surfaces by the improved Marching Cubes of Su and Ma, in Blender and outside it.

Importing this package needs no Blender; only `register` does.
"""


def register() -> None:
    """Register operators, panels, menus and commands with Blender."""
    from . import ui

    ui.register()


def unregister() -> None:
    """Take everything away that `register` added."""
    from . import ui

    ui.unregister()
