"""The volumes that have been read in this session, by their path. They are never stored in the .blend."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..core import Volume

_loaded: dict[str, Volume] = {}


def keep(path: Path, volume: Volume, scene: bpy.types.Scene) -> None:
    """Make `volume` the current one of `scene`; volumes that no scene refers to any more are let go."""
    scene.ctmc.volume_path = str(path)
    _loaded[str(path)] = volume
    used = {one.ctmc.volume_path for one in bpy.data.scenes}
    for stale in set(_loaded) - used:
        del _loaded[stale]


def current(scene: bpy.types.Scene) -> Volume | None:
    """The volume last loaded for `scene`, if it was loaded in this session."""
    return _loaded.get(scene.ctmc.volume_path)


def register() -> None:
    """Nothing to register."""


def unregister() -> None:
    """Let every volume go."""
    _loaded.clear()
