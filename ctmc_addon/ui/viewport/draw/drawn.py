# SPDX-License-Identifier: GPL-3.0-or-later
"""Show drawings in the viewport: on the slices, and as a coarse surface that follows every stroke.

While a tool that draws on slices is active, the surface ends at the slice, on the viewer's side, so that it never hides
the drawing. Nothing of this is written to the file.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
import numpy as np

from ....blender.slices import corners_of, slices_of
from ....blender.surface import require_provenance
from ....blender.viewport import WHOLE, OverlayPicture, PreviewSurface
from ....core import CtmcError, Preview, ReconstructionSettings
from ....core.segmentation import Flags, cropped, grown_window, veiled
from ....core.volume import resliced, slice_at, slice_corners, slice_normal, slice_values
from ... import jobs
from ...properties.preferences import machine
from ...state import change_events, session
from ...state.ct import volumes
from ...state.draw import drawings, masks
from ...state.draw.tools import tool_of
from ...state.results import surfaces
from ..ct.slice_hits import slices_in

DISPLAY_GAMMA = 2.2
SOON = 0.01  # Seconds from a change to the surface.
CROP_MM = 4.0  # Margin around a structure for its surface.
EDGE = 0.17  # Cosine: a slice seen at less than 10 degrees is not drawn on, so it ends no surface.
CUTTING = "ctmc.scissors"  # Scissors cut through everything, so the whole surface is shown.

_handlers: list[Any] = []
_pictures: dict[Any, tuple[Any, OverlayPicture | None]] = {}
"""The picture of each scene, structure and slice, with the state that it shows."""
_surfaces: dict[tuple[int, str], tuple[int, PreviewSurface | None]] = {}  # Revision and surface by scene and structure.


def _seen_color(item: Any) -> tuple[float, ...]:
    """Return a structure's display color, converted from its linear color."""
    return tuple(light ** (1 / DISPLAY_GAMMA) for light in item.color)


def pictures_of(scene: bpy.types.Scene, key: Any, corners_mm: Any, section: Any = None) -> Iterator[OverlayPicture]:
    """Yield a picture of each drawn structure in a slice, updated only when it has changed."""
    active, scale = drawings.active(scene), machine().scale
    for item in drawings.structures(scene):
        if not item.shown:
            continue
        drawn, place = masks.of(scene, item), (scene.session_uid, item.key, key)
        is_active = active is not None and active.key == item.key
        state = (corners_mm.tobytes(), drawn.revision, tuple(item.color), is_active, scale)
        if place not in _pictures or _pictures[place][0] != state:
            mask, corners = cropped(_mask_in(scene, drawn.mask, corners_mm, section), corners_mm)
            color = _seen_color(item)
            _pictures[place] = (
                state,
                OverlayPicture(veiled(mask, color, is_active), corners * scale) if mask.size else None,
            )
        picture = _pictures[place][1]
        if picture is not None:
            yield picture


def _mask_in(scene: bpy.types.Scene, mask: Flags, corners_mm: Any, section: Any) -> Any:
    """Return a mask in a slice of the grid, or on any plane, (rows, columns) bool."""
    labels = masks.label_volume(mask, volumes.require_loaded(scene).volume)
    if section is not None:
        return slice_values(labels, section) > 0
    width, height = (np.linalg.norm(corners_mm[end] - corners_mm[0]) for end in (1, 3))
    pixel = min(labels.spacing)
    shape = (min(1024, max(2, round(float(height) / pixel))), min(1024, max(2, round(float(width) / pixel))))
    return resliced(labels, corners_mm, shape, 0.0) >= 0.5


def draw() -> None:
    """Draw slices and surfaces in a viewport."""
    context = bpy.context
    scene, space = context.scene, context.space_data
    ct = volumes.loaded(scene)
    discard(scene)
    if ct is None or space is None or not space.overlay.show_overlays or not any(drawings.structures(scene)):
        return
    view, scale = scene.ctmc_view, machine().scale
    if view.show_slice:
        section = slice_at(ct.volume, view.plane, view.position)
        for picture in pictures_of(scene, "shown", slice_corners(ct.volume, section), section):
            picture.draw(context.region_data, above=1)
    for obj in slices_of(scene, ct.statistics.fingerprint):
        if obj.visible_get(viewport=space):
            for picture in pictures_of(scene, obj.session_uid, corners_of(obj, scale)):
                picture.draw(context.region_data, above=1)
    if scene.ctmc.preview:
        _draw_surfaces(context)


def discard(scene: bpy.types.Scene) -> None:
    """Release pictures and surfaces of removed structures, slices and scenes, or of another CT."""
    if not (_pictures or _surfaces):
        return
    ct, uid = volumes.loaded(scene), scene.session_uid
    slices = {"shown"} | {obj.session_uid for obj in slices_of(scene, "" if ct is None else ct.statistics.fingerprint)}
    structures = {item.key for item in drawings.structures(scene)}
    other_scenes = {each.session_uid for each in bpy.data.scenes} - {uid}
    for of, key, at in list(_pictures):
        if of not in other_scenes and not (of == uid and key in structures and at in slices):
            del _pictures[of, key, at]
    for of, key in list(_surfaces):
        if of not in other_scenes and not (of == uid and key in structures):
            del _surfaces[of, key]


