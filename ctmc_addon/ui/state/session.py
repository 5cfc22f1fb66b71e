# SPDX-License-Identifier: GPL-3.0-or-later
"""Keep a scene's data of this session that is never stored in the file: messages, cost estimates, full surfaces.

Data-blocks are kept by their session_uid: undo makes every reference to one invalid.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core import Reconstruction, ReconstructionSettings, Volume
from . import change_events

Origin = tuple[str, ReconstructionSettings, str]
"""Key of a surface before simplification: fingerprint of its CT, settings without goal and alpha, part of a solid."""


@dataclass
class Session:
    """Data of one scene in this session.

    Parameters
    ----------
    message : str
        The last error; stays until the next action.
    load_message : str
        The error of the last load; stays until the next.
    refused : (path, ReadingOptions) or None
        The CT that was not loaded because a slice is damaged; it can be read without that slice.
    full : dict of Origin to Reconstruction
        Surfaces of the last run before simplification: the next level of simplification needs no extraction.
    full_labels : Volume or None
        The labels that `full` was made of; labels that have changed since are another volume.
    cost : CostEstimates or None
        None while it is counted.
    rotation : RotationTable or None
    last_surface : int or None
        `session_uid` of the surface that Results showed last.
    table : (tuple of StructureRow, ValueKind) or None
        Measures of all surfaces, and the kind of their CT's values.
    ticked_names : frozenset of str
        Names of the structures that were ticked in the last list, for the next one.
    labels : (volumes and their offsets, Volume) or None
        Label volumes of all sources, and what they were combined to.
    box : (Volume, label values, corners) or None
        The box (8, 3) of the labels that the panel's solid is made of, RAS+ mm.
    active : tuple or None
        The last active object and collection.
    boxes : set of str
        Fingerprints of CTs whose box was seen in the scene.
    looked_for : tuple
        Number of objects and the CTs when boxes were looked for.
    written : dict of str to list
        What the files of drawings hold, by their path.
    """

    message: str = ""
    load_message: str = ""
    refused: tuple[str, Any] | None = None
    full: dict[Origin, Reconstruction] = field(default_factory=dict)
    full_labels: Volume | None = None
    cost: Any = None
    rotation: Any = None
    last_surface: int | None = None
    table: Any = None
    ticked_names: frozenset[str] = frozenset()
    labels: tuple[list[tuple[Volume, int]], Volume] | None = None
    box: tuple[Volume, tuple[int, ...], NDArray[np.float64]] | None = None
    active: tuple[Any, ...] | None = None
    boxes: set[str] = field(default_factory=set)
    looked_for: tuple[Any, ...] = ()
    written: dict[str, list[Any]] = field(default_factory=dict)


_sessions: dict[int, Session] = {}


def of(scene: bpy.types.Scene) -> Session:
    """Return the session of a scene."""
    return _sessions.setdefault(scene.session_uid, Session())


def drop_surfaces(fingerprint: str) -> None:
    """Release surfaces before simplification of a CT that is no longer in memory, its labels, and its cost."""
    for scene_session in _sessions.values():
        scene_session.full = {key: full for key, full in scene_session.full.items() if key[0] != fingerprint}
        scene_session.cost = scene_session.labels = scene_session.full_labels = scene_session.box = None


def scene_of(uid: int) -> bpy.types.Scene | None:
    """Return the scene with this session_uid; None if it was removed.

    Parameters
    ----------
    uid : int
    """
    return next((scene for scene in bpy.data.scenes if scene.session_uid == uid), None)


def object_of(uid: int | None) -> bpy.types.Object | None:
    """Return the object with this session_uid; None if it was removed.

    Parameters
    ----------
    uid : int or None
    """
    return next((obj for obj in bpy.data.objects if obj.session_uid == uid), None)


def viewports() -> Iterator[bpy.types.Area]:
    """Yield the 3D viewports of all windows."""
    for window in bpy.context.window_manager.windows:
        yield from (area for area in window.screen.areas if area.type == "VIEW_3D")


def redraw_panels() -> None:
    """Redraw only the sidebars, because a viewport full of triangles is expensive."""
    for area in viewports():
        for region in area.regions:
            if region.type == "UI":
                region.tag_redraw()


def redraw_viewports() -> None:
    """Redraw the 3D viewports."""
    for area in viewports():
        area.tag_redraw()


def clear(*_: Any) -> None:
    """Forget all scenes, because another file is loaded."""
    _sessions.clear()


register, unregister = change_events.following(load_pre=clear, at_end=clear)
