# SPDX-License-Identifier: GPL-3.0-or-later
"""Show the histogram in one viewport, with lines that set threshold and upper limit.

Nothing of it is stored.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import bpy

from ....blender.viewport import Shown, Strip, draw_strip, placed_names, strip_in, width_of
from ....core import Volume
from ....core.volume import (
    ThresholdLimits,
    ValueKind,
    grabbed_limit,
    histogram_bars,
    moved_limit,
    round_ticks,
    rounded_to,
    shown_range,
    tissue_bands,
)
from ...state import session
from ...state.ct import volumes
from ...translations import translate

PIXELS_OF_A_TICK = 70.0


@dataclass
class Open:
    """The open histogram and its viewport.

    Parameters
    ----------
    area : int
        `as_pointer` of its viewport.
    handler : object
        The draw handler.
    range : (low, high) or None
        The axis, kept while a line is dragged.
    pointed, held : float, bool or None
        The value under the mouse; whether the line it holds or would take is the upper limit.
    """

    area: int
    handler: Any
    range: tuple[float, float] | None = None
    pointed: float | None = None
    held: bool | None = None


_open: list[Open] = []  # Holds at most one.


def current() -> Open | None:
    """Return the open histogram, if any."""
    return _open[0] if _open else None


def show(area: bpy.types.Area) -> Open:
    """Open the histogram in a viewport."""
    hide()
    handler = bpy.types.SpaceView3D.draw_handler_add(draw, (), "WINDOW", "POST_PIXEL")
    _open.append(Open(area.as_pointer(), handler))
    session.redraw_viewports()
    return _open[0]


def hide() -> None:
    """Close the histogram, in any viewport."""
    while _open:
        bpy.types.SpaceView3D.draw_handler_remove(_open.pop().handler, "WINDOW")
    session.redraw_viewports()


def limits_stored(scene: bpy.types.Scene) -> tuple[Any, ...]:
    """Return the stored limits, for `restore_limits`."""
    settings = scene.ctmc
    return settings.threshold, settings.upper, settings.use_threshold, settings.use_upper, settings.use_label


def restore_limits(scene: bpy.types.Scene, stored: tuple[Any, ...]) -> None:
    """Restore the limits from before a drag."""
    settings = scene.ctmc
    settings.threshold, settings.upper, settings.use_threshold, settings.use_upper, settings.use_label = stored


def strip_of(area: bpy.types.Area, scene: bpy.types.Scene) -> Strip | None:
    """Return the open histogram's strip in its viewport; None without a CT, or with labels."""
    ct, shown = volumes.loaded(scene), current()
    if ct is None or shown is None or ct.volume.kind == ValueKind.LABEL:
        return None
    low, high = shown.range or shown_range(ct.statistics, ct.volume.kind, *volumes.used_limits(scene))
    strip = strip_in(area, low, high, bpy.context.preferences.system.ui_scale)
    names = placed_names(strip, _bands_of(ct.volume, strip), lambda text: width_of(text, strip.scale))
    return replace(strip, names=max((name.row for name in names), default=0))


def _bands_of(volume: Volume, strip: Strip) -> list[tuple[float, float, tuple[str, ...]]]:
    """Return the tissues on the axis: lowest and highest value, and possible names."""
    bands = tissue_bands(strip.low, strip.high) if volume.kind == ValueKind.HU else []
    named = [(band, translate(band.name)) for band in bands]
    return [(band.low, band.high, (f"{name} {band.low:.6g}", name)) for band, name in named]


def grabbed(strip: Strip, scene: bpy.types.Scene, x: float) -> bool:
    """Return whether a press takes the upper limit; else it takes the threshold.

    Parameters
    ----------
    strip : Strip
    scene : bpy.types.Scene
    x : float
        Pixel in the viewport.
    """
    threshold, upper = volumes.used_limits(scene)
    value = strip.value_at(x)
    current_value = value if threshold is None else threshold
    return grabbed_limit(ThresholdLimits(current_value, upper), value, strip.high, strip.reach)


def line_at(strip: Strip, scene: bpy.types.Scene, is_upper: bool) -> float:
    """Return the pixel of a line; a limit that is not set is at the end."""
    value = volumes.used_limits(scene)[is_upper]
    return strip.axis[1] if value is None else strip.x_of(value)


def drag(strip: Strip, scene: bpy.types.Scene, is_upper: bool, x: float) -> None:
    """Move a line of the histogram to a pixel, and with it the threshold or the upper limit.

    Parameters
    ----------
    strip : Strip
    scene : bpy.types.Scene
    is_upper : bool
        Whether it is the upper limit's line.
    x : float
        Pixel in the viewport.
    """
    settings = scene.ctmc
    threshold, upper = volumes.used_limits(scene)
    value = strip.value_at(x)
    if strip.low < value < strip.high:
        value = rounded_to(value, strip.pixel)
    before = ThresholdLimits(strip.low if threshold is None else threshold, upper)
    after = moved_limit(before, is_upper, value, strip.low, strip.high)
    if is_upper and after.upper is None:
        settings.use_upper = False
    elif is_upper:
        settings.upper = after.upper
    else:
        settings.threshold = after.threshold


def shown_of(strip: Strip, scene: bpy.types.Scene) -> Shown:
    """Return the strip's content for the scene's CT."""
    ct, opened = volumes.require_loaded(scene), current()
    first, last = strip.axis
    bars = histogram_bars(ct.statistics, strip.low, strip.high, max(1, int(last - first)))
    ticks = round_ticks(strip.low, strip.high, max(2, int((last - first) / (PIXELS_OF_A_TICK * strip.scale))))
    is_hu = ct.volume.kind == ValueKind.HU
    bands = _bands_of(ct.volume, strip)
    pointed, held = (None, None) if opened is None else (opened.pointed, opened.held)
    text = None
    if pointed is not None:
        value = rounded_to(pointed, strip.pixel)
        tissue = next((f", {name}" for low, high, (_, name) in bands if low <= value < high), "")
        text = (pointed, with_unit(value, is_hu) + tissue)
    return Shown(
        (bars.heights, bars.start, bars.width),
        [(tick, f"{tick:.6g}") for tick in ticks],
        bands,
        volumes.used_limits(scene),
        None if held is None else int(held),
        _title_of(scene, is_hu),
        translate("Drag a line. Upper limit at the right end: none. Esc closes"),
        text,
    )


def with_unit(value: float, is_hu: bool) -> str:
    """Return a value with its unit, if it has one."""
    return f"{value:.6g} HU" if is_hu else f"{value:.6g}"


def _title_of(scene: bpy.types.Scene, is_hu: bool) -> str:
    threshold, upper = volumes.used_limits(scene)
    words = {"Threshold": threshold, "Upper Limit": upper}
    phrases = [f"{translate(word)} {with_unit(value, is_hu)}" for word, value in words.items() if value is not None]
    return "    ".join(phrases)


def draw() -> None:
    """Draw the histogram in its viewport."""
    context, opened = bpy.context, current()
    if opened is None or context.area is None or context.area.as_pointer() != opened.area:
        return
    if context.region != next(region for region in context.area.regions if region.type == "WINDOW"):
        return  # In quad view, this is one of the other three regions.
    strip = strip_of(context.area, context.scene)
    if strip is not None:
        draw_strip(strip, shown_of(strip, context.scene))


def register() -> None:
    """Do nothing, because the draw handler is added when the histogram is opened."""


def unregister() -> None:
    """Close the histogram."""
    hide()