def _draw_surfaces(context: Any) -> None:
    """Draw the coarse surfaces, up to the slice if there is one to draw on."""
    scene, region = context.scene, context.region_data
    if any(is_behind(scene, item) for item in drawings.structures(scene)):
        _wake()
    plane = end_of(context)
    for item in drawings.structures(scene):
        _, surface = _surfaces.get((scene.session_uid, item.key), (0, None))
        if surface is not None and item.shown and not is_made(scene, item):
            surface.draw(region.perspective_matrix, region.view_matrix, tuple(item.color), plane)


def is_made(scene: bpy.types.Scene, item: Any) -> bool:
    """Return whether the viewport already shows a structure's surface as drawn, which would flicker with this one."""
    line = drawings.line_of(scene, item)
    objects = [obj for obj in surfaces.of_structure(scene, line) if obj.visible_get()]
    return drawings.hash_of(scene, line) in [require_provenance(obj).drawn for obj in objects]


def shows(scene: bpy.types.Scene, label: int | None) -> bool:
    """Return whether a label was drawn, so that it is shown here and needs no other preview."""
    return label in labels_of(scene)


def labels_of(scene: bpy.types.Scene) -> set[int]:
    """Return the labels that were drawn."""
    keys = {item.key for item in drawings.structures(scene)}
    return {line.value for line in scene.ctmc.labels if line.source in keys}


def end_of(context: Any) -> tuple[float, float, float, float]:
    """Return the plane at which surfaces end in a view: that of its slice, while drawing and in Quad View."""
    draws = tool_of(context) not in ("", CUTTING)
    return _plane_of(context) if draws or context.region_data.use_clip_planes else WHOLE


def _plane_of(context: Any) -> tuple[float, float, float, float]:
    """Return the plane of the slice that faces the viewer most, positive on the viewer's side; Blender units."""
    region = context.region_data
    eye = np.array(region.view_matrix.inverted())
    best, most = WHOLE, EDGE
    for corners_mm in slices_in(context.scene, context.space_data):
        corners = corners_mm * machine().scale
        normal = slice_normal(corners)
        facing = abs(float(normal @ eye[:3, 2]))
        if facing > most:
            side = normal @ (eye[:3, 3] - corners[0]) if region.is_perspective else normal @ eye[:3, 2]
            normal *= 1.0 if side >= 0 else -1.0
            a, b, c = normal.tolist()
            best, most = (a, b, c, -float(normal @ corners[0])), facing
    return best


def follow(_properties: Any, name: str) -> None:
    """Redraw after a change; drawing finds outdated surfaces."""
    if name == change_events.DRAWN:
        session.redraw_viewports()


def is_behind(scene: bpy.types.Scene, item: Any) -> bool:
    """Return whether a structure has changed since its surface was made."""
    shown_revision = _surfaces.get((scene.session_uid, item.key), (-1, None))[0]
    return shown_revision != masks.of(scene, item).revision


def _wake() -> None:
    """Start a timer that makes surfaces once the event is over, and no stroke is being drawn."""
    if not bpy.app.timers.is_registered(tick):
        bpy.app.timers.register(tick, first_interval=SOON)


def tick() -> float | None:
    """Make the surfaces of changed structures, one at a time."""
    if jobs.running() is not None or masks.stroke_under_way():
        return 10 * SOON
    for scene in bpy.data.scenes:
        if volumes.loaded(scene) is None or volumes.is_coarse(scene):
            continue
        for item in drawings.structures(scene):
            if is_behind(scene, item):
                revision = masks.of(scene, item).revision
                try:
                    surface = surface_of(scene, item)
                except (CtmcError, MemoryError):  # Show none until the next stroke.
                    surface = None
                _surfaces[scene.session_uid, item.key] = (revision, surface)
                session.redraw_viewports()
                return SOON
    return None


def surface_of(scene: bpy.types.Scene, item: Any) -> PreviewSurface | None:
    """Return a structure's surface, as fine as the time for a preview allows; None if it is empty."""
    window, volume = masks.window_in(scene, item), volumes.require_loaded(scene).volume
    if window is None:
        return None
    mask = masks.of(scene, item).mask
    z, y, x = grown_window(window, max(CROP_MM, 1.01 * max(volume.spacing)), volume.spacing, mask.shape)
    labels = masks.label_volume(mask, volume).part(((x.start, x.stop), (y.start, y.stop), (z.start, z.stop)))
    limits = machine()
    shown = Preview(labels, limits.preview_seconds, limits.budget).interactive(ReconstructionSettings(label=1))
    return None if shown is None else PreviewSurface(shown.surface, scene.ctmc.alpha, limits.scale)


def clear(*_: Any) -> None:
    """Forget everything shown, because another file is loaded."""
    _pictures.clear()
    _surfaces.clear()


_follow, _ignore = change_events.following(follow, load_pre=clear)


def register() -> None:
    """Draw in every 3D viewport of a Blender with a window."""
    _follow()
    if not bpy.app.background:
        _handlers.append(bpy.types.SpaceView3D.draw_handler_add(draw, (), "WINDOW", "POST_VIEW"))


def unregister() -> None:
    """Remove handler, timer and pictures."""
    _ignore()
    if bpy.app.timers.is_registered(tick):
        bpy.app.timers.unregister(tick)
    while _handlers:
        bpy.types.SpaceView3D.draw_handler_remove(_handlers.pop(), "WINDOW")
    clear()
