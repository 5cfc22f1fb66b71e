# SPDX-License-Identifier: GPL-3.0-or-later
"""Define the settings of renders in the scene itself: `scene.ctmc_studio`; their engine is the figures'.

As in settings.py, this module must not hold `bpy` itself, nor anything that does.
"""

from __future__ import annotations

from typing import Any

from bpy.props import PointerProperty
from bpy.types import PropertyGroup, Scene
from bpy.utils import register_class, unregister_class

from ..kinds import choice


def _show(studio: Any, _context: Any) -> None:
    """Change the background of a scene that has a studio at once."""
    from ....blender.scene.background import is_studio_world, show_background

    if is_studio_world(studio.id_data.world):
        show_background(studio.id_data, studio.background)


class CTMCStudio(PropertyGroup):
    """How the scene is rendered."""

    background: choice(
        "Background",
        "Background of renders. It changes at once if camera and lights are set up",
        items=[
            ("GRADIENT", "Dark Gradient", "Dark gray, lighter in the middle"),
            ("DARK", "Dark", "Nearly black"),
            ("WHITE", "White", "White, for documents"),
            ("TRANSPARENT", "Transparent", "No background, to lay the picture over another"),
        ],
        update=_show,
    )


def register() -> None:
    """Give every scene its studio."""
    register_class(CTMCStudio)
    Scene.ctmc_studio = PointerProperty(type=CTMCStudio, name="CTMC Studio")


def unregister() -> None:
    """Unregister it."""
    del Scene.ctmc_studio
    unregister_class(CTMCStudio)
