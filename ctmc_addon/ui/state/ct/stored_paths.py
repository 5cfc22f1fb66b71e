# SPDX-License-Identifier: GPL-3.0-or-later
"""Keep the paths of CTs and labels in the .blend, relative to it where that is possible."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import bpy

from ....blender.scene.ct_box import noted_paths
from .. import change_events


def states_in(scene: bpy.types.Scene) -> tuple[Any, ...]:
    """Return the panel's state of each CT of a scene, the present one first."""
    return (scene.ctmc, *scene.ctmc_scans)


def stored_cts() -> list[Any]:
    """Return the panel's state of each CT of the file."""
    return [ct for scene in bpy.data.scenes for ct in states_in(scene)]


def exists(path: str) -> bool:
    """Return whether a file or folder exists at a stored path of a .blend."""
    return Path(bpy.path.abspath(path)).exists()


def name_of(path: str) -> str:
    """Return the last part of a stored path, whichever system wrote it."""
    return path.replace("\\", "/").rstrip("/").rpartition("/")[2]


def stored_path(path: Path, blend_path: str = "") -> str:
    """Return a path as a file stores it: relative to `blend_path`, by default the present .blend, if possible."""
    blend = blend_path or bpy.data.filepath
    if not blend:
        return str(path)
    try:
        return str(bpy.path.relpath(str(path), start=str(Path(blend).parent)))
    except ValueError:  # The path is on another drive.
        return str(path)


_absolute: list[str] = []  # Absolute form of the stored paths, while the file is saved.


def noted() -> list[tuple[str, Callable[[str], None]]]:
    """Return the stored paths of the open file, each with a function that stores another."""
    cts = stored_cts()
    sources = [source for ct in cts for source in ct.label_sources]
    notes = [(ct.volume_path, partial(setattr, ct, "volume_path")) for ct in cts]
    notes += [(source.path, partial(setattr, source, "path")) for source in sources]
    return notes + noted_paths()


def before_save(target: str, *_: Any) -> None:
    """Make paths relative to the .blend to save; those of another system stay as they are."""
    paths = [bpy.path.abspath(path) for path, _ in noted()]
    _absolute[:] = [path if Path(path).is_absolute() else "" for path in paths]
    _relate_paths(target)


def after_save(*_: Any) -> None:
    """Make paths relative to the open file again, which differs from the saved one if that was a copy."""
    _relate_paths(bpy.data.filepath)
    _absolute.clear()


def _relate_paths(blend: str) -> None:
    """Store the paths relative to a .blend, or absolute if it is not saved yet."""
    for (_, note), path in zip(noted(), _absolute, strict=False):
        if path:
            note(stored_path(Path(path), blend))


register, unregister = change_events.following(save_pre=before_save, save_post=after_save, save_post_fail=after_save)
