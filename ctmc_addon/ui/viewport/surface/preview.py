# SPDX-License-Identifier: GPL-3.0-or-later
"""Show a coarse surface in the viewport that follows the settings; nothing of it is written to the file."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import bpy

from ....blender.colors import BONE, color_of
from ....blender.surface import read_provenance
from ....blender.viewport import PreviewSurface
from ....core import CtmcError, Preview, PreviewResult, ReconstructionSettings, Steps, Volume
from ....core.volume import quick_threshold
from ...properties.preferences import machine
from ...state import session
from ...state.ct import volumes
from ...state.draw.tools import tool_of
from ..draw import drawn

PreviewKey = tuple[Any, ...]
"""Settings that decide the position of a surface, as `key_of` returns them."""


@dataclass
class State:
    """The shown surface, its scene, and its maker.

    Parameters
    ----------
    requested : bool
        Whether a surface is to be shown as soon as it is ready: `shown` is None while its threshold is computed.
    key : PreviewKey or None
        Settings that decide the position of the shown surface.
    """

    scene: int = 0
    maker: Preview | None = None
    shown: PreviewSurface | None = None
    requested: bool = False
    key: PreviewKey | None = None
    color: tuple[float, float, float] = BONE


state = State()


def prepare(volume: Volume) -> None:
    """Forget the shown surface and prepare for another volume."""
    limits = machine()
    state.shown, state.requested = None, False
    state.maker = Preview(volume, limits.preview_seconds, limits.budget)


def settings_of(scene: bpy.types.Scene) -> ReconstructionSettings | None:
    """Return the settings to preview, for the volume in memory; None if it is off or they contradict each other."""
    ct = volumes.loaded(scene)
    try:
        settings = scene.ctmc.all_settings()[0] if scene.ctmc.preview else None
        return settings if settings is None or ct is None else ct.for_copy(settings)
    except CtmcError:
        return None


def follow(scene: bpy.types.Scene) -> None:
    """Show a coarse surface for the present settings, within the budget of the preferences."""
    settings = settings_of(scene)
    if settings is None or state.maker is None:
        hide()
        return
    state.requested = True
    state.maker.budget = machine().preview_seconds
    show(scene, state.maker.interactive(settings))


def refine_steps(scene_uid: int, settings: ReconstructionSettings | None) -> Steps[None]:
    """Show a finer surface while idle."""
    if settings is None or state.maker is None:
        return
    surface = yield from state.maker.refine_steps(settings)
    scene = session.scene_of(scene_uid)
    if surface is not None and state.requested and scene is not None:
        show(scene, surface)


def show(scene: bpy.types.Scene, surface: PreviewResult | None) -> None:
    """Put a surface on the graphics card when Blender draws next."""
    settings = scene.ctmc
    state.scene, state.shown, state.key = scene.session_uid, None, _preview_key(scene)
    if surface is not None:
        state.shown = PreviewSurface(surface.surface, settings.alpha, machine().scale)
    recolor(scene)


def recolor(scene: bpy.types.Scene) -> None:
    """Show the preview in the color of its future surface."""
    settings = settings_of(scene)
    item = None if settings is None else scene.ctmc.structure_of(settings)
    state.color = color_of(None if settings is None else settings.label) if item is None else tuple(item.color)
    session.redraw_viewports()


def move(alpha: float) -> None:
    """Move the preview to another alpha."""
    if state.shown is not None:
        state.shown.move(alpha)
        session.redraw_viewports()


def hide() -> None:
    """Hide the preview."""
    state.requested = False
    if state.shown is not None:
        state.shown = None
        session.redraw_viewports()


def is_made(context: bpy.types.Context, *, hidden: bool = False) -> bool:
    """Return whether the viewport already shows the same surface as an object; the two would flicker.

    With `hidden` a hidden object counts too.
    """
    fingerprint = context.scene.ctmc.volume_fingerprint
    if state.key is None:
        return False
    surfaces = [(obj, read_provenance(obj)) for obj in context.view_layer.objects if obj.type == "MESH"]
    return any(
        provenance.fingerprint == fingerprint
        and key_of(provenance.settings, provenance.threshold) == state.key
        and (hidden or obj.visible_get())
        for obj, provenance in surfaces
        if provenance is not None
    )


def _preview_key(scene: bpy.types.Scene) -> PreviewKey | None:
    """Return the key of the preview's position in a scene; None without one."""
    ct, settings = volumes.loaded(scene), settings_of(scene)
    try:
        return None if ct is None or settings is None else key_of(settings, quick_threshold(ct.volume, settings))
    except CtmcError:
        return None


@lru_cache(maxsize=256)
def key_of(settings: ReconstructionSettings, threshold: float | None) -> PreviewKey:
    """Return the settings that decide the position of a surface: label or threshold, upper limit, smoothing.

    All other settings remove parts or move it by less than a voxel.
    """
    value = None if threshold is None or settings.label is not None else float(f"{threshold:.6g}")
    return settings.label, value, settings.upper, settings.smoothing_method, settings.smoothing_width_mm


def draw() -> None:
    """Draw the preview in a viewport of its scene."""
    context = bpy.context
    if state.shown is None or context.scene.session_uid != state.scene or volumes.current(context.scene) is None:
        return
    if is_made(context) or tool_of(context):  # The preview would hide the slice that is drawn on.
        return
    if state.key is not None and drawn.shows(context.scene, state.key[0]):
        return
    view = context.region_data
    state.shown.draw(view.perspective_matrix, view.view_matrix, state.color, drawn.end_of(context))
