"""The volumes that have been read in this session. The .blend holds their path and fingerprint, never their values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import bpy

from ...core import Volume
from ...core.volume import VolumeStatistics
from ...readers import Series


@dataclass(frozen=True, eq=False)
class Loaded:
    """A volume, and what the panel says of it.

    Parameters
    ----------
    reading : mapping
        The keyword arguments of `read_volume` it was read with.
    geometry : bool
        Whether the files say spacing and orientation; else the panel asks.
    series_number : int
        Which of the series it is.
    sibling : Path or None
        Its label volume, where one lies beside it.
    """

    path: Path
    volume: Volume
    survey: VolumeStatistics
    series: tuple[Series, ...] = ()
    reading: Mapping[str, Any] = field(default_factory=dict)
    geometry: bool = True
    series_number: int = 1
    sibling: Path | None = None


_loaded: dict[str, Loaded] = {}


def keep(loaded: Loaded, scene: bpy.types.Scene) -> None:
    """Make a volume the current one of `scene`; volumes that no scene refers to any more are let go."""
    scene.ctmc.volume_path = stored_path(loaded.path)
    scene.ctmc.volume_fingerprint = loaded.survey.fingerprint
    _loaded[loaded.survey.fingerprint] = loaded
    let_go()


def let_go(*_: Any) -> None:
    """Let the volumes go that no scene refers to, after another was loaded or another file opened."""
    used = {one.ctmc.volume_fingerprint for one in bpy.data.scenes}
    for stale in set(_loaded) - used:
        del _loaded[stale]


def loaded(scene: bpy.types.Scene) -> Loaded | None:
    """What was last loaded for `scene`, if it was loaded in this session."""
    return _loaded.get(scene.ctmc.volume_fingerprint)


def current(scene: bpy.types.Scene) -> Volume | None:
    """The volume last loaded for `scene`, if it was loaded in this session."""
    found = loaded(scene)
    return None if found is None else found.volume


def missing(scene: bpy.types.Scene) -> bool:
    """Whether the file knows a CT that is not in memory."""
    return bool(scene.ctmc.volume_path) and loaded(scene) is None


def has_volume(operator: Any, context: bpy.types.Context) -> bool:
    """Whether a CT is in memory, with the reason if not."""
    if current(context.scene) is None:
        operator.poll_message_set("Load the CT again first" if missing(context.scene) else "Load a CT first")
        return False
    return True


def there(path: str) -> bool:
    """Whether something lies at a path that a file has noted."""
    return Path(bpy.path.abspath(path)).exists()


def name_of(path: str) -> str:
    """The last part of a path that a file has noted, whichever system wrote it."""
    return path.replace("\\", "/").rstrip("/").rpartition("/")[2]


def stored_path(path: Path) -> str:
    """How the file notes a path: relative to itself, once it is saved and where that is possible."""
    if not bpy.data.filepath:
        return str(path)
    try:
        return bpy.path.relpath(str(path))
    except ValueError:  # another drive
        return str(path)


def register() -> None:
    """Look for volumes to let go after another file was opened."""
    bpy.app.handlers.load_post.append(bpy.app.handlers.persistent(let_go))


def unregister() -> None:
    """Let every volume go."""
    bpy.app.handlers.load_post.remove(let_go)
    _loaded.clear()
