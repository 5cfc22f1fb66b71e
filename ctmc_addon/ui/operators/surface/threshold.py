# SPDX-License-Identifier: GPL-3.0-or-later
"""Choose the threshold: Otsu at a click, tissues, and the histogram in the panel."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import bpy
import bpy.utils.previews
from bpy.props import EnumProperty

from ....core import CtmcError, finish
from ....core.volume import TISSUES, ValueKind, histogram_picture, used_threshold_steps
from ... import jobs
from ...needs import Needs
from ...properties.surface.threshold_choice import take_tissue
from ...state.ct import volumes
from ...translations import translate

PICTURE = (144, 120)  # Size in pixels.
NAME = "histogram"

_pictures: dict[str, Any] = {}
_shown: dict[str, Any] = {}


class CTMC_OT_auto_threshold(Needs, bpy.types.Operator):
    """Set the threshold by Otsu's method."""

    bl_idname = "ctmc.auto_threshold"
    bl_label = "Otsu"
    bl_description = (
        "Set Otsu's threshold, which best separates the values of the volume, or of the region, into two classes"
    )
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    needs = (volumes.has_volume,)

    def execute(self, context: bpy.types.Context) -> set[str]:
        scene = context.scene
        loaded = volumes.loaded(scene)
        assert loaded is not None, "poll asks for one"
        try:
            settings = replace(scene.ctmc.to_settings(), threshold=None, label=None)
            threshold = finish(used_threshold_steps(loaded.volume, loaded.for_copy(settings)))
        except CtmcError as error:
            return jobs.refuse(self, scene.session_uid, error)
        scene.ctmc.threshold = threshold
        self.report({"INFO"}, translate("Threshold {value}").format(value=f"{threshold:g}"))
        return {"FINISHED"}


class CTMC_OT_tissue(bpy.types.Operator):
    """Set the usual threshold of a tissue."""

    bl_idname = "ctmc.tissue"
    bl_label = "Tissue"
    bl_description = "Set the usual threshold of a tissue, with its upper limit if it has one [HU]"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    tissue: EnumProperty(
        name="Tissue",
        description="Tissue that the surface encloses",
        items=[(key, tissue.name, tissue.text) for key, tissue in TISSUES.items()],
        default="bone",
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        volume = volumes.current(context.scene)
        if volume is not None and volume.kind != ValueKind.HU:
            cls.poll_message_set("Thresholds of tissues are in HU, and this volume holds other values")
            return False
        return volumes.has_volume(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        take_tissue(context.scene.ctmc, self.tissue)
        return {"FINISHED"}


def histogram_icon(scene: bpy.types.Scene) -> int:
    """Return the icon number of the histogram's picture, redrawn if volume or limits have changed; 0 without one."""
    loaded = volumes.loaded(scene)
    if loaded is None or not _pictures:
        return 0
    limits = volumes.used_limits(scene)
    key = (loaded.statistics.fingerprint, limits)
    pictures = _pictures[NAME]
    picture = pictures[NAME] if NAME in pictures else pictures.new(NAME)
    if _shown.get("key") != key:
        pixels = histogram_picture(loaded.statistics, limits, *PICTURE)
        picture.image_size = PICTURE
        picture.image_pixels_float.foreach_set(pixels.ravel())
        _shown["key"] = key
    return int(picture.icon_id)


_register, _unregister = bpy.utils.register_classes_factory((CTMC_OT_auto_threshold, CTMC_OT_tissue))


def register() -> None:
    """Register the operators and a place for the picture."""
    _register()
    if not bpy.app.background:
        _pictures[NAME] = bpy.utils.previews.new()


def unregister() -> None:
    """Unregister them."""
    while _pictures:
        bpy.utils.previews.remove(_pictures.popitem()[1])
    _shown.clear()
    _unregister()
